from __future__ import annotations

import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pirlc.diagnostics import PirlcError, render
from pirlc.ir.policy import Environment
from pirlc.oracle.load import load
from pirlc.oracle.manifest import Manifest, from_json, to_json, usable_for
from pirlc.oracle.network import Bounded, Greedy, Head, Network, NetworkOracle, Scaling
from pirlc.oracle.store import StoredOracle, list_stored, load_stored, save_oracle
from pirlc.simulation.environments import facts
from pirlc.simulation.policy import Ready
from pirlc.simulation.rollout import ReturnEstimate
from pirlc.simulation.workers import Workers, collect_returns

CARTPOLE = Environment("CartPole-v1")
PENDULUM = Environment("Pendulum-v1", (("g", 9.5),))


def network(inputs: int, outputs: int, seed: int = 0) -> Network:
    rng = np.random.default_rng(seed)
    widths = (inputs, 16, 8, outputs)

    def draw(*shape: int) -> Any:
        return rng.normal(size=shape).astype(np.float32)

    return Network(
        Scaling(draw(inputs), np.abs(draw(inputs)) + np.float32(0.5)),
        tuple(draw(b, a) for a, b in pairwise(widths)),
        tuple(draw(b) for b in widths[1:]),
        "relu",
    )


def manifest_of(oracle: NetworkOracle, environment: Environment) -> Manifest:
    return Manifest(
        environment=environment,
        algorithm="dqn",
        hyperparameters={"steps": 10, "learner": {"net_arch": [16, 8]}},
        seed=3,
        steps=10,
        attempts=1,
        seconds=0.5,
        versions={"numpy": np.__version__},
        score=ReturnEstimate(9.5, 9.0, 10.0, 1.0, 4),
        first_seed=510_000,
        layers=oracle.network.layers,
        activation="relu",
        head=oracle.head,
        scaled=True,
        sha256="",
    )


def stored(folder: Path, environment: Environment = CARTPOLE) -> StoredOracle:
    head: Head = Greedy((0, 1), True)
    size = 4
    if environment.id == "Pendulum-v1":
        head, size = Bounded((-2.0,), (2.0,), True), 3
    oracle = NetworkOracle(network(size, 2 if size == 4 else 1), head)
    return save_oracle(oracle, manifest_of(oracle, environment), folder)


def shown(origin: Path, environment: Environment = CARTPOLE) -> str:
    with pytest.raises(PirlcError) as caught:
        load(str(origin), environment, facts(environment))
    return render(caught.value.diagnostics[0]).replace(str(origin), "ORACLE")


@pytest.mark.parametrize("environment", [CARTPOLE, PENDULUM])
def test_round_trip(tmp_path: Path, environment: Environment) -> None:
    saved = stored(tmp_path / "deep" / "oracle", environment)
    loaded = load(str(saved.folder), environment, facts(environment))
    assert loaded.manifest == saved.manifest
    assert from_json(json.loads(json.dumps(to_json(saved.manifest)))) == saved.manifest
    size = saved.oracle.network.inputs
    observations = np.random.default_rng(1).normal(size=(50, size)) * 3
    assert np.array_equal(loaded.oracle.actions(observations), saved.oracle.actions(observations))
    row = loaded.oracle.actions(observations[:1])[0]
    assert loaded.oracle.act(observations[0]) == tuple(row)
    assert sorted(p.name for p in saved.folder.iterdir()) == [
        "manifest.json",
        "weights.safetensors",
    ]
    assert [p.name for p in saved.folder.parent.iterdir()] == ["oracle"]


def test_the_same_oracle_is_saved_as_the_same_bytes(tmp_path: Path) -> None:
    one, other = stored(tmp_path / "one"), stored(tmp_path / "other")
    for name in ("manifest.json", "weights.safetensors"):
        assert (one.folder / name).read_bytes() == (other.folder / name).read_bytes()


def test_forward_is_the_definition() -> None:
    net = network(4, 2)
    x = np.array([[0.1, -0.2, 0.3, 2.0], [np.nan, 1.0, -np.inf, 0.0]])
    clean = np.where(np.isfinite(x), x, 0.0)
    h = (clean - net.scaling.offset) / net.scaling.scale
    for weight, bias in zip(net.weights[:-1], net.biases[:-1], strict=True):
        h = np.maximum(h @ weight.T.astype(np.float64) + bias, 0.0)
    expected = h @ net.weights[-1].T + net.biases[-1]
    np.testing.assert_allclose(net.forward(x), expected, rtol=1e-5, atol=1e-5)
    oracle = NetworkOracle(net, Greedy((3, 7), True))
    assert oracle.actions(x)[:, 0].tolist() == [(3.0, 7.0)[i] for i in expected.argmax(axis=1)]
    values = oracle.values(x)
    assert values is not None
    np.testing.assert_allclose(values, expected, rtol=1e-5, atol=1e-5)
    assert NetworkOracle(net, Greedy((3, 7), False)).values(x) is None
    squashed = NetworkOracle(net, Bounded((-1.0, 0.0), (3.0, 5.0), True)).actions(x)
    wanted = np.array([-1.0, 0.0]) + (np.tanh(expected) + 1) / 2 * np.array([4.0, 5.0])
    np.testing.assert_allclose(squashed, wanted, rtol=1e-4, atol=1e-4)
    clipped = NetworkOracle(net, Bounded((-1.0, 0.0), (3.0, 5.0), False)).actions(x)
    np.testing.assert_allclose(clipped, np.clip(expected, [-1, 0], [3, 5]), rtol=1e-4, atol=1e-4)


def test_oracles_act_in_worker_processes(tmp_path: Path) -> None:
    oracle = stored(tmp_path / "oracle").oracle
    alone = collect_returns(Ready(oracle), CARTPOLE, range(8))
    shared = collect_returns(Ready(oracle), CARTPOLE, range(8), workers=Workers(2))
    assert np.array_equal(alone, shared)


def test_loading_and_acting_import_no_torch(tmp_path: Path) -> None:
    folder = stored(tmp_path / "oracle").folder
    code = (
        "import sys, numpy\n"
        "from pathlib import Path\n"
        "from pirlc.oracle.store import load_stored\n"
        f"oracle = load_stored(Path({str(folder)!r})).oracle\n"
        "oracle.act(numpy.zeros(4))\n"
        "import pirlc.oracle.train, pirlc.oracle.load\n"
        "assert 'torch' not in sys.modules and 'stable_baselines3' not in sys.modules\n"
    )
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_listing_passes_over_what_it_cannot_read(tmp_path: Path) -> None:
    stored(tmp_path / "b")
    stored(tmp_path / "a", PENDULUM)
    broken = stored(tmp_path / "c").folder
    (broken / "weights.safetensors").write_bytes(b"")
    (tmp_path / "notes.txt").write_text("x")
    assert [s.folder.name for s in list_stored(tmp_path)] == ["a", "b"]
    assert list_stored(tmp_path / "none") == ()


def test_missing_and_foreign(tmp_path: Path) -> None:
    assert shown(tmp_path / "none") == (
        "error[E0601]: cannot read the oracle `ORACLE`\n  = note: there is no such file or folder"
    )
    (tmp_path / "folder").mkdir()
    assert shown(tmp_path / "folder") == (
        "error[E0602]: `ORACLE` is not an oracle that pirlc can load\n"
        "  = note: it is a folder without manifest.json\n"
        "  = help: an oracle is a folder written by `pirlc oracle train`, or an ONNX file; with "
        "`--trust` also TorchScript, a Stable-Baselines3 .zip, or `module:function`"
    )
    for content in ("[]", "{}", '{"format": "x"}'):
        (tmp_path / "folder" / "manifest.json").write_text(content)
        (tmp_path / "folder" / "weights.safetensors").write_bytes(b"")
        assert "manifest.json does not describe an oracle" in shown(tmp_path / "folder")
    for name, content in [("a.pkl", b"\x80\x04."), ("b.pt", b""), ("c.bin", b"x" * 99)]:
        (tmp_path / name).write_bytes(content)
        assert "E0602" in shown(tmp_path / name)
    (tmp_path / "d.zip").write_bytes(b"PK\x03\x04" + b"\0" * 50)
    assert shown(tmp_path / "d.zip") == (
        "error[E0603]: the oracle `ORACLE` is damaged\n"
        "  = note: the archive is cut short\n"
        "  = help: train it again, or copy it again in full"
    )


def damage(folder: Path, **changes: Any) -> None:
    data = json.loads((folder / "manifest.json").read_text())
    for name, value in changes.items():
        if value is None:
            del data[name]
        else:
            data[name] = value
    (folder / "manifest.json").write_text(json.dumps(data))


def damaged(reason: str) -> str:
    return (
        f"error[E0603]: the oracle `ORACLE` is damaged\n  = note: {reason}\n"
        "  = help: train it again, or copy it again in full"
    )


def test_damaged(tmp_path: Path) -> None:
    folder = stored(tmp_path / "o").folder
    data = (folder / "weights.safetensors").read_bytes()
    (folder / "weights.safetensors").write_bytes(data[:-8])
    assert shown(folder) == damaged(
        "weights.safetensors is not the file that the manifest was written for"
    )
    (folder / "weights.safetensors").unlink()
    assert shown(folder).startswith("error[E0601]: cannot read the oracle `ORACLE`")
    (stored(tmp_path / "o").folder / "manifest.json").write_text('{"format": 1')
    assert "manifest.json is not JSON" in shown(folder)
    damage(stored(tmp_path / "p").folder, seed=None)
    assert shown(tmp_path / "p") == damaged("the manifest lacks `seed`")
    damage(stored(tmp_path / "q").folder, steps="many")
    assert shown(tmp_path / "q") == damaged("the manifest's `steps` is not of type int")
    manifest = to_json(stored(tmp_path / "r").manifest)
    layers: Any = manifest["network"]
    damage(tmp_path / "r", network={**layers, "layers": [4, 16, 9, 2]})
    assert shown(tmp_path / "r") == damaged(
        "weights.safetensors lacks `weight.1` of shape (9, 16) in binary32"
    )
    damage(stored(tmp_path / "s").folder, format=99)
    assert shown(tmp_path / "s") == (
        "error[E0604]: the oracle `ORACLE` has format 99; this pirlc reads up to 1\n"
        "  = help: use a newer pirlc, or train the oracle again"
    )


def test_every_truncation_of_the_weights_is_a_diagnostic(tmp_path: Path) -> None:
    folder = stored(tmp_path / "o").folder
    whole = (folder / "weights.safetensors").read_bytes()
    for cut in range(0, len(whole), 97):
        (folder / "weights.safetensors").write_bytes(whole[:cut])
        assert "E0603" in shown(folder)


def test_weights_that_are_not_finite(tmp_path: Path) -> None:
    bad = network(4, 2)
    bad.weights[1][0, 0] = np.nan
    oracle = NetworkOracle(bad, Greedy((0, 1), True))
    save_oracle(oracle, manifest_of(oracle, CARTPOLE), tmp_path / "o")
    assert "holds numbers that are not finite" in shown(tmp_path / "o")


def test_oracles_of_other_environments(tmp_path: Path) -> None:
    folder = stored(tmp_path / "o", PENDULUM).folder
    assert shown(folder, Environment("Pendulum-v1")) == (
        "error[E0605]: the oracle `ORACLE` was trained for another environment\n"
        "  = note: trained for `Pendulum-v1` with g = 9.5\n"
        "  = note: wanted for `Pendulum-v1`\n"
        "  = help: train one for this environment, or change the `environment` line"
    )
    four = NetworkOracle(network(4, 1), Bounded((-2.0,), (2.0,), True))
    save_oracle(four, manifest_of(four, PENDULUM), tmp_path / "four")
    assert shown(tmp_path / "four", PENDULUM) == (
        "error[E0606]: the oracle `ORACLE` takes 4 readings, but the observations of `Pendulum-v1` "
        "have 3"
    )
    three = NetworkOracle(network(3, 1), Bounded((-1.0,), (1.0,), True))
    save_oracle(three, manifest_of(three, PENDULUM), tmp_path / "three")
    assert shown(tmp_path / "three", PENDULUM) == (
        "error[E0607]: the oracle `ORACLE` does not give the actions of `Pendulum-v1`\n"
        "  = note: it gives numbers in [-1, 1]; needed: numbers in [-2, 2]"
    )


def test_the_length_of_episodes_makes_no_other_environment(tmp_path: Path) -> None:
    folder = str(stored(tmp_path / "o", PENDULUM).folder)
    short = Environment("Pendulum-v1", (("max_episode_steps", 50), ("g", 9.5)))
    assert load(folder, short, facts(short)).manifest is not None


def test_a_driver_for_one_track_is_a_driver_on_any() -> None:
    trained = Environment("pirlc/Torcs-v0", (("track", "aalborg"), ("reward", "progress")))
    assert usable_for(trained, Environment("pirlc/Torcs-v0", (("laps", 3),)))
    assert not usable_for(trained, Environment("Pendulum-v1", trained.arguments))


def test_folders_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    with pytest.raises(PirlcError) as caught:
        stored(tmp_path / "mine")
    assert render(caught.value.diagnostics[0]) == (
        f"error[E0615]: cannot save the oracle in `{tmp_path / 'mine'}`\n"
        "  = note: it exists and does not hold an oracle"
    )
    assert (tmp_path / "mine" / "thesis.txt").read_text() == "years of work"
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(PirlcError) as caught:
            stored(folder)
        assert caught.value.diagnostics[0].code == "E0615"


def test_saving_again_replaces(tmp_path: Path) -> None:
    stored(tmp_path / "o")
    stored(tmp_path / "o", PENDULUM)
    assert load_stored(tmp_path / "o").manifest.environment == PENDULUM
    assert [p.name for p in tmp_path.iterdir()] == ["o"]


def test_a_full_disk_leaves_the_old_oracle(tmp_path: Path) -> None:
    folder = stored(tmp_path / "o").folder
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    code = (
        "import resource, sys\n"
        "from pathlib import Path\n"
        "from pirlc.diagnostics import PirlcError\n"
        "from pirlc.oracle.store import load_stored, save_oracle\n"
        f"known = load_stored(Path({str(folder)!r}))\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "try:\n"
        "    save_oracle(known.oracle, known.manifest, known.folder)\n"
        "except PirlcError as error:\n"
        "    print(error)\n"
    )
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True)
    assert done.stdout == f"E0615: cannot save the oracle in `{folder}`\n", done.stderr
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before
    assert [p.name for p in tmp_path.iterdir()] == ["o"]


def test_every_code_has_its_page() -> None:
    import re

    import pirlc
    from pirlc.resources import explanations

    assert pirlc.__file__ is not None
    texts = [file.read_text() for file in Path(pirlc.__file__).parent.rglob("*.py")]
    for letter in ("E05", "E06"):
        used = {code for text in texts for code in re.findall(rf'"({letter}\d\d)"', text)}
        pages = {page.stem for page in explanations().glob(f"{letter}*.md")}
        assert used == pages
