"""How often the second verdict is right: false alarms, and wrong models that it finds.

One study, 108 synthetic experiments y = a load + noise at three loads and three temperatures on two
rigs, identified with a normal law of a; temperature and rig are columns that the simulator does not
ask for. Again with all three loads in each experiment. Beside each wrong model stands the power of
a test that knows it: the likelihood ratio (Neyman and Pearson) of the true distribution to the best
normal law, at a level of 5 %. `python -m benchmarks power --replicates 60` keeps each replicate as
a line of power.jsonl and begins where it ended.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table
from scipy import optimize, stats

from aleator import Check, Free, GradientMultistart, Inputs, Noise, Normal, identify
from aleator.core.types import Array
from benchmarks.kept import Entry, kept

MEAN, SD, NOISE = 1.0, 0.2, 0.05
LOADS, REPETITIONS = (1.0, 2.0, 3.0), 6
GRID = np.linspace(-12.0, 12.0, 2401)
"""Values of (a - mean)/sd over which true densities are integrated."""
KINDS = ALONE, SERIES = ("one load each", "all loads each")
ORACLE = 1000
"""Data sets by which the power of the test that knows the truth is measured."""

Standard = Callable[[Array], Array]


def two_modes(z: Array) -> Array:
    """Two normal laws of equal weight, as a density of mean zero and standard deviation one."""
    apart, own = 0.93, np.sqrt(1.0 - 0.93**2)
    return np.asarray(0.5 * (stats.norm.pdf(z, apart, own) + stats.norm.pdf(z, -apart, own)))


def heavy_tails(z: Array) -> Array:
    """Student's t with three degrees of freedom, scaled to a standard deviation of one."""
    return np.asarray(stats.t.pdf(z, 3, scale=1.0 / np.sqrt(3.0)))


def experiments() -> pd.DataFrame:
    """The plan: loads, temperatures and rigs, each combination six times."""
    plan = product(LOADS, (20.0, 50.0, 80.0), ("A", "B"), range(REPETITIONS))
    return pd.DataFrame(plan, columns=["load", "temperature", "rig", "number"]).drop(
        columns="number"
    )


def series(plan: pd.DataFrame) -> pd.DataFrame:
    """The same experiments, each under all loads: three rows of one id."""
    rows = plan.loc[plan.index.repeat(len(LOADS))]
    return rows.assign(id=rows.index, load=np.tile(LOADS, len(plan))).reset_index(drop=True)


@dataclass(frozen=True)
class Truth:
    """Where data come from: the standardized law of a, and what a condition does.

    `shift` is in standard deviations of a, and `louder` a factor of the noise; both by experiment.
    """

    law: Standard = stats.norm.pdf
    shift: Callable[[pd.DataFrame], Array | float] = lambda _: 0.0
    louder: Callable[[pd.DataFrame], Array | float] = lambda _: 1.0
    noise: float = NOISE

    def draw(self, plan: pd.DataFrame, rng: np.random.Generator) -> Array:
        """Outcomes (R,); rows with one id share their a."""
        density = self.law(GRID)
        reached = np.cumsum(density) / density.sum()
        own = plan["id"] if "id" in plan else np.arange(len(plan))
        z = np.interp(rng.random(len(plan)), reached, GRID)[own] + self.shift(plan)
        noise = self.noise * self.louder(plan) * rng.standard_normal(len(plan))
        return np.asarray(plan["load"] * (MEAN + SD * z) + noise)

    def log_likelihood(self, plan: pd.DataFrame, y: Array) -> float:
        """log of the true density of the outcomes (N,)."""
        load = plan["load"].to_numpy()
        z = GRID + np.reshape(self.shift(plan) + np.zeros(len(plan)), (-1, 1))
        scale = np.reshape(self.noise * self.louder(plan) + np.zeros(len(plan)), (-1, 1))
        given = stats.norm.pdf(y[:, None], load[:, None] * (MEAN + SD * z), scale)
        weights = self.law(GRID) / self.law(GRID).sum()
        return float(np.sum(np.log(given @ weights)))


TRUTHS = {
    "the right model": Truth(),
    "two modes": Truth(law=two_modes),
    "tails of t3": Truth(law=heavy_tails),
    "noise three times larger on one rig": Truth(
        louder=lambda plan: np.where(plan["rig"] == "B", 3.0, 1.0), noise=0.3
    ),
    "bias of one scatter at one temperature": Truth(
        shift=lambda plan: np.where(plan["temperature"] == 50.0, 1.0, 0.0)
    ),
    "drift of the mean with temperature": Truth(
        shift=lambda plan: (plan["temperature"].to_numpy() - 50.0) / 60.0
    ),
}


def print_power(console: Console, path: Path, replicates: int) -> None:
    """Identify `replicates` data sets of each truth, but those of the file, and print a table."""
    keys = product(TRUTHS, KINDS, range(replicates))
    known = kept(path, sorted(keys, key=lambda key: key[2]), identified)
    table = Table("truth", *KINDS, "by a test that knows (one load)")
    for name, truth in TRUTHS.items():
        of = [[e["flagged"] for key, e in known.items() if key[:2] == (name, k)] for k in KINDS]
        oracle = "" if truth is TRUTHS["the right model"] else f"{100 * _power(truth):.0f} %"
        table.add_row(name, *(f"{sum(found)} of {len(found)}" for found in of), oracle)
    console.print(table)


def identified(name: str, kind: str, seed: int) -> Entry:
    """Whether a data set of a truth is called inconsistent, and why."""
    plan, truth = experiments(), TRUTHS[name]
    if kind == SERIES:
        plan = series(plan)
    plan["y"] = truth.draw(plan, np.random.default_rng([seed, 1]))
    law = Inputs({"a": Normal(mean=Free(0.2, 2.0), sd=Free(0.01, 1.0))})
    found = identify(
        lambda load, a: a * load, plan, law, outcome="y", vectorized=True,
        noise=Noise(truth.noise), search=GradientMultistart(starts=2),
        verification=Check(0), seed=seed, best_law=False,
    )  # fmt: skip
    told = [d.message for d in found.consistency.discrepancies]
    return {"flagged": found.consistent is False, "p": found.consistency.p, "told": told}


def _power(truth: Truth) -> float:
    """The power of the likelihood ratio of the truth to the best normal law, at 5 %."""
    plan, right, rng = experiments(), Truth(noise=truth.noise), np.random.default_rng(0)

    def ratios(source: Truth) -> Array:
        return np.array(
            [
                truth.log_likelihood(plan, y) - _best_normal(plan, y, truth.noise)
                for y in (source.draw(plan, rng) for _ in range(ORACLE))
            ]
        )

    return float(np.mean(ratios(truth) > np.quantile(ratios(right), 0.95)))


def _best_normal(plan: pd.DataFrame, y: Array, noise: float) -> float:
    """The largest log-likelihood of a normal law of a."""
    load = plan["load"].to_numpy()

    def lost(theta: Array) -> float:
        scale = np.sqrt((load * np.exp(theta[1])) ** 2 + noise**2)
        return -float(np.sum(stats.norm.logpdf(y, load * theta[0], scale)))

    return -float(optimize.minimize(lost, np.array([MEAN, np.log(SD)]), method="BFGS").fun)
