"""How long bounds, remarks and guards take, and what is proved: `python -m benchmarks.bounds`.

For every closed program under examples/: seconds of processor time, and how many of its actions'
bounds are exact, known to within 1e-9, or unknown.
"""

from __future__ import annotations

import time
from pathlib import Path

from pirlc.frontend import parse_sketch
from pirlc.ir.evidence import PROVED, Kind
from pirlc.ir.expansion import close
from pirlc.source import SourceText
from pirlc.verify.bounds.actions import bounds
from pirlc.verify.findings import ActionBounds, Extreme
from pirlc.verify.remarks.collect import guard_margins, remarks

EXAMPLES = Path(__file__).parents[1] / "examples"


def extremes(found: ActionBounds) -> list[Extreme]:
    return [value for value in vars(found).values() if isinstance(value, Extreme)]


def main() -> None:
    print(f"{'program':44} {'bounds':>8} {'remarks':>8}  exact  1e-9  unknown")
    for path in sorted(EXAMPLES.rglob("*.pirl")):
        program = close(parse_sketch(SourceText(path.name, path.read_text(encoding="utf-8"))))
        if program is None:
            continue
        start = time.process_time()
        found = bounds(program)
        between = time.process_time()
        remarks(program)
        guard_margins(program)
        end = time.process_time()
        all_bounds = [e for one in found if isinstance(one, ActionBounds) for e in extremes(one)]
        exact = sum(e.evidence == PROVED for e in all_bounds)
        unknown = sum(e.evidence.kind is Kind.UNKNOWN for e in all_bounds)
        near = len(all_bounds) - exact - unknown
        name = str(path.relative_to(EXAMPLES))
        print(
            f"{name:44} {between - start:6.2f} s {end - between:6.2f} s  {exact:5}  {near:4}"
            f"  {unknown:7}"
        )


if __name__ == "__main__":
    main()
