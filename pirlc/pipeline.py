"""From a sketch to files: the calls of a synthesis, readable as the table of contents.

SourceText -parse-> Sketch -search-> Program -lower, render-> files
                               |        -prove, analyse-> findings
              oracle, environment                      everything -> manifest, page
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pirlc.backend.emit import emit
from pirlc.backend.files import not_writable, write, write_text
from pirlc.backend.policies import c_controller
from pirlc.backend.toolchain import find_compiler
from pirlc.diagnostics import Diagnostic, PirlcError, Severity
from pirlc.frontend import check
from pirlc.frontend.ablations import without_if, without_sketch
from pirlc.ir.policy import Environment, Program, Sketch
from pirlc.ir.printer import program_text
from pirlc.oracle.load import LoadedOracle, load
from pirlc.oracle.shipped import find_shipped
from pirlc.oracle.train import plan as plan_training
from pirlc.oracle.train import train_or_load
from pirlc.oracle.training import Progress as TrainingProgress
from pirlc.report.dossier import STAGES, Dossier, write_dossier
from pirlc.report.front import front_data, pick, write_front
from pirlc.report.manifest import Spent, asked_of, circumstances, provenance, results_of
from pirlc.report.plots import plot_search
from pirlc.report.problems import NoSimulator, NothingSoSmall, error
from pirlc.report.request import SynthesisRequest
from pirlc.report.run import GIVEN, SKETCH, Run, open_run
from pirlc.search.candidate import Candidate, as_entry
from pirlc.search.choice import require_suitable
from pirlc.search.context import FIRST_EVALUATION_SEED, Search
from pirlc.search.enumeration import Enumeration
from pirlc.search.front import Front, find_front
from pirlc.search.journal import Budget, Journal
from pirlc.search.settings import Choice, Settings, Tell, default_settings
from pirlc.search.synthesis import Ending, Found, Plan, find_program
from pirlc.semantics.policies import InterpretedPolicy
from pirlc.simulation.environments import EnvironmentFacts, check_interface, facts
from pirlc.simulation.policy import PolicyFactory, Ready
from pirlc.simulation.rollout import ReturnEstimate, estimate
from pirlc.source import SourceText
from pirlc.verify.emitted.gate import compared

_EPISODES, _COSTLY_EPISODES = 1000, 50
"""Of the evaluation at the end; the second where simulators run compiled programs by themselves,
for the oracle and the reference interpreter race there at a fraction of that speed."""


@dataclass(frozen=True)
class SynthesisResult:
    """A program with the evidence for it.

    `returns` are over the same unseen episodes: of the `program`, of the `emitted C`, of the
    `oracle`, and of Algorithm 1's own result `without refinement`; empty if interrupted, as there
    is no `dossier` then. `front` is what `report.front` says of the programs to choose from; None
    if the search was interrupted before there was one.
    """

    program: Program
    program_file: Path
    files: tuple[Path, ...]
    returns: Mapping[str, ReturnEstimate]
    dossier: Dossier | None
    front: Mapping[str, Any] | None
    ending: Ending
    search_seconds: float
    warnings: tuple[Diagnostic, ...]
    oracle: LoadedOracle | None
    choice: Choice | None


@dataclass(frozen=True)
class NoResult:
    """A search that ended before it had any program: by `TIMEOUT`, or `INTERRUPTED`."""

    ending: Ending
    search_seconds: float
    oracle: LoadedOracle | None
    choice: Choice | None


def synthesize(
    request: SynthesisRequest,
    tell: Tell,
    tell_training: Callable[[TrainingProgress], None],
    tell_warnings: Callable[[tuple[Diagnostic, ...]], None] = lambda _: None,
    tell_oracle: Callable[[LoadedOracle], None] = lambda _: None,
    tell_choice: Callable[[Choice], None] = lambda _: None,
) -> SynthesisResult | NoResult:
    """The whole of `pirlc synth`. Raises PirlcError for whatever is wrong with the input.

    Warnings and the oracle are told as soon as they are known, before the search, and the choice of
    the optimiser when it is made.
    """
    sketch, warnings = check(request.source)
    environment, known = _environment(sketch, request)
    sketch = sketch.in_environment(environment)
    misfits = check_interface(sketch.interface, known, request.source)
    if any(found.severity is Severity.ERROR for found in misfits):
        raise PirlcError(misfits)
    source, sketch, remarks = _searched(request, sketch)
    warnings = (*warnings, *misfits, *remarks)
    settings = _settings(sketch, request, known)
    episodes = request.episodes or (_COSTLY_EPISODES if known.native else _EPISODES)
    if not any(map(Enumeration(sketch).count, range(1, settings.largest + 1))):
        raise error(NothingSoSmall(settings.largest))
    if request.oracle is not None:
        require_suitable(sketch, settings)
    find_compiler()  # A missing one is told before the search, not after it.
    tell_warnings(warnings)
    run = open_run(request.folder, asked_of(request, settings, episodes))
    write_text(run.folder / SKETCH, source.text)
    if source is not request.source:
        write_text(run.folder / GIVEN, request.source.text)
    oracle = _oracle(request, environment, known, settings.seed, tell_training)
    if oracle is not None:
        tell_oracle(oracle)
    with (
        _journal(request, run) as journal,
        _recorder(run.candidates) as record,
        TemporaryDirectory(prefix="pirlc-") as libraries,
    ):
        search = Search(
            sketch,
            environment,
            settings,
            journal,
            request.workers,
            tell,
            record,
            request.trust,
            Path(libraries) if known.native else None,
            known.deterministic,
            tell_choice,
            lambda warning: tell_warnings((warning,)),
        )
        found = find_program(search, oracle.oracle if oracle else None, request.plan)
        spent = Spent(
            journal.used if journal.stopped_at is None else journal.stopped_at,
            journal.budget.elapsed,
        )
        if isinstance(found, Ending):
            run.write_manifest(circumstances(environment, found, spent, oracle, search.choice))
            return NoResult(found, spent.seconds, oracle, search.choice)
        head = partial(provenance, request, settings.seed, oracle)
        front, found = _front(search, found)
        table = front_data(front, request.pick, deterministic=known.deterministic)
        front_files = write_front(run.folder, table, front, head)
        found, picked = pick(found, front, request.pick)
        program = found.program.program
        text = program_text(program, head(found.program))
        program_file = write_text(run.folder / f"{sketch.interface.name}.pirl", text)
        files = _emit(program, run)
        returns, ending = _evaluate(request.plan, episodes, run, search, found, oracle)
        plot = run.folder / "search.png"
        plot_search(search.met, program.size, returns.get("program"), returns.get("oracle"), plot)
        results = partial(
            results_of,
            environment,
            found,
            spent=spent,
            oracle=oracle,
            choice=search.choice,
            picked=picked,
        )
        run.write_manifest(results(ending=ending, returns=returns))
        dossier, ending = _dossier(run, search, program, oracle, ending)
    if ending is Ending.INTERRUPTED:
        run.write_manifest(results(ending=ending, returns=returns))
    return SynthesisResult(
        program=program,
        program_file=program_file,
        files=(*files, *front_files, plot, *(dossier.files if dossier else ())),
        returns=returns,
        dossier=dossier,
        front=table,
        ending=ending,
        search_seconds=spent.seconds,
        warnings=warnings,
        oracle=oracle,
        choice=search.choice,
    )


def _environment(sketch: Sketch, request: SynthesisRequest) -> tuple[Environment, EnvironmentFacts]:
    environment = sketch.interface.environment
    if environment is None:
        raise error(NoSimulator(request.source.name))
    environment = environment.with_arguments(request.arguments)
    return environment, facts(environment, request.trust)


def _searched(
    request: SynthesisRequest, sketch: Sketch
) -> tuple[SourceText, Sketch, tuple[Diagnostic, ...]]:
    """The sketch that is searched, as text and as read, with remarks: the one that was given, but
    for the paper's ablations."""
    source, remarks = request.source, tuple[Diagnostic, ...]()
    if not request.plan.sketch:
        source = without_sketch(source, sketch)
        sketch, _ = check(source)
    if not request.plan.branches:
        source, remarks = without_if(source, sketch)
        sketch, _ = check(source)
    return source, sketch, remarks


def _settings(sketch: Sketch, request: SynthesisRequest, known: EnvironmentFacts) -> Settings:
    if request.settings is not None:
        return request.settings
    settings = default_settings(actions=len(sketch.interface.actions), native=known.native)
    return replace(
        settings,
        seed=request.seed,
        largest=settings.largest if request.largest is None else request.largest,
        pool=settings.pool if request.pool is None else request.pool,
        optimizer=request.optimizer,
        tuning=request.tuning,
    )


def _oracle(
    request: SynthesisRequest,
    environment: Environment,
    known: EnvironmentFacts,
    seed: int,
    tell: Callable[[TrainingProgress], None],
) -> LoadedOracle | None:
    wish = request.oracle
    if wish is None:
        return None
    if wish.origin is not None:
        return load(wish.origin, environment, known, trust=request.trust)
    if wish.shipped and not wish.overrides:
        found = find_shipped(
            Path(request.source.name), environment, known, algorithm=wish.algorithm, seed=wish.seed
        )
        if found is not None:
            return found
    training = plan_training(
        environment,
        known,
        algorithm=wish.algorithm,
        seed=seed if wish.seed is None else wish.seed,
        overrides=wish.overrides,
    )
    stored = train_or_load(training, request.cache / "oracles", tell, trust=request.trust)
    return LoadedOracle(stored.oracle, stored.manifest, "trained")


def _journal(request: SynthesisRequest, run: Run) -> closing[Journal]:
    return closing(Journal(run.journal, Budget(request.calls, request.seconds)))


@contextmanager
def _recorder(place: Path) -> Iterator[Callable[[str, Candidate], None]]:
    """Writes every program met as a line of the record."""
    try:
        file = place.open("w", encoding="utf-8")
    except OSError as e:
        raise not_writable(place, e) from None

    def record(stage: str, candidate: Candidate) -> None:
        try:
            file.write(json.dumps(as_entry(candidate, stage)) + "\n")
            file.flush()
        except OSError as e:
            raise not_writable(place, e) from None

    try:
        yield record
    finally:
        # Whatever could not be written was told when it was flushed.
        with suppress(OSError):
            file.close()


def _front(search: Search, found: Found) -> tuple[Front | None, Found]:
    """The programs to choose from; an interrupted search has none."""
    if found.ending is Ending.INTERRUPTED:
        return None, found
    search.journal.lift_budget()
    try:
        return find_front(search, found.program), found
    except KeyboardInterrupt:
        return None, replace(found, ending=Ending.INTERRUPTED)


def _emit(program: Program, run: Run) -> tuple[Path, ...]:
    """Raises `PirlcError` (E0915), the C not written, where that is not shown to be the program."""
    paths: list[Path] = []
    for target in ("c", "python"):
        files = emit(program, (target,))
        compared(program, files)
        paths += write(files, run.folder / target)
    return tuple(paths)


def _evaluate(
    plan: Plan,
    episodes: int,
    run: Run,
    search: Search,
    found: Found,
    oracle: LoadedOracle | None,
) -> tuple[dict[str, ReturnEstimate], Ending]:
    """Returns over episodes that the search never saw; an interrupted search gets none."""
    if found.ending is Ending.INTERRUPTED:
        return {}, found.ending
    program = found.program.program
    text = program_text(program)
    subjects: dict[str, tuple[PolicyFactory, str]] = {
        "program": (partial(InterpretedPolicy, program), text),
        "emitted C": (c_controller(program, run.folder / "c" / "build"), text),
    }
    if oracle is not None:
        subjects["oracle"] = (
            Ready(oracle.oracle),
            (f"{oracle.origin} {text}" if oracle.manifest is None else oracle.manifest.sha256),
        )
    imitated = found.imitated
    if imitated is not None and plan.refine:
        subjects["without refinement"] = (
            search.policy(imitated.expansion.template, dict(imitated.values)),
            program_text(imitated.program),
        )
    count = search.episodes(episodes)
    seeds = range(FIRST_EVALUATION_SEED, FIRST_EVALUATION_SEED + count)
    returns: dict[str, ReturnEstimate] = {}
    search.journal.lift_budget()
    try:
        for number, (name, (subject, what)) in enumerate(subjects.items()):
            search.progress(f"evaluate ({name})", number, len(subjects))
            rewards = search.evaluate(name, subject, what, seeds)
            returns[name] = estimate(rewards, deterministic=search.deterministic)
    except KeyboardInterrupt:
        return returns, Ending.INTERRUPTED
    return returns, found.ending


def _dossier(
    run: Run, search: Search, program: Program, oracle: LoadedOracle | None, ending: Ending
) -> tuple[Dossier | None, Ending]:
    """Proofs, analysis, an unseen episode and the page; nothing if the user wants to leave."""
    if ending is Ending.INTERRUPTED:
        return None, ending

    def tell(stage: str) -> None:
        search.progress(stage, STAGES.index(stage), len(STAGES))

    try:
        dossier = write_dossier(
            run.folder,
            program,
            search.environment,
            oracle.oracle if oracle else None,
            FIRST_EVALUATION_SEED,
            tell,
            trust=search.trust,
        )
    except KeyboardInterrupt:
        return None, Ending.INTERRUPTED
    return dossier, ending
