"""The manifest of a run: what suffices to repeat it, and what came out."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from hashlib import sha256
from importlib.metadata import version
from typing import Any

import pirlc
from pirlc.ir.policy import Environment, Program
from pirlc.ir.printer import program_text
from pirlc.oracle.load import LoadedOracle
from pirlc.oracle.manifest import environment_as_json, to_json
from pirlc.report.omissions import left_out
from pirlc.report.request import SynthesisRequest
from pirlc.search.candidate import Candidate, as_entry
from pirlc.search.context import FIRST_EVALUATION_SEED
from pirlc.search.settings import Choice, Settings
from pirlc.search.synthesis import Ending, Found
from pirlc.simulation.rollout import ReturnEstimate

_LIBRARIES = (
    "casadi",
    "cmaes",
    "gymnasium",
    "numpy",
    "optuna",
    "scipy",
    "stable_baselines3",
    "torch",
    "z3-solver",
)


@dataclass(frozen=True)
class Spent:
    """What a search took: tunings and simulations, and seconds of this run.

    Given as the budget, `calls` stops a search at the place where time stopped this one.
    """

    calls: int
    seconds: float


def sha256_of(program: Program) -> str:
    """Of the program's text, by which what was found about it is told apart."""
    return sha256(program_text(program).encode()).hexdigest()


def asked_of(request: SynthesisRequest, settings: Settings, episodes: int) -> dict[str, Any]:
    """What a run is a run of. The same request resumes it; where results go plays no part.

    Neither do the number of processes, which no result depends on, nor the bounds on calls and
    time, so that a run which they cut short can be resumed with larger ones.
    """
    return {
        "sketch": sha256(request.source.text.encode()).hexdigest(),
        "arguments": dict(request.arguments),
        "oracle": None if request.oracle is None else asdict(request.oracle),
        "settings": asdict(settings),
        "plan": asdict(request.plan),
        "episodes": episodes,
    }


def versions() -> dict[str, str]:
    """Of everything that a result depends on."""
    return {"pirlc": pirlc.__version__, "python": platform.python_version()} | {
        name: version(name) for name in _LIBRARIES
    }


def provenance(
    request: SynthesisRequest, seed: int, oracle: LoadedOracle | None, program: Candidate
) -> tuple[str, ...]:
    """The comment at the head of a synthesised program."""
    if oracle is None:
        by = "by return alone"
    elif oracle.manifest is None:
        by = "to imitate a given oracle"
    else:
        by = f"to imitate {oracle.manifest.algorithm} (weights {oracle.manifest.sha256[:12]})"
    digest = sha256(request.source.text.encode()).hexdigest()
    options = " ".join(left_out(request.oracle, asdict(request.plan)))
    return (
        f"Synthesised by pirlc {pirlc.__version__} {by}, seed {seed}.",
        *([f"With {options}."] if options else []),
        f"{program.size} nodes. Sketch (SHA-256): {digest}",
        "The numbers may be changed here or overridden in emitted code.",
    )


def optimizer_data(choice: Choice | None) -> dict[str, Any] | None:
    """Which optimiser found the parameters, and why that one; None without an oracle."""
    if choice is None:
        return None
    return {
        "chosen": str(choice.optimizer),
        "why": choice.why,
        "mean_distances": {str(name): mean for name, mean in choice.means.items()},
        "templates": [asdict(measured) for measured in choice.measured],
        "seconds": {str(name): round(took, 2) for name, took in choice.seconds.items()},
    }


def circumstances(
    environment: Environment,
    ending: Ending,
    spent: Spent,
    oracle: LoadedOracle | None,
    choice: Choice | None,
) -> dict[str, Any]:
    """How a search went, whether it found a program or not."""
    return {
        "state": ending.value,
        "versions": versions(),
        "environment": environment_as_json(environment),
        "calls_of_search": spent.calls,
        "seconds_of_search": round(spent.seconds, 1),
        "oracle": to_json(oracle.manifest) if oracle and oracle.manifest else None,
        "oracle_from": None if oracle is None else oracle.origin,
        "optimizer": optimizer_data(choice),
    }


def results_of(
    environment: Environment,
    found: Found,
    ending: Ending,
    spent: Spent,
    oracle: LoadedOracle | None,
    choice: Choice | None,
    returns: Mapping[str, ReturnEstimate],
    picked: int | None = None,
) -> dict[str, Any]:
    """The part of the manifest that is known at the end. `picked`: the program's number on the
    front, where the user chose it."""
    text = program_text(found.program.program)
    return {
        **circumstances(environment, ending, spent, oracle, choice),
        "picked": picked,
        "program": {
            "size": found.program.size,
            "sha256": sha256_of(found.program.program),
            "text": text,
            **{k: v for k, v in as_entry(found.program, "result").items() if k != "size"},
        },
        "imitated": found.imitated
        and {
            **as_entry(found.imitated, "Algorithm 1"),
            "text": program_text(found.imitated.program),
        },
        "evaluation": {
            "first_seed": FIRST_EVALUATION_SEED,
            "returns": {name: asdict(estimate) for name, estimate in returns.items()},
        },
    }
