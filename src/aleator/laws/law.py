"""The interface of a marginal law, and helpers that map a standard normal variate to a law."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy import special

from aleator.core.polynomials import gauss_hermite, hermite_recurrence
from aleator.core.types import Array
from aleator.errors import InputsError, naming, require_filled
from aleator.laws.hyperparameter import (
    Free,
    Hyperparameter,
    Specification,
    filled,
    location_and_scale,
)


@dataclass(frozen=True)
class Numerics:
    """Settings for the accuracy with which laws are computed; chosen by tests/laws.

    sds: the range assumed for a normal law extends this many standard deviations beyond the limits
    of its mean (by judgement; a probability of 1e-15 is beyond). tail: the probability beyond the
    range assumed for any other law without an end. step: relative step of numerical derivatives,
    whose error is of the order of its fourth power. farthest, knots: the table of a quantile
    function has this number of `knots`, at standard normal variates from -farthest to farthest.
    worth: a table is made for at least this many values of one law, because it costs some thousand
    quantiles (`make bench`). passes: the largest number of iterations of `invert`. rounding:
    `invert` ends where its bracket or its step, relative to the largest end of the bracket, is
    below this.
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

    `x` (q,) are the nodes, and `weights` (q,) sum to one. `t` (q,) are the nodes in the variable of
    the law's orthogonal polynomials. `dx` and `dweights` (q, k) are derivatives by the law's
    hyperparameters; with them the derivative of any weighted sum over the nodes is exact.
    """

    x: Array
    weights: Array
    t: Array
    dx: Array
    dweights: Array


@dataclass(frozen=True)
class Standard:
    """A law as the image x = F^-1(Phi(theta)) of standard normal variates theta of any shape.

    `x` has the shape of theta, and `dtheta`, its derivative by theta, has this shape too. `dvalues`
    (*theta.shape, k) are the derivatives of x by the law's hyperparameters.
    """

    x: Array
    dtheta: Array
    dvalues: Array


@dataclass(frozen=True)
class MeanSd:
    """The mean and standard deviation of a law, with derivatives (k,) by its hyperparameters."""

    mean: float
    sd: float
    dmean: Array
    dsd: Array

    @classmethod
    def of(cls, rule: Rule) -> MeanSd:
        """Mean and sd by a quadrature rule of the law; two nodes are enough to be exact.

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
    """The interface of a marginal law P_X(alpha) of one parameter.

    The argument `values` (k,) of its methods has the values of the law's hyperparameters, in the
    order of `hyperparameters`.
    """

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The law's hyperparameters with their limits, in the order of `values`."""

    @property
    def box(self) -> tuple[float, float]:
        """A finite interval that contains every quadrature node for every admissible alpha."""

    @property
    def bounded(self) -> bool:
        """Whether the user stated the range of the parameter; otherwise `box` is a guess."""

    @property
    def scatters(self) -> bool:
        """Whether the parameter varies between experiments (a constant does not)."""

    def rule(self, values: Array, nodes: int) -> Rule:
        """The Gauss rule of the law with `nodes` nodes (one for a constant)."""

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:
        """The first recurrence coefficients a (count,), b (count,) of the orthonormal polynomials.

        The polynomials are orthonormal under the law, in the variable t of `Rule`; see
        `aleator.core.polynomials`. A constant has one pair, whatever the count.
        """

    def log_density(self, values: Array, x: Array) -> Array:
        """The log-density log f(x) at each x (J,), minus infinity outside the support."""

    def normal_score(self, values: Array, x: Array) -> Array:
        """The normal score Phi^-1(F(x)) at each x (J,), infinite outside the support.

        It is the inverse of `standard`.
        """

    def quantile(self, values: Array, probability: Array) -> Array:
        """The quantile of the law at each probability, which maps uniform numbers to samples."""

    def standard(self, values: Array, theta: Array) -> Standard:
        """The law as the image of standard normal variates of any shape, with derivatives.

        `values` (k,) are the hyperparameters of one law, for every theta. `values` (k, B, 1) are
        those of B laws, one for each experiment, at variates theta (B, J); any rows that broadcast
        against theta are allowed.
        """

    def mean_and_sd(self, values: Array) -> MeanSd:
        """The mean and standard deviation of the law, with derivatives by its hyperparameters."""

    def filling(self, center: float, sd: float | None = None) -> Array:
        """Values (k,) of the hyperparameters that give the law this center and sd.

        Each value is moved into its limits, and fixed ones stay as they are. With `sd` None only
        the location is set, and all other hyperparameters are at their starts.
        """

    def customary(self, values: Array) -> Mapping[str, float]:
        """The quantities, by name, by which the law is usually told and which `values` are not.

        A lognormal law has its median and the sd of the logarithm; many laws have none.
        """


def require_law(value: object, place: str) -> None:
    """Check that a value is a law; InputsError says how the law is written that is meant.

    >>> require_law(0.1, "parameter 'damping'")
    Traceback (most recent call last):
    aleator.errors.InputsError: parameter 'damping': 0.1 is no law
      Remedy: write Constant(0.1) if it is the same in all experiments, or Normal(...)
    """
    if isinstance(value, float | int | Free):
        remedy = f"write Constant({value!r}) if it is the same in all experiments, or Normal(...)"
    elif isinstance(value, tuple | list):
        remedy = f"write TruncatedNormal(box={tuple(value)!r}), or Normal(mean=Free(...), ...)"
    elif hasattr(value, "ppf"):
        name = getattr(getattr(value, "dist", value), "name", type(value).__name__)
        raise InputsError(
            f"{place}: the distribution '{name}' of scipy.stats is no law",
            "write ScipyLaw(scipy.stats.norm(2.0, 0.1)), with arguments of the distribution",
        )
    elif isinstance(value, str):
        remedy = "write it with its limits, as LogNormal(mean=Free(0.1, 2.0), sd=Free(0.01, 1.0))"
    else:
        require_filled(value, Law, place)
        return
    raise InputsError(f"{place}: {value!r:.60} is no law", remedy)


class ThroughNormal:
    """Base class of laws that use Hermite polynomials of the standard normal variate theta.

    Any function of finite variance can be approximated by them, whatever the law (Ernst, Mugler,
    Starkloff and Ullmann, 2012). A rule of q nodes is exact for polynomials of theta, not of x.
    """

    def rule(self, values: Array, nodes: int) -> Rule:
        """The Gauss-Hermite rule in theta, mapped to x; its weights do not depend on alpha."""
        theta, weights = gauss_hermite(nodes)
        image = self.standard(values, theta)
        return Rule(image.x, weights, theta, image.dvalues, np.zeros(image.dvalues.shape))

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:  # noqa: ARG002
        """The recurrence coefficients of the Hermite polynomials of theta."""
        return hermite_recurrence(count)

    @abstractmethod
    def standard(self, values: Array, theta: Array) -> Standard:
        """The law as the image of standard normal variates, with derivatives."""


class ByMeanAndSd:
    """Base class of laws whose two hyperparameters are the law's mean and standard deviation."""

    mean: Specification
    sd: Specification
    scatters = True

    def __post_init__(self) -> None:
        with naming(type(self).__name__):
            _ = self.hyperparameters

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters `mean` and `sd`, which are those of the law itself."""
        return location_and_scale(self.mean, self.sd)

    @property
    def bounded(self) -> bool:
        """False: the user states no range for a law of this kind."""
        return False

    def mean_and_sd(self, values: Array) -> MeanSd:
        """The mean and the sd, which are the two hyperparameters."""
        return MeanSd(float(values[0]), float(values[1]), np.eye(2)[0], np.eye(2)[1])

    def filling(self, center: float, sd: float | None = None) -> Array:
        """The values (mean, sd) equal to the center and the sd, moved into their limits."""
        return filled(self.hyperparameters, center, sd)

    def customary(self, values: Array) -> Mapping[str, float]:  # noqa: ARG002
        """None: mean and sd are the usual quantities."""
        return {}


Tail = Callable[..., Array]
"""A quantile function of probabilities (J,) and of the law's shape parameters, each (J,) too."""


def from_tails(theta: Array, below: Tail, above: Tail, *shapes: Array) -> Array:
    """The quantile x = F^-1(Phi(theta)), computed from the probability of the nearer tail.

    Left of the median x = below(P), right of it x = above(1 - P), with P = Phi(theta). Phi(theta)
    rounds to one beyond 8.3, while the probability of the nearer tail keeps all its digits. `below`
    and `above` also get the law's `shapes`, which broadcast against theta of any shape.

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
    """A table of a smooth function of a standard normal variate: values and slopes at K knots.

    `value` (K,) and `slope` (K,) are interpolated by cubic Hermite polynomials. The error is
    h^4/384 times the fourth derivative, with the distance h = 19/(K - 1) of the knots.

    >>> theta = Tabulated.knots()
    >>> table = Tabulated(np.exp(0.3 * theta), 0.3 * np.exp(0.3 * theta))
    >>> bool(abs(table(np.array([1.234]))[0] - np.exp(0.3 * 1.234)) < 1e-10)
    True
    """

    value: Array
    slope: Array

    @staticmethod
    def knots(count: int = NUMERICS.knots) -> Array:
        """The variates (K,) at which a function is tabulated."""
        return np.linspace(-NUMERICS.farthest, NUMERICS.farthest, count)

    @property
    def finite(self) -> bool:
        """Whether the value and the slope are finite at every knot."""
        return bool(np.all(np.isfinite(self.value)) and np.all(np.isfinite(self.slope)))

    def __call__(self, theta: Array) -> Array:
        """The interpolated values at theta of any shape, which must lie within the knots."""
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
    """The quantile F^-1(P) from the smaller of P and 1 - P: below(P), or above(1 - P).

    >>> from_probability(np.array([0.25, 0.75]), lambda p: p, lambda p: 1.0 - p).tolist()
    [0.25, 0.75]
    """
    p = np.asarray(probability, dtype=float)
    return np.where(p < 0.5, below(p), above(1.0 - p))


def to_score(below: Array, above: Array) -> Array:
    """The normal score Phi^-1(F) from the smaller of the probabilities F below and 1 - F above.

    >>> to_score(np.array([0.5, 1.0]), np.array([0.5, special.ndtr(-9.0)])).tolist()
    [0.0, 9.0]
    """
    return np.asarray(np.where(below <= above, special.ndtri(below), -special.ndtri(above)))


def normal_log_density(theta: Array) -> Array:
    """The log-density log phi(theta) of the standard normal law.

    >>> float(normal_log_density(np.array([0.0]))[0].round(6))
    -0.918939
    """
    return np.asarray(-0.5 * theta**2 - 0.5 * np.log(2.0 * np.pi))


def slope(theta: Array, log_density: Array) -> Array:
    """The slope dx/dtheta = phi(theta)/f(x) (J,) from log f(x); zero where f(x) is infinite.

    >>> x = np.array([-1.0, 2.0])
    >>> slope(x, -0.5 * x**2 - 0.5 * np.log(2.0 * np.pi)).tolist()
    [1.0, 1.0]
    """
    return np.asarray(np.exp(normal_log_density(theta) - log_density))


def difference(
    function: Callable[[Array], Array], at: Array | float, step: Array | float | None = None
) -> Array:
    """The derivative of a function of one number by central differences of fourth order.

    The number `at` may be an array, to which the function is applied elementwise. Without a `step`,
    `at` must be positive, and the step is 1e-3 of it.

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
    """The images of theta under several laws, with one call for each distinct law.

    The columns of `values` (k, ...) are the hyperparameters of the laws and broadcast against
    theta. `of_one(values (k,), theta (M,))` gives the image under one law.

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
    """The quantiles y (N, P) that solve cdf(y) = p (N, P) within brackets [low, high] (N, P).

    Newton's method from `start`, or from the middle of the bracket. The bracket shrinks at every
    iteration, and a step that would leave it is replaced by a bisection. `cdf` and `pdf` take and
    return (N, P). Cost: six iterations for a smooth law, up to 50 where the density is a row of
    spikes.

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
