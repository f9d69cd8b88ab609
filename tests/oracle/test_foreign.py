from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from pirlc.diagnostics import PirlcError, render
from pirlc.ir.policy import Environment
from pirlc.oracle.load import load
from pirlc.oracle.network import Oracle
from pirlc.simulation.environments import facts

CARTPOLE, PENDULUM = Environment("CartPole-v1"), Environment("Pendulum-v1")
WEIGHT = np.array([[0.1, 0.2, 3.0, 1.0], [0.0, -0.3, -2.0, -0.5]], np.float32)
OBSERVATIONS = np.random.default_rng(0).normal(size=(40, 4))


def model(
    path: Path, weight: Any, batch: Any = "N", extra: tuple[onnx.NodeProto, ...] = ()
) -> Path:
    size = weight.shape[1]
    graph = helper.make_graph(
        [helper.make_node("Gemm", ["x", "w"], ["y"], transB=1), *extra],
        "policy",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, [batch, size])],
        [
            helper.make_tensor_value_info(
                extra[-1].output[0] if extra else "y",
                TensorProto.INT64 if extra else TensorProto.FLOAT,
                None,
            )
        ],
        [numpy_helper.from_array(weight, "w")],
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    path.write_bytes(made.SerializeToString())
    return path


def opened(origin: object, environment: Environment = CARTPOLE, trust: bool = False) -> Oracle:
    return load(str(origin), environment, facts(environment), trust=trust).oracle


def message(origin: object, environment: Environment = CARTPOLE, trust: bool = False) -> str:
    with pytest.raises(PirlcError) as caught:
        opened(origin, environment, trust)
    return render(caught.value.diagnostics[0]).replace(str(origin), "ORACLE")


@pytest.mark.parametrize("batch", ["N", 1])
def test_onnx_scores(tmp_path: Path, batch: Any) -> None:
    oracle = opened(model(tmp_path / "m.onnx", WEIGHT, batch))
    expected = (OBSERVATIONS.astype(np.float32) @ WEIGHT.T).argmax(axis=1)
    assert oracle.actions(OBSERVATIONS)[:, 0].tolist() == expected.tolist()
    assert oracle.act(OBSERVATIONS[3]) == (float(expected[3]),)
    assert oracle.values(OBSERVATIONS) is None
    again = pickle.loads(pickle.dumps(oracle))
    assert again.actions(OBSERVATIONS)[:, 0].tolist() == expected.tolist()


def test_onnx_integers_and_continuous_actions(tmp_path: Path) -> None:
    choose = helper.make_node("ArgMax", ["y"], ["a"], axis=1, keepdims=0)
    oracle = opened(model(tmp_path / "i.onnx", WEIGHT, extra=(choose,)))
    expected = (OBSERVATIONS.astype(np.float32) @ WEIGHT.T).argmax(axis=1)
    assert oracle.actions(OBSERVATIONS)[:, 0].tolist() == expected.tolist()
    weight = np.array([[1.0, -2.0, 0.5]], np.float32)
    torque = opened(model(tmp_path / "t.onnx", weight), PENDULUM)
    x = np.array([[1.0, 0.2, 0.1], [0.0, 5.0, 0.0], [np.nan, 0.0, 1.0]])
    np.testing.assert_allclose(torque.actions(x)[:, 0], [0.65, -2.0, 0.5], rtol=1e-6)


def test_onnx_that_does_not_fit(tmp_path: Path) -> None:
    four = model(tmp_path / "m.onnx", WEIGHT)
    assert message(four, PENDULUM) == (
        "error[E0606]: the oracle `ORACLE` takes 4 readings, but the observations of `Pendulum-v1` "
        "have 3"
    )
    three = model(tmp_path / "three.onnx", np.ones((3, 4), np.float32))
    assert message(three) == (
        "error[E0607]: the oracle `ORACLE` does not give the actions of `CartPole-v1`\n"
        "  = note: it gives float32 of shape (2, 3) for 2 observations; needed: one of 0, 1"
    )
    data = four.read_bytes()
    for cut in (0, 10, len(data) // 2):
        (tmp_path / "cut.onnx").write_bytes(data[:cut])
        text = message(tmp_path / "cut.onnx")
        assert text.startswith(
            "error[E0603]: the oracle `ORACLE` is damaged\n  = note: onnxruntime"
        )


def script(path: Path) -> Path:
    import torch

    layer = torch.nn.Linear(4, 2, bias=False)
    with torch.no_grad():
        layer.weight.copy_(torch.from_numpy(WEIGHT))
    torch.jit.trace(layer, torch.zeros(1, 4)).save(str(path))  # type: ignore[no-untyped-call]
    return path


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_torchscript_needs_trust(tmp_path: Path) -> None:
    path = script(tmp_path / "m.pt")
    assert message(path) == (
        "error[E0608]: loading `ORACLE` would run the code that it contains (TorchScript is a "
        "program)\n"
        "  = help: if you trust where it comes from, add `--trust`; nothing needs trust in a "
        "folder written by `pirlc oracle train`, or an ONNX file"
    )
    oracle = pickle.loads(pickle.dumps(opened(path, trust=True)))
    expected = (OBSERVATIONS.astype(np.float32) @ WEIGHT.T).argmax(axis=1)
    assert oracle.actions(OBSERVATIONS)[:, 0].tolist() == expected.tolist()
    (tmp_path / "cut.pt").write_bytes(path.read_bytes()[:-30])
    assert "E060" in message(tmp_path / "cut.pt", trust=True)


def test_stable_baselines_files_need_trust(tmp_path: Path) -> None:
    from stable_baselines3 import DQN, PPO, TD3

    path = tmp_path / "model.zip"
    for learner, name, environment, size in [
        (DQN, "CartPole-v1", CARTPOLE, 4),
        (PPO, "CartPole-v1", CARTPOLE, 4),
        (TD3, "Pendulum-v1", PENDULUM, 3),
    ]:
        trained = learner("MlpPolicy", name, seed=1, device="cpu")
        trained.save(path)
        assert "a Stable-Baselines3 file holds pickled Python objects" in message(path, environment)
        oracle = opened(path, environment, trust=True)
        x = np.random.default_rng(2).normal(size=(30, size)).astype(np.float32)
        expected = trained.predict(x, deterministic=True)[0]
        got = oracle.actions(x.astype(np.float64))
        np.testing.assert_allclose(got, np.reshape(expected, got.shape), atol=1e-5)
    assert "E0606" in message(path, CARTPOLE, trust=True)
    (tmp_path / "cut.zip").write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert "E0603" in message(tmp_path / "cut.zip", trust=True)
    relu6 = {"activation_fn": __import__("torch").nn.ELU}
    PPO("MlpPolicy", "CartPole-v1", policy_kwargs=relu6, device="cpu").save(path)
    assert message(path, trust=True) == (
        "error[E0609]: the network of `ORACLE` is not a plain multilayer perceptron\n"
        "  = note: it contains a layer of kind ELU\n  = help: export it to ONNX"
    )


FUNCTIONS = """
def push(observation):
    return 1 if observation[2] > 0 else 0

def torque(observation):
    return [-observation[1]]

def two(observation):
    return 1, 2

def fails(observation):
    raise KeyError("gain")

gain = 3
"""


def test_functions_need_trust(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_oracles.py").write_text(FUNCTIONS)
    monkeypatch.chdir(tmp_path)
    assert "(a Python function)" in message("my_oracles:push")
    oracle = pickle.loads(pickle.dumps(opened("my_oracles:push", trust=True)))
    assert oracle.actions(OBSERVATIONS)[:, 0].tolist() == (OBSERVATIONS[:, 2] > 0).tolist()
    assert opened("my_oracles:torque", PENDULUM, True).act(np.array([0.0, 0.5, 0.0])) == (-0.5,)
    assert message("my_oracles:two", trust=True) == (
        "error[E0607]: the oracle `ORACLE` does not give the actions of `CartPole-v1`\n"
        "  = note: it gives 2 numbers; needed: one of 0, 1"
    )
    assert message("my_oracles:fails", trust=True) == (
        "error[E0610]: the oracle `ORACLE` failed\n  = note: KeyError: 'gain'"
    )
    assert message("my_oracles:gain", trust=True).startswith("error[E0602]")
    assert message("my_oracles:none", trust=True).startswith("error[E0601]")
    assert message("no_such_module:none", trust=True) == (
        "error[E0601]: cannot read the oracle `ORACLE`\n"
        "  = note: ModuleNotFoundError: No module named 'no_such_module'"
    )
