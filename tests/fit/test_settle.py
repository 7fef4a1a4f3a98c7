"""An answer settles where no step and no node gains."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from individual_cases import ALPHA, decay, likelihood_of, table
from scipy import optimize, stats

from aleator import Free, Inputs, Noise, Normal
from aleator.fit.quadrature import _gaps, highest_maximum, nearest_maximum, with_enough_nodes
from aleator.inference.diagnostics import once_warnings
from aleator.likelihood.individual.panels import Panels
from aleator.search import Ascent, Optimum, SearchResult
from aleator.search.interface import hills_of


def test_it_settles_where_no_step_and_no_node_gains() -> None:
    likelihood = likelihood_of(decay, table(decay, experiments=20), nodes=3)
    end = with_enough_nodes(likelihood, ALPHA)
    again, alpha = nearest_maximum(end.likelihood, end.alpha * 1.02)
    assert again.evaluate(alpha).total == pytest.approx(end.value, abs=1e-3)
    finest = end.likelihood.by(replace(end.likelihood.rule, first=41, others=41), end.alpha)
    assert finest.evaluate(end.alpha).total == pytest.approx(end.value, abs=1e-2)
    assert end.gap == pytest.approx(0.0, abs=2e-3)


def test_the_gap_of_many_experiments_is_that_of_all_though_panels_see_a_sample() -> None:
    """Of 1,500 experiments panels are tried on 300, whose mean difference is not that of all."""
    rng, count = np.random.default_rng(5), 1500
    time = rng.uniform(0.5, 2.0, count)
    y = 2.0 * np.exp(rng.normal(0.5, 0.1, count) * time) + 0.1 * rng.standard_normal(count)
    frame = pd.DataFrame({"id": [f"e{l}" for l in range(count)], "time": time, "y": y})
    law = Inputs({"a": Normal(Free(0.0, 1.0), Free(0.01, 0.5))})
    alpha = np.array([0.5, 0.1, 0.1])
    held = likelihood_of(lambda t, x: 2.0 * np.exp(x[0] * t), frame, law).adapted(alpha)
    whole = held.by(Panels(), alpha).evaluate(alpha).total - held.evaluate(alpha).total
    assert _gaps(held, alpha)[-1] == pytest.approx(whole, rel=1e-3)
    sizes = [len(block) for block in held.sampled(300).blocks]
    assert sizes == [30] * 10


def test_a_maximum_that_finer_nodes_put_first_keeps_the_starts_that_led_to_it() -> None:
    """a and about -a give the same outcome: two maxima, of which a search with few nodes took the
    lower one for the best. One start or two had ended at the higher one."""
    y = (1.0 + 0.3 * np.random.default_rng(6).standard_normal(40)) ** 2
    frame = pd.DataFrame({"id": range(40), "time": 0.0, "y": y})
    law = Inputs({"a": Normal(Free(-3.0, 3.0), Free(0.01, 3.0))})

    def model(time, x):
        return x[0] ** 2 + 0.15 * x[0] ** 3 + 0.0 * time

    likelihood = likelihood_of(model, frame, law, noise=Noise(0.05))
    places = {side: np.array([side, 0.3, 0.05]) for side in (-1.1, 0.9)}
    ends = {side: with_enough_nodes(likelihood, alpha) for side, alpha in places.items()}
    low, high = sorted(ends, key=lambda side: ends[side].value)
    assert ends[high].value > ends[low].value + 0.05
    for few in (1, 2):
        coarse = [(ends[low].alpha, 3.0, 3), (ends[high].alpha, 2.0, few)]
        ascents = [Ascent(a, a, v, 9, True) for a, v, count in coarse for _ in range(count)]
        optima = tuple(Optimum(*one) for one in coarse)
        search = SearchResult(optima[0].alpha, 3.0, tuple(ascents), optima)
        top = highest_maximum(ends[low], search)
        scores = top.maximum.likelihood(top.maximum.alpha).scores
        met = hills_of(top.search_result, scores, np.arange(2))
        assert top.maximum.value == pytest.approx(ends[high].value, abs=1e-3)
        assert [hill.starts for hill in met] == [few, 3]
        assert bool(once_warnings(top.search_result, met)) is (few == 1)


def test_the_highest_of_two_maxima_is_told_though_the_nodes_of_the_other_misread_it() -> None:
    """The outcome is -6 - a far below, and above max(1, a), at time 1 a - 0.5.

    With the law far below, integrals are normal and five nodes are exact. With the law above, three
    outcomes lie at the kink. There nodes around the mode leave out what is below one.
    """
    rng, noise = np.random.default_rng(1), 0.003
    time = np.repeat([0.0, 1.0], 12)
    y = np.concatenate([
        1.0 + noise * rng.standard_normal(3), 1.0 + np.abs(rng.normal(0.0, 1.0, 9)),
        1.5 + 0.4 * rng.standard_normal(12),
    ])  # fmt: skip
    late = time > 0.0

    def model(time, x):
        return np.where(x[0] < -4.0, -6.0 - x[0], np.where(time > 0.0, x[0] - 0.5, x[0].clip(1.0)))

    def exact(mean: float, sd: float) -> float:
        wide, kinked = np.hypot(sd, noise), y[~late]
        if mean < -4.0:
            return float(stats.norm.logpdf(y, -6.0 - mean, wide).sum())
        given = mean + (kinked - mean) * (sd / wide) ** 2
        above = stats.norm.pdf(kinked, mean, wide) * stats.norm.sf(1.0, given, sd * noise / wide)
        below = stats.norm.cdf(1.0, mean, sd) * stats.norm.pdf(kinked, 1.0, noise)
        plain = stats.norm.logpdf(y[late], mean - 0.5, wide)
        return float(np.log(above + below).sum() + plain.sum())

    def best(mean: float) -> optimize.OptimizeResult:
        return optimize.minimize(lambda alpha: -exact(*alpha), (mean, 0.5), method="Nelder-Mead")

    frame = pd.DataFrame({"id": range(24), "time": time, "y": y})
    law = Inputs({"a": Normal(Free(-12.0, 6.0), Free(0.01, 4.0))})
    likelihood = likelihood_of(model, frame, law, noise=Noise(noise))
    low, high = (best(mean) for mean in (-7.5, 1.5))
    assert -high.fun > -low.fun + 3.0
    ends = [nearest_maximum(likelihood, np.array([*one.x, noise])) for one in (low, high)]
    optima = tuple(Optimum(alpha, held.evaluate(alpha).total, 1) for held, alpha in ends)
    assert optima[1].log_likelihood < optima[0].log_likelihood - 5.0
    ascents = tuple(Ascent(o.alpha, o.alpha, o.log_likelihood, 9, True) for o in optima)
    search = SearchResult(optima[0].alpha, optima[0].log_likelihood, ascents, optima)
    top = highest_maximum(with_enough_nodes(likelihood, search.alpha), search)
    assert top.maximum.value == pytest.approx(-high.fun, abs=1e-4)
    assert top.maximum.alpha[:2] == pytest.approx(high.x, abs=1e-3)
    assert [o.log_likelihood for o in top.search_result.optima[1:]] == pytest.approx([-low.fun])
