"""The mistakes about environments and the failures of simulators (codes E05xx)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import assert_never

from pirlc.diagnostics import Diagnostic, Label, PirlcError, Severity
from pirlc.source import NOWHERE, SourceText, Span


@dataclass(frozen=True)
class UnknownEnvironment:
    id: str
    similar: str | None


@dataclass(frozen=True)
class UntrustedEnvironment:
    id: str


@dataclass(frozen=True)
class BadArguments:
    id: str
    arguments: tuple[str, ...]
    reason: str


@dataclass(frozen=True)
class EnvironmentFailed:
    """The environment exists but cannot be made here: a missing package, a failing constructor."""

    id: str
    reason: str


@dataclass(frozen=True)
class UnsupportedObservations:
    id: str
    space: str


@dataclass(frozen=True)
class UnsupportedActions:
    id: str
    space: str


@dataclass(frozen=True)
class SensorOutside:
    sensor: str
    index: int
    id: str
    size: int


@dataclass(frozen=True)
class ComponentOutside:
    action: str
    component: int
    id: str
    count: int


@dataclass(frozen=True)
class ComponentMissing:
    component: int
    id: str
    count: int


@dataclass(frozen=True)
class ComponentTwice:
    action: str
    other: str
    component: int
    other_span: Span


@dataclass(frozen=True)
class WrongActionKind:
    action: str
    id: str
    discrete: bool
    """Whether the environment's action is discrete (and the file's continuous)."""
    space: str


@dataclass(frozen=True)
class ValueOutside:
    action: str
    value: int
    id: str
    first: int
    last: int


@dataclass(frozen=True)
class RangeWider:
    action: str
    lower: float
    upper: float
    id: str
    space_lower: float
    space_upper: float


@dataclass(frozen=True)
class SampleTimeDiffers:
    id: str
    stated: float
    simulated: float


@dataclass(frozen=True)
class NoEnvironment:
    name: str


@dataclass(frozen=True)
class SimulatorRaised:
    id: str
    doing: str
    """`reset`, `step` or `race`."""
    seed: int
    step: int
    error: str


@dataclass(frozen=True)
class BadReward:
    id: str
    seed: int
    step: int
    reward: str


@dataclass(frozen=True)
class BadObservation:
    id: str
    seed: int
    step: int
    expected: int
    got: str


@dataclass(frozen=True)
class BadAction:
    """A policy chose an action that the environment does not have."""

    id: str
    seed: int
    step: int
    action: tuple[float, ...]
    space: str


@dataclass(frozen=True)
class EndlessEpisode:
    id: str
    seed: int
    limit: int


@dataclass(frozen=True)
class ControllerNotLoaded:
    """A simulator that runs compiled policies by itself could not load one."""

    id: str


@dataclass(frozen=True)
class WorkerDied:
    reason: str


Problem = (
    UnknownEnvironment
    | UntrustedEnvironment
    | BadArguments
    | EnvironmentFailed
    | UnsupportedObservations
    | UnsupportedActions
    | SensorOutside
    | ComponentOutside
    | ComponentMissing
    | ComponentTwice
    | WrongActionKind
    | ValueOutside
    | RangeWider
    | SampleTimeDiffers
    | NoEnvironment
    | SimulatorRaised
    | BadReward
    | BadObservation
    | BadAction
    | EndlessEpisode
    | ControllerNotLoaded
    | WorkerDied
)


def _has(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _when(seed: int, step: int) -> str:
    return f"in the episode of seed {seed}, at step {step}"


def describe(problem: Problem) -> Diagnostic:
    """The problem in words, without its place in a source text (see `place`)."""
    match problem:
        case UnknownEnvironment(name, similar):
            return Diagnostic(
                "E0501",
                f"no environment is called `{name}`",
                help=f"did you mean `{similar}`?"
                if similar
                else "an environment is named by its Gymnasium id, such as `CartPole-v1`",
            )
        case UntrustedEnvironment(name):
            return Diagnostic(
                "E0502",
                f"the environment `{name}` runs code from a module of its own",
                help="if you trust where it comes from, add `--trust`",
            )
        case BadArguments(name, arguments, reason):
            listed = ", ".join(f"`{argument}`" for argument in arguments)
            return Diagnostic(
                "E0503",
                f"the environment `{name}` does not take these arguments: {listed}",
                notes=(f"the environment says: {reason}",),
            )
        case EnvironmentFailed(name, reason):
            return Diagnostic(
                "E0504",
                f"the environment `{name}` cannot be made",
                notes=(f"the environment says: {reason}",),
            )
        case UnsupportedObservations(name, space):
            return Diagnostic(
                "E0505",
                f"the observations of `{name}` are not a vector of real numbers",
                notes=(f"its observation space is {space}",),
                help="sensors need a one-dimensional `Box`; wrap the environment to flatten it",
            )
        case UnsupportedActions(name, space):
            return Diagnostic(
                "E0506",
                f"the actions of `{name}` are neither one discrete choice nor a vector of reals",
                notes=(f"its action space is {space}",),
                help="actions need a `Discrete` space or a one-dimensional `Box` of floats",
            )
        case SensorOutside(sensor, index, name, size):
            return Diagnostic(
                "E0507",
                f"sensor `{sensor}` reads component {index}, but the observations of `{name}` "
                f"have {_has(size, 'component')}",
                help=f"its indices run from 0 to {size - 1}",
            )
        case ComponentOutside(action, component, name, count):
            return Diagnostic(
                "E0508",
                f"action `{action}` drives component {component}, but the actions of `{name}` "
                f"have {_has(count, 'component')}",
                help="leave the number out, or give each action a component of its own",
            )
        case ComponentMissing(component, name, count):
            return Diagnostic(
                "E0508",
                f"no action drives component {component} of `{name}`",
                notes=(f"the actions of `{name}` have {_has(count, 'component')}",),
                help="add an action for it",
            )
        case ComponentTwice(action, other, component):
            return Diagnostic(
                "E0508",
                f"actions `{other}` and `{action}` both drive component {component}",
            )
        case WrongActionKind(action, name, discrete, space):
            wanted = "a discrete choice" if discrete else "real numbers"
            return Diagnostic(
                "E0509",
                f"action `{action}` is {'continuous' if discrete else 'discrete'}, "
                f"but the actions of `{name}` are {wanted}",
                notes=(f"its action space is {space}",),
                help="write the values in braces, as in `{0, 1}`"
                if discrete
                else "write a range in brackets, as in `[-1, 1]`",
            )
        case ValueOutside(action, value, name, first, last):
            return Diagnostic(
                "E0510",
                f"action `{action}` may take the value {value}, which `{name}` does not have",
                help=f"its values run from {first} to {last}",
            )
        case RangeWider(action, lower, upper, name, space_lower, space_upper):
            return Diagnostic(
                "E0511",
                f"the range [{lower:g}, {upper:g}] of action `{action}` is wider than that of "
                f"`{name}`, [{space_lower:g}, {space_upper:g}]",
                notes=(
                    "what the environment does with a value outside its range is its own affair",
                ),
                severity=Severity.WARNING,
            )
        case SampleTimeDiffers(name, stated, simulated):
            return Diagnostic(
                "E0512",
                f"the sample time is {stated:g} s here, but `{name}` steps by {simulated:g} s",
                help="leave `sample_time` out to take the environment's",
                severity=Severity.WARNING,
            )
        case NoEnvironment(name):
            return Diagnostic(
                "E0513",
                f"policy `{name}` names no environment to simulate it in",
                help='add a line such as `environment "CartPole-v1"`',
            )
        case SimulatorRaised(name, doing, seed, step, error):
            return Diagnostic(
                "E0514",
                f"the environment `{name}` failed {_when(seed, step)}",
                notes=(f"its `{doing}` raised {error}",),
            )
        case BadReward(name, seed, step, reward):
            return Diagnostic(
                "E0515",
                f"the environment `{name}` gave a reward that is not a finite number "
                f"{_when(seed, step)}",
                notes=(f"the reward was {reward}",),
            )
        case BadObservation(name, seed, step, expected, got):
            return Diagnostic(
                "E0516",
                f"the environment `{name}` gave an observation of the wrong shape "
                f"{_when(seed, step)}",
                notes=(f"{_has(expected, 'component')} expected, got {got}",),
            )
        case BadAction(name, seed, step, action, space):
            shown = ", ".join(f"{value:g}" for value in action)
            return Diagnostic(
                "E0517",
                f"the policy chose an action that `{name}` does not have {_when(seed, step)}",
                notes=(f"the action was ({shown}); the action space is {space}",),
            )
        case EndlessEpisode(name, seed, limit):
            return Diagnostic(
                "E0518",
                f"the episode of seed {seed} in `{name}` did not end within {limit:,} steps",
                help="give the environment a time limit, such as `{ max_episode_steps = 1000 }`",
            )
        case ControllerNotLoaded(name):
            return Diagnostic(
                "E0540",
                f"the simulator of `{name}` could not load the compiled controller",
                notes=("its library is missing, or was built for another machine",),
                help="the same compiler must serve both: see that `CC` makes programs for this "
                "machine",
            )
        case WorkerDied(reason):
            return Diagnostic(
                "E0519",
                "a worker process of the simulation died",
                notes=(reason,),
                help="out of memory, or a crash in the environment's own code; "
                "try a single worker process",
            )
        case _:
            assert_never(problem)


def place(problem: Problem, source: SourceText | None, span: Span) -> Diagnostic:
    """The problem in words, pointing at a span where there is a text to point into."""
    diagnostic = describe(problem)
    if source is None or span == NOWHERE:
        return diagnostic
    secondary: tuple[Label, ...] = ()
    if isinstance(problem, ComponentTwice) and problem.other_span != NOWHERE:
        secondary = (Label(problem.other_span, "driven here first"),)
    return replace(diagnostic, source=source, primary=Label(span), secondary=secondary)


def failure(problem: Problem) -> PirlcError:
    return PirlcError(describe(problem))
