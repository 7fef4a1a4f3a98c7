"""The uniform law, with Legendre polynomials."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy import special

from aleator.errors import InputsError
from aleator.laws.hyperparameter import (
    OPEN,
    Hyperparameter,
    Specification,
    location_and_scale,
)
from aleator.laws.law import ByMeanAndSd, Rule, Standard, to_score
from aleator.polynomials import gauss_legendre, legendre_recurrence
from aleator.types import Array

HALF = math.sqrt(3.0)
"""Half the width of a uniform law, in standard deviations."""


@dataclass(frozen=True)
class Uniform(ByMeanAndSd):
    """Uniform law on [mean - sqrt(3) sd, mean + sqrt(3) sd], with Legendre polynomials.

    x = mean + sqrt(3) sd t with t uniform on [-1, 1] (Wiener-Askey table of Xiu and Karniadakis,
    2002). `mean` and `sd` are those of the law; each is a number (known) or `Free` (identified).
    The mean needs finite limits; an sd limit left open becomes a thousandth and a half of their
    width. `Uniform.between(lower, upper)` is the known law between two ends. Raises InputsError
    where limits or ends are missing or out of order.

    The log-likelihood of a sharp end is not smooth: with little measurement noise the identified
    support is as narrow as the outermost outcomes allow, and standard errors mean little there.

    >>> from aleator.laws import Free
    >>> law = Uniform(mean=Free(0.0, 2.0), sd=Free(0.1, 1.0))
    >>> law.rule(np.array([1.0, 1.0 / 3.0**0.5]), 2).x.round(6).tolist()     # on [0, 2]
    [0.42265, 1.57735]
    >>> Uniform.between(0.0, 2.0).quantile(np.array([1.0, 3.0**-0.5]), np.array([0.25])).tolist()
    [0.5]
    """

    mean: Specification = OPEN
    sd: Specification = OPEN
    ends: tuple[float, float] | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        _ = self.hyperparameters

    @classmethod
    def between(cls, lower: float, upper: float) -> Uniform:
        """The known law that is uniform on [lower, upper], whose ends are exact."""
        if not (math.isfinite(lower) and math.isfinite(upper) and lower < upper):
            raise InputsError(
                f"uniform between {lower} and {upper}", "give two finite numbers, the lower first"
            )
        law = cls(0.5 * (lower + upper), (upper - lower) / (2.0 * HALF))
        object.__setattr__(law, "ends", (float(lower), float(upper)))
        return law

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """`mean` and `sd` of the law."""
        return location_and_scale(self.mean, self.sd)

    @property
    def box(self) -> tuple[float, float]:
        """The ends of a known law; else the widest support that the limits admit."""
        if self.ends is not None:
            return self.ends
        mean, sd = self.hyperparameters
        return mean.lower - HALF * sd.upper, mean.upper + HALF * sd.upper

    @property
    def bounded(self) -> bool:
        """Whether the law is known: its support is then the box."""
        return not any(h.free for h in self.hyperparameters)

    def rule(self, values: Array, nodes: int) -> Rule:
        """Gauss-Legendre nodes; the weights do not depend on alpha."""
        t, weights = gauss_legendre(nodes)
        dx = np.stack([np.ones(nodes), HALF * t], axis=1)
        return Rule(self._at(values, t), weights, t, dx, np.zeros((nodes, 2)))

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:  # noqa: ARG002
        """Legendre polynomials of t in [-1, 1]."""
        return legendre_recurrence(count)

    def log_density(self, values: Array, x: Array) -> Array:
        """-log(2 sqrt(3) sd) between the ends."""
        lower, upper = self._ends(values)
        return np.where((x >= lower) & (x <= upper), -math.log(upper - lower), -np.inf)

    def normal_score(self, values: Array, x: Array) -> Array:
        """Phi^-1 of (x - lower)/(upper - lower)."""
        lower, upper = self._ends(values)
        width = upper - lower
        below, above = (np.clip(part / width, 0.0, 1.0) for part in (x - lower, upper - x))
        return to_score(below, above)

    def quantile(self, values: Array, probability: Array) -> Array:
        """mean + sqrt(3) sd (2 probability - 1)."""
        return self._at(values, 2.0 * np.asarray(probability, dtype=float) - 1.0)

    def standard(self, values: Array, theta: Array) -> Standard:
        """mean + sqrt(3) sd erf(theta/sqrt(2))."""
        t = special.erf(theta / math.sqrt(2.0))
        dtheta = HALF * values[1] * math.sqrt(2.0 / math.pi) * np.exp(-0.5 * theta**2)
        dvalues = np.stack([np.ones(theta.shape), HALF * t], axis=-1)
        return Standard(self._at(values, t), dtheta, dvalues)

    def _ends(self, values: Array) -> tuple[float, float]:
        if self.ends is not None:
            return self.ends
        half = HALF * float(values[1])
        return float(values[0]) - half, float(values[0]) + half

    def _at(self, values: Array, t: Array) -> Array:
        # rounding must not push a node out of the box
        x: Array = np.clip(values[0] + HALF * values[1] * t, *self.box)
        return x
