"""A fit draws data that its likelihood recognizes, and climbs to the maximum of other data."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import stats

from aleator import Check, Experiments, Free, Identification, Inputs, Noise, Normal
from aleator.inference.fit import climbed, stepped
from aleator.laws.hyperparameter import Hyperparameter
from aleator.search.interface import LogLikelihood

COUNT = 60


def model(load: float, x: float) -> float:
    return load * x


def identified(noise: Noise | None) -> Identification:
    rng = np.random.default_rng(3)
    load = rng.uniform(1.0, 3.0, COUNT)
    y = load * rng.normal(1.0, 0.2, COUNT)
    if noise is not None:
        y = y + rng.normal(0.0, 0.1, COUNT)
    law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.6))})
    return unjudged(
        model, pd.DataFrame({"load": load, "y": y}), law, outcome="y", vectorized=True,
        noise=noise, verification=Check(0),
    )  # fmt: skip


@pytest.fixture(scope="module", params=[None, 0.1], ids=["exact", "noisy"])
def found(request: pytest.FixtureRequest) -> Identification:
    return identified(None if request.param is None else Noise(request.param))


def variance(found: Identification, sd: float) -> np.ndarray:
    load = found.fit.table.conditions["load"].to_numpy()
    noise = found.values.get("noise.sd", 0.0)
    return (load * sd) ** 2 + noise**2


def test_it_stands_at_the_maximum(found: Identification) -> None:
    scored = found.fit.scored()
    assert scored.total == pytest.approx(found.log_likelihood.estimated, abs=1e-6)
    scaled = scored.score[:2] * found.errors.to_numpy()[:2]
    assert np.max(np.abs(scaled)) < 0.02


def test_drawn_data_have_uniform_probabilities(found: Identification) -> None:
    rng = np.random.default_rng(5)
    drawn = np.concatenate([found.fit.drawn(rng).probabilities() for _ in range(20)])
    assert stats.kstest(drawn, "uniform").pvalue > 1e-3


def test_the_maximum_of_drawn_data_is_that_of_the_closed_form(found: Identification) -> None:
    fit = found.fit.drawn(np.random.default_rng(7))
    end = climbed(fit)
    load = found.fit.table.conditions["load"].to_numpy()
    y = stats.norm(
        load * found.values["x.mean"], np.sqrt(variance(found, found.values["x.sd"]))
    ).ppf(fit.probabilities())
    values = [
        stats.norm.logpdf(y, load * end.alpha[0], np.sqrt(variance(found, end.alpha[1] + d))).sum()
        for d in (-0.01, 0.0, 0.01)
    ]
    assert values[1] == pytest.approx(end.scored().total, abs=0.15)
    assert values[1] == max(values)


def test_another_fit_sees_the_data_that_one_drew(found: Identification) -> None:
    fit = found.fit.drawn(np.random.default_rng(6))
    other = found.fit.seeing(fit.table)
    assert other.scored().total == pytest.approx(fit.scored().total, abs=1e-9)
    again = other.seeing(found.fit.table)
    assert again.scored().total == pytest.approx(found.fit.scored().total, abs=1e-6)


def test_one_step_goes_most_of_the_way(found: Identification) -> None:
    fit = found.fit.drawn(np.random.default_rng(8))
    far = climbed(fit).scored().total - fit.scored().total
    left = climbed(fit).scored().total - stepped(fit).scored().total
    assert left + 1e-6 >= 0.0
    assert left < 0.2 * far + 0.02


def test_an_experiment_that_does_not_count_changes_nothing_else(found: Identification) -> None:
    weights = np.ones(COUNT)
    weights[4] = 0.0
    end = climbed(found.fit, weights).alpha
    one = found.fit.scored().scores[4, :2]
    information = found.fit.inference.information
    expected = -np.linalg.solve(information, one)
    assert end[:2] - found.fit.alpha[:2] == pytest.approx(expected, rel=0.2, abs=2e-4)


def test_individual_draws_are_a_sample_of_the_law() -> None:
    fit = identified(Noise(0.1)).fit
    rng = np.random.default_rng(9)
    x = np.concatenate([fit.drawn(rng).likelihood.individuals(rng)[:, 0] for _ in range(20)])
    law = stats.norm(fit.alpha[0], fit.alpha[1])
    assert stats.kstest(x, law.cdf).pvalue > 1e-3


def test_what_is_given_integrates_to_the_likelihood() -> None:
    fit = identified(Noise(0.1)).fit
    nodes = np.linspace(-8.0, 8.0, 2001)
    weights = np.exp(-0.5 * nodes**2)
    x = (fit.alpha[0] + fit.alpha[1] * nodes)[:, None]
    each = np.log(np.exp(fit.likelihood.log_density_at(x)) @ (weights / weights.sum()))
    assert each == pytest.approx(fit.scored().each, abs=1e-8)


def test_where_nothing_is_identified_a_fit_stays_where_it_is() -> None:
    rng = np.random.default_rng(3)
    table = pd.DataFrame({"load": np.ones(8), "y": rng.normal(1.0, 0.3, 8)})
    law = Inputs({"x": Normal(1.0, 0.2)})
    fit = unjudged(
        model, table, law, outcome="y", vectorized=True, noise=Noise(0.1),
        verification=Check(0),
    ).fit  # fmt: skip
    other = fit.drawn(rng)
    for end in (stepped(other), climbed(other)):
        assert end.alpha.tolist() == fit.alpha.tolist()


def test_probabilities_of_series_that_tell_their_parameters_are_those_of_the_normal_law() -> None:
    rng = np.random.default_rng(21)
    times = np.linspace(0.1, 1.0, 12)
    own = rng.normal([1.0, 2.0], [0.3, 0.4], (20, 2))
    y = own @ np.array([np.ones(12), times]) + 0.01 * rng.standard_normal((20, 12))
    table = pd.DataFrame(
        {"id": np.repeat(np.arange(20), 12), "t": np.tile(times, 20), "y": y.ravel()}
    )
    law = Inputs({"a": Normal(1.0, 0.3), "b": Normal(2.0, 0.4)})
    fit = unjudged(
        lambda t, a, b: a + b * t, Experiments.from_frame(table, outcome="y", id="id"), law,
        vectorized=True, noise=Noise(0.01), verification=Check(0),
    ).fit  # fmt: skip
    curve = np.stack([0.3 * np.ones(12), 0.4 * times], axis=1)
    root = np.linalg.cholesky(curve @ curve.T + 1e-4 * np.eye(12))
    exact = np.linalg.solve(root, (y - 1.0 - 2.0 * times).T).T
    w = stats.norm.ppf(fit.probabilities(256)).reshape(20, 12)
    assert np.mean(np.isfinite(w)) > 0.95
    assert np.sqrt(np.nanmean((w - exact) ** 2)) < 0.15
    w = stats.norm.ppf(fit.probabilities(1024)).reshape(20, 12)
    assert np.mean(np.isfinite(w)) > 0.98
    assert np.sqrt(np.nanmean((w - exact) ** 2)) < 0.1


@dataclass(frozen=True)
class Product:
    """log L = -((a b - 1)/0.01)^2/2 + 3 a: data tell a product of two factors, and hardly more."""

    alpha: np.ndarray
    hyperparameters = tuple(Hyperparameter(name, 0.1, 9.0, 1.0, True) for name in "ab")
    inference = SimpleNamespace(
        identified=np.arange(2), information=1e4 * np.ones((2, 2)) + np.diag([0.0, 4.0])
    )

    def scored(self) -> LogLikelihood:
        a, b = self.alpha
        miss = (1.0 - a * b) / 1e-4
        value = np.array([-0.5e4 * (a * b - 1.0) ** 2 + 3.0 * a])
        return LogLikelihood(value, np.array([[miss * b + 3.0, miss * a]]), np.zeros(1, dtype=int))

    def at(self, alpha: np.ndarray) -> Product:
        return Product(alpha)


def test_a_step_along_a_ridge_never_ends_lower() -> None:
    begun = Product(np.ones(2))
    whole = np.linalg.solve(begun.inference.information, begun.scored().score)
    assert Product(begun.alpha + whole).scored().total < begun.scored().total - 10.0
    end = stepped(begun)
    assert begun.scored().total < end.scored().total
    assert np.any(end.alpha != begun.alpha)


# -------------------------------------------------------------- replicates of very many experiments

LOADS = np.repeat(np.linspace(1.0, 3.0, 31), 10)


@pytest.fixture(scope="module")
def very_many():
    """Exact outcomes z exp(a): log(y / z) is normal."""
    a = 0.2 + 0.3 * np.random.default_rng(8).standard_normal(LOADS.size)
    law = Inputs({"a": Normal(Free(-0.5, 1.0), Free(0.02, 1.0))})
    return unjudged(
        lambda z, a: z * np.exp(a), pd.DataFrame({"z": LOADS, "y": LOADS * np.exp(a)}), law,
        outcome="y", vectorized=True, verification=Check(0),
    )  # fmt: skip


def test_probabilities_are_those_of_the_lognormal_law(very_many) -> None:
    fit = very_many.fit.for_replicates()
    exact = stats.norm.cdf(np.log(fit.table.outcomes / LOADS), *fit.alpha)
    np.testing.assert_allclose(fit.probabilities(), exact, atol=1e-4)
    other = fit.drawn(np.random.default_rng(3))
    again = stats.norm.cdf(np.log(other.table.outcomes / LOADS), *other.alpha)
    np.testing.assert_allclose(other.probabilities(), again, atol=1e-4)


def test_the_maximum_stays_within_a_tenth_of_a_standard_error(very_many) -> None:
    fit = very_many.fit
    moved = (fit.for_replicates().alpha - fit.alpha) / fit.inference.standard_error
    assert np.max(np.abs(moved)) < 0.1
    assert (
        fit.for_replicates().likelihood.problem.levels.cells < fit.likelihood.problem.levels.cells
    )


def test_each_experiment_is_drawn_at_a_point_of_its_own(very_many) -> None:
    """Points that all share end where the farthest of very many experiments does not."""
    drawn = very_many.fit.drawn(np.random.default_rng(4))
    a = np.log(drawn.table.outcomes / LOADS)
    assert np.unique(a.round(9)).size == LOADS.size
    assert stats.kstest(a, "norm", very_many.fit.alpha).pvalue > 1e-3
