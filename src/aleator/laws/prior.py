"""What is believed of a hyperparameter before the experiments: a known law of its value."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import special

from aleator.errors import InputsError
from aleator.types import Array

if TYPE_CHECKING:
    from aleator.laws.hyperparameter import Hyperparameter
    from aleator.laws.law import Law

STEP = 1e-3
"""Step of the differences of a log-density, over a quarter of the width of the central half of the
prior, and over the distance to an end where the density vanishes or is infinite."""
PLACES = np.array([-2.0, -1.0, 1.0, 2.0])
WEIGHTS = np.array([1.0, -8.0, 8.0, -1.0]) / 12.0
"""The central difference of fourth order."""
ONWARD = np.arange(5.0)
ONWARD_WEIGHTS = np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / 12.0
"""The one on one side, for the end of a support."""
LEAST = 1e-3
"""Share of a prior that its hyperparameter's limits must hold."""


@dataclass(frozen=True)
class Prior:
    """The prior density p(v) of a hyperparameter v, that of a law whose own values are known.

    `step` is that of its differences, `soft` are the ends of its support to which the log-density
    is not finite, and `hard` those at which it stops short; infinite where there is none. It is not
    normalized again on the limits of v: a constant factor moves neither a maximum nor a
    posterior.

    >>> from aleator.laws import Normal
    >>> prior = Prior.of(Normal(1.0, 0.1), "x.mean", 0.5, 1.5)
    >>> prior.log_density(1.2), prior.slope(1.2)    # log N(1.2; 1, 0.1^2), -(1.2 - 1)/0.1^2
    (-0.6163534, -20.0)
    """

    law: Law
    step: float
    soft: tuple[float, float]
    hard: tuple[float, float]

    @classmethod
    def of(cls, law: Law, name: str, lower: float, upper: float) -> Prior:
        """The prior of the hyperparameter `name` with these limits.

        Raises InputsError where the law is not known, is that of a constant, has no density on a
        limit, or lies outside the limits.
        """
        free = [h.name for h in law.hyperparameters if h.free]
        if free:
            raise InputsError(
                f"{name}: the prior leaves {', '.join(free)} to be identified",
                "a prior is known: give it numbers",
            )
        if not law.scatters:
            raise InputsError(
                f"{name}: a constant is no prior", f"fix {name} at that number instead"
            )
        values = _values(law)
        ends = law.log_density(values, np.array([lower, upper]))
        for end, at in zip(("lower", "upper"), ends.tolist(), strict=True):
            if not np.isfinite(at):
                limit = lower if end == "lower" else upper
                raise InputsError(
                    f"{name}: the prior has no finite density at the {end} limit {limit:g}",
                    f"move the {end} limit to where the prior has one",
                )
        held = _held(law, values, lower, upper)
        if held < LEAST:
            raise InputsError(
                f"{name}: the limits [{lower:g}, {upper:g}] hold {held:.2g} of the prior",
                "move the limits to where the prior is, or mend the prior",
            )
        low, first, third, high = law.quantile(values, np.array([0.0, 0.25, 0.75, 1.0])).tolist()
        with np.errstate(all="ignore"):
            stops = np.isfinite(law.log_density(values, np.array([low, high])))
        return cls(
            law,
            STEP * 0.25 * (third - first),
            (-math.inf if stops[0] else low, math.inf if stops[1] else high),
            (low if stops[0] else -math.inf, high if stops[1] else math.inf),
        )

    def log_density(self, value: float) -> float:
        """log p(v); minus infinity outside the support."""
        return float(self.law.log_density(_values(self.law), np.array([value]))[0])

    def slope(self, value: float) -> float:
        """d log p/dv, by a difference of fourth order: to some 1e-8 of its size."""
        step = min(self.step, STEP * (value - self.soft[0]), STEP * (self.soft[1] - value))
        if not step > 0.0:
            return 0.0
        places, weights = PLACES, WEIGHTS
        if value - self.hard[0] < 3.0 * step:
            places, weights = ONWARD, ONWARD_WEIGHTS
        elif self.hard[1] - value < 3.0 * step:
            places, weights = -ONWARD, -ONWARD_WEIGHTS
        found = self.law.log_density(_values(self.law), value + step * places)
        return float(found @ weights / step)

    def curvature(self, value: float) -> float:
        """-d2 log p/dv2, by a difference of slopes; zero where the prior is not bent down."""
        step = min(10.0 * self.step, 0.5 * (value - self.soft[0]), 0.5 * (self.soft[1] - value))
        if not step > 0.0:
            return 0.0
        bent = (self.slope(value - step) - self.slope(value + step)) / (2.0 * step)
        return max(bent, 0.0)


def curvatures(hyperparameters: Sequence[Hyperparameter], alpha: Array) -> Array:
    """-d2 log p/dalpha2 (K,) of the priors, zero where there is none."""
    return np.array(
        [
            0.0 if h.prior is None else h.prior.curvature(float(value))
            for h, value in zip(hyperparameters, alpha, strict=True)
        ]
    )


def log_prior(hyperparameters: Sequence[Hyperparameter], alpha: Array) -> float:
    """sum_k log p(alpha_k) over the hyperparameters with a prior; 0 without any."""
    return float(
        sum(
            h.prior.log_density(float(value))
            for h, value in zip(hyperparameters, alpha, strict=True)
            if h.prior is not None
        )
    )


def prior_score(hyperparameters: Sequence[Hyperparameter], alpha: Array) -> Array | None:
    """The derivative (K,) of the log prior by alpha; None where there is no prior."""
    if not has_prior(hyperparameters):
        return None
    return np.array(
        [
            0.0 if h.prior is None else h.prior.slope(float(value))
            for h, value in zip(hyperparameters, alpha, strict=True)
        ]
    )


def has_prior(hyperparameters: Sequence[Hyperparameter]) -> bool:
    """Whether any of them has a prior: what is maximized is then the posterior density."""
    return any(h.prior is not None for h in hyperparameters)


def _values(law: Law) -> Array:
    return np.array([h.start for h in law.hyperparameters])


def _held(law: Law, values: Array, lower: float, upper: float) -> float:
    """The probability between the limits."""
    score = law.normal_score(values, np.array([lower, upper]))
    return float(special.ndtr(score[1]) - special.ndtr(score[0]))
