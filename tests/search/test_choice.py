"""Which optimiser a search takes: the one asked for, or the one that measures best."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pirlc.diagnostics import Diagnostic, PirlcError, render
from pirlc.frontend import parse_sketch
from pirlc.ir.policy import Environment
from pirlc.resources import explanations
from pirlc.search.choice import decide, require_suitable, with_optimizer, within
from pirlc.search.context import Search
from pirlc.search.imitation import Imitation, create_histories
from pirlc.search.journal import Budget, Journal
from pirlc.search.ndps import first_templates, initialize
from pirlc.search.neighbourhood import Neighbour
from pirlc.search.problems import LeftOut, NothingSuits, describe
from pirlc.search.settings import Choice, Settings
from pirlc.search.synthesis import Found, Plan, find_program
from pirlc.simulation.workers import ALONE, Workers
from pirlc.source import SourceText
from pirlc.tune.how import Optimizer, Tuning
from tests.search.sketches import sketch_of
from tests.support.small_search import SETTINGS, SHORT, ByHand, search_in

AUTO = replace(SETTINGS, optimizer=None, tuning=Tuning(trials=12))
CASADI, SMT, BAYES = Optimizer.CASADI, Optimizer.SMT, Optimizer.BAYES


# The decision, from mean distances.


@pytest.mark.parametrize(
    ("means", "taken", "why"),
    [
        ({CASADI: 0.10, SMT: 0.30, BAYES: 0.20}, CASADI, "the closest"),
        ({CASADI: 0.30, SMT: 0.10, BAYES: 0.20}, SMT, "the closest"),
        ({CASADI: 0.30, SMT: 0.20, BAYES: 0.10}, BAYES, "the closest"),
        # Within 2 %, or what 4,000 histories can tell.
        ({CASADI: 0.101, SMT: 0.3, BAYES: 0.1}, CASADI, "the fastest of those that come as close"),
        ({CASADI: 0.3, SMT: 0.109, BAYES: 0.1}, SMT, "the fastest of those that come as close"),
        ({CASADI: 0.3, SMT: 0.111, BAYES: 0.1}, BAYES, "the closest"),
        (
            {CASADI: 0.1, BAYES: 0.1},
            CASADI,
            "the closest, and the fastest of those that come as close",
        ),
        (
            {CASADI: 0.0},
            CASADI,
            "the fastest, and it leaves no distance that another could make up",
        ),
    ],
)
def test_the_closest_is_taken_and_of_equals_the_fastest(
    means: dict[Optimizer, float], taken: Optimizer, why: str
) -> None:
    assert decide(means, 4000) == (taken, why)


def test_what_counts_as_alike() -> None:
    assert within(0.5, 10**9) == 0.02 * 0.5
    assert within(0.1, 4000) == pytest.approx(1.96 * (0.1 * 0.9 / 4000) ** 0.5)
    assert within(0.0, 400) == 1 / 400
    # A distance over several actions can exceed 1.
    assert within(1.3, 400) == 0.02 * 1.3


# In a search.


@dataclass
class Told:
    """What a search told of its optimiser."""

    choices: list[Choice]
    warnings: list[Diagnostic]


def listened(search: Search) -> Told:
    told = Told([], [])
    search.tell_choice = told.choices.append
    search.warn = told.warnings.append
    return told


def test_the_optimiser_is_measured_told_and_used(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    journal = Journal(path, Budget(calls=1))
    run = search_in(journal, settings=AUTO)
    told = listened(run.search)
    objective = with_optimizer(run.search, create_histories(run.search, Noisy()))
    (choice,) = told.choices
    assert choice == run.search.choice
    assert choice.optimizer == objective.how.optimizer
    assert set(choice.means) >= {CASADI, BAYES}
    assert set(choice.seconds) == set(choice.means)
    parameters = [found.parameters for found in choice.measured]
    assert parameters == sorted(parameters) and len(parameters) == 3
    for optimizer, mean in choice.means.items():
        assert mean == pytest.approx(
            sum(found.distances[optimizer] for found in choice.measured) / 3
        )
    best = min(choice.means.values())
    assert choice.means[choice.optimizer] <= best + within(best, 400)
    # The comparison is no part of what a budget counts, and is not repeated.
    assert journal.used == 0
    journal.close()
    assert len(path.read_text().splitlines()) == 1
    again = search_in(Journal(path, Budget()), settings=AUTO)
    with_optimizer(again.search, create_histories(again.search, Noisy()))
    assert again.search.choice == replace(choice, seconds={})


@dataclass(frozen=True)
class Noisy(ByHand):
    """Not even the right template comes close."""

    def actions(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        law = np.sin(40.0 * observations.sum(axis=1))
        return (law > 0.0).astype(np.float64)[:, np.newaxis]


def test_the_number_of_workers_does_not_matter() -> None:
    choices = []
    for workers in (ALONE, Workers(2)):
        run = search_in(Journal(None, Budget()), settings=AUTO, workers=workers)
        with_optimizer(run.search, create_histories(run.search, Noisy()))
        assert run.search.choice is not None
        choices.append(replace(run.search.choice, seconds={}))
    assert choices[0] == choices[1]


def test_nothing_is_compared_where_nothing_is_left_to_gain() -> None:
    @dataclass(frozen=True)
    class Simple(ByHand):
        """What every template of the pool can do: push to where the pole leans."""

        def actions(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
            return (observations[:, 2] > 0.0).astype(np.float64)[:, np.newaxis]

    settings = replace(AUTO, pool=1)
    run = search_in(Journal(None, Budget()), settings=settings)
    with_optimizer(run.search, create_histories(run.search, Simple()))
    choice = run.search.choice
    assert choice is not None
    assert choice.optimizer is CASADI
    assert choice.why == "the fastest, and it leaves no distance that another could make up"
    assert set(choice.means) == set(choice.seconds) == {CASADI}


def searched(text: str, settings: Settings) -> Search:
    head = """policy p
    environment "CartPole-v1"
    sensor Angle : [-0.21, 0.21] = 2
    sensor Speed : [-3.5, 3.5] = 3
    """
    return Search(
        sketch_of(text, head),
        Environment("CartPole-v1"),
        settings,
        Journal(None, Budget()),
        ALONE,
        lambda _: None,
        lambda *_: None,
    )


def test_without_parameters_there_is_nothing_to_measure() -> None:
    search = searched("action A : {0, 1} = if peek(Angle, -1) > 0 then 1 else 0", AUTO)
    objective = with_optimizer(search, create_histories(search, ByHand()))
    assert search.choice == Choice(CASADI, "no template has parameters to find")
    assert objective.how.optimizer is CASADI


MANY = " + ".join(
    f"?k{i} * peek({'Angle' if i % 2 else 'Speed'}, -{i // 2 + 1})" for i in range(40)
)
LONG = f"window 20\naction A : {{0, 1}} = if {MANY} > 0 then 1 else 0"
SOME = f"""window 20
action A : {{0, 1}} = if Law > 0 then 1 else 0
rule Law = ?k * peek(Angle, -1) + ?l * peek(Speed, -1) | {MANY}
"""


def test_an_optimiser_that_can_take_nothing_is_refused() -> None:
    settings = replace(SETTINGS, optimizer=BAYES, largest=500)
    search = searched(LONG, settings)
    for refused in (
        lambda: require_suitable(search.sketch, settings),
        lambda: find_program(search, ByHand(), Plan()),
    ):
        with pytest.raises(PirlcError) as caught:
            refused()
        (found,) = caught.value.diagnostics
        assert render(found) == (
            "error[E0430]: `bayes` can take none of the sketch's 1 shortest templates\n"
            "  = note: 1 with more than 30 parameters\n"
            "  = help: `--optimizer casadi` takes every template; `--optimizer auto` takes the "
            "best that can"
        )
    require_suitable(search.sketch, replace(settings, optimizer=CASADI))
    require_suitable(search.sketch, replace(settings, optimizer=None))


def test_templates_that_it_cannot_take_are_left_out_and_told_once() -> None:
    tuning = Tuning(trials=12)
    settings = replace(SETTINGS, optimizer=BAYES, largest=500, tuning=tuning)
    search = searched(SOME, settings)
    told = listened(search)
    objective = with_optimizer(search, create_histories(search, ByHand()))
    assert search.choice == Choice(BAYES, "asked for")
    assert told.choices == []
    found = initialize(search, objective)
    assert len(search.pool) == 2
    assert {len(c.values) for _, c in search.met} == {2}
    assert len(found.values) == 2
    objective.tune(search, [], "again")
    initialize(search, objective)
    (warning,) = told.warnings
    assert render(warning) == (
        "warning[E0431]: `bayes` cannot take 1 of 2 templates, which are left out\n"
        "  = note: 1 with more than 30 parameters\n"
        "  = note: the same goes for templates met later\n"
        "  = help: `--optimizer casadi` takes every template; `--optimizer auto` takes the best "
        "that can"
    )


def test_one_that_can_take_few_templates_is_not_considered() -> None:
    search = searched(LONG, replace(AUTO, largest=500))
    with_optimizer(search, create_histories(search, ByHand()))
    choice = search.choice
    assert choice is not None
    assert BAYES not in choice.means


def test_reasons_are_counted_and_the_commonest_shown() -> None:
    reasons = ("a", "b", "b", "c", "c", "c", "d")
    assert describe(NothingSuits(SMT, reasons)).notes == ("3 with c", "2 with b", "1 with a")
    assert describe(LeftOut(SMT, reasons, 9)).notes[0] == "3 with c"


def test_budgets_are_part_of_what_a_tuning_is_known_by() -> None:
    run = search_in(Journal(None, Budget()))
    objective = create_histories(run.search, ByHand())
    assert isinstance(objective, Imitation)
    (problem,) = objective.problems(run.search, [neighbour(run.search)])
    hows = [
        Tuning(CASADI),
        Tuning(BAYES),
        Tuning(BAYES, trials=7),
        Tuning(BAYES, seconds=2.0),
        Tuning(SMT),
        Tuning(SMT, effort=1),
        Tuning(SMT, tolerance=0.5),
        Tuning(SMT, seconds=2.0),
    ]
    assert len({objective.key(run.search, problem, how) for how in hows}) == len(hows)
    # What an optimiser does not look at is no part of it.
    same = [Tuning(CASADI), Tuning(CASADI, trials=7), Tuning(CASADI, effort=1)]
    assert len({objective.key(run.search, problem, how) for how in same}) == 1


def neighbour(search: Search) -> Neighbour:
    return Neighbour(first_templates(search)[0], ())


def test_a_whole_search_with_bayes(tmp_path: Path) -> None:
    settings = replace(
        SETTINGS, optimizer=BAYES, tuning=Tuning(trials=12), pool=3, neighbours=2, iterations=1
    )
    path = tmp_path / "journal"
    plan = Plan(refine=False)
    found = []
    for _ in range(2):
        journal = Journal(path, Budget())
        run = search_in(journal, SHORT, settings)
        found.append(find_program(run.search, ByHand(), plan))
        journal.close()
        lines = path.read_bytes()
    assert isinstance(found[0], Found)
    assert found[0] == found[1]
    assert path.read_bytes() == lines
    assert found[0].program.mean > 8.0


def test_templates_without_an_answer_are_told_once() -> None:
    settings = replace(SETTINGS, optimizer=SMT, tuning=Tuning(effort=1), pool=3)
    run = search_in(Journal(None, Budget()), settings=settings)
    told = listened(run.search)
    objective = with_optimizer(run.search, create_histories(run.search, ByHand()))
    initialize(run.search, objective)
    initialize(run.search, objective)
    (warning,) = told.warnings
    assert render(warning) == (
        "warning[E0432]: `smt` has no answer for 3 templates (initialize)\n"
        "  = note: 3: z3 reached its limit before its first answer: these are the parameters to "
        "start from\n"
        "  = help: leave `--optimizer` out, or look at shorter programs with `--max-size`"
    )


@pytest.mark.parametrize("code", ["E0430", "E0431", "E0432"])
def test_each_code_has_a_page(code: str) -> None:
    page = (explanations() / f"{code}.md").read_text(encoding="utf-8")
    assert page.startswith(f"# {code}: ") and "## What to do" in page


def test_the_examples_of_the_page() -> None:
    page = (explanations() / "E0430.md").read_text(encoding="utf-8")
    wrong, right = re.findall(r"```pirl\n(.*?)```", page, re.DOTALL)
    settings = replace(SETTINGS, optimizer=SMT)
    with pytest.raises(PirlcError, match="E0430"):
        require_suitable(parse_sketch(SourceText("wrong", wrong)), settings)
    require_suitable(parse_sketch(SourceText("right", right)), settings)
