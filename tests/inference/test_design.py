"""Designs: closed forms of small designs, and the search for the best set against all sets."""

from __future__ import annotations

from itertools import combinations, combinations_with_replacement

import numpy as np
import pytest

from aleator.core.types import Array
from aleator.inference.design import DesignPlan, chosen, repetitions


def lines(x: Array) -> Array:
    """Information (1, C, 2, 2) of one measurement of a straight line at x, of unit error."""
    rows = np.stack([np.ones_like(x), x], axis=1)
    return np.einsum("ci,cj->cij", rows, rows)[None]


def nothing(size: int) -> Array:
    return np.zeros((1, size, size))


def slope_of(size: int, k: int) -> Array:
    return np.eye(size)[k][None, None]


def random_information(rng: np.random.Generator, laws: int, count: int, size: int) -> Array:
    vectors = rng.standard_normal((laws, count, size, 2))
    return np.asarray(vectors @ np.swapaxes(vectors, -1, -2))


@pytest.mark.parametrize("directions", [None, slope_of(2, 1)])
def test_a_straight_line_is_measured_at_its_ends(directions: Array | None) -> None:
    """D-optimal and best for the slope: half of the measurements at each end (Smith, 1918)."""
    x = np.linspace(-1.0, 1.0, 21)
    found = chosen(DesignPlan(nothing(2), lines(x), directions), 6, repeat=6)
    assert sorted(x[list(found.order)]) == [-1.0, -1.0, -1.0, 1.0, 1.0, 1.0]


def test_the_error_of_a_slope_is_that_of_the_closed_form() -> None:
    x = np.array([-1.0, 0.5, 2.0])
    plan = DesignPlan(lines(x).sum(axis=1), lines(np.array([3.0, 4.0])), slope_of(2, 1))
    alone = plan.standard_error(plan.present[:, None] + plan.offered)
    for value, new in zip(alone, (3.0, 4.0), strict=True):
        whole = np.append(x, new)
        assert value == pytest.approx(1.0 / np.sqrt(np.sum((whole - whole.mean()) ** 2)))


def test_the_middle_tells_nothing_of_a_slope_and_a_second_end_makes_it_known() -> None:
    plan = DesignPlan(lines(np.array([-1.0])).sum(axis=1), lines(np.array([-1.0, 0.0, 1.0])),
                slope_of(2, 1))  # fmt: skip
    assert not plan.determined(plan.present)
    assert plan.standard_error(plan.present) == np.inf
    found = chosen(plan, 1)
    assert found.order == (2,)
    assert found.after[0] == pytest.approx(1.0 / np.sqrt(2.0))


def test_information_that_is_singular_elsewhere_does_not_matter_to_what_is_asked() -> None:
    present = np.diag([4.0, 0.0])[None]
    plan = DesignPlan(present, np.diag([0.0, 1.0])[None, None], slope_of(2, 0))
    assert plan.standard_error(present) == pytest.approx(0.5)


@pytest.mark.parametrize("repeat", [1, 3])
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", ["one", "two", "all"])
def test_the_set_is_nearly_the_best_of_all_and_exchange_never_worse_than_greedy(
    kind: str, seed: int, repeat: int
) -> None:
    rng = np.random.default_rng(seed)
    offered = random_information(rng, 2, 9, 3)
    directions = {"one": slope_of(3, 1), "two": rng.standard_normal((1, 2, 3)), "all": None}[kind]
    if directions is not None:
        directions = np.repeat(directions, 2, axis=0)
    plan = DesignPlan(np.tile(0.1 * np.eye(3), (2, 1, 1)), offered, directions)
    sets = combinations_with_replacement if repeat > 1 else combinations
    values = [
        float(plan.standard_error(plan.present + offered[:, list(members)].sum(axis=1)))
        for members in sets(range(9), 3)
    ]
    greedy: list[int] = []
    for _ in range(3):
        left = [c for c in range(9) if repeat > 1 or c not in greedy]
        sums = [plan.present + offered[:, [*greedy, c]].sum(axis=1) for c in left]
        greedy.append(left[int(np.argmin([plan.variance(one) for one in sums]))])
    first = float(plan.standard_error(plan.present + offered[:, greedy].sum(axis=1)))
    found = chosen(plan, 3, repeat)
    assert min(values) * (1.0 - 1e-9) <= found.after[-1] <= first * (1.0 + 1e-9)
    assert found.after[-1] < 1.02 * min(values)


def test_errors_only_fall_along_a_set_and_repetitions_give_the_same() -> None:
    rng = np.random.default_rng(3)
    plan = DesignPlan(np.eye(3)[None], random_information(rng, 1, 12, 3), slope_of(3, 0))
    found = chosen(plan, 6)
    assert np.all(np.diff(found.after) < 0.0)
    again = np.diag([2.0, 1.0, 1.0])
    times = repetitions(plan, again, found.after[-1])
    # (1 + 2 r)^-1/2 is the error after r repetitions
    assert times == pytest.approx(0.5 * (found.after[-1] ** -2 - 1.0), abs=1e-5)
    assert repetitions(plan, np.zeros((3, 3)), found.after[-1]) is None


def test_equal_candidates_are_ties() -> None:
    offered = np.array([1.0, 3.0, 3.0, 3.0, 2.0])[None, :, None, None]
    found = chosen(DesignPlan(np.ones((1, 1, 1)), offered, slope_of(1, 0)), 2)
    assert found.ties == (1, 1)
    assert {*found.order} <= {1, 2, 3}


def test_a_candidate_that_cannot_be_computed_is_never_chosen() -> None:
    offered = np.array([1.0, np.nan, 3.0])[None, :, None, None]
    assert chosen(DesignPlan(np.ones((1, 1, 1)), offered, slope_of(1, 0)), 2).order == (2, 0)


def test_values_do_not_depend_on_units() -> None:
    rng = np.random.default_rng(4)
    offered, units = random_information(rng, 1, 8, 3), np.array([1e-6, 1.0, 1e5])
    plan = DesignPlan(0.1 * np.eye(3)[None], offered, None).relative()
    scale = np.outer(units, units)
    other = DesignPlan(0.1 * np.eye(3)[None] * scale, offered * scale, None).relative()
    assert chosen(plan, 3).after == pytest.approx(chosen(other, 3).after)
    assert plan.standard_error(plan.present) == pytest.approx(1.0)
