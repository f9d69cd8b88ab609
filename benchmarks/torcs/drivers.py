"""Who races: programs, oracles, and the robots that come with TORCS."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from benchmarks.torcs import paper
from pirlc.backend.policies import c_controller
from pirlc.backend.torcs import check_fit, reads_beams
from pirlc.cli.files import program_in
from pirlc.frontend import parse_sketch
from pirlc.ir.policy import Program
from pirlc.ir.terms import size
from pirlc.oracle.network import NetworkOracle
from pirlc.oracle.store import MANIFEST, load_stored
from pirlc.simulation.torcs.readings import ACTIONS, READINGS
from pirlc.simulation.torcs.simulator import ROBOTS, Robot
from pirlc.source import SourceText

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples" / "torcs"
PRINTED = EXAMPLES / "printed"
SYNTHESISED = EXAMPLES / "synthesised"
ORACLES = EXAMPLES / "oracles"

SKETCHES = ("paper", "racer", "noif")

_SYNTHESISED = re.compile(
    rf"({'|'.join(SKETCHES)})-({'|'.join(paper.TRAINING)})(?:-([a-z]+))?-(\d+)"
)


@dataclass(frozen=True)
class CompiledProgram:
    """A program as a library that TORCS loads. `reads`: the readings that its sensors are."""

    library: str
    components: int
    beams: bool
    nodes: dict[str, int]
    reads: tuple[str, ...]


@dataclass(frozen=True)
class Network:
    """An oracle, asked in lock-step.

    `held`: a reading that is missing is the last one that was not; else the network sees 0, as it
    does without further ado.
    """

    oracle: NetworkOracle
    held: bool = False


@dataclass(frozen=True)
class Driver:
    """`digest`: of the program's file or the network's weights. `trained_on` None: on no track.
    `rival`: the row of the paper's tables that it is set beside.
    """

    name: str
    wheel: CompiledProgram | Network | Robot
    digest: str = ""
    trained_on: str | None = None
    rival: str | None = None

    @property
    def nodes(self) -> dict[str, int]:
        """Of each action's expression; empty for what is no program."""
        return self.wheel.nodes if isinstance(self.wheel, CompiledProgram) else {}

    def fits(self, track: str) -> bool:
        """Whether it is for this track: trained on it, or for any."""
        return self.trained_on in (None, track)


def read_program(path: Path) -> Program:
    source = SourceText(path.name, path.read_text(encoding="utf-8"))
    return program_in(source, parse_sketch(source))


def _digest(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()


def nodes_of(program: Program) -> dict[str, int]:
    actions = program.interface.actions
    return {action.name: size(body) for action, body in zip(actions, program.bodies, strict=True)}


def compiled(path: Path, libraries: Path) -> CompiledProgram:
    """The program in a file, its library kept under `libraries`."""
    program = read_program(path)
    made = c_controller(program, libraries)
    check_fit(made.controller)
    brakes = any(a.component == ACTIONS.index("brake") for a in program.interface.actions)
    reads = tuple(READINGS[sensor.index] for sensor in program.interface.sensors)
    beams = reads_beams(made.controller)
    return CompiledProgram(
        str(made.library), 3 if brakes else 2, beams, nodes_of(program), tuple(dict.fromkeys(reads))
    )


def printed(libraries: Path) -> Iterator[Driver]:
    """The programs that the paper prints."""
    for track in paper.TRAINING:
        path = PRINTED / f"{track}.pirl"
        if path.is_file():
            name = f"printed in the paper: {track}"
            yield Driver(name, compiled(path, libraries), _digest(path), track, paper.NDPS)


_RIVALS = {"paper": paper.NDPS, "noif": paper.NOIF, "racer": None}


def synthesised(
    folder: Path, libraries: Path, sketches: Sequence[str] = SKETCHES
) -> Iterator[Driver]:
    """The programs that `benchmarks.torcs.synthesise` leaves in a folder."""
    for sketch in sketches:
        for path in sorted(folder.glob(f"{sketch}-*.pirl")):
            found = _SYNTHESISED.fullmatch(path.stem)
            if found is not None:
                track, label, seed = found[2], found[3], found[4]
                labelled = f", {label}" if label else ""
                name = f"{sketch}.pirl, {track}{labelled}, seed {seed}"
                rival = _RIVALS[sketch]
                yield Driver(name, compiled(path, libraries), _digest(path), track, rival)


def oracles(folder: Path, held: bool = False) -> Iterator[Driver]:
    """The oracles in a folder of folders; the paper's DRL row has no brake, as its DDPG."""
    for manifest in sorted(folder.rglob(MANIFEST)):
        stored = load_stored(manifest.parent)
        trained = dict(stored.manifest.environment.arguments)
        brakes = bool(trained.get("brake", False))
        name = f"oracle {manifest.parent.name} ({stored.manifest.algorithm})"
        yield Driver(
            f"{name}, holding" if held else name,
            Network(stored.oracle, held),
            stored.manifest.sha256,
            str(trained.get("track", paper.AALBORG)),
            None if brakes else paper.DRL,
        )


def robots() -> Iterator[Driver]:
    """The robots that come with TORCS."""
    for robot in ROBOTS.values():
        yield Driver(f"robot {robot.name}", robot)
