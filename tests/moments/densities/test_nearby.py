"""Densities that are sought from those of other moments: the same, whatever is known."""

from __future__ import annotations

import numpy as np
import pytest
from moments.densities.targets import stacked, standardized_of
from problems import REGRESSION
from scipy import stats

from aleator import MaximumEntropy
from aleator.moments.densities.maximum_entropy import FittedMaximumEntropy, nearby
from aleator.moments.densities.maximum_entropy.dual import Expectations, expectations
from aleator.moments.densities.maximum_entropy.legendre import Rule, gauss_rule, legendre_in_powers
from aleator.moments.densities.maximum_entropy.nearby import follow, predicted
from aleator.moments.densities.moments import Moments
from aleator.moments.likelihood import Continued
from aleator.types import Array


def skewed(shapes: Array, order: int) -> Moments:
    """Moments of beta laws with these shapes, seen on their own range."""
    return stacked(
        [standardized_of(stats.beta(k, 3.0).pdf, 0.0, 1.0, order) for k in shapes.tolist()]
    )


@pytest.mark.parametrize("order", [2, 4, 6])
@pytest.mark.parametrize("far", [1e-6, 0.02, 0.3, 3.0])
def test_what_is_known_changes_nothing_but_the_way(order: int, far: float) -> None:
    choice, shapes = MaximumEntropy(order), np.linspace(2.0, 6.0, 15)
    known = choice.fit(skewed(shapes, order), 0.0, 1.0)
    moved = skewed(shapes + far * np.linspace(-0.5, 1.0, 15), order)
    cold, near = choice.fit(moved, 0.0, 1.0), choice.fit_near(moved, 0.0, 1.0, known)
    assert np.array_equal(cold.status, near.status)
    y = np.linspace(0.02, 0.98, 25) * np.ones((15, 1))
    np.testing.assert_allclose(near.log_pdf(y), cold.log_pdf(y), atol=1e-7)
    np.testing.assert_allclose(near.cdf(y), cold.cdf(y), atol=1e-9)
    assert near.solution.residual.max() < 1e-8


def test_moments_that_no_density_has_stay_a_failure_and_spoil_no_neighbour() -> None:
    choice, shapes = MaximumEntropy(4), np.linspace(2.0, 4.0, 5)
    known = choice.fit(skewed(shapes, 4), 0.0, 1.0)
    moved = skewed(shapes + 0.05, 4)
    moved.standardized[2, 4] = 1.0 + moved.standardized[2, 3] ** 2 - 0.1  # Pearson's limit
    cold, near = choice.fit(moved, 0.0, 1.0), choice.fit_near(moved, 0.0, 1.0, known)
    assert cold.status[2] != 0
    assert np.array_equal(cold.status, near.status)
    # and a failure that is known is no start
    again = choice.fit_near(skewed(shapes, 4), 0.0, 1.0, near)
    y = np.full((5, 1), 0.4)
    np.testing.assert_allclose(again.log_pdf(y), known.log_pdf(y), atol=1e-7)


def on_the_line(moments: Moments) -> FittedMaximumEntropy:
    return MaximumEntropy(4).fit(moments, -np.inf, np.inf)


def light(skewness: float) -> Moments:
    """Standardized moments of something flatter than the normal law, on the whole line."""
    return Moments(np.zeros(1), np.ones(1), np.array([[1.0, 0.0, 1.0, skewness, 2.7]]))


def test_a_prediction_misses_by_the_square_of_the_distance() -> None:
    known = on_the_line(light(0.1)).solution
    errors = []
    for far in (0.02, 0.04):
        exact = on_the_line(light(0.1 + far)).solution
        change = exact.standardized - known.standardized
        in_powers = legendre_in_powers(exact.a, exact.b, 4)
        guess = predicted(known.exponent, known.powers, change, in_powers)
        errors.append(np.abs(guess - exact.multipliers).max())
    assert errors[1] / errors[0] == pytest.approx(4.0, rel=0.2)


def test_few_passes_lead_to_what_is_near(monkeypatch: pytest.MonkeyPatch) -> None:
    known, passes = on_the_line(light(0.1)), list[int]()

    def counted(multipliers: Array, rule: Rule) -> Expectations:
        passes.append(len(multipliers))
        return expectations(multipliers, rule)

    monkeypatch.setattr(nearby, "expectations", counted)
    MaximumEntropy(4).fit_near(light(0.12), -np.inf, np.inf, known)
    assert len(passes) <= 4


def test_a_start_that_is_far_is_given_up() -> None:
    target = np.tile(on_the_line(light(0.1)).solution.mean, (2, 1))
    start = np.array([[np.nan] * 4, [30.0, -20.0, 5.0, 40.0]])
    assert not follow(target, start, gauss_rule(4, 200))[1].any()


def test_a_search_sees_the_same_wherever_it_was_before() -> None:
    """Alphas of a linear simulator in two parameters, near and far, there and back."""
    y = REGRESSION.draw(3)
    likelihood = REGRESSION.likelihood(y, MaximumEntropy(4))
    rng = np.random.default_rng(2)
    alphas = REGRESSION.alpha * np.exp(0.3 * rng.standard_normal((12, REGRESSION.alpha.size)))
    objective = Continued(likelihood)
    there = [objective(alpha) for alpha in alphas]
    back = [objective(alpha) for alpha in alphas[::-1]][::-1]
    for alpha, *seen in zip(alphas, there, back, strict=True):
        fresh = Continued(likelihood)(alpha)
        for found in seen:
            np.testing.assert_allclose(found.each, fresh.each, atol=1e-7)
            np.testing.assert_allclose(found.scores, fresh.scores, rtol=1e-6, atol=1e-6)
