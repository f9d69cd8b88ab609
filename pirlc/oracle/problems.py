"""The mistakes about oracles and the failures of their training (codes E06xx)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

from pirlc.diagnostics import Diagnostic, PirlcError


@dataclass(frozen=True)
class UnreadableOracle:
    path: str
    reason: str


@dataclass(frozen=True)
class ForeignFile:
    path: str
    reason: str


@dataclass(frozen=True)
class DamagedOracle:
    path: str
    reason: str


@dataclass(frozen=True)
class NewerFormat:
    path: str
    format: int
    known: int


@dataclass(frozen=True)
class OtherEnvironment:
    path: str
    trained: str
    wanted: str


@dataclass(frozen=True)
class OtherObservations:
    path: str
    size: int
    environment: str
    expected: int


@dataclass(frozen=True)
class OtherActions:
    path: str
    found: str
    environment: str
    expected: str


@dataclass(frozen=True)
class UntrustedOracle:
    path: str
    kind: str


@dataclass(frozen=True)
class UnsupportedNetwork:
    path: str
    reason: str


@dataclass(frozen=True)
class OracleRaised:
    path: str
    error: str


@dataclass(frozen=True)
class UnknownAlgorithm:
    name: str
    similar: str | None
    known: tuple[str, ...]


@dataclass(frozen=True)
class WrongAlgorithm:
    name: str
    environment: str
    discrete: bool
    fitting: tuple[str, ...]


@dataclass(frozen=True)
class BadHyperparameter:
    algorithm: str
    name: str
    reason: str
    similar: str | None


@dataclass(frozen=True)
class TrainingFailed:
    algorithm: str
    environment: str
    error: str


@dataclass(frozen=True)
class Unwritable:
    path: str
    reason: str


Problem = (
    UnreadableOracle
    | ForeignFile
    | DamagedOracle
    | NewerFormat
    | OtherEnvironment
    | OtherObservations
    | OtherActions
    | UntrustedOracle
    | UnsupportedNetwork
    | OracleRaised
    | UnknownAlgorithm
    | WrongAlgorithm
    | BadHyperparameter
    | TrainingFailed
    | Unwritable
)

_FORMATS = "a folder written by `pirlc oracle train`, or an ONNX file"


def describe(problem: Problem) -> Diagnostic:
    """The problem in words."""
    match problem:
        case UnreadableOracle(path, reason):
            return Diagnostic("E0601", f"cannot read the oracle `{path}`", notes=(reason,))
        case ForeignFile(path, reason):
            return Diagnostic(
                "E0602",
                f"`{path}` is not an oracle that pirlc can load",
                notes=(reason,),
                help=f"an oracle is {_FORMATS}; with `--trust` also TorchScript, a "
                "Stable-Baselines3 .zip, or `module:function`",
            )
        case DamagedOracle(path, reason):
            return Diagnostic(
                "E0603",
                f"the oracle `{path}` is damaged",
                notes=(reason,),
                help="train it again, or copy it again in full",
            )
        case NewerFormat(path, found, known):
            return Diagnostic(
                "E0604",
                f"the oracle `{path}` has format {found}; this pirlc reads up to {known}",
                help="use a newer pirlc, or train the oracle again",
            )
        case OtherEnvironment(path, trained, wanted):
            return Diagnostic(
                "E0605",
                f"the oracle `{path}` was trained for another environment",
                notes=(f"trained for {trained}", f"wanted for {wanted}"),
                help="train one for this environment, or change the `environment` line",
            )
        case OtherObservations(path, size, environment, expected):
            return Diagnostic(
                "E0606",
                f"the oracle `{path}` takes {size} readings, but the observations of "
                f"`{environment}` have {expected}",
            )
        case OtherActions(path, found, environment, expected):
            return Diagnostic(
                "E0607",
                f"the oracle `{path}` does not give the actions of `{environment}`",
                notes=(f"it gives {found}; needed: {expected}",),
            )
        case UntrustedOracle(path, kind):
            return Diagnostic(
                "E0608",
                f"loading `{path}` would run the code that it contains ({kind})",
                help="if you trust where it comes from, add `--trust`; "
                f"nothing needs trust in {_FORMATS}",
            )
        case UnsupportedNetwork(path, reason):
            return Diagnostic(
                "E0609",
                f"the network of `{path}` is not a plain multilayer perceptron",
                notes=(reason,),
                help="export it to ONNX",
            )
        case OracleRaised(path, error):
            return Diagnostic("E0610", f"the oracle `{path}` failed", notes=(error,))
        case UnknownAlgorithm(name, similar, known):
            return Diagnostic(
                "E0611",
                f"no training algorithm is called `{name}`",
                notes=("there are " + ", ".join(known),),
                help=f"did you mean `{similar}`?" if similar else None,
            )
        case WrongAlgorithm(name, environment, discrete, fitting):
            kind = "discrete" if discrete else "continuous"
            return Diagnostic(
                "E0612",
                f"`{name}` cannot learn the {kind} actions of `{environment}`",
                help="use " + " or ".join(f"`{other}`" for other in fitting),
            )
        case BadHyperparameter(algorithm, name, reason, similar):
            return Diagnostic(
                "E0613",
                f"`{algorithm}` does not accept the hyperparameter `{name}`",
                notes=(reason,),
                help=f"did you mean `{similar}`?" if similar else None,
            )
        case TrainingFailed(algorithm, environment, error):
            return Diagnostic(
                "E0614",
                f"training an oracle for `{environment}` with `{algorithm}` failed",
                notes=(error,),
            )
        case Unwritable(path, reason):
            return Diagnostic(
                "E0615",
                f"cannot save the oracle in `{path}`",
                notes=(reason,),
            )
        case _:
            assert_never(problem)


def failure(problem: Problem) -> PirlcError:
    return PirlcError(describe(problem))
