"""`pirlc torcs race`: one race in TORCS itself, told in figures and plots."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, Literal

from pirlc.backend.files import write_text
from pirlc.backend.policies import c_controller
from pirlc.backend.torcs import check_fit, reads_beams
from pirlc.cli.files import read_program
from pirlc.cli.problems import NoSuchRobot, NothingToBlock, RaceBrokeOff, error
from pirlc.cli.session import Session
from pirlc.diagnostics import suggestion
from pirlc.ir.policy import Environment, Program
from pirlc.simulation.environments import make
from pirlc.simulation.torcs.environment import Torcs
from pirlc.simulation.torcs.protocol import Status
from pirlc.simulation.torcs.readings import ACTIONS, READINGS
from pirlc.simulation.torcs.simulator import (
    ROBOTS,
    Course,
    Robot,
    TorcsDied,
    TorcsHangs,
    TorcsProcess,
)
from pirlc.simulation.torcs.summary import RaceSummary, outcome, summary

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pirlc.simulation.torcs.protocol import Trace

ENVIRONMENT = "pirlc/Torcs-v0"

REWARD = "ndps"
"""What races are told in, whatever a program was trained for: comparable with the paper's."""

ROBOT = "robot:"
"""What a driver begins with that comes with TORCS."""

Scalar = str | int | float | bool


@dataclass(frozen=True)
class RaceRequest:
    """What the command line asks for.

    `driver`: a program's file, or ``robot:NAME``. `arguments`: those of the environment that are
    given; the others are what the program's own environment says. `blocked`: sensors or readings,
    separated by commas. `folder` None: one named for driver and track.
    """

    driver: str
    arguments: Mapping[str, Scalar]
    blocked: str
    seed: int
    real: Literal["double", "float"]
    folder: Path | None
    plots: bool


@dataclass(frozen=True)
class _Driver:
    """A program, or a robot."""

    name: str
    arguments: Mapping[str, Scalar]
    program: Program | None
    robot: Robot | None


def race(session: Session, request: RaceRequest) -> None:
    """Race, and tell how it went."""
    driver = _driver(session, request)
    arguments = {**driver.arguments, **request.arguments, "reward": REWARD}
    if request.blocked:
        arguments["blocked"] = ",".join(_blocked(request.blocked, driver.program))
    made = make(Environment(ENVIRONMENT, tuple(arguments.items())))
    with closing(made):
        environment = made.unwrapped
        assert isinstance(environment, Torcs)
        try:
            trace, seconds = _raced(environment, driver, request)
            track = _track(environment) if request.plots else None
        except (TorcsDied, TorcsHangs) as problem:
            raise error(RaceBrokeOff(environment.course.track, str(problem))) from problem
        course = environment.course
    if trace.status is Status.NO_CONTROLLER:
        raise error(RaceBrokeOff(course.track, "TORCS could not load the compiled controller"))
    figures = summary(trace)
    data = _as_data(driver, course, request, figures, seconds)
    files: list[Path] = []
    if request.plots or request.folder is not None:
        folder = request.folder or Path(f"race-{driver.name}-{course.track}")
        files.append(write_text(folder / "race.json", json.dumps(_finite(data), indent=2) + "\n"))
        title = f"{driver.name} on {course.track}, {course.car}: {outcome(figures)}"
        if track is not None:
            files += _plots(trace, track, title, folder)
    session.say(_in_words(driver, course, figures, seconds))
    for path in files:
        session.say(f"wrote {path}")
    session.finish({**data, "files": [str(path) for path in files]})


def _driver(session: Session, request: RaceRequest) -> _Driver:
    if request.driver.startswith(ROBOT):
        name = request.driver.removeprefix(ROBOT)
        if name not in ROBOTS:
            raise error(NoSuchRobot(name, tuple(ROBOTS)))
        return _Driver(name, {}, None, ROBOTS[name])
    program = read_program(session, request.driver)
    own: dict[str, Scalar] = {}
    environment = program.interface.environment
    if environment is not None and environment.id == ENVIRONMENT:
        own = dict(environment.arguments)
    own["brake"] = any(
        action.component == ACTIONS.index("brake") for action in program.interface.actions
    )
    return _Driver(program.interface.name, own, program, None)


def _blocked(text: str, program: Program | None) -> Iterable[str]:
    """The readings that the names mean: names of readings in any case, or of sensors."""
    known = {name.lower(): name for name in READINGS}
    sensors = program.interface.sensors if program is not None else ()
    own = {s.name: READINGS[s.index] for s in sensors if s.index < len(READINGS)}
    for name in filter(None, map(str.strip, text.split(","))):
        found = own.get(name) or known.get(name.lower())
        if found is None:
            raise error(NothingToBlock(name, suggestion(name, [*own, *READINGS])))
        yield found


def _raced(environment: Torcs, driver: _Driver, request: RaceRequest) -> tuple[Trace, float]:
    """The race, and the seconds that it took this machine."""
    if driver.robot is not None:
        course = replace(environment.course, robot=driver.robot)
        conditions = replace(environment.conditions, seed=request.seed)
        with closing(TorcsProcess(environment.installation, course)) as process:
            start = perf_counter()
            return process.race_robot(conditions), perf_counter() - start
    assert driver.program is not None
    with tempfile.TemporaryDirectory(prefix="pirlc-") as place:
        made = c_controller(driver.program, Path(place), request.real)
        check_fit(made.controller)
        # Starts TORCS, which is no part of the race.
        environment.reset(seed=request.seed)
        start = perf_counter()
        trace = environment.race(
            str(made.library), None, request.seed, None, reads_beams(made.controller)
        )
        return trace, perf_counter() - start


def _track(environment: Torcs) -> tuple[NDArray[Any], float]:
    """The road's edges and its length in m."""
    with closing(TorcsProcess(environment.installation, environment.course)) as process:
        return process.track()


def _plots(trace: Trace, track: tuple[NDArray[Any], float], title: str, folder: Path) -> list[Path]:
    from pirlc.report.race_plots import plot_actions, plot_line

    edges, length = track
    return [
        plot_line(trace, edges, title, folder / "line.png"),
        plot_actions(trace, length, title, folder / "actions.png"),
    ]


def _in_words(driver: _Driver, course: Course, figures: RaceSummary, seconds: float) -> str:
    laps = "  ".join(f"{lap:.3f}" for lap in figures.laps)
    rows = [("outcome", f"{outcome(figures)} (damage {figures.damage:,.0f})")]
    if figures.laps:
        rows += [("laps", f"{laps} s"), ("mean lap", f"{figures.mean_lap:.3f} s")]
    rows += [
        ("distance", f"{figures.distance:,.0f} m in {figures.time:.2f} s"),
        ("reward", f"{figures.mean_reward:.3f} a step, {figures.steps:,} steps"),
        ("largest |trackPos|", f"{figures.largest_position:.3f}"),
        ("steering deviation", f"{figures.steering_deviation:.4f}"),
        ("top speed", f"{figures.top_speed:.1f} km/h"),
        ("speed of the race", f"{figures.time / seconds:,.0f} times real time"),
    ]
    width = max(len(name) for name, _ in rows)
    head = f"{driver.name} on {course.track}, {course.car}"
    return "\n".join([head, *(f"  {name:<{width}}  {text}" for name, text in rows)])


def _as_data(
    driver: _Driver, course: Course, request: RaceRequest, figures: RaceSummary, seconds: float
) -> dict[str, object]:
    return {
        "driver": driver.name if driver.robot is None else ROBOT + driver.name,
        "track": course.track,
        "car": course.car,
        "seed": request.seed,
        "outcome": outcome(figures),
        **asdict(figures),
        "status": figures.status.name.lower(),
        "laps": list(figures.laps),
        "mean_lap": figures.mean_lap,
        "times_real_time": figures.time / seconds,
    }


def _finite(data: Mapping[str, object]) -> dict[str, object]:
    """Without NaN, for which JSON has no words."""
    return {k: None if isinstance(v, float) and v != v else v for k, v in data.items()}
