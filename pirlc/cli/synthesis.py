"""A synthesis asked for, watched and told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from pirlc.cli.arguments import Arguments
from pirlc.cli.display import watching
from pirlc.cli.files import read_source
from pirlc.cli.measure import estimate_data, interval, number
from pirlc.cli.session import Session
from pirlc.cli.workers import Place
from pirlc.ir.printer import program_text
from pirlc.oracle.load import LoadedOracle
from pirlc.oracle.manifest import Json
from pirlc.oracle.store import default_cache
from pirlc.pipeline import NoResult, SynthesisResult, synthesize
from pirlc.report.front_table import table
from pirlc.report.manifest import optimizer_data
from pirlc.report.omissions import left_out
from pirlc.report.problems import NothingFound, describe
from pirlc.report.request import OracleRequest, SynthesisRequest
from pirlc.search.settings import Choice
from pirlc.search.synthesis import Ending, Plan
from pirlc.tune.how import Optimizer, Tuning


@dataclass(frozen=True)
class Wish:
    """The options of `pirlc synth`."""

    sketch: str
    folder: Path
    origin: str | None
    no_oracle: bool
    algorithm: str | None
    oracle_steps: int | None
    oracle_seed: int | None
    settings: Mapping[str, Json]
    seed: int
    seconds: float | None
    calls: int | None
    max_size: int | None
    pool: int | None
    optimizer: str
    trials: int | None
    effort: int | None
    tolerance: float | None
    tune_seconds: float | None
    episodes: int | None
    place: Place
    no_augment: bool
    no_sketch: bool
    no_if: bool
    no_refine: bool
    arguments: Arguments
    trust: bool
    pick: int | None


def synthesize_for(session: Session, wish: Wish) -> Ending:
    """Run the synthesis and tell its result; why it ended."""
    request = _request(wish)
    with wish.place.workers() as workers, watching() as watcher:
        result = synthesize(
            replace(request, workers=workers),
            watcher.search,
            watcher.training,
            session.tell,
            lambda oracle: session.note(oracle_in_words(oracle)),
            lambda choice: session.note(choice_in_words(choice)),
        )
    match result:
        case SynthesisResult():
            session.say(_in_words(result, wish.folder))
            found = _as_data(result)
        case NoResult():
            session.tell([describe(NothingFound(result.ending is Ending.INTERRUPTED))])
            found = dict.fromkeys(("program", "size", "front", "dossier_seconds", "verdict"))
            found |= {"returns": {}, "files": []}
    session.finish(
        {
            "ending": result.ending.value,
            "interrupted": result.ending is Ending.INTERRUPTED,
            "left_out": list(left_out(request.oracle, asdict(request.plan))),
            "search_seconds": round(result.search_seconds, 1),
            "oracle": None if result.oracle is None else result.oracle.origin,
            "optimizer": optimizer_data(result.choice),
            "folder": str(wish.folder),
            **found,
        }
    )
    return result.ending


TRAIN = "train"
"""The origin of an oracle that is to be trained, even if there is one beside the sketch."""


AUTO = "auto"
"""The optimiser that measures best."""


def oracle_in_words(oracle: LoadedOracle) -> str:
    """Which oracle the search follows."""
    if oracle.manifest is None:
        return f"oracle: {oracle.origin}"
    manifest = oracle.manifest
    return (
        f"oracle: {oracle.origin} ({manifest.algorithm}, seed {manifest.seed}, return "
        f"{number(manifest.score.mean)}, weights {manifest.sha256[:12]})"
    )


def choice_in_words(choice: Choice) -> str:
    """Which optimiser finds the parameters, and why that one."""
    words = f"optimizer: {choice.optimizer}, {choice.why}"
    if not choice.measured:
        return words
    means = ", ".join(f"{name} {mean:.4f}" for name, mean in choice.means.items())
    count = len(choice.measured)
    return f"{words} (mean distance over {count} template{'s' * (count > 1)}: {means})"


def _request(wish: Wish) -> SynthesisRequest:
    steps = {} if wish.oracle_steps is None else {"steps": wish.oracle_steps}
    train = wish.origin == TRAIN
    oracle = OracleRequest(
        origin=None if train else wish.origin,
        shipped=not train,
        algorithm=wish.algorithm,
        seed=wish.oracle_seed,
        overrides={**wish.settings, **steps},
    )
    return SynthesisRequest(
        source=read_source(wish.sketch),
        folder=wish.folder,
        cache=default_cache().parent,
        oracle=None if wish.no_oracle else oracle,
        seed=wish.seed,
        largest=wish.max_size,
        pool=wish.pool,
        optimizer=None if wish.optimizer == AUTO else Optimizer(wish.optimizer),
        tuning=_tuning(wish),
        plan=Plan(
            augment=not wish.no_augment,
            refine=not wish.no_refine,
            sketch=not wish.no_sketch,
            branches=not wish.no_if,
        ),
        calls=wish.calls,
        seconds=wish.seconds,
        episodes=wish.episodes,
        arguments=wish.arguments,
        trust=wish.trust,
        pick=wish.pick,
    )


def _tuning(wish: Wish) -> Tuning:
    return Tuning(
        trials=Tuning.trials if wish.trials is None else wish.trials,
        effort=Tuning.effort if wish.effort is None else wish.effort,
        tolerance=Tuning.tolerance if wish.tolerance is None else wish.tolerance,
        seconds=wish.tune_seconds,
    )


_ENDINGS = {
    Ending.FINISHED: "",
    Ending.BUDGET: " (the budget was used up)",
    Ending.TIMEOUT: " (timeout)",
    Ending.INTERRUPTED: " (interrupted; the same command goes on from here)",
}


def _in_words(result: SynthesisResult, folder: Path) -> str:
    program = result.program
    lines = [
        f"a program of {program.size} nodes, after {result.search_seconds:.0f} s of search"
        f"{_ENDINGS[result.ending]}",
        "",
        program_text(program).rstrip("\n"),
        "",
    ]
    if result.returns:
        found = next(iter(result.returns.values()))
        lines.append(
            "return of the one episode (the environment is deterministic)"
            if found.exact
            else f"return over {found.episodes:,} unseen episodes"
        )
        width = max(map(len, result.returns))
        means = {name: number(found.mean) for name, found in result.returns.items()}
        wide = max(map(len, means.values()))
        for name, found in result.returns.items():
            shown = means[name].rjust(wide)
            lines.append(f"  {name.ljust(width)}   {shown}   {interval(found)}")
        lines.append("")
    if result.dossier is not None:
        took = f"(proofs, analysis and page: {result.dossier.seconds:.1f} s)"
        lines += [*result.dossier.verdict, took, ""]
    lines += [*_front_in_words(result), ""]
    lines.append(f"in {folder}")
    lines += [f"  {_under(path, folder)}" for path in (result.program_file, *result.files)]
    return "\n".join(lines)


def _front_in_words(result: SynthesisResult) -> list[str]:
    front = result.front
    if front is None:
        return ["no front to pick from: an interrupted search has none"]
    marks = {front["chosen"]: "the search's own"}
    if front["picked"] is not None:
        marks[front["picked"]] = "picked"
    episodes = front["episodes"]
    over = "the one episode" if episodes == 1 else f"{episodes:,} episodes"
    lines = [f"to choose from (over {over} of the front's own; `--pick N` takes another)"]
    lines += [f"  {line}" for line in table(front["members"], marks)]
    if front["outside"] is not None:
        mean = number(front["outside"]["return"]["mean"])
        size = front["outside"]["size"]
        lines.append(f"  the search's own ({size} nodes) earns {mean} there: not more than these")
    return lines


def _under(path: Path, folder: Path) -> Path:
    return path.relative_to(folder) if path.is_relative_to(folder) else path


def _as_data(result: SynthesisResult) -> dict[str, object]:
    return {
        "program": program_text(result.program),
        "size": result.program.size,
        "returns": {name: estimate_data(found) for name, found in result.returns.items()},
        "front": result.front,
        "dossier_seconds": None if result.dossier is None else round(result.dossier.seconds, 1),
        "verdict": None if result.dossier is None else list(result.dossier.verdict),
        "files": [str(path) for path in (result.program_file, *result.files)],
    }
