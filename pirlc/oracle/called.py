"""Oracles that are called: ONNX and TorchScript models, Python functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, assert_never

import numpy as np
from numpy.typing import NDArray

from pirlc.diagnostics import PirlcError
from pirlc.oracle.network import Observations
from pirlc.oracle.problems import (
    DamagedOracle,
    ForeignFile,
    OracleRaised,
    OtherActions,
    OtherObservations,
    UnreadableOracle,
    UnsupportedNetwork,
    failure,
)
from pirlc.simulation.environments import (
    BoxActions,
    DiscreteActions,
    EnvironmentFacts,
    import_trusted,
)


def expected_actions(actions: DiscreteActions | BoxActions) -> str:
    """An environment's actions in words."""
    match actions:
        case DiscreteActions():
            return f"one of {', '.join(map(str, actions.values))}"
        case BoxActions(lower, upper):
            ranges = zip(lower, upper, strict=True)
            return "numbers in " + " x ".join(f"[{low:g}, {high:g}]" for low, high in ranges)
        case _:
            assert_never(actions)


@dataclass(frozen=True)
class _Model:
    """A called model; subclasses say how. Pickled without what cannot be, and made again."""

    origin: str
    data: bytes
    facts: EnvironmentFacts

    def __getstate__(self) -> dict[str, Any]:
        state = dict(self.__dict__)
        state.pop("call", None)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)

    @cached_property
    def call(self) -> Callable[[NDArray[np.float32]], NDArray[Any]]:
        raise AssertionError("a subclass makes the call")

    def _outputs(self, observations: Observations) -> NDArray[Any]:
        x = np.asarray(observations, dtype=np.float32)
        x = np.where(np.isfinite(x), x, np.float32(0))
        try:
            return self.call(x)
        except PirlcError:
            raise
        except Exception as error:
            words = f"{type(error).__name__}: {error}"
            raise failure(OracleRaised(self.origin, words)) from error

    def actions(self, observations: Observations) -> NDArray[np.float64]:
        outputs, n = self._outputs(observations), len(observations)
        match self.facts.actions:
            case DiscreteActions() as actions:
                if outputs.dtype.kind in "iu" and outputs.shape in ((n,), (n, 1)):
                    numbers: NDArray[np.float64] = outputs.astype(np.float64).reshape(n, 1)
                    return numbers
                if outputs.dtype.kind == "f" and outputs.shape == (n, actions.n):
                    known = np.array(actions.values, dtype=np.float64)
                    chosen: NDArray[np.float64] = known[outputs.argmax(axis=1)].reshape(n, 1)
                    return chosen
            case BoxActions(lower, upper):
                if outputs.dtype.kind == "f" and outputs.shape == (n, len(lower)):
                    wide: NDArray[np.float64] = outputs.astype(np.float64)
                    within: NDArray[np.float64] = np.minimum(np.maximum(wide, lower), upper)
                    return within
        found = f"{outputs.dtype} of shape {outputs.shape} for {n} observations"
        raise failure(
            OtherActions(self.origin, found, self.facts.id, expected_actions(self.facts.actions))
        )

    def values(self, observations: Observations) -> None:  # noqa: ARG002
        """What a foreign model's scores mean is not known."""
        return

    def reset(self) -> None:
        """Nothing to forget."""

    def act(self, observation: Observations) -> tuple[float, ...]:
        return tuple(self.actions(observation[np.newaxis])[0].tolist())


class OnnxOracle(_Model):
    @cached_property
    def call(self) -> Callable[[NDArray[np.float32]], NDArray[Any]]:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        try:
            session = onnxruntime.InferenceSession(
                self.data, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:
            reason = str(error).split("\n")[0]
            raise failure(DamagedOracle(self.origin, f"onnxruntime says: {reason}")) from error
        inputs = session.get_inputs()
        if len(inputs) != 1 or len(inputs[0].shape) != 2:
            shapes = ", ".join(str(one.shape) for one in inputs)
            reason = f"its inputs have the shapes {shapes}; one of shape (N, d) is needed"
            raise failure(UnsupportedNetwork(self.origin, reason))
        size, batch = inputs[0].shape[1], inputs[0].shape[0]
        if isinstance(size, int) and size != self.facts.observation_size:
            expected = self.facts.observation_size
            raise failure(OtherObservations(self.origin, size, self.facts.id, expected))
        name, first = inputs[0].name, session.get_outputs()[0].name
        kind = np.float64 if inputs[0].type == "tensor(double)" else np.float32

        def one_call(x: NDArray[Any]) -> NDArray[Any]:
            return np.asarray(session.run([first], {name: x})[0])

        def call(x: NDArray[np.float32]) -> NDArray[Any]:
            wide = x.astype(kind)
            if batch == 1:
                # Exported for single observations.
                return np.concatenate([one_call(row[np.newaxis]) for row in wide])
            return one_call(wide)

        return call


class TorchScriptOracle(_Model):
    @cached_property
    def call(self) -> Callable[[NDArray[np.float32]], NDArray[Any]]:
        import io
        import warnings

        import torch

        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)
                module = torch.jit.load(io.BytesIO(self.data), map_location="cpu")  # type: ignore[no-untyped-call]
        except Exception as error:
            reason = f"torch says: {str(error).splitlines()[0]}"
            raise failure(DamagedOracle(self.origin, reason)) from error

        def call(x: NDArray[np.float32]) -> NDArray[Any]:
            threads = torch.get_num_threads()
            # More are slower on networks of this size.
            torch.set_num_threads(1)
            try:
                with torch.no_grad():
                    output = module(torch.from_numpy(x))
            finally:
                torch.set_num_threads(threads)
            first = output[0] if isinstance(output, tuple | list) else output
            return np.asarray(first.detach().cpu().numpy())

        return call


@dataclass(frozen=True)
class FunctionOracle:
    """``module:function``, called with one observation at a time; pickled by its name."""

    origin: str
    facts: EnvironmentFacts

    def __reduce__(self) -> tuple[Any, ...]:
        return FunctionOracle, (self.origin, self.facts)

    @cached_property
    def call(self) -> Callable[[Observations], Any]:
        module, _, name = self.origin.partition(":")
        try:
            function = getattr(import_trusted(module), name)
        except Exception as error:
            words = f"{type(error).__name__}: {error}"
            raise failure(UnreadableOracle(self.origin, words)) from error
        if not callable(function):
            raise failure(ForeignFile(self.origin, f"`{name}` is not a function"))
        return function  # type: ignore[no-any-return]

    def actions(self, observations: Observations) -> NDArray[np.float64]:
        rows = [self.act(observation) for observation in observations]
        return np.array(rows, dtype=np.float64).reshape(len(rows), self.facts.components)

    def values(self, observations: Observations) -> None:  # noqa: ARG002
        """A function does not say."""
        return

    def reset(self) -> None:
        """Nothing to forget."""

    def act(self, observation: Observations) -> tuple[float, ...]:
        call = self.call
        try:
            answer = np.asarray(call(observation), dtype=np.float64).reshape(-1)
        except Exception as error:
            words = f"{type(error).__name__}: {error}"
            raise failure(OracleRaised(self.origin, words)) from error
        if len(answer) != self.facts.components:
            found = f"{len(answer)} numbers"
            expected = expected_actions(self.facts.actions)
            raise failure(OtherActions(self.origin, found, self.facts.id, expected))
        return tuple(answer.tolist())
