"""Surfaces of logarithms: taken where runs say so, and on the scale of the outcome for all else."""

import numpy as np
import pytest
from scipy import stats

from aleator.core.types import Array, Indices
from aleator.laws import Free, Normal
from aleator.laws.inputs import Inputs
from aleator.likelihood.level_sets import LevelLikelihood
from aleator.simulators.response_functions import Confined
from aleator.surrogates import ResponseSurface, Surface, build_surface
from aleator.surrogates.emulator import OwnSurfaces
from aleator.surrogates.fit import SmoothnessPrior, judged, spread, weights
from aleator.surrogates.samples import Samples
from aleator.surrogates.surface import products

BOX = np.array([[-1.0, 2.0], [0.5, 0.9]])
PRIOR = SmoothnessPrior((1.0, 1.6), 2.0, 2.5, 0.25, logarithm=True)


def outcome(index: Indices, x: Array) -> Array:
    """Of four decades in the first two experiments; a line, and a curve through zero, after."""
    steep = np.exp((2.0 + index) * x[:, 0] + np.sin(x[:, 1]))
    return np.choose(index, [steep, steep, 5.0 + x.sum(axis=1), x[:, 0] * x[:, 1]])


@pytest.fixture(scope="module")
def surface() -> Surface:
    return build_surface(outcome, BOX, 4, ResponseSurface(tolerance=1e-4))


def some_points(count: int) -> Array:
    return BOX[:, 0] + np.random.default_rng(2).random((count, 2)) * np.diff(BOX)[:, 0]


def test_logarithms_are_taken_where_they_are_smoother(surface: Surface) -> None:
    assert surface.logarithmic.tolist() == [True, True, False, False]
    everyone, x = np.repeat(np.arange(4), 100), np.tile(some_points(100), (4, 1))
    off = surface.at(everyone, x) - outcome(everyone, x)
    error = np.sqrt((off.reshape(4, -1) ** 2).mean(axis=1))
    assert (error < np.maximum(2.0 * surface.error, 1e-10)).all()


def test_values_and_slopes_are_those_of_the_outcome(surface: Surface) -> None:
    x = some_points(30)
    value, slope = surface.evaluate_with_gradient(x)
    assert value == pytest.approx(surface.evaluate(x))
    assert value[[1, 3]] == pytest.approx(surface.take(np.array([1, 3])).evaluate(x))
    everyone = np.repeat(np.arange(4), len(x))
    assert value.ravel() == pytest.approx(surface.at(everyone, np.tile(x, (4, 1))))
    for i in range(2):
        step = 1e-5 * np.eye(2)[i]
        difference = (surface.evaluate(x + step) - surface.evaluate(x - step)) / 2e-5
        assert slope[:, :, i] == pytest.approx(difference, rel=1e-6, abs=1e-6)


def test_runs_left_out_miss_the_outcome_and_not_its_logarithm() -> None:
    z = spread(20, 2)
    y = np.exp(np.random.default_rng(0).normal(size=(20, 2)))
    residual = judged(PRIOR, z, y).residual
    for i in range(20):
        others = np.arange(20) != i
        indices, weight = weights(PRIOR, 20)
        scaled = weight[:, None] * products(indices, z)
        terms = np.linalg.lstsq(scaled[:, others].T, np.log(y[others]), rcond=None)[0]
        assert residual[i] == pytest.approx(y[i] - np.exp(scaled[:, i] @ terms), rel=1e-5)


def test_an_outcome_that_turns_out_negative_has_a_surface_of_its_own() -> None:
    box = np.tile([0.0, 1.0], (2, 1))

    def run(_: Indices, x: Array) -> Array:
        return np.exp(10.0 * x.sum(axis=1)) - 1.01

    surfaces = OwnSurfaces(run, box, Samples.none(1, 2), 12)
    everyone = np.array([True])
    surfaces.judge(None)
    assert surfaces.surface(everyone).logarithmic.tolist() == [True]
    corner = 0.001 * np.random.default_rng(0).random((256, 2))
    surfaces.sharpen(np.array([0]), corner, 1.0, 100)
    surfaces.judge(corner)
    found = surfaces.surface(everyone)
    assert surfaces.samples.outcome.min() < 0.0
    assert found.logarithmic.tolist() == [False]
    assert found.evaluate(corner)[0] == pytest.approx(run(np.array([0]), corner), abs=1e-3)


def test_a_likelihood_on_logarithms_has_the_density_of_the_outcome() -> None:
    """exp(x + c) of a normal x is lognormal: d log y / dy is part of its density."""
    c, region = np.linspace(-1.0, 1.0, 8), np.array([[-4.0, 5.0]])
    surface = build_surface(lambda index, x: np.exp(x[:, 0] + c[index]), region, c.size)
    assert surface.logarithmic.all()
    mean, sd = 0.5, 0.6
    y = np.exp(c + mean + sd * np.random.default_rng(1).standard_normal(c.size))
    inputs = Inputs({"x": Normal(Free(-1.0, 2.0), Free(0.1, 1.0))})
    likelihood = LevelLikelihood(
        inputs, Confined(surface, region), region, np.arange(c.size), y, 4096
    )
    alpha = np.array([mean, sd])
    exact = stats.lognorm(sd, scale=np.exp(mean + c)).logpdf(y)
    assert likelihood.evaluate(alpha).each == pytest.approx(exact, abs=1e-4)
