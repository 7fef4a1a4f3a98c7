"""Laws as images x = F^-1(Phi(theta)) of a standard normal variate, from both of their tails."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import special

from aleator.types import Array

STEP = 1e-3
"""Relative step of differences: their error is of the order of STEP^4."""

FARTHEST, KNOTS = 9.5, 761
"""A quantile that is tabulated has so many knots, at standard normal variates up to this size."""
MANY = 256
"""Values of one law for which a table is made: it costs some thousand quantiles."""

Tail = Callable[..., Array]
"""A quantile of probabilities (J,) and of as many of each shape of the law, or of one for all."""


def from_tails(theta: Array, below: Tail, above: Tail, *shapes: Array) -> Array:
    """F^-1(Phi(theta)), by `below(P)` left of the median and by `above(1 - P)` right of it.

    Phi(theta) rounds to one beyond 8.3; the probability of the nearer tail keeps all its digits.
    Both get the law's `shapes`, which broadcast against theta of any shape.

    >>> from_tails(np.array([-9.0, 9.0]), special.ndtri, lambda p: -special.ndtri(p)).tolist()
    [-9.0, 9.0]
    """
    left = theta < 0.0
    x = np.empty(theta.shape)
    own = [np.broadcast_to(shape, theta.shape) for shape in shapes]
    x[left] = below(special.ndtr(theta[left]), *(shape[left] for shape in own))
    x[~left] = above(special.ndtr(-theta[~left]), *(shape[~left] for shape in own))
    return x


@dataclass(frozen=True)
class Tabulated:
    """A smooth function of a standard normal variate by its values and slopes (K,) at the knots.

    Cubic Hermite interpolation: its error is h^4/384 times the fourth derivative, h = 19/(K - 1).

    >>> theta = Tabulated.knots()
    >>> table = Tabulated(np.exp(0.3 * theta), 0.3 * np.exp(0.3 * theta))
    >>> bool(abs(table(np.array([1.234]))[0] - np.exp(0.3 * 1.234)) < 1e-10)
    True
    """

    value: Array
    slope: Array

    @staticmethod
    def knots(count: int = KNOTS) -> Array:
        """(K,) the variates at which a function is tabulated."""
        return np.linspace(-FARTHEST, FARTHEST, count)

    @property
    def finite(self) -> bool:
        """Whether there is a value at every knot."""
        return bool(np.all(np.isfinite(self.value)) and np.all(np.isfinite(self.slope)))

    def __call__(self, theta: Array) -> Array:
        """Values at theta of any shape, none farther out than the last knot."""
        gaps = self.value.size - 1
        width = 2.0 * FARTHEST / gaps
        place = (theta + FARTHEST) / width
        left = np.clip(place.astype(np.intp), 0, gaps - 1)
        t = place - left
        a, b = self.value[left], self.value[left + 1]
        rise, da, db = b - a, width * self.slope[left], width * self.slope[left + 1]
        curve = t * (1.0 - t) * ((1.0 - t) * (da - rise) + t * (rise - db))
        return np.asarray(a + t * rise + curve)


def from_probability(probability: Array, below: Tail, above: Tail) -> Array:
    """F^-1(P) by the tail that is nearer.

    >>> from_probability(np.array([0.25, 0.75]), lambda p: p, lambda p: 1.0 - p).tolist()
    [0.25, 0.75]
    """
    p = np.asarray(probability, dtype=float)
    return np.where(p < 0.5, below(p), above(1.0 - p))


def to_score(below: Array, above: Array) -> Array:
    """Phi^-1(F) from the probabilities F below and 1 - F above, by the tail that is nearer.

    >>> to_score(np.array([0.5, 1.0]), np.array([0.5, special.ndtr(-9.0)])).tolist()
    [0.0, 9.0]
    """
    score: Array = np.where(below <= above, special.ndtri(below), -special.ndtri(above))
    return score


def normal_log_density(theta: Array) -> Array:
    """log phi(theta) of the standard normal law.

    >>> float(normal_log_density(np.array([0.0]))[0].round(6))
    -0.918939
    """
    log_density: Array = -0.5 * theta**2 - 0.5 * np.log(2.0 * np.pi)
    return log_density


def slope(theta: Array, log_density: Array) -> Array:
    """dx/dtheta = phi(theta)/f(x) (J,) from log f(x); zero where the density is infinite.

    >>> x = np.array([-1.0, 2.0])
    >>> slope(x, -0.5 * x**2 - 0.5 * np.log(2.0 * np.pi)).tolist()
    [1.0, 1.0]
    """
    dtheta: Array = np.exp(normal_log_density(theta) - log_density)
    return dtheta


def difference(
    function: Callable[[Array], Array], at: Array | float, step: Array | float | None = None
) -> Array:
    """Derivative of a function of one number by central differences of fourth order.

    The number may be an array that the function takes elementwise. Without a `step` it is
    positive, and the step 1e-3 of it.

    >>> bool(abs(difference(lambda v: v**5, np.array([2.0]))[0] - 80.0) < 1e-9)
    True
    """
    center = np.asarray(at, dtype=float)
    h = STEP * center if step is None else np.asarray(step)
    near = function(center + h) - function(center - h)
    far = function(center + 2.0 * h) - function(center - 2.0 * h)
    found: Array = (8.0 * near - far) / (12.0 * h)
    return found
