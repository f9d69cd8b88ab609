"""Time of a step: emitted C beside the neural oracle in ONNX Runtime, in one run on this machine.

ONNX Runtime is called from Python, one observation at a time, on one thread. The controller is
timed twice: in a loop in C, as on its target, and called from Python in the same way.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.assure import tools
from benchmarks.assure.driving import HOST, build
from benchmarks.assure.streams import stream
from benchmarks.assure.subjects import EXAMPLES, Subject
from pirlc.backend.toolchain import compile_controller
from pirlc.oracle.network import Bounded, NetworkOracle
from pirlc.oracle.store import default_cache, list_stored, load_stored

ROUNDS = 7
CALLS = 2_000
C_STEPS = 100_000


@dataclass(frozen=True)
class Times:
    """Microseconds a step, the medians of the rounds; `layers` are the network's widths."""

    label: str
    layers: tuple[int, ...]
    onnx: float
    c: float
    c_from_python: float


def oracle_of(label: str, environment: str) -> NetworkOracle | None:
    """The oracle that guided the search: shipped for TORCS, else the first in the user's cache."""
    if label.startswith("torcs/"):
        sketch = "racer" if "racer" in label else "paper"
        track = "g-track-1" if "g-track-1" in label else "aalborg"
        return load_stored(EXAMPLES / "torcs" / "oracles" / f"{sketch}-{track}").oracle
    for stored in list_stored(default_cache()):
        if stored.manifest.environment.id == environment:
            return stored.oracle
    return None


def model(oracle: NetworkOracle) -> bytes:
    """The oracle as ONNX: scaling, layers, and what makes an action of the outputs."""
    from onnx import TensorProto, helper, numpy_helper

    network, head = oracle.network, oracle.head
    nodes: list[Any] = []
    constants: list[Any] = []
    last = "observation"

    def constant(name: str, value: Any) -> str:
        constants.append(numpy_helper.from_array(np.asarray(value, np.float32), name))
        return name

    def node(kind: str, *inputs: str, **attributes: Any) -> str:
        name = f"v{len(nodes)}"
        nodes.append(helper.make_node(kind, list(inputs), [name], **attributes))
        return name

    last = node("Sub", last, constant("offset", network.scaling.offset))
    last = node("Div", last, constant("scale", network.scaling.scale))
    layers = list(zip(network.weights, network.biases, strict=True))
    for i, (weight, bias) in enumerate(layers):
        last = node("Gemm", last, constant(f"w{i}", weight), constant(f"b{i}", bias), transB=1)
        if i < len(layers) - 1:
            last = node("Tanh" if network.activation == "tanh" else "Relu", last)
    kind = TensorProto.FLOAT
    if isinstance(head, Bounded):
        low, high = np.asarray(head.lower), np.asarray(head.upper)
        if head.squashed:
            least, most = map(np.asarray, head.reach or (low, high))
            last = node("Tanh", last)
            last = node("Mul", last, constant("half", (most - least) / 2))
            last = node("Add", last, constant("middle", (most + least) / 2))
        last = node("Max", last, constant("low", low))
        last = node("Min", last, constant("high", high))
    else:
        last = node("ArgMax", last, axis=1, keepdims=1)
        kind = TensorProto.INT64
    graph = helper.make_graph(
        nodes,
        "oracle",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, [1, network.inputs])],
        [helper.make_tensor_value_info(last, kind, [1, None])],
        constants,
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    data: bytes = made.SerializeToString()
    return data


def measure(subject: Subject, work: Path) -> tuple[Times | None, list[str]]:
    """None where the oracle is not to be had."""
    import onnxruntime

    environment = subject.program.interface.environment
    assert environment is not None
    oracle = oracle_of(subject.label, environment.id)
    if oracle is None:
        return None, []
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(
        model(oracle), options, providers=["CPUExecutionProvider"]
    )
    rng = np.random.default_rng(0)
    observation = rng.uniform(-1.0, 1.0, (1, oracle.network.inputs)).astype(np.float32)
    findings = _agreement(oracle, session, rng)

    controller = compile_controller(subject.controller, work / "libraries", subject.real)
    row = np.zeros(max(1, subject.controller.observation_size)).tolist()
    native = _native(subject, work / "timed")
    onnx_times, c_times, python_times = [], [], []
    for _ in range(ROUNDS):
        onnx_times.append(_timed(CALLS, lambda: session.run(None, {"observation": observation})))
        c_times.append(native())
        python_times.append(_timed(CALLS, lambda: controller.step(row)))
    times = Times(
        label=subject.label,
        layers=oracle.network.layers,
        onnx=float(np.median(onnx_times)),
        c=float(np.median(c_times)),
        c_from_python=float(np.median(python_times)),
    )
    return times, [f"{subject.name}: {finding}" for finding in findings]


def _timed(calls: int, call: Callable[[], object]) -> float:
    start = time.perf_counter()
    for _ in range(calls):
        call()
    return (time.perf_counter() - start) / calls * 1e6


def _native(subject: Subject, folder: Path) -> Callable[[], float]:
    """A program that steps the controller in a loop, as a function that runs it."""
    sizes = [f"-DSTEPS={C_STEPS}", "-DROUNDS=3"]
    program = build(subject, HOST, folder, driver_only=sizes, driver="timed.c")
    stream(subject.program, C_STEPS, subject.seed).tofile(folder / "readings")

    def median() -> float:
        lines = tools.succeed([program, "readings"], folder).split()
        return float(np.median([float(line) for line in lines])) / 1e3

    return median


def _agreement(oracle: NetworkOracle, session: Any, rng: np.random.Generator) -> list[str]:
    """The model must answer as the oracle does."""
    inputs = rng.uniform(-1.0, 1.0, (200, oracle.network.inputs)).astype(np.float32)
    ours = oracle.actions(inputs.astype(np.float64))
    theirs = np.vstack([session.run(None, {"observation": x[None]})[0] for x in inputs])
    if not isinstance(oracle.head, Bounded):
        theirs = np.asarray(oracle.head.values)[theirs]
    apart = np.abs(ours - theirs).max(axis=1) > 1e-3
    return [f"the ONNX model differs for {apart.sum()} of 200"] if apart.mean() > 0.02 else []
