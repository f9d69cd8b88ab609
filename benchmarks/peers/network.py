"""The oracle itself, through ONNX Runtime on one thread."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.assure.neural import model
from benchmarks.peers.tasks import Array
from pirlc.oracle.network import Bounded, NetworkOracle

ROUNDS, CALLS = 150, 100


@dataclass
class OnnxPolicy:
    """The oracle as a model of any number of observations; `data` is the file."""

    oracle: NetworkOracle

    def __post_init__(self) -> None:
        import onnx
        import onnxruntime

        made = onnx.load_from_string(model(self.oracle))
        for value in (*made.graph.input, *made.graph.output):
            value.type.tensor_type.shape.dim[0].dim_param = "N"
        self.data = made.SerializeToString()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        self.session = onnxruntime.InferenceSession(
            self.data, options, providers=["CPUExecutionProvider"]
        )

    @property
    def parameters(self) -> int:
        network = self.oracle.network
        return sum(int(a.size) for a in (*network.weights, *network.biases))

    def actions(self, observations: Array) -> Array:
        """(N, 1) for (N, d)."""
        found = self._run(observations.astype(np.float32))
        head = self.oracle.head
        chosen = found if isinstance(head, Bounded) else np.asarray(head.values)[found]
        wide: Array = chosen.astype(np.float64)
        return wide

    def _run(self, x: Any) -> Any:
        return self.session.run(None, {"observation": x})[0]

    def reset(self) -> None:
        """Nothing to forget."""

    def act(self, observation: Array) -> tuple[float, ...]:
        return tuple(self.actions(observation[np.newaxis])[0].tolist())

    def step_nanoseconds(self, observations: Array) -> float:
        """Of a call from Python with one observation, in the fastest round."""
        rows = [row[np.newaxis] for row in observations[:CALLS].astype(np.float32)]
        best = float("inf")
        for _ in range(ROUNDS):
            start = time.perf_counter()
            for row in rows:
                self._run(row)
            best = min(best, (time.perf_counter() - start) / len(rows))
        return best * 1e9
