"""Surfaces through the runs that worked: what failed costs accuracy, and the estimate says so."""

from collections.abc import Callable

import numpy as np
import pytest

from aleator.core.types import Array, Indices
from aleator.surrogates import ResponseSurface, Surface, build_surface

BOX = np.tile([0.0, 1.0], (2, 1))
CHOICE = ResponseSurface(tolerance=0.02)


def waves(index: Indices, x: Array) -> Array:
    return np.cos(4.0 * x[:, 0] + 3.0 * x[:, 1] + index)


def with_hole(side: float) -> Callable[[Indices, Array], Array]:
    """Waves without an outcome in a corner of the box."""

    def run(index: Indices, x: Array) -> Array:
        return np.where(np.all(x > 1.0 - side, axis=1), np.nan, waves(index, x))

    return run


def true_error(surface: Surface, hole: float = 0.0) -> Array:
    x = np.random.default_rng(0).random((2000, 2))
    x = x[~np.all(x > 1.0 - hole, axis=1)]
    count = len(surface.error)
    truth = waves(np.repeat(np.arange(count), len(x)), np.tile(x, (count, 1)))
    return np.sqrt(((surface.evaluate(x) - truth.reshape(count, -1)) ** 2).mean(axis=1))


def test_runs_that_fail_here_and_there_cost_little() -> None:
    """One in ten, other ones in each experiment."""

    def run(index: Indices, x: Array) -> Array:
        lost = np.modf(np.abs(np.sin(1e4 * x[:, 0] + 77.0 * x[:, 1] + index)) * 1e3)[0] < 0.1
        return np.where(lost, np.nan, waves(index, x))

    surface = build_surface(run, BOX, 12, CHOICE)
    whole = build_surface(waves, BOX, 12, CHOICE)
    assert surface.converged.all()
    assert 0.03 < surface.failed.sum() / surface.runs.sum() < 0.2
    assert surface.runs.mean() < 1.5 * whole.runs.mean()
    assert (true_error(surface) <= 1.2 * surface.error).all()


def test_an_infeasible_corner_is_reported_and_the_rest_is_exact() -> None:
    surface = build_surface(with_hole(0.3), BOX, 6, CHOICE)
    assert (surface.failed > 0).all()
    assert (true_error(surface, hole=0.3) <= surface.error).all()
    assert np.isfinite(surface.lower).all()


def test_an_experiment_with_hardly_a_run_has_no_surface_and_is_given_up_soon() -> None:
    def run(index: Indices, x: Array) -> Array:
        return np.where((index == 1) & (x[:, 0] > 0.02), np.nan, waves(index, x))

    surface = build_surface(run, BOX, 3, CHOICE)
    assert np.isinf(surface.error).tolist() == [False, True, False]
    assert surface.converged.tolist() == [True, False, True]
    assert surface.runs[1] == 34
    assert surface.failed[1] >= 28
    x = np.random.default_rng(0).random((5, 2))
    assert np.isfinite(surface.evaluate(x)).all()
    alone = build_surface(lambda index, x: waves(2 * index, x), BOX, 2, CHOICE)
    assert surface.evaluate(x)[[0, 2]] == pytest.approx(alone.evaluate(x), abs=1e-12)


def test_a_simulator_that_always_fails_is_given_up_soon() -> None:
    surface = build_surface(lambda _, x: np.full(len(x), np.nan), BOX, 2, CHOICE)
    assert np.isinf(surface.error).all()
    assert not surface.converged.any()
    assert surface.runs.tolist() == surface.failed.tolist() == [34, 34]
