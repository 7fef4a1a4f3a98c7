"""Surfaces of two elements: exact at kinks that lie elsewhere in every experiment."""

import numpy as np
import pytest

from aleator.surrogates import ResponseSurface, Surface, build_surface
from aleator.surrogates.basis import products
from aleator.surrogates.crease import Borders, border_indices
from aleator.surrogates.elements import covariances, folded, residuals, with_slope
from aleator.surrogates.fit import Prior
from aleator.surrogates.points import spread
from aleator.types import Array, Indices

BOX = {n: np.tile([-1.0, 1.0], (n, 1)) for n in (1, 2, 3)}


def kinked(index: Indices, x: Array) -> Array:
    """A kink along an oblique line, elsewhere in every experiment."""
    g = x[:, 0] + 0.5 * x[:, -1] - 0.3 + 0.1 * index
    return np.cos(x[:, 0]) + 0.5 * x[:, -1] ** 2 + (1.0 + 0.3 * x[:, 0]) * np.maximum(g, 0.0)


def curved(index: Indices, x: Array) -> Array:
    """A kink along a parabola."""
    return np.maximum(x[:, 0] - 0.3 * x[:, 1] ** 2 - 0.1 * index, 0.0) + x[:, 0] * x[:, 1]


def smooth(index: Indices, x: Array) -> Array:
    return np.exp(0.5 * x[:, 0] + 0.1 * index) * np.cos(2.0 * x[:, -1])


def true_error(surface: Surface, function) -> Array:
    count, n = len(surface.error), len(surface.box)
    x = np.random.default_rng(3).uniform(-1.0, 1.0, (3000, n))
    truth = function(np.repeat(np.arange(count), len(x)), np.tile(x, (count, 1)))
    return np.sqrt(((surface.evaluate(x) - truth.reshape(count, -1)) ** 2).mean(axis=1))


def split(surface: Surface) -> set[int]:
    return {int(row) for crease in surface.creases for row in crease.members}


@pytest.mark.parametrize(("function", "n"), [(kinked, 1), (kinked, 2)])
def test_kinks_are_exact_with_few_runs(function, n: int) -> None:
    surface = build_surface(function, BOX[n], 4, ResponseSurface(tolerance=0.005))
    assert split(surface) == {0, 1, 2, 3}
    assert surface.converged.all()
    assert surface.runs.max() <= 80
    assert (true_error(surface, function) <= 0.005 * surface.scatter).all()


def test_a_curved_border_and_a_root_at_it_are_found() -> None:
    def root(index: Indices, x: Array) -> Array:
        return np.sqrt(np.maximum(x[:, 0] + 0.2, 0.0)) + 0.3 * x[:, 0] + index

    for function, n, power in ((curved, 2, 1.0), (root, 1, 0.5)):
        surface = build_surface(function, BOX[n], 1, ResponseSurface(tolerance=0.005))
        assert surface.creases[0].borders.power.tolist() == [power]
        assert surface.runs.max() <= 80
        assert (true_error(surface, function) <= 0.005 * surface.scatter).all()


def test_the_border_is_found_where_it_is() -> None:
    surface = build_surface(kinked, BOX[2], 3, ResponseSurface(tolerance=0.005))
    (crease,) = surface.creases
    along = np.linspace(-0.5, 0.5, 5)
    for place, row in enumerate(crease.members):
        border = np.column_stack([0.3 - 0.1 * row - 0.5 * along, along])
        level = crease.borders[np.array([place])].level(products(border_indices(2), border))
        assert np.abs(level).max() < 0.01


def test_a_smooth_outcome_stays_one_polynomial() -> None:
    for n in (1, 2):
        choice = ResponseSurface(tolerance=1e-4)
        surface = build_surface(smooth, BOX[n], 3, choice)
        assert not surface.creases
        assert surface.converged.all()


def test_only_the_experiments_with_a_kink_are_split() -> None:
    def some(index: Indices, x: Array) -> Array:
        return np.where(index % 2 == 1, kinked(index, x), smooth(index, x))

    surface = build_surface(some, BOX[2], 6, ResponseSurface(tolerance=0.005))
    assert split(surface) == {1, 3, 5}
    assert (true_error(surface, some) <= 0.005 * surface.scatter).all()


def test_all_ways_to_evaluate_agree_and_the_gradient_is_theirs() -> None:
    surface = build_surface(kinked, BOX[2], 4, ResponseSurface(tolerance=0.005))
    x = np.random.default_rng(0).uniform(-0.99, 0.99, (200, 2))
    value, slope = surface.evaluate_with_gradient(x)
    assert np.allclose(value, surface.evaluate(x), atol=1e-12)
    index = np.repeat(np.arange(4), len(x))
    assert np.allclose(surface.at(index, np.tile(x, (4, 1))), value.ravel(), atol=1e-12)
    step = 1e-6
    for i, e in enumerate(np.eye(2)):
        by_difference = (surface.evaluate(x + step * e) - surface.evaluate(x - step * e)) / 2 / step
        near = np.abs(surface.evaluate(x + step * e) + surface.evaluate(x - step * e) - 2 * value)
        away = near < 1e-8
        assert away.mean() > 0.99
        assert np.allclose(slope[:, :, i][away], by_difference[away], atol=1e-6)


def test_runs_that_fail_are_left_out_of_both_elements() -> None:
    def failing(index: Indices, x: Array) -> Array:
        return np.where(np.abs(x[:, 1] - 0.1) < 0.08, np.nan, kinked(index, x))

    surface = build_surface(failing, BOX[2], 3, ResponseSurface(tolerance=0.005))
    assert surface.failed.min() > 0
    assert split(surface) == {0, 1, 2}
    assert (true_error(surface, kinked) <= 0.01 * surface.scatter).all()


def test_derivatives_by_the_border_are_those_of_differences() -> None:
    z, borders = spread(25, 2), Borders(np.array([[-0.1, 0.5, 0.3, 0.05, 0.02, 0.01]]), np.ones(1))
    covariance = covariances(Prior((1.0, 1.0), 2.0, 2.5, 0.25), z)
    y = kinked(np.zeros(25, dtype=int), z)[None]
    basis = products(border_indices(2), z)
    change = borders.slope(basis)[:, :, None] * basis.T
    here, slope = with_slope(covariance, borders.factor(basis), change, y)
    assert np.allclose(here, residuals(covariance, borders.factor(basis), y))
    for t in range(6):
        moved = borders.border + 1e-6 * np.eye(6)[t]
        there = residuals(covariance, Borders(moved, borders.power).factor(basis), y)
        assert np.allclose((there - here) / 1e-6, slope[:, :, t], atol=1e-3)


def test_leave_one_out_residuals_are_those_of_surfaces_fitted_without_a_run() -> None:
    z, prior = spread(20, 1), Prior((1.0,), 2.0, 2.5, 0.0)
    y, borders = np.abs(z[:, 0] - 0.2)[None], Borders(np.array([[-0.2, 0.577, 0.0]]), np.ones(1))
    fit = folded(prior, z, y, borders)
    basis = products(border_indices(1), z)
    covariance = covariances(prior, z)
    assert np.allclose(residuals(covariance, borders.factor(basis), y).T, fit.judged.residual)
    full = np.linalg.inv(covariance.inverse(borders.factor(basis))[0])
    others = np.arange(20) != 7
    guess = full[7, others] @ np.linalg.solve(full[np.ix_(others, others)], y[0, others])
    assert y[0, 7] - guess == pytest.approx(fit.judged.residual[7, 0], abs=1e-7)
