"""Plants faults in templates, printers and lowering, and counts what the ordinary tests catch.

    python -m benchmarks.mutation [--seed N] [--jobs N] [--files WORD] [--most N] [--survivors]
                                [--results FILE]

Each mutant is put into a private copy of the tree. Those that cannot emit, or emit what does not
compile, are counted apart: any test catches them. On the others the tests run, quickest to tell
first, up to the first failure; golden files, which tell every change of text, only for those that
survive. Results are in benchmarks/results/mutation.json and docs/mutation.md; exit 1 below the bar.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.mutation import documentation
from benchmarks.mutation.equivalent import equivalents, stale
from benchmarks.mutation.mutants import Key, Mutant
from benchmarks.mutation.selection import (
    GOLDEN,
    TARGETS,
    Target,
    mutants_of,
    ordinary_tests,
    shuffled,
    without_golden,
)
from benchmarks.mutation.trees import Emitter, Tree

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "benchmarks" / "results" / "mutation.json"
BAR = 0.95
SLOWER = 5.0
"""How many times as long as without a fault the tests may take."""

Row = dict[str, Any]


@dataclass
class Worker:
    """A copy of the tree, and what asks it to emit."""

    tree: Tree
    emitter: Emitter


class Workers:
    """Hands out a worker for each thread that asks."""

    def __init__(self, source: Path, folder: Path) -> None:
        self._source, self._folder = source, folder
        self._local = threading.local()
        self._lock = threading.Lock()
        self.all: list[Worker] = []

    def mine(self) -> Worker:
        if not hasattr(self._local, "worker"):
            with self._lock:
                tree = Tree(self._source, self._folder / str(len(self.all)))
                self._local.worker = Worker(tree, Emitter(tree))
                self.all.append(self._local.worker)
        worker: Worker = self._local.worker
        return worker


@dataclass(frozen=True)
class Run:
    """What every mutant is compared with: `original` is what the tree emits without a fault.

    `tests` have `seconds` before they are stopped.
    """

    workers: Workers
    original: str
    known: dict[Key, str]
    tests: list[str]
    seconds: float

    def emits(self, mutant: Mutant) -> str:
        worker = self.workers.mine()
        with worker.tree.holding(mutant.path, mutant.text):
            return worker.emitter.answer()

    def row(self, target: Target, mutant: Mutant, answer: str) -> Row:
        """What became of a mutant that answered so when it was asked to emit."""
        row: Row = {
            "part": target.part,
            "file": str(mutant.path),
            "line": mutant.line,
            "within": mutant.within,
            "fault": mutant.fault,
            "was": mutant.was,
            "becomes": mutant.becomes,
            "number": mutant.number,
        }
        if not answer.startswith("ok"):
            return {**row, "verdict": "refused", "why": answer.partition(" ")[2][:200]}
        row["changes_programs"] = answer != self.original
        if mutant.key in self.known:
            return {**row, "verdict": "equivalent", "why": self.known[mutant.key]}
        tree = self.workers.mine().tree
        with tree.holding(mutant.path, mutant.text):
            verdict = tree.test([*self.tests, *without_golden()], self.seconds)
            row["seconds"] = round(verdict.seconds, 1)
            if verdict.failed:
                return {**row, "verdict": "caught", "by": verdict.failed, "why": verdict.why}
            golden = tree.test(GOLDEN, self.seconds)
        return {**row, "verdict": "survived", "golden": golden.failed is not None}


def main() -> int:
    arguments = argparse.ArgumentParser(prog="python -m benchmarks.mutation")
    arguments.add_argument("--seed", type=int, default=1)
    arguments.add_argument("--jobs", type=int, default=2)
    arguments.add_argument("--files", default="", help="only files with this word in their path")
    arguments.add_argument("--most", type=int, help="at most so many mutants of a file")
    arguments.add_argument("--results", type=Path, default=RESULTS, help="where they are written")
    arguments.add_argument(
        "--survivors", action="store_true", help="only those that survived the last time"
    )
    options = arguments.parse_args()
    targets = [target for target in TARGETS if options.files in str(target.path)]
    known = equivalents()
    made = {target: mutants_of(target, ROOT) for target in targets}
    keys = {mutant.key for listed in made.values() for mutant in listed}
    files = {str(target.path) for target in targets}
    gone = stale([key for key in known if key[0] in files], keys)
    if gone:
        print("equivalent.toml lists what is no mutant any more:", *gone, sep="\n  ")
        return 2
    before = json.loads(options.results.read_text())["mutants"] if options.survivors else []
    survived = {_key(row) for row in before if row["verdict"] == "survived"}
    rows: list[Row] = []
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="mutation-") as place:
        run = _begin(Workers(ROOT, Path(place)), known)
        if run is None:
            return 2
        with ThreadPoolExecutor(options.jobs) as pool:
            for target in targets:
                if options.survivors:
                    chosen = [m for m in made[target] if m.key in survived and m.key not in known]
                    most = len(chosen)
                else:
                    chosen = shuffled(made[target], target, options.seed)
                    most = min(options.most or len(chosen), target.sample or len(chosen))
                tried = list(_tried(pool, chosen, run.emits, most))
                answers = [answer for _, answer in tried]
                for row in pool.map(partial(run.row, target), [m for m, _ in tried], answers):
                    rows.append(row)
                    _tell(row, len(rows))
                summary = _write(options.results, options.seed, _merged(before, rows))
        for worker in run.workers.all:
            worker.emitter.close()
    _print(summary, _merged(before, rows), time.monotonic() - start)
    return 0 if all(part["caught"] >= BAR for part in summary.values() if part["tried"]) else 1


def _begin(workers: Workers, known: dict[Key, str]) -> Run | None:
    """What all mutants are compared with; nothing where the tests fail without any fault."""
    first = workers.mine()
    tests = ordinary_tests(first.tree.folder)
    verdict = first.tree.test([*tests, *GOLDEN], 1800.0)
    if verdict.failed:
        print(f"the tests fail without any fault: {verdict.failed}: {verdict.why}")
        return None
    print(f"{len(tests)} test files pass in {verdict.seconds:.0f} s", file=sys.stderr)
    return Run(workers, first.emitter.answer(), known, tests, max(60.0, SLOWER * verdict.seconds))


def _merged(before: list[Row], rows: list[Row]) -> list[Row]:
    """The rows of an earlier run with those that were made again, in the order of the files."""
    merged = {_key(row): row for row in [*before, *rows]}
    return sorted(merged.values(), key=lambda row: (row["file"], row["line"], row["becomes"]))


def _write(place: Path, seed: int, rows: list[Row]) -> dict[str, Any]:
    """Writes the results, and gives their summary, by part and of all."""
    parts = dict.fromkeys(target.part for target in TARGETS)
    summary = {part: summary_of(rows, part) for part in parts}
    summary["all"] = summary_of(rows, None)
    content = {"seed": seed, "summary": summary, "mutants": rows}
    place.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    if place == RESULTS:
        page = documentation.PLACE.read_text(encoding="utf-8")
        tables = documentation.tables(content, equivalents())
        documentation.PLACE.write_text(documentation.filled(page, tables), encoding="utf-8")
    return summary


def _key(row: Row) -> Key:
    return row["file"], row["within"], row["was"], row["becomes"], row["number"]


def _tried(
    pool: ThreadPoolExecutor,
    mutants: list[Mutant],
    emits: Callable[[Mutant], str],
    most: int,
) -> Iterator[tuple[Mutant, str]]:
    """Mutants in their order with what they emit, until `most` of them emit something."""
    batch = 16
    for start in range(0, len(mutants), batch):
        part = mutants[start : start + batch]
        for mutant, answer in zip(part, pool.map(emits, part), strict=True):
            if most == 0:
                return
            yield mutant, answer
            most -= answer.startswith("ok")


def summary_of(rows: list[Row], part: str | None) -> dict[str, Any]:
    mine = [row for row in rows if part in (None, row["part"])]
    count = {
        verdict: sum(row["verdict"] == verdict for row in mine)
        for verdict in ("refused", "equivalent", "caught", "survived")
    }
    tried = count["caught"] + count["survived"]
    golden = sum(row.get("golden", False) for row in mine)
    return {
        "made": len(mine),
        "refused": count["refused"],
        "equivalent": count["equivalent"],
        "tried": tried,
        "survived": count["survived"],
        "caught": round(count["caught"] / max(1, tried), 4),
        "caught_with_golden": round((count["caught"] + golden) / max(1, tried), 4),
    }


def _tell(row: Row, number: int) -> None:
    if row["verdict"] in ("caught", "survived"):
        word = row.get("by", "SURVIVED") + " " + row.get("why", "")[:100]
        print(f"{number:>4} {row['file']}:{row['line']} {word}", file=sys.stderr, flush=True)


def _print(summary: dict[str, Any], rows: list[Row], seconds: float) -> None:
    print(f"{'part':<11}{'refused':>8}{'equivalent':>11}{'tried':>7}{'survived':>9}{'caught':>8}")
    for name, part in summary.items():
        print(
            f"{name:<11}{part['refused']:>8}{part['equivalent']:>11}{part['tried']:>7}"
            f"{part['survived']:>9}{part['caught']:>8.1%}"
            f"   with golden files {part['caught_with_golden']:.1%}"
        )
    for row in rows:
        if row["verdict"] == "survived":
            print(f"survived: {row['file']}:{row['line']} in {row['within']} ({row['fault']})")
            print(*(f"    - {line}" for line in row["was"].splitlines()), sep="\n")
            print(*(f"    + {line}" for line in row["becomes"].splitlines()), sep="\n")
    print(f"{seconds:.0f} s; the bar is {BAR:.0%}")


if __name__ == "__main__":
    sys.exit(main())
