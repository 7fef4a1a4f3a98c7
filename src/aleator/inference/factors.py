"""Laws that follow a factor, which is a column of names: one law for each of its levels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from aleator.core.types import Array
from aleator.laws.covariates import Table, variables
from aleator.laws.inputs import Inputs
from aleator.results.documents import plain
from aleator.results.printed import number


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


def _name(level: object) -> str:
    return number(float(level)) if isinstance(level, int | float | np.number) else str(level)
