"""The tables of docs/assurance.md, from the record of a run and from the deviations."""

from __future__ import annotations

import re
from typing import Any

from benchmarks.assure.deviations import DEVIATIONS, TIDY_OFF

Record = dict[str, Any]

_BLOCK = re.compile(r"(<!-- table: ([\w-]+) -->\n).*?(<!-- end -->)", re.DOTALL)


def filled(text: str, record: Record) -> str:
    """The page with every `<!-- table: NAME --> ... <!-- end -->` written anew."""
    made = {
        "deviations": deviations(record),
        "tidy": tidy(),
        "versions": versions(record),
        "steps": steps(record),
        "functions": functions(record),
        "cortex-m4f": resources(record, "float"),
        "cortex-m3": resources(record, "double"),
        "step-time": step_time(record),
    }
    found = {match[2] for match in _BLOCK.finditer(text)}
    if found != set(made):
        raise ValueError(f"the page has the tables {sorted(found)}, not {sorted(made)}")
    return _BLOCK.sub(lambda match: f"{match[1]}{made[match[2]]}\n{match[3]}", text)


def table(head: list[str], rows: list[list[str]], numbers: int) -> str:
    """In Markdown; the last `numbers` columns are set to the right."""
    rule = ["---"] * (len(head) - numbers) + ["---:"] * numbers
    return "\n".join(f"| {' | '.join(row)} |" for row in [head, rule, *rows])


def versions(record: Record) -> str:
    return table(
        ["tool", "version"], [[f"`{name}`", v] for name, v in record["versions"].items()], 0
    )


def deviations(record: Record) -> str:
    accepted = {
        kind: {
            rule: count
            for entry in record["checks"].values()
            for rule, count in entry.get("accepted", {}).get(kind, {}).items()
        }
        for kind in ("examples", "random")
    }
    rows = [
        [
            d.tool,
            d.rule,
            d.says,
            d.reason,
            "none allowed" if d.random_only else str(accepted["examples"].get(_key(d), 0)),
            str(accepted["random"].get(_key(d), 0)),
        ]
        for d in DEVIATIONS
    ]
    head = ["tool", "rule", "what it reports", "why it stands", "in examples", "in random programs"]
    return table(head, rows, 2)


def _key(deviation: Any) -> str:
    return f"{deviation.tool} {deviation.rule}"


def tidy() -> str:
    return table(["check that is off", "why"], [[f"`{name}`", why] for name, why in TIDY_OFF], 0)


def steps(record: Record) -> str:
    rows = []
    for kind, label in (("examples", "examples"), ("random", "random programs")):
        under = record["checks"]["sanitizers"]["counts"][kind]
        across = record["checks"]["targets"]["counts"][kind]
        rows.append(
            [
                label,
                f"{under['steps']:,}",
                f"{under['steps with a missing reading']:,}",
                f"{under['steps with a reading out of range']:,}",
                f"{under['steps with a safe value']:,}",
                f"{across['steps']:,}",
                str(across.get("left out for exp or tanh", 0)),
            ]
        )
    head = ["C of", "steps under sanitizers", "with a missing reading", "with one out of range"]
    head += ["with a safe value", "steps compared on each target", "left out (exp, tanh)"]
    return table(head, rows, 6)


def functions(record: Record) -> str:
    rows: dict[tuple[str, str], dict[str, float]] = {}
    machines: list[str] = []
    for row in record["checks"]["functions"]["rows"]:
        rows.setdefault((row["function"], row["real"]), {})[row["machine"]] = row["ulp"]
        if row["machine"] not in machines:
            machines.append(row["machine"])
    lines = [
        [f"`{name}`", real, *(f"{ulps[machine]:.2f}" for machine in machines)]
        for (name, real), ulps in rows.items()
    ]
    return table(["function", "precision", *machines], lines, len(machines))


def resources(record: Record, real: str) -> str:
    rows = []
    for row in record["checks"]["resources"]["rows"]:
        if row["real"] != real:
            continue
        ours, casadi = row["emitted"], row["casadi"]
        rows.append(
            [
                _short(row["label"]),
                f"{row['operations']} + {row['checks']}",
                *(f"{ours[key]:,}" for key in ("instructions", "flash", "ram", "stack")),
                f"{row['taken']} of {row['branches']}",
                *(f"{casadi[key]:,}" for key in ("instructions", "flash", "ram", "stack")),
            ]
        )
    head = [
        "program",
        "longest path, operations",
        "instructions",
        "flash",
        "RAM",
        "stack",
        "branches",
    ]
    head += ["CasADi: instructions", "flash", "RAM", "stack"]
    return table(head, rows, 10)


def step_time(record: Record) -> str:
    rows = [
        [
            _short(row["label"]),
            "-".join(map(str, row["layers"])),
            f"{row['onnx']:.1f}",
            f"{row['c']:.3f}",
            f"{row['onnx'] / row['c']:,.0f}",
            f"{row['c_from_python']:.1f}",
            f"{row['onnx'] / row['c_from_python']:.1f}",
        ]
        for row in record["checks"]["step-time"]["rows"]
    ]
    head = ["program", "oracle's layers", "ONNX Runtime, us", "C, us", "ratio"]
    head += ["C from Python, us", "ratio"]
    return table(head, rows, 5)


def _short(label: str) -> str:
    return (
        label.rsplit("/", 1)[-1] if "printed" not in label else f"printed/{label.rsplit('/')[-1]}"
    )
