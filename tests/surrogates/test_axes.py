"""Surfaces in logarithms of parameters: taken where runs say so, in values and slopes by x."""

import numpy as np
import pytest

from aleator.core.types import Array, Indices
from aleator.surrogates import AdaptiveSurfaces, ResponseSurface, Surface, build_surface
from aleator.surrogates.surface import Axes

BOX = np.array([[0.05, 8.0], [-1.0, 1.0]])
WIDE = np.array([[0.05, 8.0], [0.2, 20.0]])
MANY = 6


def some_points(count: int, box: Array = BOX) -> Array:
    return box[:, 0] + np.random.default_rng(2).random((count, 2)) * np.diff(box)[:, 0]


def mixed(index: Indices, x: Array) -> Array:
    """A line in the logarithm of one, and a curve of the other."""
    return (2.0 + index) * np.log(x[:, 0]) + np.sin(x[:, 1])


def power(index: Indices, x: Array) -> Array:
    return 3.0 * x[:, 0] ** (0.5 + index) / x[:, 1]


@pytest.fixture(scope="module")
def surface() -> Surface:
    return build_surface(mixed, BOX, 3, ResponseSurface(tolerance=1e-4))


def test_coordinates_are_turned_round_and_their_rates_are_slopes() -> None:
    axes = Axes(WIDE, np.array([True, False]))
    x = some_points(20, WIDE)
    z = axes.inward(x)
    assert axes.outward(z) == pytest.approx(x)
    assert np.abs(z).max() <= 1.0
    assert axes.inward(WIDE.T) == pytest.approx(np.array([[-1.0, -1.0], [1.0, 1.0]]))
    assert axes.inward(np.sqrt(WIDE[:, 0] * WIDE[:, 1]))[0] == pytest.approx(0.0, abs=1e-12)
    step = 1e-6 * x
    difference = (axes.inward(x + step) - axes.inward(x - step)) / (2.0 * step)
    assert axes.rates(x) == pytest.approx(difference, rel=1e-6)


def test_a_logarithm_is_taken_where_it_is_smoother(surface: Surface) -> None:
    assert surface.axes.logarithmic.tolist() == [True, False]
    x = some_points(200)
    everyone = np.repeat(np.arange(3), len(x))
    exact = mixed(everyone, np.tile(x, (3, 1))).reshape(3, -1)
    off = np.sqrt(((surface.evaluate(x) - exact) ** 2).mean(axis=1))
    assert (off < 1e-4 * surface.scatter).all()


def test_lines_stay_lines() -> None:
    box = np.array([[0.1, 10.0], [1.0, 50.0]])
    found = build_surface(lambda i, x: 2.0 + i + x[:, 0] - 0.1 * x[:, 1], box, MANY)
    assert found.axes.logarithmic.tolist() == [False, False]


def test_slopes_are_those_by_the_parameters(surface: Surface) -> None:
    x = some_points(30)
    value, slope = surface.evaluate_with_gradient(x)
    assert value == pytest.approx(surface.evaluate(x))
    assert slope[2, :, 0] == pytest.approx(4.0 / x[:, 0], rel=1e-3)
    for i in range(2):
        step = 1e-6 * np.eye(2)[i]
        difference = (surface.evaluate(x + step) - surface.evaluate(x - step)) / 2e-6
        assert slope[:, :, i] == pytest.approx(difference, rel=1e-5, abs=1e-6)


def test_a_power_law_needs_as_few_runs_as_a_line() -> None:
    """Logarithms of parameters and of the outcome: two more runs than a plane has terms."""
    surfaces = AdaptiveSurfaces(power, WIDE, MANY, ResponseSurface())
    found = surfaces.surface()
    assert surfaces.total_runs == 5 * MANY
    assert found.axes.logarithmic.all()
    assert found.logarithmic.all()
    x = some_points(50, WIDE)
    exact = [power(np.array(i), x) for i in range(MANY)]
    assert found.evaluate(x) == pytest.approx(np.array(exact), rel=1e-9)


def test_a_region_that_comes_to_zero_has_no_logarithm() -> None:
    surfaces = AdaptiveSurfaces(power, WIDE, MANY, ResponseSurface())
    surfaces.move(np.array([[0.0, 8.0], [2.0, 3.0]]))
    assert surfaces.emulator.axes.logarithmic.tolist() == [False, True]
