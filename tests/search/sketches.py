"""Sketches for tests: read from text, and random derivations of them."""

from __future__ import annotations

import random

from pirlc.frontend import parse_sketch
from pirlc.ir.expansion import Derivation, Expansion, calls, expand
from pirlc.ir.policy import Sketch
from pirlc.ir.terms import Term
from pirlc.source import SourceText

HEAD = """policy p
sensor S : [-1, 1] = 0
sensor T : [-2, 2] = 1
window 3
"""
"""Before the actions and rules of a short sketch."""

LONG = "x" * 64


def sketch_of(text: str, head: str = HEAD) -> Sketch:
    return parse_sketch(SourceText("sketch", head + text))


SHAPES = {
    "recursive": """
        action A : {0, 1} = Switched
        rule Guard = ?a * peek(S, -1) > ?c | Guard and Guard | Guard or Guard
        rule Switched = if Guard then 1 else 0 | if Guard then Switched else Switched
    """,
    "PID": """
        action A : [-1, 1] = PID(S)
        action B : [-1, 1] = Switched
        rule PID(h) = let e = ?r - h in ?kp * peek(e, -1) + ?ki * fold(+, e)
                    | ?k * peek(h, -1)
        rule Switched = PID(T) | if peek(T, -1) > ?c then Switched else Switched
    """,
    "atoms": """
        action A : [-1, 1] = Scaled(Scaled(Reading))
        rule Reading = peek(S, -1) | ?k | Reading - Reading
        rule Scaled(x) = x * ?k | x * x + 1
    """,
    "unused": """
        action A : [-1, 1] = Second(Reading, Reading + 1)
        rule Reading = peek(S, -1) | ?k | Reading + ?k
        rule Second(x, y) = y * ?k | x | ?k | Second(x * y, Reading) + ?k
    """,
    "several": """
        action A : [-1, 1] = Term + Term
        action B : [-1, 1] = ?b
        action C : {0, 2} = if Term > 0 then 2 else 0
        rule Term = peek(S, -1) | ?k * peek(T, -1) | Term + Term
    """,
    "let": """
        action A : [-1, 1] = let e = Term in let f = e * Term in e + f
        rule Term = peek(S, -1) | let e = ?k + Other in e * e
        rule Other = ?k | abs(Term)
    """,
    "lambda": r"""
        action A : [-1, 1] safe 0 = Folded(S)
        rule Folded(x) = fold(\v acc -> v * Weight + acc, x - Weight, Weight)
                       | fold(+, x) * Weight
        rule Weight = ?w | ?w * Weight
    """,
    "sequences": """
        action A : [-1, 1] = fold(+, Smooth(Smooth(S)))
        rule Smooth(x) = x * ?k | Smooth(x) + T | abs(x - peek(x, -1))
    """,
}
"""One of each way in which a rule may be written and called."""

CLASHES = {
    "hole like a local": """
        action A : [-1, 1] = R(peek(S, -1) + 1)
        rule R(k) = let e = k in ?e * e + ?k
                  | let A_k = k in ?k * A_k + R(A_k)
                  | ?A_k + R(k * ?k)
    """,
    "local like a later parameter": """
        action A : [-1, 1] = R(peek(S, -1) + 1)
        action B : [-1, 1] = R(peek(S, -1) * 2)
        rule R(k) = let B_k = k in B_k + ?k | let A_k_2 = ?k in A_k_2 * ?k | R(k + 1) * R(?k)
    """,
    "action like a parameter": """
        action A : [-1, 1] = ?k_2 + R
        action A_k : [-1, 1] = ?k + R
        rule R = ?k + R | ?k_2 + R | ?k
    """,
    "shared parameter": """
        param A_k in [0, 10]
        param A_q = 3
        action A : [-1, 1] = ?k + R
        rule R = ?k * A_k + A_q | ?q + R | ?A_k
    """,
    "nested lets": """
        action A : [-1, 1] = R(?k + 1)
        rule R(x) = let e = x + 1 in Q(e * x) + e | (let e = x in Q(e)) * Q(let e = 2 + x in e)
        rule Q(e) = let x = e + ?x in let e = x + e in e * x * ?e | R(e) | e
    """,
    "lambdas": r"""
        action A : [-1, 1] safe 0 = R(S)
        rule R(v) = fold(\v acc -> v + acc * ?v, v, ?acc)
                  | fold(\a A_v -> a * A_v + ?v, v + ?v, ?v)
                  | let v = v in R(v) + R(v)
    """,
    "properties": r"""
        action A : [-1, 1] = ?k + R
        rule R = ?e | ?e + R
        property q = let A_k = 3 in let A_e = 2 in A < A_k + A_e
        property r over 3 = fold(\A_e_2 A_e_3 -> A_e_2 + A_e_3, A, 0) < 3
    """,
    "long names": f"""
        action {"A" * 64} : [-1, 1] = R(peek(S, -1))
        action {"A" * 63}B : [-1, 1] = R(peek(S, -1) + 1)
        rule R(x) = let {LONG} = ?{"k" * 64} in {LONG} + R(x + {LONG})
                  | ?k
                  | let {LONG} = ?{"A" * 63} in {LONG} * {LONG} * R({LONG})
    """,
    "discrete arguments": """
        action A : {0, 1, 2} = R(D)
        rule R(c) = c | if G then c else R(D) | let d = R(c) in if G then d else c
        rule D = previous(A) | if G then 1 else 2
        rule G = peek(S, -1) > ?k | previous(A) == 1
    """,
    "boolean arguments": """
        action A : {0, 1} = R(peek(S, -1) > 0)
        rule R(g) = if g then 0 else 1
                  | if G then 1 else R(g and peek(T, -1) > ?k)
                  | let h = g or peek(T, -1) < ?h in if h then R(h) else R(G)
        rule G = peek(S, -1) > ?k | not G
    """,
    "numbers and bounds": """
        action A : [-1, 1] safe 0 = ?(k in [3, 3]) + ?(l in [-1e30, 1e300] = 5) * R
        rule R = -3.5 | -?k | -(-2) | R - R - R | R / (R / 3)
               | (if R < 0 then 1 else R) * 2 | (let x = R in x * x) - 1
    """,
}
"""Names that would clash if expansion were careless."""


def random_expansion(sketch: Sketch, rng: random.Random, depth: int = 4) -> Expansion:
    """Choices at random; from `depth` rules down such as call the fewest rules."""
    return expand(
        sketch,
        tuple(Derivation(0, _random_choices(sketch, b, rng, depth)) for b in sketch.bodies),
    )


def _random_choices(
    sketch: Sketch, term: Term, rng: random.Random, depth: int
) -> tuple[Derivation, ...]:
    chosen = []
    for call in calls(term):
        alternatives = sketch.rule(call.rule).alternatives
        numbers = list(range(len(alternatives)))
        if depth <= 0:
            fewest = min(len(calls(alternative)) for alternative in alternatives)
            numbers = [n for n in numbers if len(calls(alternatives[n])) == fewest]
        number = rng.choice(numbers)
        below = _random_choices(sketch, alternatives[number], rng, depth - 1)
        chosen.append(Derivation(number, below))
    return tuple(chosen)
