"""Whether a larger model fits better than chance lets it: the likelihood ratio of nested models."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from aleator.types import Array

TIE = 1e-9
"""Ratios this close are equal: both are zero where a scale ends at zero."""


@dataclass(frozen=True)
class LikelihoodRatio:
    """D = 2 (log L_larger - log L_smaller) and what chance makes of it.

    `df` free hyperparameters more; `on_boundary` of them are scales that are zero in the smaller
    model. `bootstrap` (R,) are ratios of data drawn under the smaller model, NaN where a climb did
    not arrive; empty without. `regular` is False where there is no reference but these.
    """

    smaller: str
    larger: str
    statistic: float
    df: int
    on_boundary: int
    regular: bool
    bootstrap: Array

    @property
    def p(self) -> float:
        """P(chi-squared >= D) by the reference; NaN where there is none.

        With a scale of zero half chi2(df - 1) and half chi2(df): exact for one scale (Self and
        Liang 1987, case 5; with its correlations Stram and Lee 1994, case 3), and an upper bound
        for several (Perlman 1969).
        """
        if not self.regular or self.df < 1:
            return float("nan")
        return ratio_p(self.statistic, self.df, boundary=self.on_boundary > 0)

    @property
    def bootstrap_p(self) -> float:
        """(1 + number of drawn ratios as large) / (1 + R); NaN without any."""
        drawn = self.bootstrap[np.isfinite(self.bootstrap)]
        if not drawn.size:
            return float("nan")
        return float((1 + np.sum(drawn >= self.statistic - TIE)) / (1 + drawn.size))

    @property
    def reference(self) -> str:
        """What the p is taken from, in a few letters."""
        if not self.regular or self.df < 1:
            return "bootstrap"
        if not self.on_boundary:
            return f"chi2({self.df})"
        bound = "<= " if self.on_boundary > 1 else ""
        return f"{bound}1/2 chi2({self.df - 1}) + 1/2 chi2({self.df})"


def ratio_p(statistic: float, df: int, *, boundary: bool) -> float:
    """P(chi2(df) >= statistic), or of half chi2(df - 1) and half chi2(df) on a `boundary`.

    chi2(0) is zero. A statistic below zero, which only a wrong maximum gives, has p = 1.

    >>> round(ratio_p(3.841, 1, boundary=False), 3), round(ratio_p(3.841, 1, boundary=True), 3)
    (0.05, 0.025)
    """
    if statistic <= TIE:
        return 1.0
    larger = float(stats.chi2.sf(statistic, df))
    if not boundary:
        return larger
    smaller = float(stats.chi2.sf(statistic, df - 1)) if df > 1 else 0.0
    return 0.5 * (smaller + larger)
