"""Likelihoods by level sets against closed forms: lines, kinks, jumps, two roots, correlation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from aleator import Constant, Free, Inputs, LogNormal, Mixture, Normal, TruncatedNormal, Uniform
from aleator.likelihood.level_sets import LevelLikelihood, on_a_grid, traceable
from aleator.likelihood.level_sets.grid import Grid
from aleator.simulators.response_functions import DirectResponse

Array = NDArray[np.float64]
LOADS = np.array([0.5, 1.0, 1.5, 2.0])
ONE = Inputs({"a": Normal(Free(-1.0, 3.0), Free(0.01, 1.0))})
TWO = Inputs(
    {"a": Normal(Free(-1.0, 3.0), Free(0.01, 1.0)), "b": Normal(Free(-1.0, 3.0), Free(0.01, 1.0))}
)
TIED = Inputs(TWO.laws, {("a", "b"): Free(-0.9, 0.9)})


def likelihood(
    inputs: Inputs, outcome: Callable[..., Array], y: Array, cells: int, each: Array | None = None
) -> LevelLikelihood:
    condition = np.arange(len(y)) if each is None else each
    response = DirectResponse(
        lambda index, x: outcome(LOADS[index], *x.T), int(condition.max()) + 1, inputs.box
    )
    return LevelLikelihood(inputs, response, inputs.box, condition, y, cells)


def test_one_parameter_with_a_jump_has_the_density_of_both_branches() -> None:
    """y = c a below 1 and c a + 1 above it."""
    y = np.array([0.4, 2.3, 2.9, 1.2])
    alpha = np.array([1.1, 0.3])
    found = likelihood(ONE, lambda c, a: c * a + (a > 1.0), y, 8192)(alpha)
    low, high = y / LOADS, (y - 1.0) / LOADS
    density = stats.norm.pdf(low, *alpha) * (low < 1.0) + stats.norm.pdf(high, *alpha) * (high > 1)
    np.testing.assert_allclose(found.each, np.log(density / LOADS), atol=1e-3)
    scores = np.where(low < 1.0, low, high)
    np.testing.assert_allclose(found.scores[:, 0], (scores - 1.1) / 0.09, atol=0.02)


def test_one_parameter_with_two_roots_adds_them() -> None:
    y = np.array([0.3, 0.1, 0.7, 0.2])
    found = likelihood(ONE, lambda c, a: np.abs(a - c), y, 8192).evaluate(np.array([1.0, 0.4]))
    both = stats.norm.pdf(LOADS + y, 1.0, 0.4) + stats.norm.pdf(LOADS - y, 1.0, 0.4)
    np.testing.assert_allclose(found.each, np.log(both), atol=1e-5)


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_two_parameters_that_enter_linearly_are_normal(rho: float) -> None:
    y = np.array([1.0, 2.2, 2.6, 2.9])
    inputs, alpha = (TIED, np.array([1.0, 0.3, 0.8, 0.2, rho])) if rho else (TWO, None)
    alpha = np.array([1.0, 0.3, 0.8, 0.2]) if alpha is None else alpha
    found = likelihood(inputs, lambda c, a, b: c * a + b, y, 256).evaluate(alpha)
    sd = np.sqrt((LOADS * 0.3) ** 2 + 0.2**2 + 2.0 * rho * LOADS * 0.3 * 0.2)
    exact = stats.norm.logpdf(y, LOADS + 0.8, sd)
    np.testing.assert_allclose(found.each, exact, atol=2e-3)


def test_two_parameters_with_a_kink_against_an_integral_over_the_other() -> None:
    """y = |a - c| + b c: b = (y - |a - c|)/c, integrated over a on its own grid."""
    y, (mean, sd, middle, width) = np.array([0.6, 1.2, 1.7, 2.3]), (1.0, 0.25, 1.0, 0.1)
    alpha = np.array([mean, sd, middle, width])
    found = likelihood(TWO, lambda c, a, b: np.abs(a - c) + b * c, y, 256).evaluate(alpha)
    a = np.linspace(mean - 8.0 * sd, mean + 8.0 * sd, 200_001)[:, None]
    b = (y - np.abs(a - LOADS)) / LOADS
    inner = stats.norm.pdf(a, mean, sd) * stats.norm.pdf(b, middle, width) / LOADS
    exact = np.log(np.trapezoid(inner, a[:, 0], axis=0))
    np.testing.assert_allclose(found.each, exact, atol=5e-3)


def test_the_error_falls_with_the_size_of_the_cells() -> None:
    """Against y = a exp(b c) integrated over b, where a = y exp(-b c)."""
    y, b = np.array([1.1, 2.7, 3.4, 6.0]), 0.8 + 0.3 * np.linspace(-9.0, 9.0, 20_001)
    factor = np.exp(-np.outer(LOADS, b))
    inner = stats.norm.pdf(y[:, None] * factor, 1.0, 0.4) * factor * stats.norm.pdf(b, 0.8, 0.3)
    exact = np.log(np.trapezoid(inner, b, axis=1))
    alpha = np.array([1.0, 0.4, 0.8, 0.3])
    for cells in (32, 64, 128, 256):
        of = likelihood(TWO, lambda c, a, b: a * np.exp(b * c), y, cells)
        np.testing.assert_allclose(of.evaluate(alpha).each, exact, atol=4e-3 * (64 / cells))


def test_scores_are_derivatives_of_the_values() -> None:
    y, alpha = np.array([0.6, 1.2, 1.7, 2.3]), np.array([1.0, 0.25, 1.0, 0.1, 0.3])
    of = likelihood(TIED, lambda c, a, b: np.abs(a - c) + b * c, y, 128)
    scores = of(alpha).scores
    for k in range(alpha.size):
        step = 1e-4 * np.eye(alpha.size)[k]
        slope = (of.evaluate(alpha + step).each - of.evaluate(alpha - step).each) / 2e-4
        np.testing.assert_allclose(scores[:, k], slope, rtol=1e-4, atol=1e-5)


def test_a_narrow_law_has_a_grid_of_its_own() -> None:
    """sd = 0.01 on a box of 4: a hundredth of a cell's accuracy would be lost on the first grid."""
    y = LOADS * 1.003
    of = likelihood(ONE, lambda c, a: c * a, y, 64)
    exact = stats.norm.logpdf(y, LOADS, 0.01 * LOADS).sum()
    assert of.evaluate(np.array([1.0, 0.01])).likelihood == pytest.approx(exact, abs=1e-6)
    two = likelihood(TWO, lambda c, a, b: c * a + b, np.array([1.5, 2.0, 2.5, 3.0]) + 0.01, 128)
    narrow = np.array([1.0, 0.01, 1.0, 0.02])
    sd = np.hypot(0.01 * LOADS, 0.02)
    exact = stats.norm.logpdf(0.01, 0.0, sd).sum()
    assert two.evaluate(narrow).likelihood == pytest.approx(exact, abs=0.02)


def test_the_information_is_exact_where_one_law_is_very_narrow() -> None:
    """y = c exp(a) + b: a = log((y - b)/c), integrated over b by the nodes of its own law."""
    alpha, width = np.array([1.0, 0.08, 0.7, 0.002]), np.array([0.08, 0.08, 0.002, 0.002])
    y = LOADS * np.exp([1.05, 0.93, 1.08, 0.98]) + 0.7
    z, weight = np.polynomial.hermite_e.hermegauss(60)

    def exact(alpha: Array) -> float:
        rest = y[:, None] - (alpha[2] + alpha[3] * z)
        inner = stats.norm.pdf(np.log(rest / LOADS[:, None]), alpha[0], alpha[1]) / rest
        return float(np.log(inner @ weight / np.sqrt(2.0 * np.pi)).sum())

    of = likelihood(TWO, lambda c, a, b: c * np.exp(a) + b, y, 64)
    assert of.evaluate(alpha).likelihood == pytest.approx(exact(alpha), abs=1e-3)
    steps = 1e-2 * np.diag(width)
    for k, step in enumerate(steps):
        slope = (of(alpha + step).score - of(alpha - step).score) / (2.0 * step[k])
        for i, other in enumerate(steps):
            ends = [exact(alpha + a * step + b * other) for a in (1, -1) for b in (1, -1)]
            second = (ends[0] - ends[1] - ends[2] + ends[3]) / (4.0 * step[k] * other[i])
            # in the metric of the two laws' widths
            assert slope[i] * width[k] * width[i] == pytest.approx(
                second * width[k] * width[i], abs=0.003
            )


def test_the_score_at_the_limit_of_a_share_is_that_from_inside() -> None:
    """A share has the limit 0.999999: a step beyond it would leave the range of all laws."""
    law = Normal(Free(-1.0, 3.0), Free(0.01, 1.0))
    inputs, y = Inputs({"a": Mixture((law, law))}), LOADS * [0.9, 1.2, 1.0, 0.8]
    (k,) = (i for i, h in enumerate(inputs.hyperparameters) if h.name == "a.1.share")
    alpha = np.insert([1.0, 0.3, 2.0, 0.3], k, inputs.hyperparameters[k].upper)
    found = likelihood(inputs, lambda c, a: c * a, y, 1024)(alpha)
    one, two = (stats.norm.pdf(y / LOADS, mean, 0.3) for mean in (1.0, 2.0))
    np.testing.assert_allclose(found.scores[:, k], 1.0 - two / one, rtol=1e-3)


def test_equal_conditions_share_runs_and_parts_are_parts() -> None:
    calls: list[int] = []

    def counted(c: Array, a: Array) -> Array:
        calls.append(a.size)
        return c * a

    each, y = np.array([0, 0, 2, 2, 3]), np.array([0.4, 0.6, 1.4, 1.7, 2.2])
    of = likelihood(ONE, counted, y, 1024, each)
    assert not of.unreached.any()
    assert sum(calls) == 4 * 1025
    alpha = np.array([1.0, 0.3])
    rows = np.array([1, 3, 4])
    np.testing.assert_allclose(of.take(rows)(alpha).each, of(alpha).each[rows])
    np.testing.assert_allclose(of.with_outcomes(y + 0.1)(alpha).each, likelihood(
        ONE, lambda c, a: c * a, y + 0.1, 1024, each)(alpha).each)  # fmt: skip


def test_an_outcome_that_is_never_reached_has_no_density() -> None:
    of = likelihood(ONE, lambda c, a: np.abs(c * a), np.array([0.4, -0.1, 1.0, 2.0]), 1024)
    found = of(np.array([1.0, 0.3]))
    assert found.status.tolist() == [0, 4, 0, 0]
    assert np.isfinite(found.total)
    assert np.all(found.scores[1] == 0.0)


def test_runs_that_fail_are_cells_without_a_set() -> None:
    def failing(c: Array, a: Array) -> Array:
        return np.where(a > 2.0, np.nan, c * a)

    y, alpha = LOADS * 1.0, np.array([1.0, 0.3])
    sound = likelihood(ONE, lambda c, a: c * a, y, 1024).evaluate(alpha)
    np.testing.assert_allclose(likelihood(ONE, failing, y, 1024).evaluate(alpha).each, sound.each)


def test_a_grid_serves_laws_inside_it_that_are_not_narrow() -> None:
    sides = (np.linspace(0.0, 10.0, 101),)
    response = DirectResponse(lambda _, x: x[:, 0], 1, np.array([[0.0, 10.0]]))
    grid = Grid(response, np.zeros(1, np.intp), (0,), sides, np.zeros(1), 0.002)
    marks = np.array([[-5.0, -3.0, -1.0, 1.0, 3.0, 5.0]])
    assert grid.serves(5.0 + 0.5 * marks)
    assert not grid.serves(5.0 + 0.4 * marks)
    assert not grid.serves(5.0 + 1.01 * marks)
    # a law that ends between two marks needs no cells beyond
    assert grid.serves(np.minimum(3.0 + 0.55 * marks, 4.65 + 1e-6 * marks))


def test_a_skewed_law_has_its_grid_where_its_mass_is() -> None:
    """A lognormal law whose standard deviation is its mean has a long tail."""
    inputs = Inputs({"a": LogNormal(Free(0.3, 4.0), Free(0.01, 4.0))})
    y, alpha = LOADS * 1.3, np.array([1.2, 1.2])
    log_sd = np.sqrt(np.log(2.0))
    exact = stats.lognorm.logpdf(1.3, log_sd, scale=1.2 / np.sqrt(2.0)) - np.log(LOADS)
    for cells in (128, 4096):
        found = likelihood(inputs, lambda c, a: c * a, y, cells).evaluate(alpha)
        np.testing.assert_allclose(found.each, exact, atol=1e-6)


def test_what_laws_can_be_traced() -> None:
    both = {
        "a": LogNormal(Free(0.1, 2.0), 0.2),
        "b": TruncatedNormal((0.0, 1.0), Free(0.1, 0.9), 0.1),
    }
    grids = [ONE, TIED, Inputs(both)]
    # the support of a uniform law moves; three parameters are too many for a grid
    lines = [
        Inputs({"a": Uniform(Free(0.0, 1.0), Free(0.1, 0.2))}),
        Inputs({**TWO.laws, "c": Normal(0.0, 1.0)}),
        Inputs({**TWO.laws, "k": Constant(Free(0.0, 1.0))}),
    ]
    assert all(traceable(inputs) for inputs in grids + lines)
    assert [on_a_grid(inputs) for inputs in grids + lines] == [True] * 3 + [False] * 3


def test_sets_are_looked_at_in_parts_that_change_nothing() -> None:
    y, alpha = np.array([1.0, 2.2, 2.6, 2.9]), np.array([1.0, 0.3, 0.8, 0.2])
    of = likelihood(TWO, lambda c, a, b: c * a + b, y, 64)
    whole, alone = of(alpha), of.evaluate(alpha).each
    parts = replace(of.sets(alpha), block=200)
    np.testing.assert_allclose(parts(alpha).each, whole.each, rtol=1e-12)
    np.testing.assert_allclose(parts(alpha).scores, whole.scores, rtol=1e-9)
    np.testing.assert_allclose(parts.evaluate(alpha).each, alone, rtol=1e-12)
