"""Repeated measurements whose maximum of the likelihood is known: published, or in closed form.

Every answer is that of the default settings.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identifications import assert_maximum, errors_of, estimates, unjudged
from scipy import integrate, stats

from aleator import (
    Censoring,
    Experiments,
    Free,
    Identification,
    Inputs,
    Noise,
    Normal,
)

DATA = Path(__file__).parents[1] / "data"


def line(days: np.ndarray, start: np.ndarray, slope: np.ndarray) -> np.ndarray:
    return start + slope * days


def sleep_study(correlated: bool) -> Identification:
    inputs = Inputs(
        {
            "start": Normal(Free(100.0, 400.0), Free(0.1, 200.0)),
            "slope": Normal(Free(-50.0, 50.0), Free(0.05, 50.0)),
        },
        {("start", "slope"): Free(-0.99, 0.99)} if correlated else None,
    )
    table = Experiments.from_csv(DATA / "sleepstudy.csv", outcome="reaction", id="unit")
    return unjudged(line, table, inputs, noise=Noise(Free(1.0, 200.0)))


def dyestuff() -> Identification:
    inputs = Inputs({"mean": Normal(Free(1000.0, 2000.0), Free(0.1, 500.0))})
    table = Experiments.from_csv(DATA / "dyestuff.csv", outcome="yield", id="unit")
    return unjudged(lambda mean: mean, table, inputs, noise=Noise(Free(1.0, 500.0)))


# Maxima of the closed form and standard errors; those of CORRELATED are published too.
INDEPENDENT = {
    "start.mean": (251.405105, 6.669), "start.sd": (24.1712652, 5.37),
    "slope.mean": (10.467286, 1.502), "slope.sd": (5.79940841, 1.16),
    "noise.sd": (25.5561347, 1.5),
}  # fmt: skip
CORRELATED = {
    "start.mean": (251.405105, 6.632), "start.sd": (23.7805672, 5.577),
    "slope.mean": (10.467286, 1.502), "slope.sd": (5.71683448, 1.187),
    "correlation.start.slope": (0.0813200, 0.324), "noise.sd": (25.5918156, 1.508),
}  # fmt: skip
BATCHES = {
    "mean.mean": (1527.5, 17.69), "mean.sd": (37.2603453, 15.5), "noise.sd": (49.5101000, 7.1),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("found", "wanted", "value"),
    [
        (lambda: sleep_study(False), INDEPENDENT, -876.001628),
        (lambda: sleep_study(True), CORRELATED, -875.969672),
        (dyestuff, BATCHES, -163.663530),
    ],
    ids=["sleepstudy, independent", "sleepstudy, correlated", "dyestuff"],
)
def test_published_maxima_are_met(found, wanted, value) -> None:
    answer = found()
    assert answer.sound
    assert answer.log_likelihood.estimated == pytest.approx(value, abs=0.01)
    for name, (estimate, error) in wanted.items():
        entry = answer.alpha[name]
        assert entry.estimate == pytest.approx(estimate, abs=0.05 * error), name
        if wanted is CORRELATED:
            assert entry.standard_error == pytest.approx(error, rel=0.01), name


def growth(time: np.ndarray, log_rate: np.ndarray) -> np.ndarray:
    return np.exp(np.minimum(np.exp(log_rate) * time, 30.0))


def censored_table(kind: str, rows: int, seed: int = 4) -> pd.DataFrame:
    """Sixteen experiments of `rows` values, of which those of the kind are known by bounds only."""
    rng = np.random.default_rng(seed)
    frame = []
    for l in range(16):
        x = rng.normal(-0.5, 0.6)
        for time in np.linspace(0.5, 1.5, rows) if rows > 1 else [rng.uniform(0.5, 1.5)]:
            y = float(growth(time, x)) + 0.2 * rng.standard_normal()
            low, high, word = y, y, "measured"
            if kind == "left" and y < 1.6:
                low, high, word = np.nan, 1.6, "below"
            elif kind == "right" and y > 2.4:
                low, high, word = 2.4, np.nan, "above"
            elif kind == "between":
                low, high = np.floor(2.0 * y) / 2.0, np.floor(2.0 * y) / 2.0 + 0.5
            value = high if word == "below" else low
            upper = high if kind == "between" else np.nan
            frame.append({"id": f"e{l}", "time": time, "y": value, "status": word, "upper": upper})
    return pd.DataFrame(frame)


def exact(frame: pd.DataFrame, alpha: np.ndarray) -> float:
    """log L by Simpson's rule with 20,001 points of the one parameter."""
    mean, sd, noise = alpha
    total = 0.0
    for _, own in frame.groupby("id"):
        t, low, word = own["time"].to_numpy(), own["y"].to_numpy(), own["status"].to_numpy()
        high = own["upper"].to_numpy()

        x = np.linspace(mean - 8.0 * sd, mean + 8.0 * sd, 20_001)
        eta = growth(t, x[:, None])
        u, above = (low - eta) / noise, (high - eta) / noise
        p = stats.norm.pdf(u) / noise
        p = np.where(word == "below", stats.norm.cdf(u), p)
        p = np.where(word == "above", stats.norm.sf(u), p)
        p = np.where(np.isnan(high), p, stats.norm.cdf(above) - stats.norm.cdf(u))
        density = np.prod(p, axis=1) * stats.norm.pdf(x, mean, sd)
        total += float(np.log(integrate.simpson(density, x=x)))
    return total


@pytest.mark.slow
@pytest.mark.parametrize("rows", [1, pytest.param(4, marks=pytest.mark.long)])
@pytest.mark.parametrize("kind", ["left", "right", "between"])
def test_censored_values_give_the_exact_maximum(kind: str, rows: int) -> None:
    frame = censored_table(kind, rows)
    words = {"left": {"left": "below"}, "right": {"right": "above"}}.get(kind)
    censored = Censoring(upper="upper") if words is None else Censoring("status", **words)
    table = Experiments.from_frame(frame, outcome="y", conditions=["time"], censored=censored)
    assert np.any(table.observations.censored)
    inputs = Inputs({"log_rate": Normal(Free(-2.0, 1.0), Free(0.01, 2.0))})
    # one value an experiment does not tell the noise from the scatter
    noise = Noise(Free(0.01, 2.0) if rows > 1 else 0.2)
    answer = unjudged(growth, table, inputs, noise=noise, vectorized=True)
    alpha = estimates(answer)
    assert answer.sound
    assert answer.log_likelihood.estimated == pytest.approx(exact(frame, alpha), abs=0.01)
    assert_maximum(lambda a: exact(frame, a), alpha, errors_of(answer))
