"""Many experiments: searched on a sample, answered with all."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from aleator import Check, Free, Gaussian, Identification, Inputs, Normal, identify
from aleator.fit import search as searching
from aleator.moments.likelihood import Continued
from aleator.search import Ascent, Optimum, SearchResult


def table(count: int) -> pd.DataFrame:
    rng = np.random.default_rng(4)
    z = np.linspace(1.0, 2.0, count)
    return pd.DataFrame({"z": z, "y": z * (1.0 + 0.1 * rng.standard_normal(count))})


def scatter(law: Inputs, data: pd.DataFrame) -> Identification:
    return identify(
        lambda z, a: z * a, data, law, outcome="y", vectorized=True, density=Gaussian(),
        verification=Check(0), consistency=False, best_law=False,
    )  # fmt: skip


@pytest.mark.parametrize("most", [60, 1000])
def test_the_answer_is_that_of_all_experiments(most: int, monkeypatch) -> None:
    """y = z a with a normal: mean and sd of y/z, whether or not a sample of 40 was searched."""
    settings = searching.SampledSearch(most, 40)
    monkeypatch.setattr(searching.of_many, "__defaults__", (settings,))
    data = table(300)
    found = scatter(Inputs({"a": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))}), data)
    ratio = data["y"] / data["z"]
    assert found.alpha["a.mean"].estimate == pytest.approx(ratio.mean(), abs=1e-5)
    assert found.alpha["a.sd"].estimate == pytest.approx(ratio.std(ddof=0), abs=1e-5)
    assert found.search["distinct_optima"] == 1
    assert found.sound


def test_the_ends_of_a_sample_that_become_one_optimum_are_one() -> None:
    """Three optima that a search of the sample claims: two near the maximum, one left out."""
    data = table(2500)
    small = scatter(Inputs({"a": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))}), data)
    problem = small.fit.likelihood.problem
    places = [np.array([1.003, 0.1]), np.array([0.99, 0.11]), np.array([1.4, 0.5])]

    def search(objective: Continued) -> SearchResult:
        assert objective(places[0]).each.size == searching.SAMPLE.size
        optima = tuple(Optimum(p, -float(k), 1) for k, p in enumerate(places))
        ascents = tuple(Ascent(p, p, -float(k), 9, True) for k, p in enumerate(places))
        return SearchResult(places[0], 0.0, ascents, optima)

    found = searching.of_many(problem, search, searching.SampledSearch(best=2))
    assert len(found.optima) == 1
    assert len(found.ascents) == 2
    assert found.converged
    assert found.alpha == pytest.approx(small.fit.alpha, abs=1e-4)
    assert found.log_likelihood == pytest.approx(small.fit.scored().total, abs=1e-4)
