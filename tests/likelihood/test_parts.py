"""Many experiments some at a time: what they are together, in memory that does not grow."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pandas as pd
import pytest

from aleator import Convolution, Free, Inputs, MonteCarlo, Normal, identify
from aleator.errors import InputsError
from aleator.likelihood import predictive
from aleator.moments.likelihood import Likelihood
from aleator.likelihood.parts import InParts


@pytest.fixture(scope="module")
def likelihood() -> Likelihood:
    """Exact outcomes z a of 40 experiments, some of them under equal conditions."""
    rng = np.random.default_rng(5)
    z = np.repeat(np.linspace(1.0, 2.0, 20), 2)
    y = z * (1.0 + 0.1 * rng.standard_normal(40))
    law = Inputs({"a": Normal(mean=Free(0.5, 1.5), sd=Free(0.02, 0.5))})
    found = identify(
        lambda z, a: z * a, pd.DataFrame({"z": z, "y": y}), law, outcome="y", vectorized=True,
        density=Convolution(), verification=MonteCarlo(0), consistency=False, best_law=False,
    )  # fmt: skip
    return found.fit.problem.likelihood


def test_in_parts_and_at_once_are_the_same(likelihood, monkeypatch) -> None:
    alpha, y = np.array([1.02, 0.11]), likelihood.outcomes
    whole = likelihood.predictive.at(alpha)
    assert not isinstance(whole, InParts)
    # seven experiments of some 400 nodes at a time
    monkeypatch.setattr(predictive, "LARGEST", 7 * 401)
    every = np.arange(40)
    parts = likelihood.predictive.take(every).at(alpha)
    assert isinstance(parts, InParts)
    assert [rows.stop - rows.start for rows in parts.rows] == [7, 7, 7, 7, 7, 5]
    one, other = whole.scored(y), parts.scored(y)
    np.testing.assert_allclose(other.each, one.each, rtol=1e-12)
    np.testing.assert_allclose(other.scores, one.scores, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(parts.fitted.status, whole.fitted.status)
    np.testing.assert_allclose(parts.fitted.cdf(y), whole.fitted.cdf(y), rtol=1e-12)
    np.testing.assert_allclose(parts.fitted.pdf(y), whole.fitted.pdf(y), rtol=1e-10)
    grid = np.linspace(0.8, 2.2, 5) * np.ones((40, 1))
    np.testing.assert_allclose(parts.fitted.log_pdf(grid), whole.fitted.log_pdf(grid), rtol=1e-9)
    levels = np.array([0.1, 0.5, 0.975])
    np.testing.assert_allclose(parts.fitted.quantile(levels), whole.fitted.quantile(levels))
    with pytest.raises(InputsError, match="the outcome"):
        parts.fitted.cdf(y[:3])


def test_some_experiments_are_those_of_all(likelihood) -> None:
    alpha, rows = np.array([0.97, 0.09]), np.array([31, 4, 5, 20])
    some, every = likelihood.take(rows)(alpha), likelihood(alpha)
    np.testing.assert_allclose(some.each, every.each[rows], rtol=1e-12)
    np.testing.assert_allclose(some.scores, every.scores[rows], rtol=1e-9)


def test_parts_bound_what_an_evaluation_holds(likelihood, monkeypatch) -> None:
    monkeypatch.setattr(predictive, "LARGEST", 8 * 401)
    many = likelihood.take(np.tile(np.arange(40), 50))
    tracemalloc.start()
    many.continued(np.array([1.0, 0.1]))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # one array of all outcomes at the nodes alone would be 6.4 MB
    assert peak < 5e6
