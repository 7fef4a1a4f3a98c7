"""Kernels whose mean over noise-free outcomes is the density of an experiment at one outcome."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from aleator.inference.verification.choice import REPLICATES
from aleator.observations.model import ObservationModel
from aleator.observations.normal import NormalError
from aleator.types import Array

NORMAL = NormalError()
POSITIVE = 0.2
"""An estimate of higher order below this share of that of lower order is not taken."""
NARROWER = (0.7, 0.5, 0.35, 0.25)
"""Bandwidths of the kernels that tell of the smoothing bias, over those of the estimate."""
SEEN = 3.0
"""Standard errors of a difference between two bandwidths that are more than chance."""
FAR = 0.05
"""Width about an outcome far out in which samples are drawn, over the bandwidth under the law."""


@dataclass(frozen=True)
class Noise:
    """p(y | Y, sd) of outcomes y (N,) by the observation model: unbiased, no smoothing."""

    y: Array
    sd: float
    observation: ObservationModel = NORMAL

    @property
    def scale(self) -> Array:
        """(N,) the standard deviation of the noise."""
        return np.full(self.y.size, self.sd)

    @property
    def width(self) -> Array:
        """(N,) how near to y an outcome explains it."""
        return self.scale

    def take(self, rows: NDArray[np.intp]) -> Noise:
        """The kernels of some of the experiments."""
        return Noise(self.y[rows], self.sd, self.observation)

    def scaled(self, factor: float) -> Noise:  # noqa: ARG002  one interface for all kernels
        """The same: nothing is smoothed."""
        return self

    def orders(self, outcomes: Array) -> tuple[Array, ...]:
        """The one kernel there is, as (N, S) each."""
        y, scale = self.y[:, None], np.array(self.sd)
        return (np.exp(self.observation.log_density(y, outcomes, scale).value),)


@dataclass(frozen=True)
class Window:
    """Smoothing kernels of outcomes y (N,) with bandwidths h (N,), one-sided at an end.

    With u = (y - Y)/h and I_k the integral of u^k phi(u) over the window that the range
    [lower, upper] of the outcome leaves of it, (c + d u + e u^2) phi(u) integrates 1, u, u^2 to
    1, 0, 0 there. In the open that is (3 - u^2) phi(u)/2, of fourth order (Wand and Jones, 1995,
    sec. 2.8); at an end it is the one-sided kernel of third order.
    """

    y: Array
    lower: Array
    upper: Array
    h: Array

    @classmethod
    def of(cls, y: Array, lower: Array, upper: Array, outcomes: Array) -> Window:
        """Bandwidths S^(-1/7) times the spread of outcomes (N, S).

        The spread is the smaller of standard deviation and scaled quartile range, so that two
        modes are not smeared.
        """
        quartiles = np.quantile(outcomes, [0.25, 0.75], axis=1)
        sd = outcomes.std(axis=1)
        spread = np.minimum(sd, (quartiles[1] - quartiles[0]) / 1.349)
        spread = np.where(spread > 0.0, spread, np.maximum(sd, 1e-300))
        return cls(y, lower, upper, spread * outcomes.shape[1] ** (-1.0 / 7.0))

    @property
    def scale(self) -> Array:
        """(N,) the bandwidth."""
        return self.h

    @property
    def width(self) -> Array:
        """(N,) how near to y an outcome explains it: far out the density falls quickly."""
        return FAR * self.h

    def take(self, rows: NDArray[np.intp]) -> Window:
        """The kernels of some of the experiments."""
        return Window(self.y[rows], self.lower[rows], self.upper[rows], self.h[rows])

    def scaled(self, factor: float) -> Window:
        """The kernels with other bandwidths."""
        return Window(self.y, self.lower, self.upper, factor * self.h)

    def orders(self, outcomes: Array) -> tuple[Array, ...]:
        """Kernels of zeroth, first and second degree, as (N, S) each; zero outside the range."""
        inside = (self.y >= self.lower) & (self.y <= self.upper)
        at = np.where(inside, self.y, np.clip(self.y, self.lower, self.upper))
        moments = _window_moments((at - self.upper) / self.h, (at - self.lower) / self.h)
        u = (at[:, None] - outcomes) / self.h[:, None]
        plain = np.where(inside[:, None], normal_pdf(u), 0.0) / self.h[:, None]
        zeroth = plain / moments[0][:, None]
        higher = (
            plain * np.polynomial.polynomial.polyval(u, _corrected(moments, k)[:, :, None], False)
            for k in (1, 2)
        )
        return (zeroth, *higher)


Kernel = Noise | Window


def chosen(kernel: Kernel, outcomes: Array, weights: Array) -> tuple[Array, Array]:
    """Terms (N, S) of the highest order of use, and a bound (N,) of the smoothing bias of log f.

    Far in a tail an estimate of higher order may not be positive; that of lower order is. The bias
    is bounded by half of the difference from the order below, or by that from narrower kernels:
    each of them may vanish by chance. What a kernel smears, a kink of the density or a tail that
    falls off within its width, only narrower ones see.
    """
    orders = kernel.orders(outcomes)
    if len(orders) == 1:
        return weights * orders[0], np.zeros(weights.shape[0])
    zeroth, first, second = (weights * terms for terms in orders)
    means = [terms.mean(axis=1) for terms in (zeroth, first, second)]
    simple = means[1] > POSITIVE * means[0]
    reference = np.where(simple, means[1], means[0])
    usable = means[2] > POSITIVE * reference
    terms = np.where(simple[:, None], first, zeroth)
    terms = np.where(usable[:, None], second, terms)
    safe = np.where(usable, means[2], 1.0)
    narrow = [weights * kernel.scaled(f).orders(outcomes)[-1] for f in NARROWER]
    smeared = smoothing(second, narrow) / safe
    bias = larger(0.5 * np.log(safe / np.where(usable, reference, 1.0)), smeared)
    return terms, np.where(usable, bias, 0.5)


def smoothing(terms: Array, narrow: Sequence[Array]) -> Array:
    """What smoothing adds to the means (N,) of terms (N, S), as terms of narrower kernels tell.

    The difference from the next narrower one, whatever its error; of the others those differences
    that are more than chance, if they are larger.
    """
    found = (terms - narrow[0]).mean(axis=1)
    for other in narrow[1:]:
        copies = copies_of(terms - other)
        away = copies.mean(axis=1)
        certain = np.abs(away) > SEEN * error_of(copies)
        found = np.where(certain, larger(found, away), found)
    return np.asarray(found)


def copies_of(terms: Array) -> Array:
    """Means (m, C) of terms (m, S) over each copy."""
    return np.asarray(terms.reshape(terms.shape[0], REPLICATES, -1).mean(axis=2))


def error_of(copies: Array) -> Array:
    """Standard error (...,) of the mean of copies (..., C); zero for a single one."""
    count = copies.shape[-1]
    if count == 1:
        return np.zeros(copies.shape[:-1])
    return np.asarray(copies.std(axis=-1, ddof=1) / math.sqrt(count))


def larger(a: Array, b: Array) -> Array:
    """Of two numbers the one of larger size, with its sign."""
    return np.where(np.abs(a) >= np.abs(b), a, b)


def normal_pdf(u: Array) -> Array:
    """The standard normal density."""
    return np.asarray(np.exp(-0.5 * u**2) / np.sqrt(2.0 * np.pi))


def _window_moments(a: Array, b: Array) -> list[Array]:
    """Integrals (5 of (N,)) of u^k phi(u) over [a, b], by parts: k = 0..4."""
    low, high = (np.where(np.isfinite(end), end, 0.0) for end in (a, b))
    at_low, at_high = normal_pdf(a), normal_pdf(b)
    moments = [np.asarray(special.ndtr(b) - special.ndtr(a)), at_low - at_high]
    for k in range(2, 5):
        edges = low ** (k - 1) * at_low - high ** (k - 1) * at_high
        moments.append((k - 1) * moments[k - 2] + edges)
    return moments


def _corrected(moments: list[Array], degree: int) -> Array:
    """Coefficients (degree+1, N) of the factor that integrates 1, u, .. to 1, 0, .."""
    size = degree + 1
    matrix = np.stack([np.stack(moments[i : i + size], axis=-1) for i in range(size)], axis=-1)
    first = np.zeros((moments[0].size, size, 1))
    first[:, 0] = 1.0
    return np.asarray(np.linalg.solve(matrix, first)[:, :, 0].T)
