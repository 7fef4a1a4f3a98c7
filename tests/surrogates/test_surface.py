"""Surfaces: three ways to evaluate that agree, derivatives, and the range of the outcome."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from aleator.errors import InputsError
from aleator.surrogates import ResponseSurface, Surface, build_surface
from aleator.surrogates.surface import SURFACES

BOX = np.array([[-1.0, 2.0], [0.5, 0.9]])
COUNT = 7


def outcome(index: NDArray[np.intp], x: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.sin((1.0 + 0.5 * index) * x[:, 0]) * np.exp(x[:, 1]) + index


@pytest.fixture(scope="module")
def surface() -> Surface:
    return build_surface(outcome, BOX, COUNT, ResponseSurface(tolerance=1e-4))


def some_points(count: int) -> NDArray[np.float64]:
    return BOX[:, 0] + np.random.default_rng(2).random((count, 2)) * (BOX[:, 1] - BOX[:, 0])


def test_at_equals_evaluate(surface: Surface) -> None:
    x = some_points(40)
    index = np.random.default_rng(3).integers(COUNT, size=40)
    assert surface.at(index, x) == pytest.approx(surface.evaluate(x)[index, range(40)], abs=1e-13)


def test_gradient_equals_finite_differences(surface: Surface) -> None:
    x = some_points(30)
    value, slope = surface.evaluate_with_gradient(x)
    assert value == pytest.approx(surface.evaluate(x), abs=1e-13)
    assert slope.shape == (COUNT, 30, 2)
    for i, width in enumerate(BOX[:, 1] - BOX[:, 0]):
        step = np.zeros(2)
        step[i] = 1e-5 * width
        difference = (surface.evaluate(x + step) - surface.evaluate(x - step)) / (2.0 * step[i])
        assert slope[:, :, i] == pytest.approx(difference, abs=1e-6)


def test_some_experiments_are_those_of_all(surface: Surface) -> None:
    x, rows = some_points(20), np.array([5, 0, 3])
    some, (value, slope) = surface.take(rows), surface.evaluate_with_gradient(x)
    assert some.evaluate(x) == pytest.approx(value[rows], abs=1e-13)
    assert some.evaluate_with_gradient(x)[1] == pytest.approx(slope[rows], abs=1e-11)
    for name in ("error", "runs", "lower", "upper"):
        assert np.array_equal(getattr(some, name), getattr(surface, name)[rows])


def test_blocks_do_not_show(surface: Surface, monkeypatch: pytest.MonkeyPatch) -> None:
    x = some_points(50)
    index = np.arange(50) % COUNT
    whole = (*surface.evaluate_with_gradient(x), surface.evaluate(x), surface.at(index, x))
    module = sys.modules[Surface.__module__]
    monkeypatch.setattr(module, "SURFACES", replace(SURFACES, block=500))
    parts = (*surface.evaluate_with_gradient(x), surface.evaluate(x), surface.at(index, x))
    for one, two in zip(whole, parts, strict=True):
        assert one == pytest.approx(two, abs=1e-13)


def test_the_range_holds_the_outcome_and_not_much_more(surface: Surface) -> None:
    grid = np.stack(np.meshgrid(*(np.linspace(*side, 201) for side in BOX)), -1).reshape(-1, 2)
    for l in range(COUNT):
        dense = outcome(np.full(len(grid), l), grid)
        margin = 1e-3 * np.ptp(dense)
        assert surface.lower[l] == pytest.approx(dense.min(), abs=margin)
        assert surface.upper[l] == pytest.approx(dense.max(), abs=margin)


def test_scatter_is_the_standard_deviation_over_the_box(surface: Surface) -> None:
    dense = surface.evaluate(some_points(100_000))
    assert surface.scatter == pytest.approx(dense.std(axis=1), rel=0.01)


def test_points_of_a_wrong_shape_are_refused(surface: Surface) -> None:
    for call in (surface.evaluate, surface.evaluate_with_gradient):
        with pytest.raises(InputsError, match="2 columns"):
            call(np.zeros((3, 1)))
    with pytest.raises(InputsError, match="one whole number"):
        surface.at(np.zeros(2, dtype=int), np.zeros((3, 2)))
    with pytest.raises(InputsError, match="one whole number"):
        surface.at(np.zeros(3), np.zeros((3, 2)))
    with pytest.raises(InputsError, match="experiment 7"):
        surface.at(np.array([7]), np.zeros((1, 2)))
