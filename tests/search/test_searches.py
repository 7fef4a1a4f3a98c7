"""All searches: known maxima, limits, seeds, places without a number, cost, and misuse."""

from __future__ import annotations

import random
import re
import sys

import numpy as np
import pytest
from landscapes import CENTERS, Heard, Recorded, box, hills, result, ridge, waves
from scipy import optimize
from searches import ALL, DIFFERENTIAL, GENETIC, PLAIN, POPULATIONS, each

from aleator.core.types import Array
from aleator.errors import AleatorError, InputsError
from aleator.laws import Hyperparameter
from aleator.search import (
    CMAES,
    CustomSearch,
    DifferentialEvolution,
    GeneticAlgorithm,
    GradientMultistart,
    objective_of,
)
from aleator.search.interface import LogLikelihood
from reproduction.trials import TracedObjective, compare

# ------------------------------------------------------------------------------ the maximum


@each(ALL)
def test_the_end_of_a_curved_ridge_is_found(search) -> None:
    found = search.maximize(ridge, box(), seed=0)
    assert found.log_likelihood == pytest.approx(0.0, abs=1e-5)
    assert found.alpha == pytest.approx([1.0, 1.0], abs=5e-3)
    assert found.converged


@each(PLAIN[:3])
def test_without_a_polish_the_end_of_the_ridge_is_near(search) -> None:
    """The level that the search's own convergence test promises, 0.01."""
    found = search.maximize(ridge, box(), seed=0)
    assert -0.01 < found.log_likelihood <= 0.0


@each([GradientMultistart(10), *POPULATIONS])
def test_the_highest_of_three_hills_is_found_for_most_seeds(search) -> None:
    """A hill takes two hundredths of the box: a population may overlook it."""
    ends = [search.maximize(hills, box(), seed=seed) for seed in range(4)]
    there = [end for end in ends if end.log_likelihood > np.log(1.6) - 0.01]
    assert len(there) >= 3
    for end in there:
        assert end.log_likelihood == pytest.approx(np.log(1.6), abs=1e-6)
        assert end.alpha == pytest.approx([2.5, 1.5], abs=1e-3)


@each([GENETIC, DIFFERENTIAL])
def test_populations_find_the_highest_of_a_hundred_waves(search) -> None:
    for seed in range(3):
        found = search.maximize(waves, box(), seed=seed)
        assert found.alpha == pytest.approx([0.0, 0.0], abs=1e-5)


def test_runs_of_cma_es_that_end_on_two_hills_are_two_optima() -> None:
    guesses = [CENTERS[0] + 0.3, CENTERS[0] - 0.3, CENTERS[1] + 0.3]
    found = CMAES(runs=4, step=0.03).maximize(hills, box(start=2.0), seed=0, guesses=guesses)
    assert found.optima[0].alpha == pytest.approx([2.5, 1.5], abs=1e-3)
    assert [o.log_likelihood for o in found.optima[:2]] == pytest.approx(
        [np.log(1.6), 0.0], abs=1e-6
    )
    assert found.optima[1].starts >= 2
    assert sum(o.starts for o in found.optima) == len(found.ascents) == 4


# ------------------------------------------------------------------------------ limits


@each([*ALL, *PLAIN])
def test_every_alpha_lies_within_the_limits_and_the_best_may_lie_on_them(search) -> None:
    limits = [
        Hyperparameter("a", -1.0, 0.5, 0.2, free=True),
        Hyperparameter("known", 7.0, 7.0, 7.0, free=False),
        Hyperparameter("b", 0.01, 2.0, 1.0, free=True, log=True),
    ]
    objective = Recorded(lambda alpha: padded(ridge(alpha[[0, 2]])))
    found = search.maximize(objective, limits, seed=0)
    asked = np.array(objective.asked)
    assert np.all(asked[:, 1] == 7.0)
    assert np.all((asked[:, 0] >= -1.0) & (asked[:, 0] <= 0.5))
    assert np.all((asked[:, 2] >= 0.01) & (asked[:, 2] <= 2.0))
    # for every a the best b is a^2, so that the maximum has a = 0.5
    assert found.alpha == pytest.approx([0.5, 7.0, 0.25], abs=0.02)
    assert found.log_likelihood == pytest.approx(-0.25, abs=0.01)


def padded(value: LogLikelihood) -> LogLikelihood:
    """With a zero in the score for the known hyperparameter in the middle."""
    assert value.scores is not None
    return LogLikelihood(value.each, np.insert(value.scores, 1, 0.0, axis=1), value.status)


@each([*ALL, *PLAIN])
def test_nothing_to_search_is_one_evaluation(search) -> None:
    fixed = [Hyperparameter(n, 1.0, 1.0, 1.0, free=False) for n in "ab"]
    objective = Recorded(ridge)
    found = search.maximize(objective, fixed, seed=0)
    assert found.alpha.tolist() == [1.0, 1.0]
    assert found.evaluations == len(objective.asked) == 1
    assert found.converged


@each([*ALL, *PLAIN])
def test_one_free_hyperparameter_is_enough(search) -> None:
    limits = [box()[0], Hyperparameter("b", 4.0, 4.0, 4.0, free=False)]
    found = search.maximize(ridge, limits, seed=0)
    # the other maximum, near a = -2, is lower
    exact = optimize.minimize_scalar(
        lambda a: -ridge(np.array([a, 4.0])).total, bounds=(1.5, 2.5), method="bounded",
        options={"xatol": 1e-12},
    )  # fmt: skip
    assert found.log_likelihood == pytest.approx(-exact.fun, abs=0.01)
    assert found.alpha[0] == pytest.approx(exact.x, abs=0.01)


# ------------------------------------------------------------------------------ seeds


@each([*ALL, *PLAIN])
def test_the_same_seed_asks_and_finds_the_same_and_no_global_state_is_touched(search) -> None:
    np.random.seed(5)  # noqa: NPY002
    random.seed(5)
    before, plain = np.random.get_state(), random.getstate()  # noqa: NPY002
    one, two = Recorded(hills), Recorded(hills)
    first = search.maximize(one, box(), seed=3)
    second = search.maximize(two, box(), seed=3)
    np.testing.assert_array_equal(one.asked, two.asked)
    np.testing.assert_array_equal(first.alpha, second.alpha)
    after = np.random.get_state()  # noqa: NPY002
    assert before[0] == after[0]
    np.testing.assert_array_equal(before[1], after[1])
    assert before[2:] == after[2:]
    assert plain == random.getstate()


@each([GradientMultistart(6), DIFFERENTIAL])
def test_another_seed_asks_elsewhere(search) -> None:
    one, two = Recorded(waves), Recorded(waves)
    search.maximize(one, box(), seed=3)
    search.maximize(two, box(), seed=4)
    assert not np.array_equal(one.asked[-20:], two.asked[-20:])


# ------------------------------------------------------------------------------ no numbers


def half_blind(alpha: Array) -> LogLikelihood:
    """The ridge, but no number where a + b > 3 or a < -3, with the warnings of such places."""
    if alpha[0] + alpha[1] > 3.0:
        return result(float(np.log(np.float64(-1.0))), np.full(2, np.nan))
    if alpha[0] < -3.0:
        return result(float(-1.0 / np.float64(0.0)), np.zeros(2))
    return ridge(alpha)


@each(ALL)
def test_places_without_a_number_warn_not_and_are_left(search) -> None:
    # its own start lies where there is no number
    found = search.maximize(half_blind, box(), seed=0, guesses=[np.array([-1.0, 2.0])])
    assert found.log_likelihood == pytest.approx(0.0, abs=1e-4)


def blind(alpha: Array) -> LogLikelihood:
    return result(float("nan"), np.full(alpha.size, np.nan))


@each([*ALL, *PLAIN])
def test_no_number_anywhere_is_refused_and_names_the_wide_limits(search) -> None:
    limits = [box()[0], Hyperparameter("far", -1e12, 1e12, 0.0, free=True)]
    with pytest.raises(InputsError) as caught:
        search.maximize(blind, limits, seed=0)
    assert "far" in caught.value.problem
    assert "far" in caught.value.remedy


def test_without_wide_limits_the_refusal_names_all_that_is_searched() -> None:
    with pytest.raises(InputsError) as caught:
        DIFFERENTIAL.maximize(blind, box(), seed=0)
    assert "orders" not in caught.value.problem
    assert "a, b" in caught.value.remedy


@pytest.mark.parametrize("width", [1e3, 1e9, 1e15])
def test_a_guess_in_wide_limits_is_climbed_from(width) -> None:
    limits = [Hyperparameter(n, -width, width, 0.3 * width, free=True) for n in "ab"]
    found = GradientMultistart(8, evaluations=200).maximize(
        ridge, limits, seed=0, guesses=[np.array([0.5, 0.4])]
    )
    assert found.alpha == pytest.approx([1.0, 1.0], abs=1e-2)


# ------------------------------------------------------------------------------ what it costs


@each(PLAIN[:3])
def test_a_plain_population_asks_for_values_in_batches_and_for_no_score(search) -> None:
    objective = Recorded(hills)
    found = search.maximize(objective, box(), seed=0)
    # CMA-ES takes the scores of its distinct ends to tell them apart
    assert objective.scored == (len(found.optima) if isinstance(search, CMAES) else 0)
    assert found.evaluations == sum(objective.batches)
    smallest = 6 if isinstance(search, CMAES) else 40
    assert np.mean(objective.batches) >= smallest


def test_a_genetic_search_takes_no_more_than_its_generations() -> None:
    search = GeneticAlgorithm(population=20, generations=7, patience=100, polish=False)
    objective = Recorded(waves)
    found = search.maximize(objective, box(), seed=0)
    assert found.evaluations == len(objective.asked) <= 7 * 20
    assert not found.converged


def test_differential_evolution_takes_no_more_than_its_generations() -> None:
    objective = Recorded(waves)
    found = DifferentialEvolution(20, 7, polish=False).maximize(objective, box(), seed=0)
    assert found.evaluations == len(objective.asked) == 7 * 20
    assert not found.converged


def test_a_run_of_cma_es_takes_no_more_than_its_evaluations_and_one_population() -> None:
    found = CMAES(runs=2, evaluations=30, population=8, polish=False).maximize(ridge, box(), seed=0)
    assert all(30 <= ascent.evaluations <= 38 for ascent in found.ascents)
    assert not found.converged


@each(POPULATIONS)
def test_start_and_guesses_are_the_first_to_be_asked(search) -> None:
    objective, guess = Recorded(waves), np.array([-3.25, 2.75])
    search.maximize(objective, box(), seed=0, guesses=[guess])
    if isinstance(search, CMAES):
        # its runs begin around them
        found = search.maximize(waves, box(), seed=0, guesses=[guess])
        starts = [ascent.start for ascent in found.ascents[:2]]
    else:
        starts = objective.asked[:2]
    np.testing.assert_allclose(starts, [[4.0, 4.0], guess], rtol=1e-12)


# ------------------------------------------------------------------------------ progress


@each(ALL)
def test_progress_goes_forward_to_its_total(search) -> None:
    heard = Heard()
    found = search.maximize(ridge, box(), seed=0, progress=heard)
    assert heard.updates
    assert f"{found.log_likelihood:.2f}" in heard.updates[-1][0] or (found.log_likelihood > -0.01)
    done = [d for _, d, _ in heard.updates if d is not None]
    assert done == sorted(done)
    assert all(d <= t for _, d, t in heard.updates if d is not None and t is not None)


@each([*ALL, *PLAIN])
def test_ctrl_c_passes_through(search) -> None:
    calls = 0

    def interrupted(alpha: Array) -> LogLikelihood:
        nonlocal calls
        calls += 1
        if calls > 30:
            raise KeyboardInterrupt
        return ridge(alpha)

    with pytest.raises(KeyboardInterrupt):
        search.maximize(interrupted, box(), seed=0)
    assert calls == 31


@each(ALL)
def test_the_trace_rises_to_the_answer(search) -> None:
    traced = TracedObjective(hills)
    found = search.maximize(traced, box(), seed=0)
    values = [step.log_likelihood for step in traced.trace]
    counts = [step.evaluations for step in traced.trace]
    seconds = [step.seconds for step in traced.trace]
    assert values == sorted(values)
    assert counts == sorted(counts)
    assert seconds == sorted(seconds)
    assert values[-1] == found.log_likelihood
    assert counts[-1] <= found.evaluations


# ------------------------------------------------------------------------------ comparison


def test_a_comparison_counts_what_was_asked() -> None:
    objective = Recorded(hills)
    trials = compare([GENETIC, GradientMultistart(5)], objective, box(), seed=0)
    assert [t.name for t in trials] == ["genetic(40)", "gradient_multistart(5)"]
    assert sum(t.evaluations for t in trials) == len(objective.asked)
    assert sum(t.scored for t in trials) == objective.scored
    for trial in trials:
        close = trial.reached(np.log(1.6) - 0.01)
        closer = trial.reached(np.log(1.6) - 1e-4)
        assert close is not None
        assert closer is not None
        assert close.evaluations <= closer.evaluations <= trial.evaluations
        assert close.seconds <= closer.seconds <= trial.seconds
        assert trial.reached(1.0) is None


def test_a_plain_function_is_an_objective() -> None:
    alphas = np.array([[0.0, 0.0], [1.0, 1.0]])
    np.testing.assert_allclose(objective_of(ridge).values(alphas), [-1.0, 0.0])
    recorded = Recorded(ridge)
    assert objective_of(recorded) is recorded


# ------------------------------------------------------------------------------ extras


@pytest.mark.parametrize(("make", "package"), [(GeneticAlgorithm, "pymoo"), (CMAES, "cma")])
def test_a_missing_package_is_named_with_its_remedy(make, package, monkeypatch) -> None:
    for name in [n for n in sys.modules if n.split(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(AleatorError, match=package) as caught:
        make()
    assert f"pip install {package}" in caught.value.remedy
    # the others do without
    assert DIFFERENTIAL.maximize(ridge, box(), seed=0).converged


@pytest.mark.parametrize(
    "make",
    [
        lambda: GeneticAlgorithm(population=3),
        lambda: GeneticAlgorithm(generations=0),
        lambda: GeneticAlgorithm(patience=0),
        lambda: DifferentialEvolution(population=4),
        lambda: DifferentialEvolution(generations=0),
        lambda: CMAES(runs=0),
        lambda: CMAES(evaluations=0),
        lambda: CMAES(population=3),
        lambda: CMAES(step=0.0),
        lambda: CMAES(step=float("nan")),
        lambda: compare([], ridge, box(), seed=0),
    ],
)
def test_misuse_has_a_remedy(make) -> None:
    with pytest.raises(InputsError) as caught:
        make()
    assert caught.value.remedy


# ------------------------------------------------------------------------------ a user's own


@pytest.mark.parametrize("returned", [None, "best", [1.0], [np.nan, 1.0], [9.0, 1.0], [[1.0, 1.0]]])
def test_a_custom_search_must_return_alpha_within_the_limits(returned) -> None:
    search = CustomSearch(lambda *_: returned)
    with pytest.raises(InputsError, match=re.escape(repr(returned))):
        search.maximize(ridge, box(), seed=0)


def test_a_custom_search_starts_at_the_best_guess_and_keeps_the_best_it_met() -> None:
    seen = {}

    def careless(value, lower, upper, start, rng) -> Array:
        seen.update(start=start.copy(), lower=lower, upper=upper, draw=rng.random())
        value(np.array([1.0, 1.0]))
        return lower

    search = CustomSearch(careless, polish=False, name="careless")
    guesses = [np.array([-4.0, 0.0]), np.array([1.1, 1.2])]
    found = search.maximize(ridge, box(), seed=7, guesses=guesses)
    assert seen["start"].tolist() == [1.1, 1.2]
    assert seen["lower"].tolist() == [-5.0, -5.0]
    assert seen["upper"].tolist() == [5.0, 5.0]
    assert seen["draw"] == np.random.default_rng(7).random()
    assert found.alpha.tolist() == [1.0, 1.0]
    assert found.log_likelihood == 0.0


@pytest.mark.parametrize(
    "function",
    [
        lambda value, lower, upper, start: start,  # noqa: ARG005
        lambda value, *, start, rng, lower, upper: start,  # noqa: ARG005
        lambda value, lower, upper, start, rng, more: start,  # noqa: ARG005
        "nelder-mead",
    ],
)
def test_a_custom_search_that_takes_other_arguments_is_refused_with_those_it_gets(function) -> None:
    with pytest.raises(InputsError) as caught:
        CustomSearch(function)
    assert "(value, lower, upper, start, rng)" in caught.value.remedy
