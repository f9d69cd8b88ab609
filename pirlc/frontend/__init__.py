"""The front end: from the text of a .pirl file to a typed sketch, or to diagnostics."""

from __future__ import annotations

from pirlc.diagnostics import Diagnostic, PirlcError
from pirlc.frontend import names, syntax, wellformed
from pirlc.frontend.declare import declare
from pirlc.frontend.describe import describe
from pirlc.frontend.elaborate import elaborate
from pirlc.frontend.explain import explain
from pirlc.frontend.parse import DEPTH_LIMIT, parse
from pirlc.frontend.problems import Collector, Found
from pirlc.frontend.problems_syntax import TooDeep
from pirlc.ir.policy import Sketch
from pirlc.source import SourceText, Span

__all__ = ["check", "explain", "format_source", "parse_sketch"]


def parse_sketch(source: SourceText) -> Sketch:
    """The sketch that a text says. Raises `PirlcError` with all diagnostics found."""
    return check(source)[0]


def check(source: SourceText) -> tuple[Sketch, tuple[Diagnostic, ...]]:
    """The sketch and the warnings about it. Raises `PirlcError` with all diagnostics found."""
    tree = parse(source)
    try:
        return _elaborate(tree, source)
    except RecursionError:
        # Rules may nest the guessing of each other's types deeper than any one expression is.
        place = tree.declarations[0].span if tree.declarations else Span(0, 0)
        found = Found(TooDeep(place, DEPTH_LIMIT))
        raise PirlcError(describe(found, source)) from None


def format_source(source: SourceText) -> str:
    """The text in the one layout. Raises `PirlcError` with syntax diagnostics."""
    from pirlc.frontend import format as formatter  # `pirlc check` starts without it

    return formatter.format_source(source)


def _elaborate(
    tree: syntax.SyntaxTree, source: SourceText
) -> tuple[Sketch, tuple[Diagnostic, ...]]:
    collector = Collector()
    end = len(source.text.rstrip())
    declared = declare(tree, Span(max(0, end - 1), end), collector)
    for body in declared.bodies:
        if body is not None:
            names.check_action(body, declared.scope, collector)
    for declaration in tree.declarations:
        match declaration:
            case syntax.Rule():
                names.check_rule(declaration, declared.scope, collector)
            case syntax.Property():
                names.check_property(declaration.body, declared.scope, collector)
            case _:
                pass
    bodies, rules, properties = elaborate(declared, collector)
    sketch = Sketch(declared.interface, declared.parameters, rules, bodies, properties)
    wellformed.judge(declared, sketch, collector)
    if collector.found:
        ordered = sorted(collector.found, key=_place)
        raise PirlcError(describe(found, source) for found in ordered)
    wellformed.warnings(declared, sketch, collector)
    return sketch, tuple(describe(found, source) for found in collector.found)


def _place(found: Found) -> int:
    span = getattr(found.problem, "span", None)
    return span.start if isinstance(span, Span) else 0
