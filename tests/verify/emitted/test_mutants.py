"""Changed C is never called proved where a compiler makes something else of it.

Random changes of single tokens and statements of emitted C; those that are proved all the same
(`0.5f` for `0.5`, a test that cannot fail any more) are compiled and run against the interpreter.
"""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

from pirlc.backend.c import CPrinter, c_files
from pirlc.backend.files import GeneratedFile, Provenance
from pirlc.backend.toolchain import CController, build_files, find_compiler, load
from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import close
from pirlc.ir.policy import Program
from pirlc.lower import lower
from pirlc.semantics.interpreter import initial_state, step
from pirlc.semantics.precision import BINARY64
from pirlc.source import SourceText
from pirlc.verify.emitted.check import Comparison
from pirlc.verify.emitted.graph import Graph
from pirlc.verify.findings import Difference
from tests.support.observations import random_observations

TEXT = r"""policy mutant
sensor x : [-1, 1.1]  = 2
sensor y : [0.1, 0.3] = 0 missing zero
sensor z : [-5, 5]    = 1 missing hold 2 then fail
window 4
param kp = 0.12
param ki = 0.05
action u : [-1, 0.7] safe 0.25 =
  kp * peek(x, -1) + ki * fold(+, x - z) - previous(u) * 0.5 + min(peek(y, -2), peek(z, -1))
action mode : {0, 1, 3} safe 1 =
  if previous(mode) == 3 and peek(x, -1) < 0.3 then 0 else if peek(z, -1) / 2 > ki then 3 else 1
"""

OTHERS = {
    "<": ("<=", ">"),
    "<=": ("<",),
    ">": (">=", "<"),
    ">=": (">",),
    "==": ("!=",),
    "!=": ("==",),
    "+": ("-", "*"),
    "-": ("+",),
    "*": ("+",),
    "/": ("*",),
    "&&": ("||",),
    "||": ("&&",),
    "|=": ("=",),
    "=": ("|=",),
    "!": ("",),
    "?": ("?!",),
}
TOKENS = re.compile(
    r"/\*.*?\*/|[A-Za-z_]\w*|\d+\.?\d*(?:e[+-]?\d+)?u?|<=|>=|==|!=|&&|\|\||\|=|->|\+\+|[-+*/<>=!]"
)


def mutants(source: str, rng: random.Random) -> list[str]:
    """Every text that comes of changing one token, or leaving out one statement, of the code."""
    start = source.index("const mutant_params")
    tokens = [(m.start(), m.group()) for m in TOKENS.finditer(source, start)]
    names = sorted({text for _, text in tokens if re.match(r"[A-Za-z_]", text)})
    changed: list[str] = []
    for place, text in tokens:
        if re.fullmatch(r"\d+u", text):
            others: tuple[str, ...] = (f"{int(text[:-1]) + 1}u", f"{abs(int(text[:-1]) - 1)}u")
        elif re.match(r"\d", text):
            others = (f"{text}1", f"{text}f", f"-{text}")
        elif re.match(r"[A-Za-z_]", text):
            others = (rng.choice(names),)
        else:
            others = OTHERS.get(text, ())
        before, after = source[:place], source[place + len(text) :]
        changed += [before + other + after for other in others if other != text]
    changed += [
        source[: start + line.start()] + source[start + line.end() :]
        for line in re.finditer(r"^ +[^\n{}]*;$", source[start:], re.MULTILINE)
    ]
    return changed


def _differences(program: Program, header: str, source: str) -> list[Difference]:
    """What `check_text` would tell, without its search for a run."""
    comparison = Comparison(program, CPrinter(lower(program), "double"), "double", Graph())
    comparison.run(header, source)
    return comparison.differences


def _differing_steps(text: str, header: str, source: str, folder: Path, rng: random.Random) -> int:
    program = close(parse_sketch(SourceText("mutant.pirl", text)))
    assert program is not None
    controller = lower(program)
    files = [GeneratedFile.of("mutant.h", header), GeneratedFile.of("mutant.c", source)]
    library = build_files(controller, files, folder, find_compiler(), ("-std=c99", "-O1", "-w"))
    compiled = CController(load(library), controller, "double")
    differing = 0
    for _ in range(40):
        compiled.reset()
        state = initial_state(program, BINARY64)
        for observation in random_observations(rng, program.interface, 25).tolist():
            result = step(program, state, observation, BINARY64)
            state = result.state
            differing += compiled.step(observation) != (result.actions, result.status)
    return differing


@pytest.mark.slow
def test_no_mutant_is_proved_that_behaves_differently(tmp_path):
    rng = random.Random(4)
    program = close(parse_sketch(SourceText("mutant.pirl", TEXT)))
    assert program is not None
    header, source = (f.text for f in c_files(lower(program), "double", Provenance("mutant")))
    assert _differing_steps(TEXT, header, source, tmp_path, rng) == 0
    changed = mutants(source, rng)
    assert len(changed) > 700
    chosen = rng.sample(changed, 400)
    proved = [mutant for mutant in chosen if not _differences(program, header, mutant)]
    # Few changes are none, and most that are wrong show at once.
    assert len(proved) < 40
    for mutant in proved:
        assert _differing_steps(TEXT, header, mutant, tmp_path, rng) == 0, mutant
