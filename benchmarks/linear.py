"""Straight lines with normal laws and noise, in closed form: thousands of data sets of each study.

Those of `right` whose likelihood is that of normal variables, and one whose laws follow a column.
`python -m benchmarks linear --replicates 2000` prints how often the intervals hold the truth, by
Aleator's own errors and drop, and `linear-verdicts` how many right models are called inconsistent.
Both keep their data sets in a file and go on where they ended. Nothing is searched or integrated:
what is left is what the statistics themselves are worth.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
from rich.console import Console
from scipy import stats

from aleator import By, Free, Inputs, Noise, Normal
from aleator.core.progress import Silent
from aleator.core.types import Array
from aleator.inference.consistency import consistency_of
from aleator.inference.fit import Fit
from aleator.inference.information import INTERVALS
from benchmarks.kept import Entry, kept
from benchmarks.mixed import Mixed, Plan, drawn, maximum
from benchmarks.shapes import SHAPES

LINEAR = (
    "one value each", "series of 3", "10 experiments", "12 experiments", "300 experiments",
    "two parameters", "sd near zero", "correlated", "a covariate", "slopes and a covariate",
)  # fmt: skip
"""Studies of `shapes` that are lines, with one parameter or two."""
FOLLOWED = "slopes that hardly scatter"
SUBJECTS, OLD, TIMES = 27, 11, (-3.0, -1.0, 1.0, 3.0)
DROP = float(stats.chi2.ppf(INTERVALS.level, 1)) / 2.0
HALF = float(stats.norm.ppf(0.5 + INTERVALS.level / 2.0))


@dataclass(frozen=True, eq=False)
class Study:
    """A plan, the truth (K,), and the table without its outcomes."""

    name: str
    plan: Plan
    truth: Array
    frame: pd.DataFrame

    def fit(self, seed: int) -> Mixed:
        """One data set at its maximum."""
        y = drawn(self.plan, self.truth, np.random.default_rng([seed, *self.name.encode()]))
        return Mixed.of(self.plan, y, self.truth, self.frame.assign(y=y.ravel()))


@cache
def study(name: str) -> Study:
    """One of the studies, by its name."""
    if name == FOLLOWED:
        return _followed()
    shape = next(shape for shape in SHAPES if shape.name == name)
    assert shape.noise is not None
    frame = shape.table(0).table
    frame = frame.assign(id=np.repeat(np.arange(shape.count), shape.values))
    covariate = np.arange(shape.count, dtype=float) % 2.0
    return _study(name, frame, "c", shape.inputs, shape.noise, dict(shape.truth), covariate)


def _followed() -> Study:
    """27 subjects of two kinds at four times: level and slope follow the kind."""
    old = np.arange(SUBJECTS) < OLD
    rows = np.repeat(np.arange(SUBJECTS), len(TIMES))
    frame = pd.DataFrame(
        {
            "id": rows,
            "time": np.tile(TIMES, SUBJECTS),
            "kind": np.where(old[rows], "old", "new"),
        }
    )
    laws = {
        "level": Normal(By("1 + kind", 10.0, 40.0), Free(0.0, 6.0)),
        "slope": Normal(By("1 + kind", -2.0, 4.0), Free(0.0, 2.0)),
    }
    truth = {
        "level.mean[Intercept]": 24.9, "level.mean[kind=old]": -2.3, "level.sd": 1.7,
        "slope.mean[Intercept]": 0.78, "slope.mean[kind=old]": -0.3, "slope.sd": 0.15,
        "noise.sd": 1.3,
    }  # fmt: skip
    return _study(
        FOLLOWED, frame, "time", Inputs(laws), Noise(Free(0.05, 6.0)), truth, old.astype(float)
    )


def _study(
    name: str,
    frame: pd.DataFrame,
    condition: str,
    inputs: Inputs,
    noise: Noise,
    truth: dict[str, float],
    covariate: Array,
) -> Study:
    """A line by a condition, through zero with one parameter; means follow the covariate (N,)."""
    along = frame[condition].to_numpy().reshape(len(covariate), -1)
    one = np.ones_like(along)
    curves = np.stack([along] if len(inputs.names) == 1 else [one, along], axis=2)
    laws = inputs
    if inputs.regressed:
        table = frame.groupby("id", sort=False).first()
        laws = inputs.resolved(table[list(inputs.covariates)])
    hyperparameters = (*laws.hyperparameters, noise.hyperparameter)
    means = [
        [h.name for h in hyperparameters if h.name.startswith(f"{n}.mean")] for n in laws.names
    ]
    columns = np.stack([np.ones(len(covariate)), covariate], axis=1)
    designs = tuple(columns[:, : len(names)] for names in means)
    tied = bool(laws.correlation.hyperparameters)
    alpha = np.array([truth.get(h.name, h.start) for h in hyperparameters])
    return Study(name, Plan(laws.names, curves, designs, hyperparameters, tied), alpha, frame)


def intervals(name: str, seed: int) -> Entry:
    """Whether each interval holds the truth, by profile, standard error and sandwich error."""
    of, fit = study(name), study(name).fit(seed)
    found = {}
    for k in fit.inference.identified:
        near = np.where(np.arange(of.truth.size) == k, of.truth, fit.alpha)
        lost = fit.scored().total - fit.at(maximum(of.plan, fit.y, near, k)).scored().total
        off = abs(fit.alpha[k] - of.truth[k])
        errors = fit.inference.standard_error[k], fit.inference.sandwich_error[k]
        by_errors = [bool(off <= HALF * e) if np.isfinite(e) else None for e in errors]
        found[of.plan.hyperparameters[k].name] = [bool(lost <= DROP), *by_errors]
    return {"holds": found}


def verdict(name: str, seed: int) -> Entry:
    """The second verdict of one data set, and by which kind of test it is inconsistent."""
    found = consistency_of(cast(Fit, study(name).fit(seed)), True, seed, Silent())
    kinds = [d.test.kind for d in found.discrepancies]
    return {"consistent": found.consistent, "p": found.p, "kind": kinds[0] if kinds else None}


def print_linear(console: Console, path: Path, replicates: int) -> None:
    """Coverage of the intervals, of what the file has and what it lacks."""
    entries = kept(path, product(LINEAR, range(replicates)), intervals)
    rows = []
    for name in LINEAR:
        some = [entry["holds"] for key, entry in entries.items() if key[0] == name]
        for alpha in some[0]:
            row: dict[str, Any] = {"study": name, "alpha": alpha, "replicates": len(some)}
            for k, kind in enumerate(("profile", "standard error", "sandwich")):
                held = [each[alpha][k] for each in some if each[alpha][k] is not None]
                row[kind] = f"{100 * np.mean(held):.1f} %"
            rows.append(row)
    console.print(pd.DataFrame(rows).to_string(index=False))


def print_linear_verdicts(console: Console, path: Path, replicates: int) -> None:
    """How many data sets are called inconsistent, and by which kinds of tests."""
    names = (*LINEAR, FOLLOWED)
    entries = kept(path, product(names, range(replicates)), verdict)
    for name in names:
        some = [entry for key, entry in entries.items() if key[0] == name]
        kinds = Counter(entry["kind"] for entry in some if entry["consistent"] is False)
        told = ", ".join(f"{kind} {count}" for kind, count in kinds.most_common())
        console.print(f"{name}: {kinds.total()} of {len(some)} inconsistent ({told})")
