"""Laws that follow a factor, a column of names: the law of each level, and how much they differ."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from aleator.core.types import Array
from aleator.inference.information import INTERVALS, Inference
from aleator.laws.covariates import Table, variables
from aleator.laws.inputs import Inputs
from aleator.results.documents import plain
from aleator.results.printed import number
from aleator.results.values import FactorEffect


@dataclass(frozen=True)
class FactorSettings:
    """Settings of the laws by level. The value is chosen by judgement."""

    levels: int = 4
    """The most levels of a factor whose laws are told and drawn apart."""


FACTORS = FactorSettings()


@dataclass(frozen=True, eq=False)
class LawsByLevel:
    """The laws of the parameter `i` at the E `levels` of a `factor`.

    `at` has the values of the other covariates of these laws: the median of numbers, the most
    frequent one of names. `inputs` are the joint laws, one for each level.
    """

    i: int
    factor: str
    levels: tuple[str, ...]
    at: dict[str, Any]
    inputs: Inputs

    @classmethod
    def of(
        cls, inputs: Inputs, i: int, covariates: Table | None, settings: FactorSettings = FACTORS
    ) -> LawsByLevel | None:
        """The laws by the levels of the first factor that parameter i follows.

        `covariates` has a row for each experiment. None where the law follows no factor of two to
        four levels.

        >>> from aleator.laws import By, Normal
        >>> table = pd.DataFrame({"by": ["a", "b", "a", "b"], "t": [0.0, 1.0, 2.0, 3.0]})
        >>> law = Normal(By("1 + C(by) + t", 0.0, 9.0), 1.0)
        >>> found = LawsByLevel.of(Inputs({"k": law}).resolved(table), 0, table)
        >>> found.factor, found.levels, found.at
        ('by', ('a', 'b'), {'t': 1.5})
        >>> found.values(np.array([1.0, 3.0, 2.0, 1.0]))[0].tolist()  # the mean of each
        [4.0, 7.0]
        """
        model = inputs.covariate_model
        if model is None or covariates is None:
            return None
        own = [entry.design for entry in model.entries[inputs.parts[i]] if entry.design]
        every = {name for entry in model.entries if entry.design for name in entry.design.factors}
        mine = dict.fromkeys(name for design in own for name in design.factors)
        for factor in mine:
            levels = pd.Categorical(covariates[factor]).categories
            if not 2 <= len(levels) <= settings.levels:
                continue
            row = {
                name: covariates[name].mode()[0] if name in every else covariates[name].median()
                for name in inputs.covariates
            }
            table = pd.DataFrame([row | {factor: level} for level in levels])
            used = [name for design in own for name in variables(design.formula)]
            at = {name: plain(row[name]) for name in used if name != factor}
            return cls(i, factor, tuple(map(_name, levels)), at, inputs.resolved(table))
        return None

    def values(self, alpha: Array) -> Array:
        """The hyperparameters (k, E) of the law at each level."""
        own = self.inputs.values(alpha[: self.inputs.size], slice(0, len(self.levels)))[self.i]
        return own[:, :, 0]


def factor_effects(
    inputs: Inputs, alpha: Array, inference: Inference, intervals: Array, covariates: Table | None
) -> tuple[FactorEffect, ...]:
    """The largest difference between the levels of each factor, and the test that all are equal.

    Where the difference is one coefficient, its interval is that of the coefficient among the
    `intervals` (K, 2): the profile's where it is known. For several pairs of levels each side is
    longer by the ratio of the normal quantiles of Bonferroni's level and of 95 %, up to the limits.
    Else it is the difference -+ that quantile times its standard error.

    With the coefficients b of a formula, their covariance V and a row C of contrasts for each level
    but the first, Wald's statistic (C b)' (C V C')^-1 C b has the chi-squared law with as many
    degrees of freedom as C has rank, for many experiments; with few of them p is too small.
    `covariates` has a row for each experiment. A factor with a coefficient whose uncertainty is not
    known, because it lies on a limit, is left out. Cost: milliseconds.
    """
    model = inputs.covariate_model
    if model is None or covariates is None or not inference.positive:
        return ()
    found = []
    for entry in model.entries:
        places = [*range(*entry.places.indices(inputs.size))]
        known = {int(k): place for place, k in enumerate(inference.free)}
        if entry.design is None or not entry.design.factors:
            continue
        inside = [j for j, k in enumerate(places) if k in known]
        own = [known[places[j]] for j in inside]
        covariance = np.zeros((len(places), len(places)))
        covariance[np.ix_(inside, inside)] = inference.covariance[np.ix_(own, own)]
        for factor in entry.design.factors:
            levels = pd.Categorical(covariates[factor]).categories
            rows = np.stack([
                entry.design.at(covariates.assign(**{factor: level})).matrix.mean(axis=0)
                for level in levels
            ])  # fmt: skip
            moved = np.flatnonzero(np.ptp(rows, axis=0) > 0.0)
            if len(levels) < 2 or not {*moved.tolist()} <= {*inside}:
                continue
            limits = np.array([[h.lower, h.upper] for h in inputs.hyperparameters])
            known_ends = np.stack([intervals[places], limits[places]])
            effect = _effect(rows, alpha[places], covariance, known_ends)
            first, second = (_name(levels[k]) for k in effect.pop("between"))
            between, name = (first, second), entry.hyperparameter.name
            found.append(FactorEffect(name, factor, between, **effect))
    return tuple(found)


def _effect(rows: Array, b: Array, covariance: Array, ends: Array) -> dict[str, Any]:
    """The largest difference between levels, whose values are `rows` (L, p) b, and Wald's test.

    `ends` (2, p, 2) are the intervals and the limits of the coefficients b.
    """
    value, pairs = rows @ b, [*combinations(range(len(rows)), 2)]
    first, second = max(pairs, key=lambda pair: abs(value[pair[0]] - value[pair[1]]))
    if value[first] < value[second]:
        first, second = second, first
    apart = rows[first] - rows[second]
    difference, error = float(apart @ b), float(np.sqrt(apart @ covariance @ apart))
    quantile = float(stats.norm.isf(INTERVALS.tail / len(pairs)))
    interval = np.array([-quantile, quantile]) * error + difference
    which = np.flatnonzero(apart)
    if which.size == 1 and np.all(np.isfinite(ends[0, which[0]])):
        k = int(which[0])
        longer = quantile / float(stats.norm.isf(INTERVALS.tail))
        interval = np.sort(apart[k] * np.clip(b[k] + longer * (ends[0, k] - b[k]), *ends[1, k]))
    contrasts = rows[1:] - rows[0]
    spread = contrasts @ covariance @ contrasts.T
    df = int(np.linalg.matrix_rank(spread, hermitian=True))
    wald = float(contrasts @ b @ np.linalg.pinv(spread, hermitian=True) @ (contrasts @ b))
    return {
        "between": (first, second),
        "difference": difference,
        "standard_error": error,
        "interval": tuple(interval.tolist()),
        "pairs": len(pairs),
        "wald": wald,
        "df": df,
        "p": float(stats.chi2.sf(wald, df)),
    }


def _name(level: object) -> str:
    return number(float(level)) if isinstance(level, int | float | np.number) else str(level)
