"""Panels of two variates where an outcome is not smooth, against integrals in closed form."""

import numpy as np
import pandas as pd
import pytest
from individual_cases import likelihood_of
from scipy import stats

from aleator import Experiments, Free, Inputs, Noise, Normal
from aleator.fit.quadrature import Maximum, nearest_maximum, with_enough_nodes
from aleator.fit.uncertainty import UNCERTAINTY, inferred
from aleator.inference.fit import Fit
from aleator.likelihood.individual import GaussHermite, LawPoints, PlanePanels
from aleator.search import Optimum, SearchResult

TWO = Inputs(
    {"a": Normal(Free(-3.0, 3.0), Free(0.01, 3.0)), "b": Normal(Free(-3.0, 3.0), Free(0.01, 3.0))}
)
ALPHA = np.array([0.6, 0.4, 0.3, 0.3, 0.05])
"""Means and sds of a and b, and the sd of the noise."""


def line(time, x):
    return x[0] + x[1] * time


def kink(time, x):
    return np.maximum(0.0, x[0] + x[1] - time)


def jump(time, x):
    return 1.0 * (x[0] + x[1] * time > 1.0)


def bend(time, x):
    return np.abs(x[0] - time) + x[1] * time


def front(time, x):
    return x[1] * np.tanh((time - x[0]) / 0.05)


def exact(model, time, y, alpha) -> np.ndarray:
    """Log-densities; a front and a bend given a are normal, a by the trapezoidal rule."""
    m, s, n, v, noise = alpha
    if model is line:
        return stats.norm.logpdf(y, m + n * time, np.sqrt(s**2 + (v * time) ** 2 + noise**2))
    if model is jump:
        beyond = stats.norm.sf(1.0, m + n * time, np.hypot(s, v * time))
        parts = [p * stats.norm.pdf(y, at, noise) for at, p in ((1, beyond), (0, 1 - beyond))]
        return np.log(np.sum(parts, axis=0))
    if model is kink:
        # max(0, g) with g normal: its part below zero, and the part above given the outcome
        mean, own = m + n - time, s**2 + v**2
        whole = own + noise**2
        given = stats.norm.sf(0.0, mean + (y - mean) * own / whole, np.sqrt(own / whole) * noise)
        below = stats.norm.cdf(0.0, mean, np.sqrt(own)) * stats.norm.pdf(y, 0.0, noise)
        return np.log(below + stats.norm.pdf(y, mean, np.sqrt(whole)) * given)
    a = np.linspace(m - 9.0 * s, m + 9.0 * s, 10_001)[:, None]
    slope = time if model is bend else np.tanh((time - a) / 0.05)
    mean = np.abs(a - time) + n * time if model is bend else n * slope
    given = stats.norm.pdf(y, mean, np.hypot(slope * v, noise))
    return np.log(stats.norm.pdf(a[:, 0], m, s) @ given * (a[1, 0] - a[0, 0]))


def drawn(model, noise: float, count: int = 20, seed: int = 3) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    time = rng.uniform(0.2, 1.8, count)
    a, b = (m + s * rng.standard_normal(count) for m, s in (ALPHA[:2], ALPHA[2:4]))
    y = model(time, (a, b)) + noise * rng.standard_normal(count)
    return pd.DataFrame({"id": range(count), "time": time, "y": y})


def differences(model, frame: pd.DataFrame, alpha: np.ndarray) -> np.ndarray:
    """The exact score."""
    own = frame["time"].to_numpy(), frame["y"].to_numpy()
    steps = 1e-4 * np.eye(alpha.size)
    ends = [[exact(model, *own, alpha + sign * h).sum() for h in steps] for sign in (1, -1)]
    return (np.array(ends[0]) - ends[1]) / 2e-4


@pytest.mark.parametrize("noise", [0.05, 0.02])
@pytest.mark.parametrize("model", [kink, jump, bend, front])
def test_panels_integrate_what_is_not_smooth(model, noise: float) -> None:
    frame, alpha = drawn(model, noise), np.array([*ALPHA[:4], noise])
    each = likelihood_of(model, frame, TWO).by(PlanePanels(), alpha).evaluate(alpha).each
    truth = exact(model, frame["time"].to_numpy(), frame["y"].to_numpy(), alpha)
    assert each == pytest.approx(truth, abs=1e-3)


@pytest.mark.parametrize("model", [line, kink, jump, bend, front])
def test_coarse_panels_miss_less_than_an_interval_is_found_to(model) -> None:
    frame = drawn(model, 0.02)
    likelihood = likelihood_of(model, frame, TWO).by(PlanePanels.coarse(), ALPHA)
    truth = exact(model, frame["time"].to_numpy(), frame["y"].to_numpy(), ALPHA)
    assert likelihood.evaluate(ALPHA).total == pytest.approx(truth.sum(), abs=5e-3)


def test_coarse_panels_give_way_where_the_others_tell_something_else() -> None:
    coarse = PlanePanels.coarse()
    assert coarse.finer(2) == (PlanePanels(),)
    assert coarse.refined([-0.02], 2e-3, 2) == PlanePanels()
    assert coarse.refined([-5e-3], 2e-3, 2) is None
    assert PlanePanels().refined([-0.02], 2e-3, 2) is None


def test_points_of_the_law_serve_for_whatever_is_observed() -> None:
    frame, other = (
        drawn(front, 0.05),
        drawn(front, 0.05, seed=4).assign(time=drawn(front, 0.05)["time"]),
    )
    here = likelihood_of(front, frame, TWO).by(PlanePanels(), ALPHA)
    table = Experiments.from_frame(frame, outcome="y", id="id")
    fit = Fit.of_individuals(here, ALPHA, None, table, here.rule).for_replicates()
    assert fit.likelihood.integral.rule == LawPoints(2000)
    another = fit.seeing(Experiments.from_frame(other, outcome="y", id="id"))
    assert another.likelihood.integral.nodes is fit.likelihood.integral.nodes
    for seen, rows in ((fit, frame), (another, other)):
        truth = exact(front, rows["time"].to_numpy(), rows["y"].to_numpy(), ALPHA)
        assert seen.scored().each == pytest.approx(truth, abs=0.1)


def test_a_climb_along_a_ridge_arrives() -> None:
    """At one time only the sum of the variances is told: nodes must follow what becomes narrow."""
    y = 0.9 + 0.4 * np.random.default_rng(5).standard_normal(12)
    frame = pd.DataFrame({"id": range(12), "time": 1.0, "y": y})
    likelihood = likelihood_of(line, frame, TWO).by(PlanePanels.coarse(), ALPHA)
    start = np.array([0.6, 0.9, 0.3, 0.9, 0.9])
    held, alpha = nearest_maximum(likelihood, start)
    best = stats.norm.logpdf(y, y.mean(), y.std()).sum()
    assert exact(line, 1.0, y, alpha).sum() == pytest.approx(best, abs=5e-3)
    assert held.evaluate(alpha).total == pytest.approx(best, abs=5e-3)


@pytest.mark.parametrize("model", [kink, jump])
def test_their_score_counts_what_moves_across(model) -> None:
    frame = drawn(model, 0.05)
    held = likelihood_of(model, frame, TWO).by(PlanePanels(), ALPHA)
    beside = ALPHA * 1.01
    for alpha in (ALPHA, beside):
        np.testing.assert_allclose(held(alpha).score, differences(model, frame, alpha), atol=0.02)


def test_an_answer_at_a_kink_is_the_exact_one() -> None:
    frame = drawn(kink, 0.05, 10)
    end = with_enough_nodes(likelihood_of(kink, frame, TWO), ALPHA)
    assert isinstance(end.likelihood.rule, PlanePanels)
    own = frame["time"].to_numpy(), frame["y"].to_numpy()
    assert end.value == pytest.approx(exact(kink, *own, end.alpha).sum(), abs=5e-3)
    inside = (end.alpha > 0.011) | (np.arange(5) % 2 == 0)
    score, scores = (
        part[..., inside]
        for part in (differences(kink, frame, end.alpha), end.likelihood(end.alpha).scores)
    )
    # the squared distance from the maximum in standard errors, whatever the units
    assert score @ np.linalg.pinv(scores.T @ scores) @ score < 0.1**2


def test_a_smooth_outcome_keeps_few_nodes() -> None:
    end = with_enough_nodes(likelihood_of(line, drawn(line, 0.05), TWO), ALPHA)
    assert isinstance(end.likelihood.rule, GaussHermite)


def search_of(end: Maximum) -> SearchResult:
    return SearchResult(end.alpha, end.value, (), (Optimum(end.alpha, end.value, 1),))


def test_at_the_ends_of_intervals_the_exact_likelihood_has_dropped_as_told() -> None:
    frame = drawn(front, 0.05, 12)
    time, y = frame["time"].to_numpy(), frame["y"].to_numpy()
    means = Inputs({"a": Normal(Free(-3.0, 3.0), 0.4), "b": Normal(Free(-3.0, 3.0), 0.3)})
    end = with_enough_nodes(likelihood_of(front, frame, means, noise=Noise(0.05)), ALPHA)
    assert isinstance(end.likelihood.rule, PlanePanels)
    end, _, _, profile = inferred(end, search_of(end))
    top, told = exact(front, time, y, end.alpha).sum(), np.argwhere(profile.drops > 0.0)
    assert len(told) == 4
    for k, side in told:
        point, drop = profile.points[k, side], profile.drops[k, side]
        assert point[k] == profile.intervals[k, side]
        assert top - exact(front, time, y, point).sum() == pytest.approx(
            drop, abs=UNCERTAINTY.unknown
        )


def test_a_saddle_is_left_for_the_maximum_beside_it() -> None:
    """The sign of a cannot be told from its square: between the two maxima there is a saddle."""
    rng = np.random.default_rng(6)
    one = Inputs({"a": Normal(Free(-3.0, 3.0), Free(0.01, 3.0))})
    y = (1.0 + 0.2 * rng.standard_normal(40)) ** 2 + 0.05 * rng.standard_normal(40)
    frame = pd.DataFrame({"id": range(40), "time": 0.0, "y": y})
    saddle = with_enough_nodes(
        likelihood_of(lambda time, x: x[0] ** 2 + 0.0 * time, frame, one),
        np.array([0.0, 1.0, 0.05]),
    )
    end, _, inference, _ = inferred(saddle, search_of(saddle))
    assert inference.positive
    assert abs(end.alpha[0]) == pytest.approx(1.0, abs=0.15)
    assert end.value > saddle.value - 1e-6
