"""Individual parameters against columns and each other: the score of a correlation."""

import numpy as np
import pandas as pd
import pytest
from normal_levels import judged
from scipy import stats

from aleator import Check, Free, Identification, Inputs, Noise, Normal, identify
from aleator.results.values import Consistency

N, TIMES, SPREAD, NOISE = 30, np.array([0.0, 1.0, 2.0]), np.array([0.3, 0.4]), 0.3
DESIGN = np.stack([np.ones(3), TIMES], axis=1)


def found(rho: float) -> Identification:
    """Straight lines whose intercept and slope are correlated, which the law does not know."""
    rng = np.random.default_rng(3)
    u, v = rng.standard_normal((2, N))
    a, b = 1.0 + SPREAD[0] * u, 1.0 + SPREAD[1] * (rho * u + np.sqrt(1.0 - rho**2) * v)
    y = a[:, None] + b[:, None] * TIMES + NOISE * rng.standard_normal((N, 3))
    table = pd.DataFrame(
        {"id": np.repeat(np.arange(N), 3), "time": np.tile(TIMES, N), "y": y.ravel()}
    )
    limits = {"mean": Free(-1.0, 3.0), "sd": Free(0.01, 2.0)}
    law = Inputs({"a": Normal(**limits), "b": Normal(**limits)})
    return identify(
        lambda time, a, b: a + b * time, table, law, outcome="y", vectorized=True,
        noise=Noise(NOISE), verification=Check(0), best_law=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def tied() -> Identification:
    return found(0.9)


def test_a_correlation_that_the_law_lacks_is_named(tied: Identification) -> None:
    assert tied.sound
    assert tied.consistent is False
    test = tied.consistency.discrepancies[0].test
    assert (test.kind, {test.of, test.column}) == ("pair", {"a", "b"})
    assert test.z > 0.0
    assert "[correlation] a.b" in tied.consistency.discrepancies[0].remedy
    (pair,) = (r for r in tied.consistency.relations if r.pair)
    assert pair.p == test.p < 1e-3
    means = tied.individuals
    wanted = np.corrcoef(means["a.mean"], means["b.mean"])[0, 1]
    assert pair.correlation == pytest.approx(wanted, abs=1e-6)


def test_the_mean_products_are_the_score_of_a_correlation(tied: Identification) -> None:
    values, y = tied.values, tied.fit.table.observations.lower.reshape(N, 3)
    mean, sd = values[["a.mean", "b.mean"]].to_numpy(), values[["a.sd", "b.sd"]].to_numpy()

    def each(rho: float) -> np.ndarray:
        law = np.outer(sd, sd) * np.array([[1.0, rho], [rho, 1.0]])
        cov = DESIGN @ law @ DESIGN.T + NOISE**2 * np.eye(3)
        return stats.multivariate_normal(DESIGN @ mean, cov).logpdf(y)

    score = (each(1e-4) - each(-1e-4)) / 2e-4
    means, products = tied.fit.likelihood.variates()
    assert products[:, 0, 1] == pytest.approx(score, abs=1e-5)
    assert tied.shrinkage["a"] == pytest.approx(1.0 - np.std(means[:, 0]), abs=1e-6)


def test_independent_parameters_of_which_shrinkage_is_large_are_not_called_correlated() -> None:
    fair = found(0.0)
    (pair,) = (r for r in fair.consistency.relations if r.pair)
    assert pair.p > 0.02
    assert fair.shrinkage["a"] > 0.1


def test_a_parameter_that_drifts_along_the_table_is_related_to_its_order() -> None:
    rng = np.random.default_rng(5)
    a = np.linspace(-2.0, 2.0, 40) + 0.5 * rng.standard_normal(40)
    consistency = judged(a[:, None] + 0.3 * rng.standard_normal((40, 3)), half=np.arange(40) % 2)
    of = {r.other: r for r in consistency.relations}
    assert of["the order of the rows"].correlation > 0.8
    assert of["the order of the rows"].p < 1e-3
    assert abs(of["half"].correlation) < 0.4
    assert not any(r.pair for r in consistency.relations)


def test_a_table_sorted_by_what_single_experiments_are_has_no_order() -> None:
    rng = np.random.default_rng(6)
    a = np.sort(rng.standard_normal(40))
    consistency = judged(a[:, None] + 0.02 * rng.standard_normal((40, 3)), half=np.arange(40) % 2)
    assert [r.other for r in consistency.relations] == ["half"]
    assert consistency.consistent


def cores(seed: int, effect: float) -> Consistency:
    """Sixteen experiments of four values, whose parameter may follow a column of two values."""
    rng, moisture = np.random.default_rng([5, seed]), np.arange(16) % 2
    a = rng.standard_normal(16) + effect * moisture
    return judged(a[:, None] + 0.3 * rng.standard_normal((16, 4)), moisture=moisture)


def test_a_covariate_is_hinted_at_where_all_tests_together_do_not_see_it() -> None:
    found = cores(3, 1.6)
    hint, own = found.covariate, next(t for t in found.tests if t.kind == "relation")
    assert found.consistent
    assert hint is not None
    assert (hint.test.of, hint.test.column) == ("a", "moisture")
    # One parameter and one column of the table: the order of the rows is no covariate.
    assert hint.test.corrected == pytest.approx(hint.test.p)
    assert hint.test.p == own.p < 0.05 < own.corrected


def test_a_name_that_a_discrepancy_has_is_no_hint_as_well() -> None:
    found = cores(4, 1.6)
    assert found.discrepancies[0].test.column == "moisture"
    assert found.covariate is None
