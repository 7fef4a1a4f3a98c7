"""An observation model from outside the package: Student's t, for measurements with outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.observations.model import Observed


@dataclass(frozen=True)
class StudentError:
    """(y - eta)/scale has Student's t law with `df` > 2 degrees of freedom.

    Raises InputsError for fewer: the law has then no standard deviation.
    """

    df: float

    def __post_init__(self) -> None:
        if not self.df > 2.0:
            raise InputsError(f"df = {self.df}", "take more than two degrees of freedom")

    @property
    def name(self) -> str:
        return f"student({self.df:g})"

    def log_density(self, y: Array, eta: Array, scale: Array) -> Observed:
        u = (y - eta) / scale
        pull = (self.df + 1.0) * u / (self.df + u**2)
        value = stats.t.logpdf(u, self.df) - np.log(scale)
        return Observed(value, pull / scale, (u * pull - 1.0) / scale)

    def cdf(self, y: Array, eta: Array, scale: Array) -> Array:
        return stats.t.cdf((y - eta) / scale, self.df)

    def quantile(self, probability: Array, eta: Array, scale: Array) -> Array:
        return eta + scale * stats.t.ppf(probability, self.df)

    def moments(self, order: int) -> Array:
        """Those of order below df exist."""
        return np.array(
            [stats.t.moment(m, self.df) if m < self.df else np.nan for m in range(order + 1)]
        )
