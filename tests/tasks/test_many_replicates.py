"""Replicates of very many experiments: coarser, and yet the same to a verdict."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from aleator import Check, Free, Inputs, Normal, identify
from aleator.inference.consistency import CONSISTENCY

LOADS = np.repeat(np.linspace(1.0, 3.0, 31), 100)


@pytest.fixture(scope="module")
def found():
    """Exact outcomes z exp(a): log(y / z) is normal."""
    a = 0.2 + 0.3 * np.random.default_rng(8).standard_normal(LOADS.size)
    law = Inputs({"a": Normal(Free(-0.5, 1.0), Free(0.02, 1.0))})
    return identify(
        lambda z, a: z * np.exp(a), pd.DataFrame({"z": LOADS, "y": LOADS * np.exp(a)}), law,
        outcome="y", vectorized=True, verification=Check(0),
    )  # fmt: skip


def test_probabilities_are_those_of_the_lognormal_law(found) -> None:
    fit = found.fit.for_replicates()
    exact = stats.norm.cdf(np.log(fit.table.outcomes / LOADS), *fit.alpha)
    np.testing.assert_allclose(fit.probabilities(), exact, atol=1e-4)
    other = fit.drawn(np.random.default_rng(3))
    again = stats.norm.cdf(np.log(other.table.outcomes / LOADS), *other.alpha)
    np.testing.assert_allclose(other.probabilities(), again, atol=1e-4)


def test_the_maximum_stays_within_a_tenth_of_a_standard_error(found) -> None:
    fit = found.fit
    moved = (fit.for_replicates().alpha - fit.alpha) / fit.inference.standard_error
    assert np.max(np.abs(moved)) < 0.1
    assert (
        fit.for_replicates().likelihood.problem.levels.cells < fit.likelihood.problem.levels.cells
    )


def test_each_experiment_is_drawn_at_a_point_of_its_own(found) -> None:
    """Points that all share end where the farthest of very many experiments does not."""
    drawn = found.fit.drawn(np.random.default_rng(4))
    a = np.log(drawn.table.outcomes / LOADS)
    assert np.unique(a.round(9)).size == LOADS.size
    assert stats.kstest(a, "norm", found.fit.alpha).pvalue > 1e-3


def test_a_right_model_of_very_many_is_consistent_by_few_replicates(found) -> None:
    assert found.consistent
    assert found.consistency.replicates <= CONSISTENCY.large_replicates
