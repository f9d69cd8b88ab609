"""The derivations that a sketch allows, shortest programs first, and how many there are.

A derivation's size is the size of the program template it expands to; it adds up from the parts
(`_Shape`), so that derivations of one size are made, or counted, without expanding any.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

from pirlc.ir.expansion import Derivation, calls
from pirlc.ir.policy import Sketch
from pirlc.ir.terms import LocalRef, RuleCall, Term, children, size, subterms


@dataclass(frozen=True)
class _Shape:
    """A term's size apart from its outermost rule calls, and those calls."""

    own: int
    calls: tuple[RuleCall, ...]


def _shape(term: Term) -> _Shape:
    if isinstance(term, RuleCall):
        return _Shape(0, (term,))
    below = [_shape(child) for child in children(term)]
    own = size(term) - sum(size(child) for child in children(term))
    return _Shape(
        own + sum(shape.own for shape in below),
        tuple(call for shape in below for call in shape.calls),
    )


class Enumeration:
    """The derivations of one sketch. Holds tables that grow as larger sizes are asked for."""

    def __init__(self, sketch: Sketch) -> None:
        self.sketch = sketch
        self._rules = {rule.key: rule for rule in sketch.rules}
        self._shapes: dict[int, _Shape] = {}
        self._uses: dict[tuple[str, int], tuple[bool, ...]] = {}
        self._count_call = lru_cache(maxsize=None)(self._count_call_uncached)
        self._kept: list[Term] = []
        self._sums: dict[tuple[tuple[int, ...], int], int] = {}
        self._least = _least_derivations(sketch)

    def count(self, total: int) -> int:
        """How many combinations of derivations, one an action, have this total size."""
        return self._count_all([self._shape_of(body) for body in self.sketch.bodies], total)

    def derivations(self, total: int) -> Iterator[tuple[Derivation, ...]]:
        """All of them, in an order that depends on the sketch alone."""
        shapes = [self._shape_of(body) for body in self.sketch.bodies]
        own = sum(shape.own for shape in shapes)
        flat = tuple(call for shape in shapes for call in shape.calls)
        for choices in self._sequences(flat, total - own):
            remaining = list(choices)
            result = []
            for shape in shapes:
                taken: list[Derivation] = []
                for _ in shape.calls:
                    taken.extend(remaining.pop(0))
                result.append(Derivation(0, tuple(taken)))
            yield tuple(result)

    def shortest_first(self, largest: int) -> Iterator[tuple[Derivation, ...]]:
        """Every derivation up to a size."""
        for total in range(1, largest + 1):
            yield from self.derivations(total)

    def of_call(self, call: RuleCall, total: int) -> Iterator[Derivation]:
        """Derivations of one call whose arguments are settled (counted as single names)."""
        rule = self._rules[call.rule]
        for number, alternative in enumerate(rule.alternatives):
            shape = self._shape_of(alternative)
            for choices in self._sequences(shape.calls, total - shape.own):
                yield Derivation(number, tuple(d for group in choices for d in group))

    def frames(
        self, call: RuleCall, total: int, inner: Derivation
    ) -> Iterator[tuple[Derivation, int, RuleCall]]:
        """Derivations of a call that have `inner` in place of a call of the same rule.

        With its number among the children, and that call. `total` is their size without it.
        """
        for number, alternative in enumerate(self._rules[call.rule].alternatives):
            shape = self._shape_of(alternative)
            for position, place in enumerate(shape.calls):
                if place.rule != call.rule:
                    continue
                settled = tuple(
                    self._least[c.rule] for argument in place.arguments for c in calls(argument)
                )
                before, after = shape.calls[:position], shape.calls[position + 1 :]
                for choices in self._sequences(before + after, total - shape.own):
                    groups = (*choices[:position], (inner, *settled), *choices[position:])
                    at = sum(len(group) for group in groups[:position])
                    yield Derivation(number, tuple(d for g in groups for d in g)), at, place

    def own_size(self, term: Term) -> int:
        """The size of a term of the sketch apart from its outermost rule calls."""
        return self._shape_of(term).own

    def _shape_of(self, term: Term) -> _Shape:
        # Keyed by identity: terms of the sketch live as long as it does, and hashing them is slow.
        key = id(term)
        if key not in self._shapes:
            self._shapes[key] = _shape(term)
            self._kept.append(term)
        return self._shapes[key]

    def _used(self, rule: str, alternative: int) -> tuple[bool, ...]:
        key = (rule, alternative)
        if key not in self._uses:
            body = self._rules[rule].alternatives[alternative]
            names = {sub.name for sub in subterms(body) if isinstance(sub, LocalRef)}
            self._uses[key] = tuple(name in names for name, _ in self._rules[rule].parameters)
        return self._uses[key]

    def _sequences(
        self, wanted: tuple[RuleCall, ...], total: int
    ) -> Iterator[tuple[tuple[Derivation, ...], ...]]:
        """For each call the derivations it needs: its own, then those of its arguments' calls."""
        if not wanted:
            if total == 0:
                yield ()
            return
        first, rest = wanted[0], wanted[1:]
        for here in range(1, total - len(rest) + 1):
            if not self._count_shapes(rest, total - here):
                continue
            for head in self._call(first, here):
                for tail in self._sequences(rest, total - here):
                    yield (head, *tail)

    def _call(self, call: RuleCall, total: int) -> Iterator[tuple[Derivation, ...]]:
        if not self._count_call(_Key(call), total):
            return
        rule = self._rules[call.rule]
        for number, alternative in enumerate(rule.alternatives):
            shape = self._shape_of(alternative)
            used = self._used(call.rule, number)
            for arguments, cost in self._arguments(call.arguments, used, total - shape.own):
                for choices in self._sequences(shape.calls, total - shape.own - cost):
                    below = tuple(d for group in choices for d in group)
                    yield (Derivation(number, below), *arguments)

    def _arguments(
        self, arguments: tuple[Term, ...], used: tuple[bool, ...], most: int
    ) -> Iterator[tuple[tuple[Derivation, ...], int]]:
        if not arguments:
            yield (), 0
            return
        if not used[0]:
            # What an argument computes that goes unused is no matter: one choice stands for all.
            head = tuple(self._least[call.rule] for call in calls(arguments[0]))
            for tail, cost in self._arguments(arguments[1:], used[1:], most):
                yield head + tail, cost
            return
        shape = self._shape_of(arguments[0])
        for own_total in self._argument_sizes(shape, most):
            cost = _argument_cost(own_total)
            for choices in self._sequences(shape.calls, own_total - shape.own):
                head = tuple(d for group in choices for d in group)
                for tail, more in self._arguments(arguments[1:], used[1:], most - cost):
                    yield head + tail, cost + more

    def _argument_sizes(self, shape: _Shape, most: int) -> Iterator[int]:
        """The sizes that an argument may have."""
        for total in range(1, max(most - 1, 1) + 1):
            if self._count_shapes(shape.calls, total - shape.own):
                yield total

    def _count_all(self, shapes: list[_Shape], total: int) -> int:
        flat = tuple(call for shape in shapes for call in shape.calls)
        return self._count_shapes(flat, total - sum(shape.own for shape in shapes))

    def _count_shapes(self, wanted: tuple[RuleCall, ...], total: int) -> int:
        if not wanted:
            return int(total == 0)
        if total < len(wanted):
            return 0
        first, rest = wanted[0], wanted[1:]
        if not rest:
            return self._count_call(_Key(first), total)
        # Kept: of three calls, the pairs of the last two are asked for again and again.
        key = (tuple(map(id, wanted)), total)
        if key not in self._sums:
            self._sums[key] = sum(
                here_count * self._count_shapes(rest, total - here)
                for here in range(1, total - len(rest) + 1)
                if (here_count := self._count_call(_Key(first), here))
            )
        return self._sums[key]

    def _count_call_uncached(self, key: _Key, total: int) -> int:
        call = key.call
        rule = self._rules[call.rule]
        count = 0
        for number, alternative in enumerate(rule.alternatives):
            shape = self._shape_of(alternative)
            if shape.own > total:
                continue
            costs = {0: 1}
            for argument, used in zip(call.arguments, self._used(call.rule, number), strict=True):
                if not used:
                    continue
                inner = self._shape_of(argument)
                after: dict[int, int] = {}
                for spent, ways in costs.items():
                    for own in self._argument_sizes(inner, total - shape.own - spent):
                        cost = spent + _argument_cost(own)
                        here = self._count_shapes(inner.calls, own - inner.own)
                        after[cost] = after.get(cost, 0) + ways * here
                costs = after
            for cost, ways in costs.items():
                count += ways * self._count_shapes(shape.calls, total - shape.own - cost)
        return count


@dataclass(frozen=True, slots=True, eq=False)
class _Key:
    """A call as a dictionary key, by identity."""

    call: RuleCall

    def __hash__(self) -> int:
        return id(self.call)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and other.call is self.call


def _argument_cost(own: int) -> int:
    """What binding an argument adds: nothing for a single name (its uses are counted already)."""
    return 1 + own if own > 1 else 0


def _least_derivations(sketch: Sketch) -> dict[str, Derivation]:
    """For each rule a derivation with the fewest nested choices, the first such in the text."""
    found: dict[str, Derivation] = {}
    while True:
        new: dict[str, Derivation] = {}
        for rule in sketch.rules:
            for number, alternative in enumerate(rule.alternatives):
                needed = [call.rule for call in calls(alternative)]
                if rule.key not in found and rule.key not in new and found.keys() >= set(needed):
                    new[rule.key] = Derivation(number, tuple(found[key] for key in needed))
        if not new:
            return found
        found.update(new)
