"""Where searches begin."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from aleator.laws import Hyperparameter
from aleator.search.multistart import starting_points
from aleator.search.objective import Coordinates

LOW, HIGH = -2.0, 6.0
LIMITS = [
    Hyperparameter("a", LOW, HIGH, 1.0, free=True),
    Hyperparameter("known", 3.0, 3.0, 3.0, free=False),
    Hyperparameter("c", 0.01, 10.0, 0.5, free=True, log=True),
]


def test_own_start_and_guesses_come_first_and_points_fill_the_limits() -> None:
    guess = np.array([7.0, 3.0, 0.2])
    points = starting_points(Coordinates(LIMITS), [guess], 18, seed=0)
    assert points.shape == (18, 3)
    np.testing.assert_array_equal(points[0], [1.0, 3.0, 0.5])
    # a guess beyond a limit starts on it
    np.testing.assert_array_equal(points[1], [HIGH, 3.0, 0.2])
    unit = (points[2:, 0] - LOW) / (HIGH - LOW)
    # a twentieth away from either limit
    assert np.histogram(unit, bins=4, range=(0.05, 0.95))[0].tolist() == [4, 4, 4, 4]


def test_fewer_points_than_are_known_are_the_first_of_them() -> None:
    guesses = [np.array([float(k), 3.0, 0.2]) for k in range(3)]
    points = starting_points(Coordinates(LIMITS), guesses, 2, seed=0)
    np.testing.assert_array_equal(points, [[1.0, 3.0, 0.5], guesses[0]])


def test_in_wide_limits_points_lie_around_the_guesses_at_distances_of_every_size() -> None:
    wide = [Hyperparameter("b", -1e12, 1e12, 0.0, free=True), LIMITS[2]]
    guess = np.array([3.0, 0.2])
    points = starting_points(Coordinates(wide), [guess], 66, seed=0)[2:]
    distance = np.abs(points[:, 0] - 3.0)
    # from a hundredth of the guess to the limits are 14 decades, of which the starts fill 12
    decades = np.histogram(np.log10(distance), bins=[-2, 1, 4, 7, 10])[0]
    assert np.all(decades >= 10)
    assert 20 <= np.sum(points[:, 0] < 3.0) <= 44
    # without a guess there is nothing to lie around
    even = starting_points(Coordinates(wide), [], 65, seed=0)[1:]
    assert np.median(np.abs(even[:, 0])) > 1e11


@settings(max_examples=30, deadline=None)
@given(
    width=st.floats(1e-3, 1e200),
    guess=st.floats(-1e6, 1e6),
    count=st.integers(1, 20),
    seed=st.integers(0, 3),
)
def test_every_start_is_finite_and_within_the_limits(width, guess, count, seed) -> None:
    limits = [Hyperparameter("b", -width, 2.0 * width, 0.0, free=True)]
    points = starting_points(Coordinates(limits), [np.array([guess])], count, seed)
    assert points.shape == (count, 1)
    assert np.all((points >= -width) & (points <= 2.0 * width))
