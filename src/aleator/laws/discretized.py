"""Points and weights that stand for a continuous law known by its density."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aleator.polynomials import gauss_legendre
from aleator.types import Array

NEAR = 1e-8
"""Distance from a finite end, in sd or widths, within which the mass is put on one point: closer,
an infinite density would be lost in the rounding of x."""
POINTS = 16
"""Gauss-Legendre points of a panel."""
WAVES = 8.0
"""Width of the first panels, in the variable s, times the degree: polynomials of half the degree
then have few zeros in a panel."""
ALIKE = 1e-14
"""Change of an integral, over its total, by halving a panel, that ends the halving."""
DEEPEST = 45
"""Halvings of a panel: one that holds a jump of the density is then of no weight."""
MOST = 4096
"""Panels halved at once; where more ask for it, the density itself is not smooth to rounding."""
FAR = 30.0
"""Largest |s| of an infinite end, at about e^30 sd: the tails that are admitted end before it."""


@dataclass(frozen=True)
class Support:
    """The ends of a law, and where and how wide it is."""

    lower: float
    upper: float
    mean: float
    sd: float

    def span(self) -> tuple[float, float]:
        """The range of the variable s that stands for the support."""
        near = -np.log(NEAR)
        low = -near if np.isfinite(self.lower) or np.isfinite(self.upper) else -FAR
        high = near if np.isfinite(self.lower) and np.isfinite(self.upper) else FAR
        return float(low), float(high)

    def near_ends(self) -> list[tuple[float, float]]:
        """Each finite end with the point next to it that the range of s still holds."""
        first, last = (float(x) for x in self.at(np.array(self.span()))[0])
        if not math.isfinite(self.lower):
            return [(self.upper, first)] if math.isfinite(self.upper) else []
        lower = [(self.lower, first)]
        return [*lower, (self.upper, last)] if math.isfinite(self.upper) else lower

    def at(self, s: Array) -> tuple[Array, Array]:
        """Points x(s) and log dx/ds: logistic, exponential or hyperbolic sine by the open ends.

        Each is logarithmic in the distance from a finite end and in the far tail of an open one,
        so that panels of equal width in s serve densities that are infinite at an end.
        """
        if np.isfinite(self.lower) and np.isfinite(self.upper):
            width = self.upper - self.lower
            # the distance from the nearer end keeps its digits
            part = width / (1.0 + np.exp(np.abs(s)))
            x = np.where(s < 0.0, self.lower + part, self.upper - part)
            return x, np.log(width) - np.abs(s) - 2.0 * np.log1p(np.exp(-np.abs(s)))
        if np.isfinite(self.lower):
            return self.lower + self.sd * np.exp(s), np.log(self.sd) + s
        if np.isfinite(self.upper):
            return self.upper - self.sd * np.exp(s), np.log(self.sd) + s
        return self.mean + self.sd * np.sinh(s), np.log(self.sd) + np.log(np.cosh(s))


def discretize(
    support: Support, log_density: Callable[[Array], Array], degree: int
) -> tuple[Array, Array]:
    """Standardized points z (Q,) and weights (Q,) that integrate z^degree and all below.

    `log_density` takes and gives flat arrays. Composite Gauss-Legendre in s, panels halved until
    the integrals of 1, |z|^(degree/2) and |z|^degree no longer change (1e-14 of the total), which
    also finds kinks and jumps of the density, and until they are narrow for the zeros of
    polynomials. The mass within NEAR of a finite end is not here. Weights are not normalized.
    """
    low, high = support.span()
    step = WAVES / max(degree, 16)
    edges = np.linspace(low, high, 1 + int(np.ceil((high - low) / step)))
    left, right = edges[:-1], edges[1:]
    t, w = gauss_legendre(POINTS)
    powers = np.array([0.0, 0.5, 1.0]) * degree

    def panels(a: Array, b: Array) -> tuple[Array, Array, Array]:
        """z (P, 16), log weights (P, 16), and logs of the integrands (P, 16, 3)."""
        half = 0.5 * (b - a)[:, None]
        x, log_jac = support.at(0.5 * (a + b)[:, None] + half * t)
        z = (x - support.mean) / support.sd
        with np.errstate(divide="ignore", invalid="ignore"):
            logs = log_density(x.ravel()).reshape(x.shape) + log_jac + np.log(w * (b - a)[:, None])
            grown = logs[..., None] + powers * np.log(np.maximum(np.abs(z), 1e-300))[..., None]
        return z, logs, np.where(np.isnan(grown), -np.inf, grown)

    z, logs, grown = panels(left, right)
    top = grown.max(axis=(0, 1))
    total = np.exp(grown - top).sum(axis=(0, 1))
    kept: list[tuple[Array, Array]] = []
    for _ in range(DEEPEST):
        middle = 0.5 * (left + right)
        first, second = panels(left, middle), panels(middle, right)
        coarse = np.exp(grown - top).sum(axis=1)
        fine = np.exp(first[2] - top).sum(axis=1) + np.exp(second[2] - top).sum(axis=1)
        rough = np.any(np.abs(fine - coarse) > ALIKE * total, axis=1)
        wide = np.ptp(z, axis=1) > step * np.maximum(1.0, np.abs(z).min(axis=1))
        rough |= wide & np.any(coarse > ALIKE * total, axis=1)
        kept.append((z[~rough].ravel(), logs[~rough].ravel()))
        if not rough.any():
            break
        if np.count_nonzero(rough) > MOST:
            kept.append((z[rough].ravel(), logs[rough].ravel()))
            break
        left, right = (
            np.concatenate([left[rough], middle[rough]]),
            np.concatenate([middle[rough], right[rough]]),
        )
        z, logs, grown = (
            np.concatenate([one[rough], two[rough]]) for one, two in zip(first, second, strict=True)
        )
    points = np.concatenate([part[0] for part in kept])
    weights = np.exp(np.concatenate([part[1] for part in kept]))
    held = weights > 0.0
    return points[held], weights[held]
