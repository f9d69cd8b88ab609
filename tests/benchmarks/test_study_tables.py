"""The study's tables and pages, from small records that are given."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.study import peers_tables, tables, torcs_tables
from benchmarks.study.pages import DOCUMENT, PEERS, with_tables, write_pages
from benchmarks.study.reading import correlation, oracle_of, pairs, provable, return_of
from benchmarks.study.records import NONE, RESULTS, TIMEOUT, Record, Return, read, writing
from benchmarks.study.rows import CLASSIC, TORCS
from benchmarks.study.summing import against, front, pooled


def record(method: str, environment: str, seed: int, mean: float, half: float = 1.0) -> Record:
    return Record(
        suite=CLASSIC,
        method=method,
        environment=environment,
        seed=seed,
        command=("pirlc", "synth"),
        returns=Return(mean, mean - half, mean + half, 1000, 1_000_000),
        size=10 + seed,
        core_seconds=20.0 + seed,
        distance=0.125,
        oracle=f"oracle {environment} {seed}",
    )


MOUNTAIN_CAR = (
    record("DRL", "MountainCar-v0", 0, -100.0),
    record("NDPS-CasADi", "MountainCar-v0", 0, -99.0),
    record("NDPS-CasADi", "MountainCar-v0", 1, -101.0),
    record("NDPS-SMT", "MountainCar-v0", 0, -110.0),
    record("NDPS-BOPT", "MountainCar-v0", 0, -110.5),
    record("minimum", "MountainCar-v0", 0, -200.0, 0.0),
    replace(record("Naive", "MountainCar-v0", 0, 0.0), returns=None, ending=TIMEOUT, size=None),
    replace(record("NoIF", "MountainCar-v0", 0, 0.0), returns=None, ending=NONE, size=None),
)


def line(text: str, start: str) -> str:
    found = [each for each in text.splitlines() if each.startswith(start)]
    assert len(found) == 1
    return found[0]


def test_table_openai() -> None:
    assert tables.openai(MOUNTAIN_CAR) == (
        "|  | CartPole-v0 | paper | MountainCar-v0 | paper | Acrobot-v1 | paper | CartPole-v1 "
        "| Pendulum-v1 |\n"
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n"
        "| DRL | - | 197.53 | -100.00 | -84.73 | - | -63.17 | - | - |\n"
        "| NDPS-CasADi | - | - | -100.00 (-101.00 to -99.00) | - | - | - | - | - |\n"
        "| NDPS-SMT | - | 183.15 | -110.00 | -108.06 | - | -84.16 | - | - |\n"
        "| NDPS-BOPT | - | 143.21 | -110.50 | -143.86 | - | -127.21 | - | - |\n"
        "| minimum | - | 8.00 | -200.00 | -200.00 | - | -200.00 | - | - |\n"
    )


def test_bars_and_ordering() -> None:
    bars = tables.bars(MOUNTAIN_CAR)
    assert line(bars, "| NDPS-CasADi | MountainCar-v0") == (
        "| NDPS-CasADi | MountainCar-v0 | -108.06 | -100.00 (-101.00 to -99.00) "
        "| -99.00 ± 1.00; -101.00 ± 1.00 | yes |"
    )
    assert line(bars, "| NDPS-SMT | MountainCar-v0").endswith("| no |")
    assert line(bars, "| NDPS-BOPT | MountainCar-v0").endswith("| yes |")
    assert line(bars, "| NDPS-CasADi | Acrobot-v1").startswith(
        "| NDPS-CasADi | Acrobot-v1 | -84.16"
    )
    ordering = tables.ordering(MOUNTAIN_CAR)
    assert line(ordering, "| DRL ahead of NDPS-SMT | MountainCar-v0") == (
        "| DRL ahead of NDPS-SMT | MountainCar-v0 | -84.73 > -108.06 "
        "| -100.00 ± 1.00, -110.00 ± 1.00 | yes |"
    )
    assert line(ordering, "| NDPS-SMT ahead of NDPS-BOPT | MountainCar-v0").endswith(
        "| -110.00 ± 1.00, -110.50 ± 1.00 | no difference |"
    )
    turned = [replace(r, method={"DRL": "NDPS-SMT", "NDPS-SMT": "DRL"}.get(r.method, r.method))
              for r in MOUNTAIN_CAR]  # fmt: skip
    assert line(tables.ordering(turned), "| DRL ahead of NDPS-SMT | MountainCar-v0").endswith(
        "| no, reversed |"
    )


def test_ablations_say_what_was_not_found() -> None:
    assert tables.ablations(MOUNTAIN_CAR, refined=False).splitlines()[2:] == [
        "| NDPS (CasADi) | - | -100.00 (-101.00 to -99.00) | - | - | - |",
        "| Naive | - | timeout | - | - | - |",
        "| NoIF | - | none | - | - | - |",
    ]
    refined = [
        replace(MOUNTAIN_CAR[1], method="synth"),
        replace(MOUNTAIN_CAR[2], method="NoAug refined"),
    ]
    assert tables.ablations(refined, refined=True).splitlines()[2:] == [
        "| pirlc synth | - | -99.00 | - | - | - |",
        "| NoAug | - | -101.00 | - | - | - |",
    ]
    assert tables.timeouts(MOUNTAIN_CAR) == "- Naive, MountainCar-v0, seed 0\n"


def test_costs_and_every_run() -> None:
    assert "| NDPS-CasADi | - / - | 20 / 10 11 | - / - | - / - | - / - |\n" in tables.costs(
        MOUNTAIN_CAR
    )
    every = tables.each(MOUNTAIN_CAR).splitlines()
    assert [row.split(" | ")[1] for row in every[2:]] == [
        *("DRL", "NDPS-CasADi", "NDPS-CasADi", "NDPS-SMT", "NDPS-BOPT", "minimum", "Naive", "NoIF")
    ]
    assert every[3] == (
        "| MountainCar-v0 | NDPS-CasADi | 0 | -99.00 ± 1.00 | 10 | 0.1250 | 20 | - |"
    )
    assert every[8] == "| MountainCar-v0 | Naive | 0 | - | - | 0.1250 | 20 | timeout |"


def test_the_defaults_beside_algorithm_1_alone_and_the_oracle() -> None:
    drl = record("DRL", "Pendulum-v1", 2, -150.0)
    figures = {"without_refinement": [-149.0, -154.0, -144.0], "without_refinement_size": 53}
    synth = replace(record("synth", "Pendulum-v1", 2, -146.5), figures=figures)
    assert tables.defaults([drl, synth]).splitlines()[2] == (
        "| Pendulum-v1 | 2 | -146.50 ± 1.00 | 12 | -149.00 ± 5.00 | 53 | -150.00 ± 1.00 | 22 |"
    )


def test_does_imitation_predict_return() -> None:
    points = [[0.1, -100.0], [0.2, -110.0], [0.3, -105.0], [0.4, -120.0], [0.5, -130.0]]
    rank = correlation(points)
    assert rank == -0.9
    figures = {"pairs": points, "rank_correlation": rank}
    found = [replace(MOUNTAIN_CAR[1], figures=figures), replace(MOUNTAIN_CAR[3], figures=figures)]
    assert tables.imitation(found).splitlines()[2:] == [
        "| MountainCar-v0 | 2 | 10 | -0.90 | -0.90 to -0.90 |"
    ]
    assert correlation(points[:4]) is None
    assert correlation([[0.1, -1.0]] * 6) is None
    assert correlation([]) is None


def test_returns_of_seeds_are_pooled() -> None:
    found = pooled([Return(1.0, 0.0, 2.0, 9, 0), Return(3.0, 2.0, 4.0, 9, 0)])
    assert (found.mean, found.least, found.most, found.seeds) == (2.0, 1.0, 3.0, 2)
    assert found.half == pytest.approx(math.sqrt(2) / 2)
    assert (found.low, found.high) == (found.mean - found.half, found.mean + found.half)


def test_one_return_against_another() -> None:
    def about(mean: float) -> Return:
        return Return(mean, mean - 1, mean + 1, 9, 0)

    assert against(about(10), about(7), None) == "higher"
    assert against(about(7), about(10), None) == "lower"
    assert against(about(10), about(9), None) == "intervals overlap"
    assert against(about(500), about(499.9), 500.0) == "both at the ceiling"
    assert against(about(500), about(490), 500.0) == "higher"


def test_the_front_of_cheap_and_good() -> None:
    points = [(3.0, 5.0), (1.0, 1.0), (2.0, 0.5), (3.0, 6.0), (4.0, 6.0)]
    assert front(points) == [(1.0, 1.0), (3.0, 6.0)]


def race(lap: float, finished: bool = True) -> dict[str, object]:
    return {
        "finished": finished,
        "outcome": "finished 3 laps" if finished else "left the road after 390 m",
        "mean_lap": lap if finished else None,
        "mean_reward": 100.0,
    }


def test_table_performance() -> None:
    base = replace(record("NDPS", "aalborg", 0, 1.0), suite=TORCS)
    ndps = replace(
        base,
        figures={
            "races": {"program": race(140.0), "imitated": race(0, False)},
            "imitated_size": 50,
        },
    )
    naive = replace(
        base,
        method="Naive",
        ending=TIMEOUT,
        figures={"races": {"program": race(0, False), "imitated": race(0, False)}},
    )
    noif = replace(base, method="NoIF", figures={"races": {"program": race(150.0)}})
    none = replace(base, method="NoAug", returns=None, size=None, ending=TIMEOUT)
    drl = replace(base, method="DRL", size=None, core_seconds=None,
                  figures={"races": {"program": race(145.0)}})  # fmt: skip
    records = [ndps, naive, noif, none, drl]
    assert torcs_tables.performance(records, "aalborg").splitlines()[2:] == [
        "| DRL | - | 145.00 | 100.00 | - | - | - | - | - | 109.66 | 71.23 |",
        "| Naive | 0 | Timeout (left the road after 390 m) | - | 10 "
        "| Timeout (left the road after 390 m) | - | - | 20 | Timeout | - |",
        "| NoAug | 0 | Timeout | - | - | Timeout | - | - | 20 | Timeout | - |",
        "| NoIF | 0 | 150.00 | 100.00 | 10 | Timeout | - | - | 20 | 165.13 | 52.81 |",
        "| NDPS | 0 | 140.00 | 100.00 | 10 | Timeout (left the road after 390 m) | - | 50 | 20 "
        "| 158.87 | 54.91 |",
    ]
    assert torcs_tables.ahead(records, "aalborg", "program").splitlines()[2:] == [
        "| Naive | 140.00 against Timeout | 1 of 1 |",
        "| NoAug | 140.00 against Timeout | 1 of 1 |",
        "| NoIF | 140.00 against 150.00 | 1 of 1 |",
    ]
    assert torcs_tables.ahead(records, "aalborg", "imitated").splitlines()[2:] == [
        "| Naive | Timeout against Timeout | 0 of 1 |",
        "| NoAug | Timeout against Timeout | 0 of 1 |",
        "| NoIF | Timeout against Timeout | 0 of 1 |",
    ]
    assert torcs_tables.performance(records, "g-track-1").splitlines()[2:] == []


def peer(method: str, mean: float, size: int, provable: str | None = None) -> Record:
    made = record(method, "Acrobot-v1", 0, mean)
    return replace(made, suite=PEERS, size=size, code_bytes=1200, provable=provable,
                   step_nanoseconds=12.34)  # fmt: skip


OURS = replace(record("NDPS-CasADi", "Acrobot-v1", 0, -80.0), size=28)
TREES = (peer("viper-8", -90.0, 20), peer("dagger-tree-16", -85.0, 44),
         peer("viper-logits-64", -79.5, 90, "bounds"))  # fmt: skip


def test_a_table_of_peers() -> None:
    unshown = peer("viper-32", -70.0, 60)
    peers = [TREES[0], TREES[2], unshown, peer("symbolic-12", -99.0, 12)]
    assert peers_tables.environment_table([OURS], peers, "Acrobot-v1") == (
        "| method | return | ± of these programs | nodes | core seconds | ns a step "
        "| bytes of code | proved |\n"
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n"
        "| viper-logits-64 | -79.50 | 1.00 | 90 | 20 | 12.3 | 1,200 | bounds |\n"
        "| pirlc, no refinement | -80.00 | 1.00 | 28 | 20 | - | - | - |\n"
        "| viper-8 | -90.00 | 1.00 | 20 | 20 | 12.3 | 1,200 | - |\n"
        "| symbolic-12 | -99.00 | 1.00 | 12 | 20 | 12.3 | 1,200 | - |\n"
    )


def test_against_viper() -> None:
    larger, smaller = peers_tables.at_least, peers_tables.at_most
    told = peers_tables.against_viper([OURS], TREES, larger).splitlines()
    assert told[2:] == [
        "| Acrobot-v1 | 0 | pirlc, no refinement | -80.00 ± 1.00 | 28 | viper-logits-64 "
        "| -79.50 ± 1.00 | 90 | intervals overlap |"
    ]
    told = peers_tables.against_viper([OURS], TREES, smaller).splitlines()
    assert told[2:] == [
        "| Acrobot-v1 | 0 | pirlc, no refinement | -80.00 ± 1.00 | 28 | viper-8 "
        "| -90.00 ± 1.00 | 20 | higher |"
    ]
    assert peers_tables.verdict([OURS, replace(OURS, seed=1)], TREES).splitlines()[2:] == [
        "| Acrobot-v1 | pirlc, no refinement | intervals overlap (1 of 1) | higher (1 of 1) |"
    ]
    assert peers_tables.verdict([OURS], TREES[:1]).splitlines()[2:] == [
        "| Acrobot-v1 | pirlc, no refinement | - | higher (1 of 1) |"
    ]
    assert peers_tables.verdict([replace(OURS, seed=1)], TREES).splitlines()[2:] == []


def test_pages_of_a_folder(tmp_path: Path) -> None:
    points = [[0.1, -100.0], [0.2, -110.0], [0.3, -105.0], [0.4, -120.0], [0.5, -130.0]]
    with writing(tmp_path, CLASSIC) as results:
        for each in (*MOUNTAIN_CAR, replace(OURS, figures={"pairs": points})):
            results.write(each)
    with writing(tmp_path, PEERS) as results:
        results.write(TREES[0])
    made = write_pages(tmp_path)
    names = ["classic.md", "torcs.md", "peers.md"]
    plots = ["return-size.png", "return-time.png", "distance-return.png"]
    assert [path.name for path in made] == [*names, *plots]
    assert (tmp_path / "torcs.md").read_text("utf-8") == "There are no records yet.\n"
    assert "### Acrobot-v1\n\n| method |" in (tmp_path / "peers.md").read_text("utf-8")
    before = [path.read_bytes() for path in made]
    assert [path.read_bytes() for path in write_pages(tmp_path)] == before


def test_tables_take_their_places_in_a_document() -> None:
    document = "# A\n\nprose\n\n<!-- classic -->\nold\n<!-- end of classic -->\n\nmore prose\n"
    assert with_tables(document, {"classic": r"| \1 |" + "\n", "torcs": "not there\n"}) == (
        "# A\n\nprose\n\n<!-- classic -->\n\n| \\1 |\n\n<!-- end of classic -->\n\nmore prose\n"
    )


def test_the_document_has_the_tables_of_the_records() -> None:
    document = DOCUMENT.read_text("utf-8")
    for name in (CLASSIC, TORCS, PEERS):
        assert f"<!-- {name} -->" in document
        assert not read(RESULTS, name).left_out
    texts = {n: (RESULTS / f"{n}.md").read_text("utf-8") for n in (CLASSIC, TORCS, PEERS)}
    assert with_tables(document, texts) == document


def test_what_is_read_from_a_run(tmp_path: Path) -> None:
    entries = [
        {"stage": "tune (initialize)", "loss": 0.3, "mean_return": None},
        {"stage": "initialize", "loss": 0.2, "mean_return": -100.0},
        {"stage": "initialize", "loss": None, "mean_return": -90.0},
        {"stage": "iteration 2", "loss": 0.1, "mean_return": -95.0},
        {"stage": "refine", "loss": 0.1, "mean_return": -85.0},
    ]
    text = "".join(json.dumps(entry) + "\n" for entry in entries)
    (tmp_path / "candidates.jsonl").write_text(text, encoding="utf-8")
    assert pairs(tmp_path) == [[0.2, -100.0], [0.1, -95.0]]
    assert pairs(tmp_path / "none") == []
    proved, unknown = {"kind": "proved"}, {"kind": "unknown"}
    found = {
        "properties": [
            {"name": "a", "binary64": proved},
            {"name": "b", "binary64": unknown},
            {"name": "c", "binary64": proved},
        ],
        "bounds": [{"action": "u", "raw_lower": {"value": 1, "evidence": proved}}],
        "emitted": [{"evidence": unknown}, {"evidence": unknown}],
    }
    (tmp_path / "verification.json").write_text(json.dumps(found), encoding="utf-8")
    assert provable(tmp_path) == (
        "a, c proved; b unknown; bounds proved; emitted C equal to it: unknown"
    )
    assert provable(tmp_path / "none") is None
    estimate = {"mean": 1 / 3, "low": 0.25, "high": 0.5, "std": 1.0, "episodes": 3}
    manifest = {"evaluation": {"first_seed": 5, "returns": {"program": estimate}}, "oracle": None}
    assert return_of(manifest, "program") == Return(0.33333333, 0.25, 0.5, 3, 5)
    assert return_of(manifest, "oracle") is None
    assert oracle_of(manifest) is None
    assert oracle_of({"oracle": {"weights_sha256": "ab"}}) == "ab"
