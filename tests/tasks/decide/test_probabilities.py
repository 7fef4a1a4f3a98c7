"""Probabilities of rare events against closed forms, and checks on the simulator."""

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import pytest
from scipy import integrate, optimize, stats

from aleator import By, Free, Inputs, LogNormal, Noise, Normal, Uniform
from aleator.errors import InputsError
from aleator.inference.alpha_draws import AlphaDraws
from aleator.inference.outcome_event import OutcomeEvent
from aleator.inference.rare_events import Event
from aleator.observations.errors import MeasurementErrors
from aleator.observations.experiments import Conditions
from aleator.simulators import Runner, as_simulator
from aleator.surrogates import ResponseSurface
from aleator.tasks.event_points import corrected, of_law, unseen_after, unseen_by
from aleator.tasks.new_experiments import Kriged, PredictedValue, PredictionContext
from aleator.tasks.probability import probability, widened_interval

ONE = pd.DataFrame({"load": [1.0]})


def ground(
    simulator: Callable[..., np.ndarray], inputs: Inputs, noise: Noise | None = None,
    fast: bool = False, conditions: pd.DataFrame = ONE, transform: str = "none",
) -> PredictionContext:  # fmt: skip
    table = Conditions.from_frame(conditions, transform=transform)
    runner = Runner(as_simulator(simulator, True), table, inputs.names)
    errors = None if noise is None else MeasurementErrors.of(noise, table)
    return PredictionContext(table, inputs, errors, runner, fast, ResponseSurface())


def known(inputs: Inputs, *noise: float) -> AlphaDraws:
    return AlphaDraws.at(np.array([*(h.start for h in inputs.hyperparameters), *noise]))


def above(value: float) -> Event:
    return Event(((value, np.inf),))


def found(where: PredictionContext, event: Event, draws: AlphaDraws, checks: int = 0):
    return probability(PredictedValue.of(where, 0, draws), draws, event, checks)


ALONE = Inputs({"a": Normal(0.0, 1.0)})
PAIR = Inputs({"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0)})


def agrees(told, exact: float, within: float) -> None:
    assert told.status == "solved"
    assert told.probability == pytest.approx(exact, rel=within)
    assert abs(told.probability - exact) < 4.0 * told.error


@pytest.mark.parametrize("fast", [True, False])
def test_a_linear_model_has_its_normal_tail(fast: bool) -> None:
    where = ground(lambda load, a, b: load * (3.0 * a + 4.0 * b), PAIR, fast=fast)
    told = found(where, above(5.0 * 4.75), known(PAIR))
    agrees(told, stats.norm.sf(4.75), 0.05)
    assert told.distance == pytest.approx(4.75, abs=1e-3)


def test_measurement_errors_are_part_of_it() -> None:
    where = ground(lambda load, a, b: load * (a + b), PAIR, Noise(1.0))
    told = found(where, Event(((-np.inf, -8.0),)), known(PAIR, 1.0))
    agrees(told, stats.norm.cdf(-8.0 / np.sqrt(3.0)), 0.1)


def test_both_sides_of_a_failure_count() -> None:
    where = ground(lambda load, a: load * np.abs(a), ALONE, fast=True)
    agrees(found(where, above(4.5), known(ALONE)), 2.0 * stats.norm.sf(4.5), 0.05)
    between = found(ground(lambda load, a: load * a, ALONE), Event(((-4.5, 4.5),)), known(ALONE))
    assert 1.0 - between.probability == pytest.approx(2.0 * stats.norm.sf(4.5), rel=0.05)


def test_the_error_is_that_of_curved_limit_states() -> None:
    """z over parabolas a + k b^2 > c and rings, whose tails are integrals over b or closed."""
    z = []
    for k, c in product((0.05, 0.25), (2.5, 4.5)):
        exact = integrate.quad(
            lambda b, k=k, c=c: stats.norm.sf(c - k * b**2) * stats.norm.pdf(b), -12.0, 12.0
        )[0]
        where = ground(lambda load, a, b, k=k: load * (a + k * b**2), PAIR)
        told = found(where, above(c), known(PAIR))
        assert told.probability == pytest.approx(exact, rel=0.06)
        z.append((told.probability - exact) / told.error)
    for square in (8.0, 30.0):
        where = ground(lambda load, a, b: load * (a**2 + b**2), PAIR)
        told = found(where, above(square), known(PAIR))
        z.append((told.probability - stats.chi2.sf(square, 2)) / told.error)
    assert np.sqrt(np.mean(np.square(z))) < 1.4
    assert np.abs(z).max() < 4.0


def test_the_probability_and_the_estimate_lie_in_their_interval() -> None:
    """Also where a few heavy laws make nearly all of the mean; 95 % of the laws are within."""
    rng = np.random.default_rng(3)
    for spread in (0.1, 1.0, 4.0, 8.0):
        values = 1e-9 * np.exp(spread * rng.normal(size=256))
        weights = rng.dirichlet(np.ones(256))
        mean = float(weights @ values)
        for own in (0.0, float(np.median(values)), 1.0):
            low, high = widened_interval(np.array([mean, own]), values, weights)
            assert low <= min(mean, own) < max(mean, own) <= high
            assert np.sum(weights, where=(values >= low) & (values <= high)) > 0.92
        ends = widened_interval(np.array([mean]), values, weights)
        inside = np.sum(weights, where=(values >= ends[0]) & (values <= ends[1]))
        assert 0.92 < inside < 0.98


def test_an_estimate_on_its_limit_lies_in_the_interval_of_its_probability() -> None:
    """sd = 0 is the least of all plausible ones: a failure has its least probability there."""
    law = Inputs({"a": Normal(0.0, Free(0.0, 2.0))})
    score = stats.norm.ppf((np.arange(64) + 0.5) / 64)
    sds = 0.2 + 0.1 * np.abs(score)
    alpha, none = np.stack([np.zeros(64), sds], axis=1), np.empty(0, np.intp)
    draws = AlphaDraws(np.array([0.0, 1e-6]), alpha, np.full(64, 1 / 64), alpha, score, none)
    told = found(ground(lambda load, a: load * a, law, fast=True), above(0.5), draws)
    assert told.at_estimate == pytest.approx(0.0, abs=1e-9)
    assert told.lower <= told.at_estimate < told.probability < told.upper
    exact = stats.norm.sf(0.5 / sds).mean()
    assert told.probability == pytest.approx(exact, rel=0.05)


def test_what_a_bounded_law_cannot_reach_has_the_probability_zero() -> None:
    law = Inputs({"a": Uniform(0.5, np.sqrt(1.0 / 12.0))})
    for fast in (True, False):
        told = found(ground(lambda load, a: load * a, law, fast=fast), above(1.1), known(law))
        assert (told.probability, told.status) == (0.0, "never")
        assert (told.contrary.probability, told.contrary.status) == (1.0, "always")


def test_a_slow_simulator_is_run_some_tens_of_times_and_checked() -> None:
    law = Inputs({"a": LogNormal(1.0, 0.2)})
    where = ground(lambda load, a: load * np.sqrt(a) * np.exp(a), law)
    limit = 3.0
    told = found(where, above(np.sqrt(limit) * np.exp(limit)), known(law), 20)
    variance = np.log(1.0 + 0.2**2)
    exact = stats.norm.sf((np.log(limit) + 0.5 * variance) / np.sqrt(variance))
    agrees(told, exact, 0.1)
    assert exact < 1e-8
    assert told.checks == 20
    assert where.runner.runs < 96 + 2 * 96 + 20 + 1  # polynomial, a round, checks


def doubtful(monkeypatch: pytest.MonkeyPatch) -> None:
    """Surfaces have a standard deviation of 0.1 wherever they are asked."""
    monkeypatch.setattr(Kriged, "deviation", lambda _, x: np.full(len(x), 0.1))


def test_runs_correct_a_surface_that_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """A surface whose outcomes are 0.1 too small: P(a > 1.9) in place of P(a > 2)."""
    doubtful(monkeypatch)
    draws = known(ALONE)
    right = ground(lambda load, a: load * a, ALONE)
    near = PredictedValue.of(right, 0, draws)
    wrong = PredictedValue.of(ground(lambda load, a: load * a - 0.1, ALONE), 0, draws)
    mixed = replace(near, surface=wrong.surface)
    change = corrected(mixed, draws, above(1.9), of_law(mixed).joined, 400)
    exact = stats.norm.sf(1.9) - stats.norm.sf(2.0)
    assert abs(change.value - exact) < 3.0 * change.error < 3.0 * exact
    assert change.runs == 400


def test_the_interval_is_that_of_the_uncertain_mean() -> None:
    """P(a + mean > 3) rises with the mean: its quantiles are those at quantiles of the mean."""
    law = Inputs({"a": Normal(0.0, 1.0)})
    score = stats.norm.ppf((np.arange(200) + 0.5) / 200)
    alpha = np.stack([0.5 * score, np.ones(200)], axis=1)
    none = np.empty(0, np.intp)
    draws = AlphaDraws(np.array([0.0, 1.0]), alpha, np.full(200, 1 / 200), alpha, score, none)
    told = found(ground(lambda load, a: load * a, law, fast=True), above(3.0), draws)
    ends = stats.norm.sf(3.0 - 0.5 * stats.norm.ppf([0.025, 0.975]))
    assert [told.lower, told.upper] == pytest.approx(ends, rel=0.12)
    assert told.at_estimate == pytest.approx(stats.norm.sf(3.0), rel=0.05)
    assert told.probability == pytest.approx(stats.norm.sf(3.0 / np.sqrt(1.25)), rel=0.05)


def test_laws_that_follow_covariates_are_asked_row_by_row() -> None:
    rows = pd.DataFrame({"load": [1.0, 1.0], "t": [0.0, 2.0]})
    law = Inputs({"a": Normal(By("1 + t", -5.0, 5.0), 1.0)}).resolved(rows)
    where = ground(lambda load, t, a: load * a + 0.0 * t, law, fast=True, conditions=rows)
    draws = AlphaDraws.at(np.array([0.0, 1.0, 1.0]))
    for place, mean in ((0, 0.0), (1, 2.0)):
        told = probability(PredictedValue.of(where, place, draws), draws, above(5.0))
        assert told.probability == pytest.approx(stats.norm.sf(5.0 - mean), rel=0.05)


def test_values_are_in_the_unit_of_the_outcome() -> None:
    where = ground(lambda load, a: load * np.exp(a), ALONE, transform="log")
    event = OutcomeEvent.of("outcome > 2.0", ["outcome"]).on(where.seen.responses[0].transform)
    agrees(found(where, event, known(ALONE)), stats.norm.sf(np.log(2.0)), 0.02)
    with pytest.raises(InputsError, match="logarithm"):
        OutcomeEvent.of("outcome > -1", ["outcome"]).on(where.seen.responses[0].transform)


def bump(place: tuple[float, float], width: float) -> Callable[..., np.ndarray]:
    """A line with a narrow hill away from the point of the line that is most probable."""
    return lambda load, a, b: (
        load * (a + 8.0 * np.exp(-((a - place[0]) ** 2 + (b - place[1]) ** 2) / (2.0 * width**2)))
    )


def by_cells(response: Callable[..., np.ndarray], limit: float) -> float:
    """P(y(a, b) > limit) of two standard normal variates by 1601 x 1601 cells."""
    a = np.linspace(-8.0, 8.0, 1601)
    density = stats.norm.pdf(a)
    inside = response(1.0, a[:, None], a) > limit
    return float(np.sum(inside * density[:, None] * density) * (a[1] - a[0]) ** 2)


@pytest.mark.slow
def test_a_hill_off_the_design_point_is_part_of_the_event() -> None:
    """The crest is 0.016 above the limit: nine tenths of the probability."""
    place = (-3.1, 0.2)
    where = ground(bump(place, 0.5), PAIR)
    told = found(where, above(4.9), known(PAIR), 20)
    exact = by_cells(bump(place, 0.5), 4.9)
    agrees(told, exact, 0.2)
    assert told.unseen > exact
    assert where.runner.runs < 700


@pytest.mark.parametrize(
    ("response", "limit"),
    [
        (lambda load, a, b: load * np.maximum(a, -0.95 * b), 4.1),
        (lambda load, a, b: load * (a + 0.7 * np.abs(b)), 5.1),
    ],
)
def test_regions_and_kinks_by_few_runs(response: Callable[..., np.ndarray], limit: float) -> None:
    """Two regions, and a kink, which no polynomial has."""
    where = ground(response, PAIR)
    agrees(found(where, above(limit), known(PAIR), 20), by_cells(response, limit), 0.1)
    assert where.runner.runs < 400


def test_runs_exclude_only_what_they_would_have_met() -> None:
    """Of points of the law itself, three in a hundred for a hundred runs."""
    assert unseen_by(np.ones(100_000), 100) == pytest.approx(1.0 - 0.05 ** (1 / 100), rel=1e-3)


@pytest.mark.parametrize("radii", [(6.0,), (6.0, 6.0), (3.0, 6.0)])
def test_all_rounds_of_runs_exclude_regions(radii: tuple[float, ...]) -> None:
    """Of one variate, runs are rarest about the centre: the region is |a| < t."""

    def met(t: float) -> np.ndarray:
        return 0.5 * (1.0 - 2.0 * stats.norm.sf(t)) + 0.5 * np.minimum(t / np.array(radii), 1.0)

    def kept(t: float) -> float:
        return (1.0 - met(t).mean()) ** (96 * len(radii)) - 0.05

    t = float(optimize.brentq(kept, 1e-6, 1.0))
    assert np.prod((1.0 - met(t)) ** 96) <= 0.05 + 1e-9
    assert unseen_after(radii, 96, 1) == pytest.approx(1.0 - 2.0 * stats.norm.sf(t), rel=0.02)


def test_checks_that_change_the_probability_leave_it_unsettled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where the surface stays 0.08 too low, P(a > 2) is not P(a > 2.08)."""
    draws, jump = known(ALONE), Event(((2.0, np.inf),))
    where = ground(lambda load, a: load * a, ALONE)
    where = replace(where, surfaces=ResponseSurface(max_runs=100))
    assert found(where, jump, draws, 20).status == "solved"
    near = PredictedValue.of(where, 0, draws)
    wrong = PredictedValue.of(ground(lambda load, a: load * a - 0.08, ALONE), 0, draws)
    doubtful(monkeypatch)
    told = probability(replace(near, surface=wrong.surface), draws, jump, 400)
    assert told.status == "unsettled"
