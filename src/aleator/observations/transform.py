"""The transform of the outcome: what the likelihood sees of a measured or a simulated outcome."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from aleator.errors import ExperimentsError
from aleator.types import Array


class Transform(StrEnum):
    """The scale on which the law of the outcome is identified: its own, or the logarithmic one.

    Measured and simulated outcomes are both in the original unit, and both are transformed; means,
    densities and log-likelihoods are those of the transformed outcome.

    >>> Transform.LOG([1.0, 10.0]), Transform.LOG.fault(-2.0)
    (array([0.        , 2.30258509]), 'the logarithm of -2 does not exist')
    """

    NONE = "none"
    LOG = "log"

    @classmethod
    def named(cls, text: str) -> Transform:
        """The transform of this name; raises ExperimentsError if there is none."""
        if text not in [*cls]:
            raise ExperimentsError(f"unknown transform {text!r}", 'it is "none" or "log"')
        return cls(text)

    def __call__(self, outcome: ArrayLike) -> Array:
        """Outcomes in the original unit as the likelihood sees them; not finite where it cannot."""
        values = np.asarray(outcome, dtype=np.float64)
        if self is Transform.NONE:
            return values
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.log(values)

    def inverse(self, transformed: Array) -> Array:
        """Outcomes in the original unit."""
        return transformed if self is Transform.NONE else np.exp(transformed)

    def fault(self, outcome: float) -> str:
        """Why a finite outcome cannot be transformed, "" if it can."""
        if self is Transform.NONE or outcome > 0.0:
            return ""
        return f"the logarithm of {outcome:g} does not exist"
