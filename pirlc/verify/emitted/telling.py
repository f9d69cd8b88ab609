"""Where two values that are not one node come apart, for people."""

from __future__ import annotations

from pirlc.verify.emitted.diagrams import under, without
from pirlc.verify.emitted.nodes import Atom, Choice, Node, atom_text, describe

_MOST_CONDITIONS, _LONGEST = 3, 50


def apart(emitted: Node, program: Node) -> tuple[str, str, str]:
    """Conditions under which two different values differ ("": always), and what each is there.

    Long conditions are only counted.
    """
    conditions: list[tuple[Atom, bool]] = []
    while isinstance(emitted, Choice) or isinstance(program, Choice):
        atom = min(
            (node.atom for node in (emitted, program) if isinstance(node, Choice)),
            key=lambda atom: atom.key,
        )
        lower = without(emitted, atom), without(program, atom)
        # Most readings are numbers and within their bounds: rather there than elsewhere.
        if lower[0] is not lower[1] and not (atom.ladder and _differ_above(emitted, program, atom)):
            emitted, program = lower
            conditions.append((atom, False))
        else:
            emitted, program = under(emitted, atom), under(program, atom)
            conditions.append((atom, True))
    texts = [_told(atom, holds) for atom, holds in conditions if holds or atom.ladder]
    short = [text for text in texts if len(text) <= _LONGEST][:_MOST_CONDITIONS]
    dropped = len(texts) - len(short)
    if dropped:
        short.append(f"{dropped} more")
    return " and ".join(short), describe(emitted), describe(program)


def _differ_above(emitted: Node, program: Node, atom: Atom) -> bool:
    return under(emitted, atom) is not under(program, atom)


def _told(atom: Atom, holds: bool) -> str:
    text = atom_text(atom, 3)
    return text if holds else f"not {text}"
