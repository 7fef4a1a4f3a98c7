"""The statistics of consistency and their probabilities."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from aleator import Experiments
from aleator.inference.consistency import corrected, discrepancy_of, effective, probabilities
from aleator.inference.residual_statistics import contrasts_of, moments, shared
from aleator.inference.table_columns import ORDER, columns_of
from aleator.results.values import Statistic

NONE = np.zeros(1, dtype=bool)
ZERO = np.zeros(1)


def test_probabilities_of_normal_statistics_are_those_of_student() -> None:
    rng = np.random.default_rng(1)
    replicates = rng.normal(3.0, 2.0, (50, 1))
    p, _, _ = probabilities(np.array([9.0]), replicates, NONE, NONE, ZERO)
    t = (9.0 - replicates.mean()) / (replicates.std(ddof=1) * np.sqrt(1.0 + 1.0 / 50))
    assert p[0] == pytest.approx(2.0 * stats.t.sf(t, 49))


def test_each_replicate_is_judged_by_the_others() -> None:
    rng = np.random.default_rng(2)
    replicates = rng.normal(size=(40, 3))
    none = np.zeros(3, dtype=bool)
    _, own, _ = probabilities(np.zeros(3), replicates, none, none, np.zeros(3))
    others = replicates[1:]
    alone, _, _ = probabilities(replicates[0], others, none, none, np.zeros(3))
    assert own[0] == pytest.approx(alone)


@pytest.mark.parametrize("freedom", [3, 10])
def test_tails_of_skewed_statistics_are_right_within_a_third(freedom: int) -> None:
    rng = np.random.default_rng(3)
    replicates = rng.chisquare(freedom, (4000, 1))
    for level in (0.05, 0.001):
        at = np.array([stats.chi2.isf(level, freedom)])
        p, _, _ = probabilities(at, replicates, ~NONE, ~NONE, ZERO)
        assert p[0] == pytest.approx(level, rel=0.34)


def test_statistics_that_do_not_scatter_say_nothing() -> None:
    p, own, z = probabilities(np.array([5.0]), np.full((40, 1), 2.0), NONE, NONE, ZERO)
    assert (p[0], own[0, 0], z[0]) == (1.0, 1.0, 0.0)


def test_what_hardly_scatters_is_judged_as_if_it_did() -> None:
    replicates = np.random.default_rng(6).normal(0.0, 1e-4, (60, 1))
    at = np.array([1e-3])
    assert probabilities(at, replicates, NONE, NONE, ZERO)[0][0] < 1e-6
    assert probabilities(at, replicates, NONE, NONE, np.array([0.05]))[0][0] > 0.9


@pytest.mark.parametrize("copies", [1, 4])
def test_copies_of_a_test_do_not_count(copies: int) -> None:
    rng = np.random.default_rng(4)
    p = np.repeat(rng.random((2000, 10)), copies, axis=1)
    assert effective(p.min(axis=1)) == pytest.approx(10.0, rel=0.1)


def test_the_smallest_of_independent_p_is_corrected_as_sidak_does() -> None:
    assert corrected(np.array([0.01]), 5.0)[0] == pytest.approx(1.0 - 0.99**5)


RNG = np.random.default_rng(1)


def simple(**columns: object) -> Experiments:
    return Experiments.from_frame(pd.DataFrame(columns), outcome="y", conditions=["load"])


def test_every_column_is_looked_at_and_constants_are_not() -> None:
    table = simple(
        load=[1.0, 2.0, 1.0, 2.0], speed=[3.0] * 4, supplier=["a", "a", "b", "b"],
        hot=[1.0, 2.0, 4.0, 3.0], y=[0.0] * 4,
    )  # fmt: skip
    assert [column.name for column in columns_of(table)] == ["load", "supplier", "hot", ORDER]


def test_columns_that_order_the_rows_alike_count_once() -> None:
    load = RNG.random(12)
    table = simple(load=load, log=np.log(load), falling=1.0 / load, y=np.zeros(12))
    first, _ = columns_of(table)
    assert (first.name, first.alike) == ("load", ("log", "falling"))


def test_columns_of_experiments_and_of_observations_are_told_apart() -> None:
    frame = pd.DataFrame(
        {
            "id": ["a", "a", "b", "b"],
            "time": [0.0, 1.0, 0.0, 1.0],
            "hot": [1.0, 1.0, 2.0, 2.0],
            "y": [0.0] * 4,
        }
    )
    found = {
        c.name: c.by_experiment for c in columns_of(Experiments.from_frame(frame, outcome="y"))
    }
    assert (found["time"], found["hot"]) == (False, True)


def test_contrasts_have_mean_zero_and_length_one() -> None:
    table = simple(
        load=RNG.random(40), level=RNG.integers(0, 3, 40), kind=RNG.choice(["a", "b"], 40),
        y=np.zeros(40),
    )  # fmt: skip
    found = contrasts_of(columns_of(table), len(table))
    assert np.allclose(found.weights.sum(axis=1), 0.0, atol=1e-12)
    assert np.allclose(np.linalg.norm(found.weights, axis=1), 1.0)
    named = [(c.name, w) for c, w in zip(found.column, found.where, strict=True)]
    assert ("level", None) in named
    assert ("level", "level = 1") in named
    assert [where for name, where in named if name == "kind"] == ["kind = b"]


def test_likeness_within_groups_has_variance_one_and_sees_what_is_shared() -> None:
    group = np.repeat(np.arange(20), 3)
    right = [shared(group, RNG.standard_normal(60)) for _ in range(4000)]
    assert abs(np.mean(right)) < 0.05
    assert abs(np.std(right) - 1.0) < 0.05
    assert shared(group, RNG.standard_normal(20)[group]) > 4.0


def heavy(rows: np.ndarray) -> np.ndarray:
    return np.array([moments(w)[1] for w in rows])


@pytest.mark.parametrize("count", [16, 27])
def test_heavy_tails_of_normal_values_are_as_rare_as_told(count: int) -> None:
    """So many samples lie beyond quantiles of the normal law with their mean and scatter."""
    found = heavy(np.random.default_rng(count).standard_normal((10000, count)))
    z = (found - found.mean()) / found.std()
    for level in (0.02, 0.002):
        share = np.mean(z > stats.norm.isf(level))
        assert share == pytest.approx(level, abs=4.0 * np.sqrt(level / 10000) + 0.1 * level)


def test_heavy_tails_are_larger_than_normal_ones_and_two_modes_smaller() -> None:
    rng = np.random.default_rng(1)
    t3, normal = rng.standard_t(3, (300, 108)), rng.standard_normal((300, 108))
    modes = 0.5 * normal + 1.5 * rng.choice([-1.0, 1.0], normal.shape)
    low, high = np.quantile(heavy(normal), [0.05, 0.95])
    assert np.mean(heavy(t3) > high) > 0.85
    assert np.mean(heavy(modes) < low) > 0.95


def test_size_and_place_do_not_count() -> None:
    w = np.random.default_rng(2).standard_normal(50)
    assert moments(3.0 + 7.0 * w) == pytest.approx(moments(w))


def test_neighbours_in_an_experiment_are_no_order_of_rows() -> None:
    test = Statistic("groups", "outcomes", ORDER, None, 4.0, 1e-4, 1e-3)
    found = discrepancy_of(test, several=True, within=())
    assert "same experiment" in found.message
    assert ORDER not in found.message


def test_each_tail_has_its_remedy() -> None:
    heavy, light = (
        discrepancy_of(
            Statistic(f"{kind} tails", "outcomes", None, None, 4.0, 1e-4, 1e-3), False, ()
        )
        for kind in ("heavy", "light")
    )
    assert "student_t" in heavy.remedy
    assert "mixture" in light.remedy


def test_a_column_that_may_be_a_result_has_the_remedy_to_take_it_out() -> None:
    test = Statistic("contrast", "outcomes", "peak", None, 4.0, 1e-4, 1e-3)
    assert "take it out of the table" in discrepancy_of(test, False, (), {"peak"}).remedy
    assert "take it out" not in discrepancy_of(test, False, ()).remedy
