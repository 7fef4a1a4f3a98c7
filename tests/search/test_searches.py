"""All searches: known maxima, limits, seeds, and places without a number."""

from __future__ import annotations

import random

import numpy as np
import pytest
from landscapes import CENTERS, Recorded, box, hills, result, ridge, waves
from scipy import optimize
from searches import ALL, DIFFERENTIAL, GENETIC, PLAIN, POPULATIONS, each

from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.laws import Hyperparameter
from aleator.search import (
    CMAES,
    GradientMultistart,
)
from aleator.search.interface import LogLikelihood

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
    ends = [search.maximize(hills, box(), seed=seed) for seed in range(8)]
    there = [end for end in ends if end.log_likelihood > np.log(1.6) - 0.01]
    assert len(there) >= 6
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


@each([GradientMultistart(6), *POPULATIONS])
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
