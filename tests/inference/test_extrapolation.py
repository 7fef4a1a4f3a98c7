"""How far new conditions are from tested ones."""

import numpy as np
import pandas as pd
import pytest
from scipy.spatial import Delaunay

from aleator.tasks.prediction import beyond_hull, beyond_range, compared


def test_within_the_hull_is_zero_and_elsewhere_not() -> None:
    rng = np.random.default_rng(0)
    tested, new = rng.normal(size=(40, 3)), rng.normal(size=(60, 3)) * 1.2
    inside = Delaunay(tested).find_simplex(new) >= 0
    assert 5 < inside.sum() < 55
    assert (beyond_hull(tested, new) == 0.0).tolist() == inside.tolist()


def test_the_unit_of_a_condition_does_not_matter() -> None:
    rng = np.random.default_rng(1)
    tested, new = rng.normal(size=(20, 2)), rng.normal(size=(10, 2)) * 2.0
    scaled = beyond_hull(tested * [1e6, 1e-3], new * [1e6, 1e-3])
    assert scaled == pytest.approx(beyond_hull(tested, new), abs=1e-9)


def test_one_condition_far_off_is_at_least_its_own_distance() -> None:
    tested = np.array([[0.0, 0.0], [1.0, 10.0]])
    assert beyond_range(tested, np.array([[1.5, 5.0]])).tolist() == [[0.5, 0.0]]
    assert beyond_hull(tested, np.array([[1.5, 5.0]]))[0] == pytest.approx(0.5)
    # between in each, but the two always went together
    assert beyond_hull(tested, np.array([[1.0, 0.0]]))[0] == pytest.approx(0.5)


def test_reasons_name_the_condition() -> None:
    tested = pd.DataFrame({"t": [1.0, 2.0], "p": [5.0, 5.0], "oil": ["a", "b"]})
    new = pd.DataFrame({"t": [1.5, 0.0, 1.5, 1.0], "p": [5.0, 5.0, 6.0, 5.0], "oil": [*"abac"]})
    found = compared(tested, new)
    assert found.distance.tolist() == [0.0, 1.0, np.inf, np.inf]
    assert found.why[0] == ""
    assert ["t" in found.why[1], "p" in found.why[2], "'c'" in found.why[3]] == [True] * 3
