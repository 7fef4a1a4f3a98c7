"""What a marginal law is, and how one is made of a standard normal variate."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy import special

from aleator.core.polynomials import gauss_hermite, hermite_recurrence
from aleator.core.types import Array
from aleator.laws.hyperparameter import Hyperparameter, Specification, filled, location_and_scale


@dataclass(frozen=True)
class Numerics:
    """How exactly laws are computed; chosen by tests/laws, or by judgement where it says so.

    sds: the box of a normal law ends so many standard deviations from its means (by judgement:
    1e-15 is beyond). tail: the probability beyond the box of another law without an end. step:
    relative step of differences, whose error is of the order of its fourth power. farthest, knots:
    a quantile that is tabulated has so many knots, at standard normal variates up to this size.
    worth: the number of values of one law from which on a table is made, which costs some thousand
    quantiles (`make bench`). passes, rounding: `invert` takes so many passes at most, and ends
    where a bracket or a step is below this share of the largest end of the bracket.
    """

    sds: float = 8.0
    tail: float = 1e-15
    step: float = 1e-3
    farthest: float = 9.5
    knots: int = 761
    worth: int = 256
    passes: int = 100
    rounding: float = 1e-14


NUMERICS = Numerics()


@dataclass(frozen=True)
class Rule:
    """A quadrature rule of q nodes for a law with k hyperparameters.

    `x` (q,) are the nodes, `weights` (q,) sum to one, `t` (q,) are the nodes in the
    variable of the law's polynomials; `dx` and `dweights` (q, k) are the derivatives by the
    law's hyperparameters, so that the derivative of any weighted sum is exact for any q.
    """

    x: Array
    weights: Array
    t: Array
    dx: Array
    dweights: Array


@dataclass(frozen=True)
class Standard:
    """A law as the image x = F^-1(Phi(theta)) of standard normal variates theta of any shape.

    `x` has the shape of theta, and so has its derivative by theta, `dtheta`; `dvalues`
    (*theta.shape, k) are the derivatives by the law's hyperparameters.
    """

    x: Array
    dtheta: Array
    dvalues: Array


@dataclass(frozen=True)
class MeanSd:
    """Mean and standard deviation of a law, with derivatives (k,) by its hyperparameters."""

    mean: float
    sd: float
    dmean: Array
    dsd: Array

    @classmethod
    def of(cls, rule: Rule) -> MeanSd:
        """Mean and sd by a quadrature rule of the law with two nodes or more, which is exact for
        both.

        >>> import numpy as np
        >>> half = np.array([0.5, 0.5])
        >>> zero, one = np.zeros((2, 1)), np.ones((2, 1))
        >>> m = MeanSd.of(Rule(np.array([1.0, 3.0]), half, np.array([-1.0, 1.0]), one, zero))
        >>> m.mean, m.sd, m.dmean.tolist(), m.dsd.tolist()
        (2.0, 1.0, [1.0], [0.0])
        """
        mean = float(rule.weights @ rule.x)
        away = rule.x - mean
        sd = float(rule.weights @ away**2) ** 0.5
        dmean = rule.weights @ rule.dx + away @ rule.dweights
        dvariance = 2.0 * (rule.weights * away) @ rule.dx + away**2 @ rule.dweights
        return cls(mean, sd, dmean, dvariance / (2.0 * sd))


class Law(Protocol):
    """A marginal law P_X(alpha) of one parameter.

    `values` (k,) are its hyperparameters in the order of `hyperparameters`.
    """

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters, resolved and in order."""

    @property
    def box(self) -> tuple[float, float]:
        """Finite interval that holds every node for every admissible alpha."""

    @property
    def bounded(self) -> bool:
        """Whether the user stated the box, rather than the law having to guess one."""

    @property
    def scatters(self) -> bool:
        """Whether the parameter varies between experiments (a constant does not)."""

    def rule(self, values: Array, nodes: int) -> Rule:
        """The Gauss rule of the law with `nodes` nodes (one for a constant)."""

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:
        """The first coefficients a (count,), b (count,) of the law's orthonormal polynomials.

        They belong to the variable t of `Rule`; see `aleator.core.polynomials`. A constant
        has one pair, whatever the count.
        """

    def log_density(self, values: Array, x: Array) -> Array:
        """log f(x) at each x (J,), minus infinity outside the support."""

    def normal_score(self, values: Array, x: Array) -> Array:
        """theta = Phi^-1(F(x)) at each x (J,), the inverse of `standard`; infinite outside."""

    def quantile(self, values: Array, probability: Array) -> Array:
        """The quantile of the law at each probability; maps uniform samples to the law."""

    def standard(self, values: Array, theta: Array) -> Standard:
        """The law as the image of standard normal variates of any shape, with derivatives.

        `values` are (k,), one law for every theta, or (k, ...) with rows that broadcast against
        theta: laws (k, B, 1) of B experiments for theta (B, J).
        """

    def mean_and_sd(self, values: Array) -> MeanSd:
        """Mean and standard deviation of the law, with derivatives by its hyperparameters."""

    def filling(self, center: float, sd: float | None = None) -> Array:
        """Hyperparameters (k,) of the law of this family with this center and sd.

        They are cut to their limits, and fixed ones keep their values. With `sd` None only the
        location is set; the others are at their starts.
        """


class ThroughNormal:
    """Base of laws whose polynomials are the Hermite polynomials of the standard normal variate
    theta.

    Hermite polynomials of theta are dense whatever the law (Ernst, Mugler, Starkloff and Ullmann,
    2012). A rule of q nodes is exact for polynomials of theta, not of x.
    """

    def rule(self, values: Array, nodes: int) -> Rule:
        """Gauss-Hermite nodes of theta; the weights do not depend on alpha."""
        theta, weights = gauss_hermite(nodes)
        image = self.standard(values, theta)
        return Rule(image.x, weights, theta, image.dvalues, np.zeros(image.dvalues.shape))

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:  # noqa: ARG002
        """Hermite polynomials of theta."""
        return hermite_recurrence(count)

    @abstractmethod
    def standard(self, values: Array, theta: Array) -> Standard:
        """The law as the image of standard normal variates, with derivatives."""


class ByMeanAndSd:
    """Base of laws whose two hyperparameters are their own mean and standard deviation."""

    mean: Specification
    sd: Specification
    scatters = True

    def __post_init__(self) -> None:
        _ = self.hyperparameters

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """`mean` and `sd` of the law itself."""
        return location_and_scale(self.mean, self.sd)

    @property
    def bounded(self) -> bool:
        """The law has no box of its own."""
        return False

    def mean_and_sd(self, values: Array) -> MeanSd:
        """The two hyperparameters."""
        return MeanSd(float(values[0]), float(values[1]), np.eye(2)[0], np.eye(2)[1])

    def filling(self, center: float, sd: float | None = None) -> Array:
        """The center and the sd, within their limits."""
        return filled(self.hyperparameters, center, sd)


Tail = Callable[..., Array]
"""A quantile function of probabilities (J,) and of the law's shapes, each one number or (J,)."""


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
    def knots(count: int = NUMERICS.knots) -> Array:
        """(K,) the variates at which a function is tabulated."""
        return np.linspace(-NUMERICS.farthest, NUMERICS.farthest, count)

    @property
    def finite(self) -> bool:
        """Whether there is a value at every knot."""
        return bool(np.all(np.isfinite(self.value)) and np.all(np.isfinite(self.slope)))

    def __call__(self, theta: Array) -> Array:
        """Values at theta of any shape, none farther out than the last knot."""
        gaps = self.value.size - 1
        width = 2.0 * NUMERICS.farthest / gaps
        place = (theta + NUMERICS.farthest) / width
        left = np.clip(place.astype(np.intp), 0, gaps - 1)
        t = place - left
        a, b = self.value[left], self.value[left + 1]
        rise, da, db = b - a, width * self.slope[left], width * self.slope[left + 1]
        curve = t * (1.0 - t) * ((1.0 - t) * (da - rise) + t * (rise - db))
        return np.asarray(a + t * rise + curve)


def from_probability(probability: Array, below: Tail, above: Tail) -> Array:
    """F^-1(P), from the smaller of P and 1 - P.

    >>> from_probability(np.array([0.25, 0.75]), lambda p: p, lambda p: 1.0 - p).tolist()
    [0.25, 0.75]
    """
    p = np.asarray(probability, dtype=float)
    return np.where(p < 0.5, below(p), above(1.0 - p))


def to_score(below: Array, above: Array) -> Array:
    """Phi^-1(F) from the probabilities F below and 1 - F above, by the smaller of the two.

    >>> to_score(np.array([0.5, 1.0]), np.array([0.5, special.ndtr(-9.0)])).tolist()
    [0.0, 9.0]
    """
    return np.asarray(np.where(below <= above, special.ndtri(below), -special.ndtri(above)))


def normal_log_density(theta: Array) -> Array:
    """log phi(theta) of the standard normal law.

    >>> float(normal_log_density(np.array([0.0]))[0].round(6))
    -0.918939
    """
    return np.asarray(-0.5 * theta**2 - 0.5 * np.log(2.0 * np.pi))


def slope(theta: Array, log_density: Array) -> Array:
    """dx/dtheta = phi(theta)/f(x) (J,) from log f(x); zero where the density is infinite.

    >>> x = np.array([-1.0, 2.0])
    >>> slope(x, -0.5 * x**2 - 0.5 * np.log(2.0 * np.pi)).tolist()
    [1.0, 1.0]
    """
    return np.asarray(np.exp(normal_log_density(theta) - log_density))


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
    h = NUMERICS.step * center if step is None else np.asarray(step)
    near = function(center + h) - function(center - h)
    far = function(center + 2.0 * h) - function(center - 2.0 * h)
    return np.asarray((8.0 * near - far) / (12.0 * h))


def by_distinct(
    of_one: Callable[[Array, Array], Standard], values: Array, theta: Array
) -> Standard:
    """The images of theta under laws whose values (k, ...) broadcast against theta.

    `of_one(values (k,), theta (M,))` is the image under one law. It is called once for each
    distinct column of values, so that the cost is that of as many laws.

    >>> def shifted(values, theta):
    ...     return Standard(values[0] + theta, np.ones(theta.shape), np.ones((theta.size, 1)))
    >>> values = np.array([[[1.0], [2.0], [1.0]]])                           # k = 1, B = 3, J = 1
    >>> by_distinct(shifted, values, np.zeros((3, 2))).x.tolist()
    [[1.0, 1.0], [2.0, 2.0], [1.0, 1.0]]
    """
    k = values.shape[0]
    distinct, which = np.unique(values.reshape(k, -1), axis=1, return_inverse=True)
    owner = np.broadcast_to(which.reshape(values.shape[1:]), theta.shape).ravel()
    order = np.argsort(owner, kind="stable")
    ends = np.cumsum(np.bincount(owner, minlength=distinct.shape[1]))[:-1]
    flat = theta.ravel()
    x, dtheta, dvalues = np.empty(flat.size), np.empty(flat.size), np.empty((flat.size, k))
    for column, part in zip(distinct.T, np.split(order, ends), strict=True):
        own = of_one(column, flat[part])
        x[part], dtheta[part], dvalues[part] = own.x, own.dtheta, own.dvalues
    shape = theta.shape
    return Standard(x.reshape(shape), dtheta.reshape(shape), dvalues.reshape(*shape, k))


def invert(
    cdf: Callable[[Array], Array],
    pdf: Callable[[Array], Array],
    p: Array,
    low: Array,
    high: Array,
    start: Array | None = None,
) -> Array:
    """y (N, P) with cdf(y) = p (N, P), known to lie in [low, high] (N, P); sought from `start`.

    Newton's method kept in a bracket that shrinks at every pass, with a bisection where it would
    leave the bracket. `cdf` and `pdf` take and return (N, P). Cost: six passes for a smooth law,
    up to 50 where the density is a row of spikes.

    >>> from scipy.special import ndtr
    >>> at = np.array([[0.975]])
    >>> normal = lambda y: np.exp(-0.5 * y**2) / np.sqrt(2.0 * np.pi)
    >>> float(invert(ndtr, normal, at, at - 9.0, at + 9.0)[0, 0])
    1.959964
    """
    low, high = low.astype(float), high.astype(float)
    scale = np.maximum(np.abs(low), np.abs(high))
    y = 0.5 * (low + high) if start is None else start
    for _ in range(NUMERICS.passes):
        excess = cdf(y) - p
        low, high = np.where(excess <= 0.0, y, low), np.where(excess >= 0.0, y, high)
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            newton = y - excess / pdf(y)
        inside = (newton >= low) & (newton <= high)
        moved = np.where(inside, newton, 0.5 * (low + high))
        arrived = (np.abs(moved - y) <= NUMERICS.rounding * scale) | (
            high - low <= NUMERICS.rounding * scale
        )
        y = moved
        if arrived.all():
            break
    return y
