"""The second verdict in closed form: hundreds of data sets of each truth in a minute.

The studies of `power`, whose likelihood is that of normal variables: a straight line through zero,
a normal law of its slope a, and known noise. The statistics, their calibration by replicates and
the verdict are those of Aleator. Only the replicates are drawn once, at the true alpha, and each
data set takes 200 of them by chance: these statistics hardly depend on alpha.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table
from scipy import stats

from aleator import Experiments
from aleator.inference.consistency.battery import Battery
from aleator.inference.consistency.columns import columns_of
from aleator.inference.consistency.judged import judged
from aleator.inference.consistency.residuals import Residuals
from aleator.inference.consistency.value import LEVEL
from aleator.tasks.consistency import STAGES
from aleator.types import Array
from benchmarks.power import ALONE, KINDS, MEAN, SD, SERIES, TRUTHS, Truth, experiments, series

POOL = 2000
"""Replicates that are drawn once."""
LEVELS = (0.05, 0.02, 0.01)
"""False alarms that one form of the tails may cost: all of them, or its share of them."""
STEPS = 30
"""Newton steps to the maximum, most."""


def print_closed(console: Console, replicates: int) -> None:
    """How many of so many data sets of each truth are called inconsistent."""
    table = Table("truth", *(f"{kind}, of {replicates}" for kind in KINDS))
    for name in TRUTHS:
        table.add_row(name, *(str(flagged(name, kind, replicates)) for kind in KINDS))
    console.print(table)
    shares = fitted_power("tails of t3", LEVELS)
    each = ", ".join(f"{100 * p:.0f} % at {a:.0%}" for p, a in zip(shares, LEVELS, strict=True))
    console.print(f"tails of t3 by the best t3 law against the best normal law: {each}")


def fitted_power(name: str, levels: tuple[float, ...]) -> list[float]:
    """The power of a test that knows the form of the tails, but neither mean nor scale.

    Of normal scores of the study with one load each: the largest log-likelihood of Student's t with
    three degrees of freedom over that of a normal law, by iterated weights (Lange et al., 1989).
    """
    plan, rng = _plan(ALONE), np.random.default_rng(11)
    load = plan["load"].to_numpy()

    def ratios(truth: Truth) -> Array:
        y = np.array([truth.draw(plan, rng) for _ in range(POOL)]) / load
        m, v = np.zeros((POOL, 1)), np.full((POOL, 1), 0.5)
        y = (y - y.mean(axis=1, keepdims=True)) / y.std(axis=1, keepdims=True)
        for _ in range(STEPS):
            weight = 4.0 / (3.0 + (y - m) ** 2 / v)
            m = np.sum(weight * y, axis=1, keepdims=True) / weight.sum(axis=1, keepdims=True)
            v = np.mean(weight * (y - m) ** 2, axis=1, keepdims=True)
        heavy = stats.t.logpdf(y, 3, m, np.sqrt(v)) - stats.norm.logpdf(y)
        return np.asarray(heavy.sum(axis=1))

    right, heavier = ratios(Truth()), ratios(TRUTHS[name])
    return [float(np.mean(heavier > np.quantile(right, 1.0 - level))) for level in levels]


def flagged(name: str, kind: str, replicates: int) -> int:
    """The data sets of a truth that are called inconsistent."""
    truth, found, rng = TRUTHS[name], 0, np.random.default_rng(5)
    battery, pool = _pool(truth.noise, kind)
    for values in _statistics(battery, truth, kind, replicates, 1):
        some = pool[rng.choice(POOL, STAGES[-1][0], replace=False)]
        for count, low, high in STAGES:
            p = judged(battery.subjects, values, some[:count]).together
            if p < low or p > high:
                break
        found += p < LEVEL
    return found


@cache
def _pool(noise: float, kind: str) -> tuple[Battery, Array]:
    """The tests of a study, and their statistics (POOL, T) under the right model."""
    plan = _plan(kind)
    table = Experiments.from_frame(plan.assign(y=0.0), outcome="y")
    experiment = table.observations.experiment
    battery = Battery.of(columns_of(table), experiment, ("a.mean", "a.sd"), np.eye(2))
    return battery, _statistics(battery, Truth(noise=noise), kind, POOL, 0)


def _plan(kind: str) -> pd.DataFrame:
    plan = experiments().sample(frac=1.0, random_state=0).reset_index(drop=True)
    return series(plan) if kind == SERIES else plan


def _statistics(battery: Battery, truth: Truth, kind: str, count: int, seed: int) -> Array:
    """The statistics (count, T) of data sets of a truth."""
    plan, rng = _plan(kind), np.random.default_rng([seed, 7])
    load = plan["load"].to_numpy()
    each = (truth.draw(plan, rng) for _ in range(count))
    with np.errstate(all="ignore"):
        found = [_of(battery, load, y, truth.noise) for y in each]
    return np.array(found)


def _of(battery: Battery, load: Array, y: Array, noise: float) -> Array:
    """The statistics (T,) of outcomes (M,), at the maximum of the likelihood.

    Of an experiment the least-squares slope is enough: it is normal about the mean of a, with the
    variance sd^2 + noise^2/sum(load^2).
    """
    square = np.bincount(battery.experiment, load**2)
    slope = np.bincount(battery.experiment, load * y) / square
    mean, sd = _maximum(slope, noise**2 / square)
    total = sd**2 + noise**2 / square
    z = (slope - mean) / np.sqrt(total)
    scores = np.stack([z / np.sqrt(total), (z**2 - 1.0) * sd / total], axis=1)
    information = np.diag([np.sum(1.0 / total), np.sum(2.0 * (sd / total) ** 2)])
    none = np.zeros((z.size, 0))
    residuals = Residuals(
        _normal_scores(load.reshape(z.size, -1), y.reshape(z.size, -1), mean, sd, noise),
        np.ones(y.size, dtype=np.bool_), scores, none, none[:, :, None],
    )  # fmt: skip
    return replace(battery, covariance=np.asarray(np.linalg.inv(information))).values(residuals)


def _maximum(slope: Array, error: Array) -> tuple[float, float]:
    """Mean and standard deviation of slopes (N,) with errors of these variances (N,)."""
    mean, log_sd = MEAN, np.log(SD)
    for _ in range(STEPS):
        own = np.exp(2.0 * log_sd)
        total = own + error
        mean = float(np.average(slope, weights=1.0 / total))
        by = np.sum(((slope - mean) ** 2 / total - 1.0) * own / total)
        step = by / np.sum(2.0 * (own / total) ** 2)
        log_sd += float(np.clip(step, -1.0, 1.0))
        if abs(step) < 1e-8:
            break
    return mean, float(np.exp(log_sd))


def _normal_scores(load: Array, y: Array, mean: float, sd: float, noise: float) -> Array:
    """Those of y (N, m), each given the earlier ones of its experiment, (M,)."""
    expected, variance = np.full(len(y), mean), np.full(len(y), sd**2)
    w = np.empty_like(y)
    for k in range(y.shape[1]):
        h = load[:, k]
        total = h**2 * variance + noise**2
        left = y[:, k] - h * expected
        w[:, k] = left / np.sqrt(total)
        gain = h * variance / total
        expected, variance = expected + gain * left, variance * (1.0 - gain * h)
    return w.ravel()
