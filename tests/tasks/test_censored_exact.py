"""Lives and run-outs without measurement noise: whole identifications against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from identifications import Array, unjudged
from scipy import stats

from aleator import (
    Censoring,
    Experiments,
    Free,
    GradientMultistart,
    Identification,
    Inputs,
    LogNormal,
    Normal,
    Predicted,
    ResponseSurface,
    compare,
    next_experiments,
    recover,
)
from aleator.errors import InputsError
from aleator.likelihood.level_sets.predicted import PredictedOutcomes

LIMIT = 4.0
LAW = {"a": LogNormal(mean=Free(0.5, 20.0), sd=Free(0.05, 20.0))}


def lives(count: int = 60) -> tuple[Array, Experiments]:
    """Lives under two loads; those above the limit of the test are run-outs. Load 2 halves them."""
    load = np.tile([1.0, 2.0], count // 2)
    life = np.exp(np.random.default_rng(1).normal(1.0, 0.5, count)) / load
    table = pd.DataFrame(
        {"life": np.minimum(life, LIMIT), "load": load,
         "ended": np.where(life > LIMIT, "run-out", "failure")}
    )  # fmt: skip
    return life * load, Experiments.from_frame(
        table, outcome="life", conditions=["load"], transform="log",
        censored=Censoring("ended", right="run-out"),
    )  # fmt: skip


def life(load: Array, a: Array) -> Array:
    return a / load


@pytest.fixture(scope="module")
def found() -> Identification:
    return unjudged(life, lives()[1], LAW, vectorized=True)


def test_lives_and_run_outs_have_the_maximum_of_a_censored_sample(found: Identification) -> None:
    strength, table = lives()
    seen = table.observations
    log_load = np.log(table.conditions["load"].to_numpy())
    sample = stats.CensoredData.right_censored(seen.lower + log_load, seen.censored)
    mean, sd = stats.norm.fit(sample)
    quantities = found.quantities["estimate"]
    assert quantities["a.median"] == pytest.approx(np.exp(mean), rel=1e-4)
    assert quantities["a.sdlog"] == pytest.approx(sd, rel=1e-4)
    law, exact = stats.norm(mean, sd), ~seen.censored
    total = law.logpdf(np.log(strength[exact])).sum()
    total += law.logsf((seen.lower + log_load)[~exact]).sum()
    assert found.log_likelihood.estimated == pytest.approx(total, abs=1e-4)
    assert found.sound
    assert "circe" not in found.baselines


def test_what_is_told_of_a_run_out(found: Identification) -> None:
    """Its own parameter is lognormal above the bound; its probability lies above the bound's."""
    seen = lives()[1].observations
    (row, *_) = np.flatnonzero(seen.censored).tolist()
    at, own = found.observations[row], found.experiments[row]
    assert (at.lower, at.upper) == (pytest.approx(np.log(LIMIT)), None)
    quantities = found.quantities["estimate"]
    mean, sd = np.log(quantities["a.median"]), quantities["a.sdlog"]
    z = (np.log(LIMIT) - mean) / sd
    above = np.exp(mean + 0.5 * sd**2) * stats.norm.sf(z - sd) / stats.norm.sf(z)
    assert own.mean["a"] == pytest.approx(above, rel=1e-4)
    assert own.log_density == pytest.approx(stats.norm.logsf(z), abs=1e-4)
    assert stats.norm.cdf(z) < at.pit < 1.0


def test_drawn_lives_end_at_the_limit_of_the_test(found: Identification) -> None:
    fit = found.session.fit
    drawn = fit.drawn(np.random.default_rng(2))
    lower, upper = drawn.table.observations.lower, drawn.table.observations.upper
    assert np.all(lower <= np.log(LIMIT))
    assert np.array_equal(upper > lower, lower == np.log(LIMIT))
    assert np.all(np.isfinite(drawn.scored().each))
    pit = np.concatenate(
        [fit.drawn(np.random.default_rng(k)).probabilities() for k in range(20)]
    )  # fmt: skip
    assert stats.kstest(pit, "uniform").pvalue > 0.01


@pytest.mark.slow
def test_the_emulator_gives_the_same_and_counts_its_error(found: Identification) -> None:
    def one_life(load: float, a: float) -> float:
        return float(a / load)

    processes, search = ResponseSurface(surfaces="process"), GradientMultistart(3)
    emulated = unjudged(one_life, lives()[1], LAW, propagation=processes, search=search)
    for name, exact in found.alpha.items():
        error = abs(emulated.alpha[name].estimate - exact.estimate)
        assert error < 0.05 * exact.standard_error
    assert emulated.emulator_error < 0.2
    assert emulated.sound


def test_several_values_with_a_bound_among_them_need_noise() -> None:
    seen = lives(8)[1]
    each = np.repeat(np.arange(4), 2)
    together = replace(seen.observations, experiment=each)
    table = Experiments(("1", "2", "3", "4"), seen.conditions, together, experiment=each)
    laws = Inputs({**LAW, "b": Normal(1.0, 0.1)})
    with pytest.raises(InputsError, match="one observation an experiment"):
        unjudged(lambda load, a, b: a * b / load, table, laws)


def test_densities_of_moments_are_refused_for_censored_values() -> None:
    with pytest.raises(InputsError, match="without censored values"):
        unjudged(life, lives()[1], LAW, propagation=ResponseSurface(tolerance=0.01))


def test_infinite_outcomes_count_beyond_every_bound() -> None:
    outcomes = PredictedOutcomes(
        np.array([[1.0, 2.0, np.inf, np.nan]]), np.full(4, 0.25), np.array([0])
    )
    below = [outcomes.cdf(np.array([y]))[0] for y in (1.5, 3.0)]
    assert below == pytest.approx([1.0 / 3.0, 0.5])
    assert outcomes.mean.tolist() == [1.5]


@pytest.mark.slow
def test_tasks_that_ask_the_likelihood_take_bounds(found: Identification) -> None:
    other = unjudged(lambda load, a: a / load**1.3, lives()[1], LAW, vectorized=True)
    values = compare(one=found, two=other).table()["log_likelihood"]
    assert values["one"] == pytest.approx(found.log_likelihood.estimated, abs=1e-3)
    candidates = pd.DataFrame({"load": [0.5, 2.0]})
    # Under the half load nearly every test ends at its limit: such a run-out tells little.
    assert next_experiments(found, candidates, 1, about="a.sd").chosen == ("2",)
    wanted = Predicted(pd.DataFrame({"load": [1.0]}), 0.05)
    assert next_experiments(found, candidates, 1, about=wanted).chosen == ("2",)
    again = recover(
        life, lives()[1], LAW, {"a.mean": 3.0, "a.sd": 1.5}, replicates=2, vectorized=True
    )
    assert np.all(np.abs(again.alpha / [3.0, 1.5] - 1.0) < 0.5)
