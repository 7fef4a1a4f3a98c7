"""The nonparametric maximum likelihood estimate: weights, points, and the gap to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import optimize, stats
from scipy.stats import qmc

from aleator.core.progress import Silent
from aleator.core.types import Array
from aleator.inference.information import infer
from aleator.inference.npmle import (
    NPMLE,
    NPMLE_SETTINGS,
    GapTest,
    gap_test,
    gradient,
    local_maxima,
    mixed,
    npmle,
    uphill,
)
from aleator.laws.hyperparameter import Hyperparameter
from aleator.search.interface import LogLikelihood

CASES = [(30, 12, 0.5), (108, 400, 0.3), (60, 400, 0.02), (400, 200, 1.0)]


def log_density(count: int, points: int, sd: float, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    y = rng.choice([-1.0, 0.3, 2.0], count) + rng.normal(0.0, 0.2 + sd, count)
    x = np.linspace(-4.0, 5.0, points)
    return stats.norm.logpdf(y[:, None], x, sd)


def by_em(matrix: np.ndarray, rounds: int) -> np.ndarray:
    """The weights after many steps of expectation and maximization."""
    density = np.exp(matrix - matrix.max(axis=1, keepdims=True))
    weights = np.full(matrix.shape[1], 1.0 / matrix.shape[1])
    for _ in range(rounds):
        weights = weights * ((1.0 / (density @ weights)) @ density) / len(density)
    return weights


def value(matrix: np.ndarray, weights: np.ndarray) -> float:
    top = matrix.max(axis=1)
    return float((top + np.log(np.exp(matrix - top[:, None]) @ weights)).sum())


@pytest.mark.parametrize("case", CASES, ids=str)
def test_it_is_certified_and_above_a_long_run_of_em(case: tuple[int, int, float]) -> None:
    matrix = log_density(*case)
    found = mixed(matrix)
    assert found.gap < 1e-4
    assert found.weights.min() >= 0.0
    assert found.weights.sum() == pytest.approx(1.0, abs=1e-12)
    assert value(matrix, found.weights) == pytest.approx(found.log_likelihood, abs=1e-9)
    em = value(matrix, by_em(matrix, 3000))
    assert em - 1e-9 <= found.log_likelihood
    assert found.log_likelihood == pytest.approx(em, abs=0.1)


def test_a_general_maximizer_finds_the_same() -> None:
    matrix = log_density(30, 12, 0.5)
    found = mixed(matrix)
    end = optimize.minimize(
        lambda w: -value(matrix, w),
        np.full(12, 1.0 / 12.0),
        method="SLSQP",
        bounds=[(0.0, 1.0)] * 12,
        constraints={"type": "eq", "fun": lambda w: w.sum() - 1.0},
        options={"ftol": 1e-12, "maxiter": 1000},
    )
    assert found.log_likelihood == pytest.approx(-end.fun, abs=1e-6)
    assert found.weights == pytest.approx(end.x, abs=1e-3)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_no_gap_is_too_small(case: tuple[int, int, float]) -> None:
    matrix = log_density(*case)
    best = mixed(matrix).log_likelihood
    for tolerance in (1.0, 0.1, 1e-3):
        rough = mixed(matrix, tolerance)
        assert rough.log_likelihood <= best + 1e-9
        assert best <= rough.log_likelihood + rough.gap + 1e-9


def test_one_experiment_takes_its_likeliest_point() -> None:
    found = mixed(np.array([[-3.0, -1.0, -2.0]]))
    assert found.weights.tolist() == [0.0, 1.0, 0.0]
    assert found.log_likelihood == -1.0


def test_experiments_far_apart_have_a_point_each_with_their_share() -> None:
    place = np.array([0, 0, 0, 1, 1, 2])
    matrix = np.where(place[:, None] == np.arange(3), 0.0, -900.0)
    found = mixed(matrix)
    assert found.weights == pytest.approx([3 / 6, 2 / 6, 1 / 6], abs=1e-8)
    shares = np.array([3, 3, 3, 2, 2, 1]) / 6.0
    assert found.log_likelihood == pytest.approx(np.log(shares).sum(), abs=1e-9)


def test_an_experiment_that_nothing_explains_is_told_and_leaves_the_others_alone() -> None:
    matrix = log_density(30, 50, 0.3)
    found = mixed(np.vstack([matrix, np.full(50, -np.inf)]))
    assert found.each[-1] == -np.inf
    assert found.weights == pytest.approx(mixed(matrix).weights)


@pytest.mark.parametrize("nothing", [np.nan, -np.inf])
def test_where_nothing_is_explained_that_is_told(nothing: float) -> None:
    found = mixed(np.full((3, 4), nothing))
    assert found.log_likelihood == -np.inf
    assert found.weights.sum() == pytest.approx(1.0)


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


def test_a_noise_wider_than_the_scatter_needs_one_point_only() -> None:
    # one point is best where the noise's sd is at least half the range (Lindsay, 1983)
    y = np.array([[0.45], [0.5], [0.55]])
    found = best(normal(y, 0.2))
    assert found.points == pytest.approx(np.array([[0.5]]), abs=2e-3)
    assert found.log_likelihood == pytest.approx(stats.norm.logpdf(y, 0.5, 0.2).sum(), abs=1e-4)


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


COUNT, NOISE = 40, 0.5
LIMITS = (
    Hyperparameter("mean", -5.0, 5.0, 0.0, free=True),
    Hyperparameter("sd", 1e-3, 5.0, 1.0, free=True, log=True),
)
GRID = np.linspace(-6.0, 6.0, 121)[:, None]


@dataclass(frozen=True)
class Measured:
    """y = x + noise with x normal, whose likelihood is a closed form: as a `Fit`."""

    y: np.ndarray
    alpha: np.ndarray
    inference: object = None
    hyperparameters: tuple[Hyperparameter, ...] = LIMITS

    @classmethod
    def of(cls, y: np.ndarray) -> Measured:
        sd = np.sqrt(max(y.var() - NOISE**2, 1e-6))
        alpha = np.array([y.mean(), sd])
        fit = cls(y, alpha)
        return replace(fit, inference=infer(fit.objective(), alpha, LIMITS))

    @property
    def likelihood(self) -> Measured:
        return self

    def objective(self):
        def value(alpha: np.ndarray) -> LogLikelihood:
            mean, sd = alpha
            variance = sd**2 + NOISE**2
            away = self.y - mean
            each = -0.5 * (away**2 / variance + np.log(2.0 * np.pi * variance))
            by_sd = sd * (away**2 / variance**2 - 1.0 / variance)
            return LogLikelihood(
                each, np.stack([away / variance, by_sd], axis=1), np.zeros(len(each), dtype=int)
            )

        return value

    def scored(self) -> LogLikelihood:
        return self.objective()(self.alpha)

    def at(self, alpha: np.ndarray) -> Measured:
        return replace(self, alpha=alpha)

    def drawn(self, rng: np.random.Generator) -> Measured:
        mean, sd = self.alpha
        x = mean + sd * rng.standard_normal(len(self.y))
        return replace(self, y=x + NOISE * rng.standard_normal(len(self.y)))

    def log_density_at(self, x: np.ndarray) -> np.ndarray:
        away = (self.y[:, None] - x[:, 0]) / NOISE
        return -0.5 * (away**2 + np.log(2.0 * np.pi * NOISE**2))


def points(fit: object, rng: np.random.Generator) -> np.ndarray:  # noqa: ARG001
    return GRID


def of(fit: Measured, most: int, seed: int = 0) -> GapTest:
    return gap_test(fit, points, most, seed, Silent())  # type: ignore[arg-type, return-value]


def p_values(count: int, modes: float, most: int = 39) -> np.ndarray:
    """Of data sets whose law has two modes so many units from the middle; 0 is a normal law."""
    found = []
    for seed in range(count):
        rng = np.random.default_rng([1, seed])
        x = modes * rng.choice([-1.0, 1.0], COUNT) + rng.normal(0.0, 0.1 if modes else 1.0, COUNT)
        fit = Measured.of(x + NOISE * rng.standard_normal(COUNT))
        found.append(of(fit, most, seed).p_value)
    return np.array(found)


def test_the_right_law_is_doubted_as_often_as_the_level_says() -> None:
    found = p_values(40, 0.0)
    assert 0.3 < found.mean() < 0.7
    assert np.mean(found <= 0.05) <= 0.12
    assert np.mean(found <= 0.5) == pytest.approx(0.5, abs=0.2)


def test_two_modes_are_found() -> None:
    assert np.mean(p_values(12, 1.5) <= 0.05) > 0.8


def test_it_stops_after_ten_larger_gaps_and_else_draws_all() -> None:
    rng = np.random.default_rng(0)
    fit = Measured.of(rng.normal(0.0, 1.1, COUNT))
    test = of(fit, 200)
    assert test.exceeded == NPMLE_SETTINGS.exceeded
    assert test.p_value == test.exceeded / test.replicates
    two = Measured.of(np.repeat([-3.0, 3.0], COUNT // 2))
    test = of(two, 25)
    assert (test.exceeded, test.replicates) == (0, 25)
    assert test.p_value == pytest.approx(1.0 / 26.0)


def test_replicates_without_a_likelihood_count_as_larger_and_are_told() -> None:
    class Broken(Measured):
        def drawn(self, rng: np.random.Generator) -> Measured:
            other = super().drawn(rng)
            return replace(other, y=np.full(COUNT, np.nan))

    fit = Measured.of(np.random.default_rng(2).normal(0.0, 1.2, COUNT))
    broken = Broken(fit.y, fit.alpha, SimpleNamespace(**vars(fit.inference)))
    with np.errstate(all="ignore"):
        test = of(broken, 30)
    assert test.failed == test.exceeded == NPMLE_SETTINGS.exceeded
    assert test.p_value == 1.0


def test_data_without_a_likelihood_are_not_judged() -> None:
    fit = Measured.of(np.random.default_rng(2).normal(0.0, 1.2, COUNT))
    lost = replace(fit, y=np.full(COUNT, np.nan))
    assert gap_test(lost, points, 30, 0, Silent()) is None  # type: ignore[arg-type]
