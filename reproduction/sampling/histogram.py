"""The density of a sample as the paper takes it: a spline through the histogram."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from aleator.core.status import Status
from aleator.core.types import Array, Flags
from aleator.errors import InputsError
from aleator.moments.densities import Codes, by_experiment, probabilities
from aleator.moments.moments import NodeOutcomes

_BISECTIONS = 60


@dataclass(frozen=True)
class HistogramSpline:
    """A spline through the histogram of sampled outcomes (paper, sec. results; a reference).

    The monotone cubic spline (Fritsch and Carlson, 1980) through the cumulated histogram, whose
    derivative is the density: a histospline (Boneva, Kendall and Stefanov, 1971) that keeps the
    mass of every bin and is nowhere negative. `bins` of equal width between the smallest and the
    largest outcome; None takes 2 S^(1/3) of them (Rice's rule) for S samples.

    A reference, not a density to search with: it has no derivative by alpha. Its error falls as
    S^(-1/3) at best. Raises InputsError for fewer than four bins.

    >>> grid = NodeOutcomes(np.linspace(0.0, 1.0, 1001)[None, :], np.full(1001, 1.0 / 1001.0))
    >>> HistogramSpline(bins=10).fit_sample(grid).pdf([[0.5]]).round(2).tolist()
    [[1.0]]
    """

    bins: int | None = None

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if self.bins is not None and self.bins < 4:
            raise InputsError(f"histogram of {self.bins} bins", "take at least 4, or None")

    @property
    def name(self) -> str:
        """Name for reports."""
        return "histogram_spline"

    def fit_sample(self, outcomes: NodeOutcomes) -> FittedHistogram:
        """The densities of N samples (weighted nodes, none of negative weight); cost O(N S)."""
        y, weights = outcomes.y, outcomes.weights
        if np.any(weights < 0.0):
            raise InputsError(
                "a histogram of nodes with negative weights", "take a sampling cubature"
            )
        bins = self.bins or max(4, int(np.ceil(2.0 * y.shape[1] ** (1.0 / 3.0))))
        low, high = y.min(axis=1), y.max(axis=1)
        width = np.where(high > low, high - low, 1.0)
        place = np.minimum(((y - low[:, None]) / width[:, None] * bins).astype(np.intp), bins - 1)
        flat = place + bins * np.arange(y.shape[0])[:, None]
        mass = np.bincount(
            flat.ravel(), np.tile(weights, y.shape[0]), minlength=bins * y.shape[0]
        ).reshape(-1, bins)
        cumulated = np.concatenate([np.zeros((y.shape[0], 1)), np.cumsum(mass, axis=1)], axis=1)
        return FittedHistogram(low, high, cumulated / cumulated[:, -1:])


@dataclass(frozen=True)
class FittedHistogram:
    """Histosplines of N experiments; methods as in `FittedDensity`, no derivatives.

    `low`, `high` (N,) are the smallest and the largest outcome, `cumulated` (N, B+1) the
    probability below each edge of the B bins.
    """

    low: Array
    high: Array
    cumulated: Array

    @cached_property
    def _cdf(self) -> PchipInterpolator:
        return PchipInterpolator(np.linspace(0.0, 1.0, self.cumulated.shape[1]), self.cumulated.T)

    @property
    def degenerate(self) -> Flags:
        """(N,) whether all samples are equal: there is no density."""
        return np.asarray(~(self.high > self.low))

    @property
    def status(self) -> Codes:
        """(N,) SOLVED or DEGENERATE."""
        return np.where(self.degenerate, Status.DEGENERATE, Status.SOLVED).astype(np.int64)

    def log_pdf(self, y: ArrayLike) -> Array:
        """Logarithm of the density at y (N,) or (N, G); -inf where no sample fell."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(self.pdf(y)))

    def pdf(self, y: ArrayLike) -> Array:
        """The density at y (N,) or (N, G)."""
        u = self._unit(y)
        inside = (u >= 0.0) & (u <= 1.0) & ~self.degenerate[:, None]
        slope = self._at(self._cdf.derivative(), np.clip(u, 0.0, 1.0)) / self._width[:, None]
        value = np.where(inside, np.maximum(slope, 0.0), 0.0)
        return np.asarray(value.reshape(np.shape(y)))

    def cdf(self, y: ArrayLike) -> Array:
        """Probability of an outcome not above y (N,) or (N, G)."""
        value = self._at(self._cdf, np.clip(self._unit(y), 0.0, 1.0))
        return np.asarray(np.clip(value, 0.0, 1.0).reshape(np.shape(y)))

    def quantile(self, p: ArrayLike) -> Array:
        """Outcomes (N, P) that are not exceeded with probabilities p (P,), by bisection."""
        wanted = np.broadcast_to(probabilities(p), (self.low.size, probabilities(p).size))
        return self._inverse(wanted)

    @property
    def _width(self) -> Array:
        return np.where(self.degenerate, 1.0, self.high - self.low)

    def _unit(self, y: ArrayLike) -> Array:
        outcome = by_experiment(y, self.low.size, "the outcome")
        return np.asarray((outcome - self.low[:, None]) / self._width[:, None])

    def _at(self, spline: PchipInterpolator, u: Array) -> Array:
        """Each experiment's own spline at its own points u (N, G)."""
        edges, coefficients = spline.x, spline.c
        panel = np.clip(np.searchsorted(edges, u, side="right") - 1, 0, edges.size - 2)
        rows = np.arange(u.shape[0])[:, None]
        step, value = u - edges[panel], np.zeros_like(u)
        for power in coefficients:
            value = value * step + power[panel, rows]
        return value

    def _inverse(self, p: Array) -> Array:
        low, high = np.zeros_like(p), np.ones_like(p)
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            below = self._at(self._cdf, middle) < p
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.asarray(self.low[:, None] + self._width[:, None] * 0.5 * (low + high))
