"""--backend ray: what a user of the command line sees of a cluster, and docs/cluster.md."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path

import pytest

from tests.support.command_line import ROOT
from tests.support.processes import started
from tests.support.ray_cluster import LocalCluster, free_port, local_cluster

ROLLOUT = ("rollout", "pole.pirl", "--episodes", "40")

needs_ray = pytest.mark.skipif(
    not (Path(sys.executable).parent / "ray").exists(), reason="ray is an extra"
)


@pytest.fixture
def folder() -> Iterator[Path]:
    """With a short name, for Ray keeps sockets in it."""
    with tempfile.TemporaryDirectory(prefix="ray", ignore_cleanup_errors=True) as made:
        yield Path(made)


@needs_ray
def test_nobody_at_the_address(pirlc, monkeypatch):
    address = f"127.0.0.1:{free_port()}"
    outcome = pirlc(*ROLLOUT, "--backend", "ray", "--ray-address", address, "--json")
    assert (outcome.code, outcome.codes) == (1, ["E0546"])
    monkeypatch.setenv("RAY_ADDRESS", address)
    synth = ("synth", "sketch.pirl", "-o", "run", "--backend", "ray", "--json")
    assert pirlc(*synth).codes == ["E0546"]
    assert not Path("run").exists()
    # The variable alone is Ray's affair.
    assert pirlc(*ROLLOUT).code == 0


def test_an_address_is_for_ray(pirlc):
    outcome = pirlc(*ROLLOUT, "--ray-address", "127.0.0.1:6379")
    assert outcome.code == 2
    assert "--ray-address makes no sense without --backend ray." in outcome.err


@pytest.mark.slow
@needs_ray
def test_what_is_printed_and_what_is_left(process, here, folder):
    with local_cluster(folder) as cluster:
        here_alone = process(*ROLLOUT, "--json")
        ray = ("--backend", "ray", "--ray-address", cluster.address)
        shared = process(*ROLLOUT, *ray, "--json")
        assert (shared.code, shared.err, shared.out) == (0, "", here_alone.out)
        # Compiled C, and no more at once than asked for.
        compiled = process(*ROLLOUT, "--as", "c", *ray, "--workers", "1", "--json")
        assert (compiled.code, compiled.err) == (0, "")
        assert compiled.data["return"] == here_alone.data["return"]
        _interrupted(here, cluster, ray)


def _interrupted(here: Path, cluster: LocalCluster, ray: tuple[str, ...]) -> None:
    """Ctrl-C, as a terminal sends it: to all processes of the group."""
    long = ("rollout", "pole.pirl", "--episodes", "1000000", "--as", "interpreter")
    with started("-m", "pirlc", *long, *ray, cwd=here, start_new_session=True) as process:
        deadline = time.monotonic() + 60
        while not any("work_on" in t for n in cluster.nodes for t in n.workers().values()):
            assert time.monotonic() < deadline
            time.sleep(0.1)
        drivers = _drivers()
        assert drivers
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=60)
        assert (process.returncode, out, err.strip()) == (130, "", "interrupted")
    assert not drivers & _drivers()
    deadline = time.monotonic() + 30
    while any("work_on" in t for n in cluster.nodes for t in n.workers().values()):
        assert time.monotonic() < deadline
        time.sleep(0.1)


def _drivers() -> set[int]:
    found = set()
    for entry in Path("/proc").iterdir():
        try:
            words = (entry / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if b"pirlc.simulation.cluster" in words:
            found.add(int(entry.name))
    return found


@pytest.mark.slow
@needs_ray
def test_nodes_that_are_not_the_same(process, folder):
    other = folder / "other"
    shutil.copytree(ROOT / "pirlc", other / "pirlc", ignore=shutil.ignore_patterns("__pycache__"))
    with (other / "pirlc" / "semantics" / "__init__.py").open("a") as changed:
        changed.write("# another\n")
    broken = folder / "broken"
    (broken / "pirlc").mkdir(parents=True)
    (broken / "pirlc" / "__init__.py").write_text("raise ImportError('half installed')\n")
    with local_cluster(folder, nodes=1) as cluster:
        asked = (*ROLLOUT, "--backend", "ray", "--ray-address", cluster.address, "--json")
        assert process(*asked).code == 0
        cluster.start(path=other)
        found = process(*asked)
        assert (found.code, found.codes) == (1, ["E0547"])
        (diagnostic,) = found.data["diagnostics"]
        assert re.fullmatch(
            r"the node \S+ \(.*\) of the cluster has another pirlc", diagnostic["message"]
        )
        cluster.nodes.pop().kill()
        cluster.wait_for(1)
        cluster.start(path=broken)
        found = process(*asked)
        assert (found.code, found.codes) == (1, ["E0547"])
        (diagnostic,) = found.data["diagnostics"]
        assert diagnostic["message"].startswith("pirlc does not run on the node ")
        assert "half installed" in diagnostic["notes"][0]


TEXT = ROOT / "docs" / "cluster.md"


@pytest.mark.slow
@needs_ray
def test_what_the_documentation_shows(process, folder):
    """Its commands, with an address of this test's own, and a search that ends soon."""
    blocks = re.findall(r"```console\n(.*?)```", TEXT.read_text(encoding="utf-8"), re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    with local_cluster(folder, nodes=0) as cluster:
        started_nodes = 0
        for number, line in enumerate(lines):
            if not line.startswith("$ "):
                continue
            own = line.replace("HEAD:6379", cluster.address).replace("6379", str(cluster.port))
            words = shlex.split(own.removeprefix("$ "))
            if words[:2] == ["ray", "start"]:
                cluster.start(options=words[2:])
                started_nodes += 1
            elif words[:2] == ["pirlc", "synth"]:
                soon = ("--no-oracle", "--budget", "100", "--episodes", "10")
                assert process(*words[1:], *soon).code == 0
            else:
                assert words[:2] == ["pirlc", "rollout"]
                outcome = process(*words[1:])
                shown = [*takewhile(lambda text: text[:2] != "$ ", lines[number + 1 :])]
                assert (outcome.err, outcome.out.splitlines()) == ("", shown)
        assert started_nodes == 2
