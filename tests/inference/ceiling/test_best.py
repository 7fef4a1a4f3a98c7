"""The best of all laws: closed forms, other grids, and a certificate that holds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

from aleator.inference.npmle import NPMLE, gradient, local_maxima, mixed, npmle, uphill
from aleator.types import Array

Density = Callable[[Array], Array]


def cover(count: int, s: int, seed: int) -> Array:
    return qmc.Sobol(s, rng=seed).random(count)


def best(log_density: Density, s: int = 1, count: int = 256) -> NPMLE:
    return npmle(log_density, cover(count, s, 0), cover(2 * count, s, 1))


def normal(y: Array, sd: float) -> Density:
    """Experiments that measure a point of the unit cube with an error: y (N, s)."""
    return lambda z: stats.norm.logpdf(y[:, None], z[None], sd).sum(axis=2)


def test_without_overlap_each_experiment_has_a_point() -> None:
    y = np.linspace(0.1, 0.9, 9)[:, None]
    found = best(normal(y, 0.004))
    assert np.sort(found.points[:, 0]) == pytest.approx(y[:, 0], abs=1e-5)
    assert found.weights == pytest.approx(np.full(9, 1 / 9), abs=1e-6)
    exact = 9 * (np.log(1 / 9) + stats.norm.logpdf(0.0, 0.0, 0.004))
    assert found.log_likelihood == pytest.approx(exact, abs=1e-3)


def test_one_experiment_is_explained_as_well_as_can_be() -> None:
    found = best(normal(np.array([[0.37]]), 0.2))
    assert found.points == pytest.approx(np.array([[0.37]]), abs=5e-3)
    assert found.log_likelihood == pytest.approx(stats.norm.logpdf(0.0, 0.0, 0.2), abs=1e-4)


def test_a_noise_wider_than_the_scatter_needs_one_point_only() -> None:
    # one point is best where the noise's sd is at least half the range (Lindsay, 1983)
    y = np.array([[0.45], [0.5], [0.55]])
    found = best(normal(y, 0.2))
    assert found.points == pytest.approx(np.array([[0.5]]), abs=2e-3)
    assert found.log_likelihood == pytest.approx(stats.norm.logpdf(y, 0.5, 0.2).sum(), abs=1e-4)


def test_two_modes_are_found_where_they_are() -> None:
    rng = np.random.default_rng(0)
    y = rng.choice([0.3, 0.7], (2000, 1)) + rng.normal(0.0, 0.05, (2000, 1))
    found = best(normal(y, 0.05))
    near = [np.abs(found.points[:, 0] - mode) < 0.05 for mode in (0.3, 0.7)]
    shares = [found.weights[at].sum() for at in near]
    assert shares == pytest.approx([0.5, 0.5], abs=0.05)


@pytest.mark.parametrize("s", [1, 2])
def test_it_is_that_of_all_points_and_not_of_a_grid(s: int) -> None:
    rng = np.random.default_rng(s)
    log_density = normal(rng.uniform(0.0, 1.0, (40, s)), 0.08)
    found = best(log_density, s)
    side = np.linspace(0.0, 1.0, 1001 if s == 1 else 61)
    grid = np.stack(np.meshgrid(*[side] * s, indexing="ij"), axis=-1).reshape(-1, s)
    on_grid = mixed(log_density(grid))
    assert on_grid.log_likelihood <= found.log_likelihood + found.gap
    assert found.log_likelihood == pytest.approx(on_grid.log_likelihood, abs=0.1)
    assert found.gap < 2e-3
    assert 40 * np.log1p(gradient(log_density, found.each, grid).max()) < found.gap + 1e-4


def test_other_coordinates_have_the_same_ceiling() -> None:
    rng = np.random.default_rng(3)
    log_density = normal(rng.uniform(0.0, 1.0, (30, 2)), 0.15)
    there = best(log_density, 2).log_likelihood
    mirrored = best(lambda z: log_density(1.0 - z[:, ::-1]), 2).log_likelihood
    bent = best(lambda z: log_density(z**2), 2).log_likelihood
    assert mirrored == pytest.approx(there, abs=2e-3)
    assert bent == pytest.approx(there, abs=2e-3)


def test_the_gradient_function_is_the_slope_toward_a_point() -> None:
    rng = np.random.default_rng(4)
    log_density = normal(rng.uniform(0.0, 1.0, (20, 1)), 0.1)
    chosen = cover(64, 1, 5)
    each = np.log(np.exp(log_density(chosen)).mean(axis=1))
    at, h = np.array([[0.42]]), 1e-6
    moved = np.log((1.0 - h) * np.exp(each) + h * np.exp(log_density(at)[:, 0]))
    slope = (moved - each).sum() / h / 20
    assert gradient(log_density, each, at)[0] == pytest.approx(slope, rel=1e-4)


def test_tops_are_found_on_ridges_at_corners_and_side_by_side() -> None:
    tops = np.array([[0.21, 0.83], [0.64, 0.35]])

    def ridges(z: Array) -> Array:
        away = z[:, None] - tops
        along, across = away @ np.array([0.8, 0.6]), away @ np.array([-0.6, 0.8])
        return np.exp(-0.5 * ((along / 0.2) ** 2 + (across / 0.01) ** 2)).max(axis=1)

    points = cover(1024, 2, 0)
    ends = uphill(ridges, points[local_maxima(points, ridges(points), 40)], 0.02)
    for top in tops:
        assert np.min(np.linalg.norm(ends - top, axis=1)) < 1e-3
    corner = uphill(lambda z: z[:, 0] - 3.0 * z[:, 1], np.array([[0.3, 0.4]]), 0.02)
    assert corner == pytest.approx(np.array([[1.0, 0.0]]))
