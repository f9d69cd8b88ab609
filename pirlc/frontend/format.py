"""`pirlc fmt`: one layout for every file, comments kept.

Spacing, line breaks and the order of an action's parts are the formatter's; the order of
declarations, single blank lines between them, parentheses and the spelling of numbers stay the
writer's. A comment stays behind or above the word that it was written at. Formatting a formatted
file changes nothing: what is laid out depends on the words and on the comments' places between
them alone.
"""

from __future__ import annotations

from typing import assert_never

from pirlc.frontend import syntax
from pirlc.frontend.parse import parse
from pirlc.ir import layout
from pirlc.ir.layout import Document, Piece, Remark, Text, together, word
from pirlc.source import SourceText

_Remarks = list[tuple[int, Remark]]
_Single = (
    syntax.Policy
    | syntax.Environment
    | syntax.Setting
    | syntax.Fill
    | syntax.Parameter
    | syntax.Action
    | syntax.Rule
    | syntax.Property
)
"""The declarations that are laid out each for itself."""


def format_source(source: SourceText) -> str:
    """The text in the one layout. Raises `PirlcError` with syntax diagnostics."""
    tree = parse(source)
    remarks = [
        (comment.span.start, Remark(_clean(comment.text), comment.own_line))
        for comment in tree.comments
    ]
    sensors = _sensor_lines(tree, remarks, source.text)
    out: list[str] = []
    last_end = 0
    for declaration in tree.declarations:
        start, end = declaration.span.start, declaration.span.end
        body = _body_start(declaration)
        above = [item for item in remarks if last_end <= item[0] < start]
        # A comment in the head of a declaration has no good place there: it goes above.
        head = [remark.text for at, remark in remarks if start <= at < body]
        inside = [item for item in remarks if body <= item[0] < end]
        last_end = _comments(out, above, source.text, last_end)
        _blank(out, source.text[last_end:start])
        out.extend(head)
        if isinstance(declaration, syntax.Sensor):
            out.append(sensors[start])
        else:
            out.append(layout.render(_declaration(declaration), remarks=inside))
        last_end = end
    _comments(out, [item for item in remarks if item[0] >= last_end], source.text, last_end)
    return "\n".join(out) + "\n" if out else ""


def _sensor_lines(tree: syntax.SyntaxTree, remarks: _Remarks, text: str) -> dict[int, str]:
    """The lines of the sensors, by where they start; neighbours have their columns aligned."""
    lines: dict[int, str] = {}
    run: list[syntax.Sensor] = []
    for declaration in (*tree.declarations, None):
        if run and not (
            isinstance(declaration, syntax.Sensor)
            and _adjacent(run[-1], declaration, remarks, text)
        ):
            starts = [sensor.span.start for sensor in run]
            lines.update(zip(starts, layout.table(list(map(_sensor_cells, run))), strict=True))
            run = []
        if isinstance(declaration, syntax.Sensor):
            run.append(declaration)
    return lines


def _adjacent(first: syntax.Sensor, second: syntax.Sensor, remarks: _Remarks, text: str) -> bool:
    """Whether only the end of a line (and a comment on it) will stand between two sensors."""
    start, end = first.span.end, second.span.start
    parted = any(
        (remark.own_line and start <= at < end) or end <= at < second.span.end
        for at, remark in remarks
    )
    return not parted and text[start:end].count("\n") <= 1


def _sensor_cells(sensor: syntax.Sensor) -> tuple[str, str, str]:
    missing = sensor.missing
    policy = f" missing {missing.word.text}" if missing else ""
    if missing and missing.limit and missing.finally_:
        policy += f" {missing.limit.text} then {missing.finally_.text}"
    range_ = sensor.range
    return (
        f"sensor {sensor.name.text}",
        f": [{range_.lower.text}, {range_.upper.text}]",
        f"= {sensor.index.text}{policy}",
    )


def _body_start(declaration: syntax.Declaration) -> int:
    """Where the part of a declaration begins that may have comments between its words."""
    match declaration:
        case syntax.Environment(arguments=(first, *_)):
            return first.span.start
        case syntax.Action(equals=(*_, body)):
            return body.span.start
        case syntax.Rule() | syntax.Property():
            return syntax.expressions(declaration)[0].span.start
        case _:
            return declaration.span.end


def _clean(comment: str) -> str:
    """A comment with a space behind its `#` (a ruler of `#` or a `#!` line stays as it is)."""
    body = comment.rstrip()
    return body if len(body) < 2 or body[1] in " \t#!" else f"# {body[1:]}"


def _blank(out: list[str], between: str) -> None:
    """A blank line, where the writer left one or more."""
    if out and out[-1] and between.count("\n") > 1:
        out.append("")


def _comments(out: list[str], comments: _Remarks, text: str, last_end: int) -> int:
    """Comments between declarations; the place in the source after the last of them."""
    for offset, remark in comments:
        if remark.own_line or not out:
            _blank(out, text[last_end:offset])
            out.append(remark.text)
        else:
            out[-1] = f"{out[-1]}  {remark.text}"
        line_end = text.find("\n", offset)
        last_end = len(text) if line_end < 0 else line_end
    return last_end


def _declaration(declaration: _Single) -> Document:
    match declaration:
        case syntax.Policy(name=name):
            return together("policy ", _name(name))
        case syntax.Environment():
            return _environment(declaration)
        case syntax.Setting(keyword=keyword, value=value):
            return together(keyword, " ", _number(value))
        case syntax.Fill(word=word_):
            return together("fill ", _name(word_))
        case syntax.Parameter(name=name, bounds=bounds, number=number):
            limits = [" in ", _range(bounds)] if bounds else []
            given = [" = ", _number(number)] if number else []
            return together("param ", _name(name), *limits, *given)
        case syntax.Action():
            return _action(declaration)
        case syntax.Rule(name=name, formals=formals, alternatives=alternatives):
            listed = ", ".join(formal.text for formal in formals)
            head = f"rule {name.text}" + (f"({listed})" if formals else "")
            starts = [alternative.span.start for alternative in alternatives]
            return layout.definition(head, [_piece(a) for a in alternatives], starts)
        case syntax.Property(name=name, over=over, body=body):
            head = f"property {name.text}" + (f" over {over.text}" if over else "")
            return layout.definition(head, [_piece(body)])
        case _:
            assert_never(declaration)


def _environment(declaration: syntax.Environment) -> Document:
    arguments: list[Document] = []
    for argument in declaration.arguments:
        match argument.value:
            case syntax.Text(source=source):
                value = source
            case syntax.Number(text=text):
                value = text
            case syntax.Truth(value=truth):
                value = "true" if truth else "false"
        start = argument.value.span.start
        arguments.append(together(_name(argument.name), " = ", Text(value, start)))
    return layout.braces(f"environment {declaration.id.source}", arguments)


def _action(declaration: syntax.Action) -> Document:
    match declaration.domain:
        case syntax.Range(lower=lower, upper=upper):
            domain = f"[{lower.text}, {upper.text}]"
        case syntax.Choice(values=values):
            domain = "{" + ", ".join(value.text for value in values) + "}"
    safe = "".join(f" safe {number.text}" for number in declaration.safe)
    *components, body = declaration.equals or (None,)
    listed = "".join(
        " = " + layout.render(_piece(component).document, width=2**62)
        for component in components
        if component is not None
    )
    head = f"action {declaration.name.text} : {domain}{listed}{safe}"
    return Text(head) if body is None else layout.definition(head, [_piece(body)])


def _name(name: syntax.Name) -> Document:
    return Text(name.text, name.span.start)


def _number(number: syntax.Number) -> Document:
    return Text(number.text, number.span.start)


def _range(range_: syntax.Range) -> Document:
    return together("[", _number(range_.lower), ", ", _number(range_.upper), "]")


def _piece(expression: syntax.Expression) -> Piece:
    start = expression.span.start
    match expression:
        case syntax.Number(text=text) | syntax.Name(text=text):
            return word(text, start)
        case syntax.Hole(name=name, bounds=bounds, guess=guess):
            if bounds is None and guess is None:
                return word(f"?{name.text}", start)
            limits = [" in ", _range(bounds)] if bounds else []
            given = [" = ", _number(guess)] if guess else []
            return Piece(together(Text("?(", start), _name(name), *limits, *given, ")"))
        case syntax.Call(name=name, arguments=arguments):
            return layout.call(name.text, map(_piece, arguments), start)
        case syntax.Unary(operator=operator, operand=operand):
            return layout.prefix(operator, _piece(operand), start)
        case syntax.Binary(operator=operator, left=left, right=right):
            # A comment between an operator and its right operand goes before the operator,
            # where a line ends.
            return layout.infix(operator, _piece(left), _piece(right), right.span.start)
        case syntax.Conditional(
            condition=condition, consequent=consequent, alternative=alternative
        ):
            places = (start, consequent.span.start, alternative.span.start)
            return layout.conditional(
                _piece(condition), _piece(consequent), _piece(alternative), places
            )
        case syntax.Binding(name=name, value=value, body=body):
            words = (start, name.span.start)
            return layout.binding(name.text, _piece(value), _piece(body), words)
        case syntax.Lambda(element=element, accumulator=accumulator, body=body):
            return layout.lambda_(element.text, accumulator.text, _piece(body), start)
        case syntax.OperatorWord(operator=operator):
            return Piece(Text(operator.value, start))
        case syntax.Group(inner=inner):
            return layout.grouped(_piece(inner), start)
        case _:
            assert_never(expression)
