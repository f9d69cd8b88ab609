"""Programs that are structurally close to a given one (paper, Algorithm 1 and appendix B).

The constants of a program are parameters of its template already, so they are always freed. What
is left is to elide a subexpression, here the derivation of one rule call, and to regenerate it
from the sketch, shortest first. Three moves do this:

- regenerate: another derivation of the same call;
- wrap: a derivation that contains the old one as a part (`E` becomes `if B then E else E2`);
- promote: one of its own parts takes its place (`if B then E else E2` becomes `E`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

from pirlc.ir.expansion import Derivation, Expansion, calls, expand
from pirlc.ir.policy import Sketch
from pirlc.ir.terms import LocalRef, RuleCall, Term, transform
from pirlc.search.canonical import canonical_form
from pirlc.search.enumeration import Enumeration

Path = tuple[int, ...]


@dataclass(frozen=True)
class Neighbour:
    """A template near a program; `values` are those of its parameters that are carried over."""

    expansion: Expansion
    values: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class _Site:
    """A rule call in a derivation: its path from the action, and the call it answers.

    The call's arguments are in the words of the action: `R(x)` inside of `R(S)` is `R(S)` too.
    """

    path: Path
    call: RuleCall
    derivation: Derivation


@dataclass(frozen=True)
class _Edit:
    """`new` in place of the derivation at `path`; parameters found under `kept_at` come from
    `kept_from` of the old one (both None where nothing below `path` is kept)."""

    path: Path
    new: Derivation
    kept_at: Path | None = None
    kept_from: Path | None = None


def neighbourhood(
    enumeration: Enumeration,
    expansion: Expansion,
    values: dict[str, float],
    *,
    growth: int,
    per_move: int,
    largest: int,
) -> tuple[Neighbour, ...]:
    """The neighbours of a program, shorter templates first, each once.

    `growth` is how much larger than the elided derivation a regenerated one may be, `per_move` how
    many derivations each move may try at one place, `largest` the largest size of a template. The
    first neighbour is the program's own template.
    """
    sketch = enumeration.sketch
    own = Neighbour(expansion, tuple(sorted(values.items())))
    own_form = canonical_form(expansion.template)
    found: dict[str, Neighbour] = {}
    for edit in _edits(enumeration, expansion, growth, per_move):
        changed = expand(sketch, _replace_at(expansion.derivations, edit.path, edit.new))
        if changed.template.size > largest:
            continue
        form = canonical_form(changed.template)
        if form == own_form:
            continue
        carried = _carried(expansion, values, changed, edit)
        # Several edits may lead to one template; the one that keeps most of the program counts.
        if form not in found or len(carried) > len(found[form].values):
            found[form] = Neighbour(changed, carried)
    return (own, *sorted(found.values(), key=lambda n: n.expansion.template.size))


def _edits(
    enumeration: Enumeration, expansion: Expansion, growth: int, per_move: int
) -> Iterator[_Edit]:
    for site in _sites(enumeration.sketch, expansion.derivations):
        yield from _promotions(enumeration.sketch, site)
        old_size = _derivation_size(enumeration, site)
        regenerated = (
            derivation
            for total in range(1, old_size + growth + 1)
            for derivation in enumeration.of_call(site.call, total)
            if derivation != site.derivation
        )
        for derivation in islice(regenerated, per_move):
            yield _Edit(site.path, derivation)
        yield from islice(_wraps(enumeration, site, growth), per_move)


def _promotions(sketch: Sketch, site: _Site) -> Iterator[_Edit]:
    for inner in _sites_below(sketch, site):
        if inner.call.rule == site.call.rule and inner.call.arguments == site.call.arguments:
            yield _Edit(site.path, inner.derivation, site.path, inner.path)


def _wraps(enumeration: Enumeration, site: _Site, growth: int) -> Iterator[_Edit]:
    for total in range(growth + 6):
        for frame, number, place in enumeration.frames(site.call, total, site.derivation):
            if _seen_from(enumeration.sketch, site, place).arguments == site.call.arguments:
                yield _Edit(site.path, frame, (*site.path, number), site.path)


def _sites(sketch: Sketch, derivations: tuple[Derivation, ...]) -> Iterator[_Site]:
    for number, (body, derivation) in enumerate(zip(sketch.bodies, derivations, strict=True)):
        yield from _sites_in(sketch, body, derivation, (number,), deep=True)


def _sites_below(sketch: Sketch, site: _Site, *, deep: bool = True) -> Iterator[_Site]:
    chosen = sketch.rule(site.call.rule).alternatives[site.derivation.alternative]
    return _sites_in(sketch, chosen, site.derivation, site.path, deep=deep, around=site)


def _seen_from(sketch: Sketch, site: _Site, call: RuleCall) -> RuleCall:
    """A call in the rule that a site calls, with the site's arguments for the rule's own."""
    rule = sketch.rule(site.call.rule)
    meanings = {
        name: argument
        for (name, _), argument in zip(rule.parameters, site.call.arguments, strict=True)
    }

    def meant(term: Term) -> Term:
        return meanings.get(term.name, term) if isinstance(term, LocalRef) else term

    return replace(call, arguments=tuple(transform(a, meant) for a in call.arguments))


def _sites_in(
    sketch: Sketch,
    term: Term,
    derivation: Derivation,
    path: Path,
    *,
    deep: bool,
    around: _Site | None = None,
) -> Iterator[_Site]:
    for number, (call, child) in enumerate(zip(calls(term), derivation.children, strict=True)):
        seen = call if around is None else _seen_from(sketch, around, call)
        site = _Site((*path, number), seen, child)
        yield site
        if deep:
            yield from _sites_below(sketch, site)


def _derivation_size(enumeration: Enumeration, site: _Site) -> int:
    """The size of what a derivation writes, its arguments counted as single names."""
    rule = enumeration.sketch.rule(site.call.rule)
    own = enumeration.own_size(rule.alternatives[site.derivation.alternative])
    below = _sites_below(enumeration.sketch, site, deep=False)
    return own + sum(_derivation_size(enumeration, inner) for inner in below)


def _replace_in(derivation: Derivation, path: Path, new: Derivation) -> Derivation:
    if not path:
        return new
    at = path[0]
    child = _replace_in(derivation.children[at], path[1:], new)
    return replace(
        derivation,
        children=(*derivation.children[:at], child, *derivation.children[at + 1 :]),
    )


def _replace_at(
    derivations: tuple[Derivation, ...], path: Path, new: Derivation
) -> tuple[Derivation, ...]:
    at = path[0]
    return (
        *derivations[:at],
        _replace_in(derivations[at], path[1:], new),
        *derivations[at + 1 :],
    )


def _carried(
    old: Expansion, values: dict[str, float], new: Expansion, edit: _Edit
) -> tuple[tuple[str, float], ...]:
    """The values of parameters that an edit leaves in place or moves along."""
    known = {(origin.path, origin.hole): values[name] for name, origin in old.origins}
    carried = {p.name: values[p.name] for p in new.template.free if p.name in values}
    for name, origin in new.origins:
        path: Path | None = origin.path
        inside = origin.path[: len(edit.path)] == edit.path
        if inside and edit.kept_at is not None and edit.kept_from is not None:
            depth = len(edit.kept_at)
            moved = origin.path[:depth] == edit.kept_at
            path = edit.kept_from + origin.path[depth:] if moved else None
        elif inside:
            path = None
        value = None if path is None else known.get((path, origin.hole))
        if value is None:
            carried.pop(name, None)
        else:
            carried[name] = value
    return tuple(sorted(carried.items()))
