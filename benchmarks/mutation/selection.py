"""Which files are mutated, how many mutants of each are tried, and by which tests."""

from __future__ import annotations

import random
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from benchmarks.mutation.code_text import Language
from benchmarks.mutation.mutants import Mutant
from benchmarks.mutation.python_source import python_mutants
from benchmarks.mutation.templates import template_mutants


@dataclass(frozen=True)
class Target:
    """A file to mutate. `language` is that of the code in it; `sample` None for all mutants."""

    part: str
    path: PurePosixPath
    language: Language
    sample: int | None = None


def _targets(part: str, *files: tuple[str, Language, int | None]) -> tuple[Target, ...]:
    return tuple(
        Target(part, PurePosixPath(path), language, sample) for path, language, sample in files
    )


TARGETS = (
    *_targets(
        "templates",
        ("templates/c/bridge.c.j2", "c", None),
        ("templates/c/controller.c.j2", "c", None),
        ("templates/c/controller.h.j2", "c", None),
        ("templates/python/controller.py.j2", "python", None),
    ),
    *_targets(
        "printers",
        ("pirlc/backend/c.py", "c", 20),
        ("pirlc/backend/c_expressions.py", "c", 18),
        ("pirlc/backend/python.py", "python", 18),
        ("pirlc/backend/python_expressions.py", "python", 16),
        ("pirlc/backend/text.py", "both", 8),
        ("pirlc/backend/numbers.py", "both", 8),
    ),
    *_targets(
        "lower",
        ("pirlc/lower/lowering.py", "both", 34),
        ("pirlc/lower/blocks.py", "both", 12),
        ("pirlc/lower/unused.py", "both", 10),
    ),
)

QUICK = (
    "tests/lower",
    "tests/backend/test_numbers.py",
    "tests/backend/test_contract.py",
    "tests/backend/test_emitted_files.py",
    "tests/backend/test_emitted_text.py",
    "tests/backend/test_python_controller.py",
    "tests/backend/test_emitted_agreement.py",
    "tests/verify/emitted/test_emitted_equality.py",
    "tests/semantics/test_agreement_edges.py",
    "tests/semantics/test_agreement_emitted.py",
)
"""What tells most mutants soonest."""

REST = ("tests/backend",)
"""Who has got through these as well has survived."""

GOLDEN = ("tests/golden",)
"""They compare text, so that they tell any change, and not whether it matters: run on survivors
alone, and reported apart."""

_COMPARES_TEXT = ("golden",)
"""Words in the names of tests elsewhere that do the same."""


def ordinary_tests(tree: Path) -> list[str]:
    """Test files of the tree, each once, the quickest to tell first, without golden files."""
    files: list[str] = []
    for place in (*QUICK, *REST):
        path = tree / place
        found = sorted(path.rglob("test_*.py")) if path.is_dir() else [path]
        files += [str(file.relative_to(tree)) for file in found if file.is_file()]
    return list(dict.fromkeys(files))


def without_golden() -> list[str]:
    """Arguments for pytest that leave out the comparisons of text in the ordinary files."""
    return ["-k", " and ".join(f"not {word}" for word in _COMPARES_TEXT)]


def mutants_of(target: Target, root: Path) -> list[Mutant]:
    """All mutants of a file, in its order."""
    text = (root / target.path).read_text(encoding="utf-8")
    make = template_mutants if target.path.suffix == ".j2" else python_mutants
    return make(target.path, text, target.language)


def shuffled(mutants: list[Mutant], target: Target, seed: int) -> list[Mutant]:
    """In an order of their own for each file, the same for the same seed."""
    return random.Random(f"{seed} {target.path}").sample(mutants, len(mutants))
