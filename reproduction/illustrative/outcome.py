"""The paper's illustrative outcome, y = tan(x/4) + exp(x/3 - 1) + tanh(x) of a normal x.

tan(x/4) has poles at x = -2 pi and 2 pi, which a standard normal x reaches: Y then has no second
moment, for E[Y^2] contains the integral of 16/(2 pi - x)^2 at the pole. The paper does not say so.
Here x is conditioned on |x| <= limit < 2 pi, where y is smooth and increasing and every moment
exists.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, cast

import numpy as np
from scipy.special import ndtr

from aleator.core.polynomials import evaluate
from aleator.core.types import Array
from aleator.laws import TruncatedNormal
from aleator.laws.inputs import Inputs
from aleator.moments.densities import FittedDensity
from aleator.moments.moments import Moments, weighted_moments
from aleator.moments.projection import expansion_map

Polynomials = Literal["own", "hermite"]

PANELS = 200
"""Panels of the fine rule, which narrow towards the poles."""

NEWTON = 3
"""Steps from the nearest of the fine points: to rounding."""

POLE = 2.0 * np.pi
"""Where tan(x/4) is infinite."""

ALPHA = np.array([0.0, 1.0])
"""Mean and standard deviation of x before it is conditioned."""


@dataclass(frozen=True)
class Fine:
    """The conditioned law on a fine rule: x, weights, outcome y, density f_Y(y), cdf F_Y(y)."""

    x: Array
    weights: Array
    y: Array
    pdf: Array
    cdf: Array


@dataclass(frozen=True)
class Camelback:
    """The illustrative outcome of x ~ Normal(0, 1) given |x| <= limit.

    >>> c = Camelback()
    >>> c.outcome(np.array([0.0])).round(6).tolist()  # exp(-1)
    [0.367879]
    """

    limit: float = 6.0

    def outcome(self, x: Array) -> Array:
        """y(x)."""
        return np.asarray(np.tan(x / 4.0) + np.exp(x / 3.0 - 1.0) + np.tanh(x))

    def slope(self, x: Array) -> Array:
        """y'(x), positive everywhere between the poles."""
        bend = 0.25 / np.cos(x / 4.0) ** 2 + np.exp(x / 3.0 - 1.0) / 3.0
        return np.asarray(bend + 1.0 / np.cosh(x) ** 2)

    def law(self, polynomials: Polynomials = "hermite") -> TruncatedNormal:
        """The law of x, with the paper's polynomials of the clipped germ or with its own."""
        return TruncatedNormal((-self.limit, self.limit), 0.0, 1.0, polynomials)

    def at(self, x: Array) -> Fine:
        """The law at points x that increase, without weights that integrate."""
        mass = ndtr(self.limit) - ndtr(-self.limit)
        pdf = np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi) / mass
        cdf = (ndtr(x) - ndtr(-self.limit)) / mass
        return Fine(x, np.zeros_like(x), self.outcome(x), pdf / self.slope(x), cdf)

    @property
    def exact(self) -> FittedDensity:
        """The law of Y as a density that `earth_movers_distance` takes: its cdf and quantiles."""
        return cast(FittedDensity, Exact(self))

    @cached_property
    def fine(self) -> Fine:
        """The law on Gauss-Legendre panels: every moment to rounding.

        f_Y(y(x)) = f_X(x) / y'(x), the change of variables for an increasing y.
        """
        t, w = np.polynomial.legendre.leggauss(12)
        reach = np.arctanh(self.limit / POLE)
        edges = POLE * np.tanh(np.linspace(-reach, reach, PANELS + 1))
        half = 0.5 * np.diff(edges)[:, None]
        x = (0.5 * (edges[1:] + edges[:-1])[:, None] + half * t).ravel()
        at = self.at(x)
        weights = (half * w).ravel() * at.pdf * self.slope(x)
        return Fine(x, weights / weights.sum(), at.y, at.pdf, at.cdf)

    def exact_moments(self, order: int) -> Moments:
        """Moments of Y by the fine rule."""
        return weighted_moments(self.fine.y[None], self.fine.weights, order)

    def nodes(self, q: int, polynomials: Polynomials = "hermite") -> tuple[Array, Array]:
        """Outcomes and weights (q,) at the nodes of the law."""
        rule = self.law(polynomials).rule(ALPHA, q)
        return self.outcome(rule.x), rule.weights

    def expanded(
        self, degree: int, q: int, order: int, polynomials: Polynomials = "hermite"
    ) -> tuple[Array, Array]:
        """The expansion from q runs at nodes with weights that integrate its `order` exactly."""
        outcomes, _ = self.nodes(q, polynomials)
        inputs = Inputs({"x": self.law(polynomials)})
        matrix, weights = expansion_map(inputs, ALPHA, q, degree, order)
        return matrix @ outcomes, weights

    def coefficients(self, degree: int, q: int, polynomials: Polynomials = "hermite") -> Array:
        """Coefficients c_0..c_degree in orthonormal polynomials by q runs (paper, eq. 8)."""
        law = self.law(polynomials)
        rule = law.rule(ALPHA, q)
        basis = evaluate(*law.recurrence(ALPHA, degree + 1), rule.t, degree)
        return np.asarray(basis.T @ (rule.weights * self.outcome(rule.x)))

    def exact_coefficients(self, degree: int, polynomials: Polynomials = "hermite") -> Array:
        """Coefficients by fine integration over the germ."""
        law, fine = self.law(polynomials), self.fine
        family = law.recurrence(ALPHA, degree + 1)
        if polynomials == "own":
            basis = evaluate(*family, fine.x, degree)
            return np.asarray(basis.T @ (fine.weights * fine.y))
        t, w = np.polynomial.legendre.leggauss(600)
        germ = 12.0 * t
        weights = 12.0 * w * np.exp(-0.5 * germ**2) / np.sqrt(2.0 * np.pi)
        outcomes = self.outcome(law.standard(ALPHA, germ).x)
        return np.asarray(evaluate(*family, germ, degree).T @ (weights * outcomes))


@dataclass(frozen=True)
class Exact:
    """The law of Y, one experiment."""

    camelback: Camelback

    def cdf(self, y: Array) -> Array:
        """Probability of an outcome not above y (1, G), by Newton's method on y(x)."""
        c = self.camelback
        x = np.interp(y, c.fine.y, c.fine.x)
        for _ in range(NEWTON):
            x = np.clip(x - (c.outcome(x) - y) / c.slope(x), -c.limit, c.limit)
        return c.at(x).cdf

    def quantile(self, p: Array) -> Array:
        """Outcomes (1, P) that are not exceeded with probabilities p (P,)."""
        return self.camelback.outcome(self.camelback.law().quantile(ALPHA, p))[None]


def raw(y: Array, weights: Array, order: int) -> Array:
    """Raw moments E[Y^m], m = 1..order, as the paper compares them.

    >>> raw(np.array([1.0, 3.0]), np.array([0.5, 0.5]), 2).tolist()
    [2.0, 5.0]
    """
    return np.array([weights @ y**m for m in range(1, order + 1)])
