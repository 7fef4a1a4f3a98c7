"""Gaussian processes that learn from slopes, too."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from aleator.core.types import Array, Indices
from aleator.surrogates.kriging import PROCESS, Covariance, Data, ProcessPosterior, _loss
from aleator.surrogates.processes import PROCESSES, Processes

CONDITIONS = np.random.default_rng(3).uniform(-1.0, 1.0, (30, 2))
BOX = np.array([[1.0, 3.0], [0.5, 4.0]])
EVERYONE = np.arange(30)


def some_runs(count: int, sloped: float) -> Data:
    """Runs of a sine of conditions and parameters, of which the share `sloped` has slopes."""
    rng, by = np.random.default_rng(5), np.array([1.0, -0.5, 2.0, 1.0])
    index = rng.integers(0, 6, count)
    u = np.hstack([CONDITIONS[index], rng.uniform(-1.0, 1.0, (count, 2))])
    slopes = np.cos(u @ by)[:, None] * by[2:]
    slopes[rng.random(count) >= sloped] = np.nan
    return Data(index, u, np.sin(u @ by) + 0.1 * index, 2, slopes)


def covariance(gaussian: bool) -> Covariance:
    start = Covariance.first(4, 2, gaussian)
    start = start.moved(start.vector + 0.2 * np.random.default_rng(1).normal(size=21))
    return replace(start, individual=0.7, line=0.4)


@pytest.mark.parametrize("gaussian", [False, True])
def test_the_process_is_that_of_a_dense_matrix_by_differences(gaussian: bool) -> None:
    """Covariances with slopes are differences of those of values; no formula is used twice."""
    data, c = some_runs(12, 0.5), replace(covariance(gaussian), noise=0.05)
    found, step, sloped = ProcessPosterior.of(c, data), 1e-3, data.sloped
    assert 0 < sloped.size < 12

    def shifted(i: int, by: float) -> tuple[Indices, Array]:
        return data.experiment[sloped], data.u[sloped] + by * np.eye(4)[2 + i]

    # Each known number is a sum of values of f + g at points, with weights.
    sums = [
        ((1.0, (data.experiment, data.u)),),
        *(((0.5 / step, shifted(i, step)), (-0.5 / step, shifted(i, -step))) for i in range(2)),
    ]

    def prior(a: tuple[Indices, Array], b: tuple[Indices, Array]) -> Array:
        wide = 1e3 * data.trend(a[1]) @ data.trend(b[1]).T
        return c.between(*a, *b) + wide

    def known(b: tuple[Indices, Array]) -> Array:
        return np.vstack([sum(w * prior(a, b) for w, a in one) for one in sums])

    matrix = np.hstack([sum(w * known(a) for w, a in one) for one in sums])
    noise = np.repeat([c.noise, PROCESS.slopes * c.noise], [12, 2 * sloped.size])
    rng = np.random.default_rng(2)
    at = np.arange(5), np.hstack([CONDITIONS[:5], rng.uniform(-1.0, 1.0, (5, 2))])
    weights = np.linalg.solve(matrix + np.diag(noise**2), known(at))
    values = np.concatenate([data.y, *data.slopes[sloped].T])
    assert found.mean(*at) == pytest.approx(weights.T @ values, abs=2e-3)
    left = prior(at, at) - known(at).T @ weights
    assert found.joint(*at) / found.variance == pytest.approx(left, abs=2e-3)


@pytest.mark.parametrize("gaussian", [False, True])
def test_the_mean_has_the_values_and_slopes_of_the_runs(gaussian: bool) -> None:
    data = some_runs(24, 0.7)
    c = replace(covariance(gaussian), noise=1e-5)
    value, slope = ProcessPosterior.of(c, data).with_slope(data.experiment, data.u)
    assert value == pytest.approx(data.y, abs=1e-5)
    assert slope[data.sloped] == pytest.approx(data.slopes[data.sloped], abs=1e-4)


@pytest.mark.parametrize("gaussian", [False, True])
def test_slopes_of_the_mean_are_its_differences(gaussian: bool) -> None:
    found = ProcessPosterior.of(covariance(gaussian), some_runs(24, 0.7))
    rng, step = np.random.default_rng(9), 1e-4
    at, u = rng.integers(0, 7, 12), rng.uniform(-1.2, 1.2, (12, 4))
    value, slope = found.with_slope(at, u)
    assert value == pytest.approx(found.mean(at, u))
    for i in range(2):
        by = step * np.eye(4)[2 + i]
        rise = found.mean(at, u + by) - found.mean(at, u - by)
        assert slope[:, i] == pytest.approx(rise / (2.0 * step), abs=1e-6)


@pytest.mark.parametrize("gaussian", [False, True])
def test_the_gradient_of_the_loss_is_that_of_finite_differences(gaussian: bool) -> None:
    data, start = some_runs(24, 0.7), covariance(gaussian)
    expected = approx_fprime(
        start.vector, lambda vector: _loss(start.moved(vector), data, PROCESS)[0], 1e-6
    )
    assert _loss(start, data, PROCESS)[1] == pytest.approx(expected, abs=2e-3)


def power(case: Indices, x: Array) -> tuple[Array, Array]:
    """A positive outcome over decades: its process is that of the logarithm of both."""
    rate = 2.0 + CONDITIONS[case, 0]
    y = x[:, 0] ** rate * np.exp(CONDITIONS[case, 1] * x[:, 1])
    slopes = np.stack([rate * y / x[:, 0], CONDITIONS[case, 1] * y], axis=1)
    return y[:, None], slopes[:, None, :]


def wavy(case: Indices, x: Array) -> tuple[Array, Array]:
    inner = 1.5 * x[:, 0] + CONDITIONS[case, 0]
    y = np.sin(inner) * x[:, 1] + CONDITIONS[case, 1]
    slopes = np.stack([1.5 * np.cos(inner) * x[:, 1], np.sin(inner)], axis=1)
    return y[:, None], slopes[:, None, :]


Sloped = Callable[[Indices, Array], tuple[Array, Array]]


def learned(function: Sloped, sloped: bool, first: int = 2) -> Processes:
    settings = replace(PROCESSES, first=first * (3 if sloped else 1), least=0)
    made = Processes(
        function, BOX, CONDITIONS, EVERYONE, 0 * EVERYONE, sloped=sloped, settings=settings
    )
    made.begin()
    made.learn()
    return made


@pytest.mark.parametrize("function", [power, wavy])
def test_slopes_pass_through_logarithms_and_coordinates(function: Sloped) -> None:
    made = learned(function, sloped=True)
    case, x = made.of_run, made.x
    value, slope = made.means.with_slopes(case, x[:, None, :])
    truth, slopes = function(case, x)
    assert value[:, 0] == pytest.approx(truth[:, 0], rel=1e-2, abs=1e-2)
    near = np.abs(slope[:, :, 0].T - slopes[:, 0]) / np.abs(slopes).max(axis=(0, 1))
    assert np.quantile(near, 0.9) < 0.01


def test_the_error_is_smaller_with_slopes() -> None:
    x = BOX[:, 0] + np.random.default_rng(7).random((30, 2)) * np.diff(BOX, axis=1).T
    truth = wavy(EVERYONE, x)[0][:, 0]
    off = [
        np.sqrt(np.mean((learned(wavy, sloped).expected(EVERYONE, x) - truth) ** 2))
        for sloped in (False, True)
    ]
    assert off[1] < 0.5 * off[0]


def test_slopes_that_contradict_the_values_are_left_out() -> None:
    def wrong(case: Indices, x: Array) -> tuple[Array, Array]:
        y, slopes = wavy(case, x)
        return y, slopes * [1.0, 0.4]

    made = learned(wrong, sloped=True)
    assert made.sloped_runs == 60
    rng = np.random.default_rng(1)
    made.make(EVERYONE, BOX[:, 0] + rng.random((30, 2)) * np.diff(BOX, axis=1).T)
    made.learn()
    assert made.contradicted
    assert made.sloped_runs == 0
    right = learned(wavy, sloped=True)
    right.make(EVERYONE, made.x[-30:])
    right.learn()
    assert not right.contradicted
    assert right.sloped_runs == 90


def test_the_last_slopes_of_very_many_runs_are_kept() -> None:
    data = some_runs(40, 1.0)
    kept = data.with_last_slopes(60)
    assert len(kept.values) == 60
    assert kept.sloped.tolist() == list(range(30, 40))
    assert not data.with_last_slopes(20).sloped.size
