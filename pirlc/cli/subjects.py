"""What a rollout runs: a program in one of its forms, an emitted C file, an oracle."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal, assert_never

from pirlc.backend.c import c_files
from pirlc.backend.files import GeneratedFile, Provenance
from pirlc.backend.names import file_stem
from pirlc.backend.numbers import PRECISIONS, RealType
from pirlc.backend.policies import CControllerFactory, c_controller, python_controller
from pirlc.backend.toolchain import build_files, find_compiler
from pirlc.cli.arguments import Arguments
from pirlc.cli.files import program_in, read_sketch, read_source
from pirlc.cli.places import check_fit, facts_for, fitting_facts
from pirlc.cli.problems import NoSketch, OtherProgram, error
from pirlc.cli.session import Session
from pirlc.diagnostics import PirlcError
from pirlc.ir.policy import Environment, Program, Sketch
from pirlc.ir.printer import program_text
from pirlc.lower import lower
from pirlc.semantics.policies import InterpretedPolicy
from pirlc.simulation.policy import PolicyFactory, Ready
from pirlc.source import SourceText

Form = Literal["interpreter", "python", "c"]

_FORMS: dict[Form, str] = {
    "interpreter": "the reference interpreter",
    "python": "emitted Python",
    "c": "emitted C",
}


@dataclass(frozen=True)
class Subject:
    """A policy and where it acts; `watched` for one that tells the status of its steps."""

    factory: PolicyFactory
    environment: Environment
    words: str
    watched: bool


@dataclass(frozen=True)
class Request:
    """What the command line asks to be run.

    `form` is that of a program, `sketch` another file that tells the environment; compiled code
    goes to `built`, which must outlive the rollout. `arguments` are the environment's.
    """

    policy: str
    form: Form | None
    sketch: str | None
    real: RealType
    trust: bool
    built: Path
    arguments: Arguments = ()


def find_subject(session: Session, request: Request) -> Subject:
    """The policy that the command line names, ready to run."""
    suffix = Path(request.policy).suffix
    if request.policy == "-" or suffix == ".pirl":
        return _program(session, request)
    if suffix == ".c":
        return _emitted_c(session, request)
    return _oracle(session, request)


def _read(session: Session, request: Request, name: str) -> tuple[SourceText, Sketch]:
    """A file whose environment counts, or would if no other file's did."""
    acts_here = request.sketch in (None, name)
    return read_sketch(session, name, request.arguments if acts_here else ())


def _program(session: Session, request: Request) -> Subject:
    source, sketch = _read(session, request, request.policy)
    program = program_in(source, sketch)
    form: Form = request.form or "python"
    words = f"{program.interface.name} ({program.size} nodes, {_FORMS[form]}, {request.real})"
    environment = _environment(session, source, program, request)
    return Subject(_runner(program, form, request), environment, words, True)


def _environment(
    session: Session, source: SourceText, program: Program, request: Request
) -> Environment:
    """The environment to act in, which the program fits: its own, or another file's."""
    if request.sketch is None:
        fitting_facts(session, source, program.interface, request.trust)
        environment = program.interface.environment
    else:
        other_source, other = _read(session, request, request.sketch)
        found = facts_for(other_source, other.interface, request.trust)
        environment = other.interface.environment
        check_fit(session, source, replace(program.interface, environment=None), found)
    assert environment is not None
    return environment


def _runner(program: Program, form: Form, request: Request) -> PolicyFactory:
    match form:
        case "interpreter":
            return partial(InterpretedPolicy, program, PRECISIONS[request.real])
        case "python":
            return python_controller(program, request.real)
        case "c":
            return c_controller(program, request.built, request.real)
        case _:
            assert_never(form)


def _emitted_c(session: Session, request: Request) -> Subject:
    """The very file that is named, compiled.

    C runs as it likes, so without trust the file must be what pirlc emits from the program.
    """
    name = request.policy
    texts = [read_source(str(Path(name).with_suffix(suffix))).text for suffix in (".h", ".c")]
    if request.sketch is None:
        raise error(NoSketch(name, "emitted C"))
    source, sketch = _read(session, request, request.sketch)
    program = program_in(source, sketch)
    real = _real_of(texts[0])
    controller = lower(program)
    expected = c_files(controller, real, Provenance(program_text(program)))
    if [file.text for file in expected] != texts and not request.trust:
        raise error(OtherProgram(name, request.sketch))
    stem = file_stem(program.interface.name)
    files = [GeneratedFile.of(f"{stem}{s}", t) for s, t in zip((".h", ".c"), texts, strict=True)]
    try:
        library = build_files(controller, files, request.built.resolve(), find_compiler())
    except PirlcError as e:
        help_ = f"was {name} emitted from {request.sketch}?"
        raise PirlcError(
            replace(d, help=help_) if d.code == "E0805" else d for d in e.diagnostics
        ) from e
    found = fitting_facts(session, source, program.interface, request.trust)
    assert program.interface.environment is not None, found
    words = f"{program.interface.name} ({name}, {real})"
    factory = CControllerFactory(controller, library, real)
    return Subject(factory, program.interface.environment, words, True)


def _real_of(header: str) -> RealType:
    return "float" if re.search(r"^typedef float \w+_real;", header, re.MULTILINE) else "double"


def _oracle(session: Session, request: Request) -> Subject:
    from pirlc.oracle.load import load
    from pirlc.oracle.store import MANIFEST, load_stored
    from pirlc.simulation.environments import facts

    path = Path(request.policy)
    if request.sketch is not None:
        source, sketch = _read(session, request, request.sketch)
        found = facts_for(source, sketch.interface, request.trust)
        environment = sketch.interface.environment
        assert environment is not None
    elif (path / MANIFEST).is_file():
        trained = load_stored(path).manifest.environment
        environment = trained.with_arguments(request.arguments)
        found = facts(environment, request.trust)
    else:
        raise error(NoSketch(request.policy, "not a program, so it should be an oracle"))
    loaded = load(request.policy, environment, found, trust=request.trust)
    words = f"oracle {request.policy}"
    if loaded.manifest is not None:
        words += f" ({loaded.manifest.algorithm}, seed {loaded.manifest.seed})"
    return Subject(Ready(loaded.oracle), environment, words, False)
