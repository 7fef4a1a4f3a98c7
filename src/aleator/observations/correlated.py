"""Errors that hang together along the observations of an experiment: AR(1), CAR(1), and others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from scipy.linalg.lapack import dtbtrs

from aleator.core.types import Array, Flags, Indices
from aleator.errors import InputsError
from aleator.laws import Free, Hyperparameter, Specification, resolve

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class SerialOrder:
    """The order of the m observations of a response, experiment by experiment.

    All arrays are in serial order. `owner` (m,) is the experiment of each observation, `gap` (m,)
    its distance to the one before, zero for the first of an experiment. `order` (m,) is its place
    among the observations of the response, whose experiments follow each other in the same way.
    """

    owner: Indices
    gap: Array
    order: Indices
    _parts: dict[tuple[int, int], SerialOrder] = field(default_factory=dict, repr=False)
    _kept: dict[bytes, Any] = field(default_factory=dict, repr=False)
    _shared: dict[bytes, Any] = field(default_factory=dict, repr=False)

    def kept(self, key: bytes, make: Callable[[], T]) -> T:
        """What `make` returned for the same key in the last call, or else returns now."""
        return _remembered(self._kept, 1, key, make)

    def shared(self, key: bytes, make: Callable[[], T]) -> T:
        """What `make` returned for one of the last keys, in any part of the whole order."""
        return _remembered(self._shared, 64, key, make)

    def part(self, which: slice) -> SerialOrder:
        """The order of the observations `which` of whole experiments; cached."""
        key = (which.start, which.stop)
        if key == (0, self.owner.size):
            return self
        if key not in self._parts:
            order = self.order[which] - which.start
            own = self.owner[which], self.gap[which], order
            self._parts[key] = SerialOrder(*own, _shared=self._shared)
        return self._parts[key]

    def cut(self, first: int, blocks: Sequence[slice]) -> list[slice]:
        """Blocks of observations from number `first` on, with their ends moved back.

        They become the beginnings of experiments. Blocks within one experiment are joined.
        """
        if not blocks:
            return []
        ends = self.starts[
            np.searchsorted(self.starts, [first + b.stop for b in blocks[:-1]], side="right") - 1
        ]
        every = np.unique([0, *(ends - first).clip(0), blocks[-1].stop])
        return [slice(int(a), int(b)) for a, b in pairwise(every)]

    def take(self, values: Array) -> Array:
        """Values (m, ...) of the observations in serial order."""
        return values if self.straight else values[self.order]

    def back(self, values: Array) -> Array:
        """Values (m, ...) in serial order, brought into that of the observations."""
        if self.straight:
            return values
        found = np.empty_like(values)
        found[self.order] = values
        return found

    @cached_property
    def straight(self) -> bool:
        """Whether this is the order of the observations themselves."""
        return bool(np.array_equal(self.order, np.arange(self.order.size)))

    @cached_property
    def first(self) -> Flags:
        """Whether each observation is the first of its experiment (m, 1)."""
        return np.asarray(np.diff(self.owner, prepend=-1)[:, None] != 0)

    @cached_property
    def starts(self) -> Indices:
        """The place of the first observation of each experiment."""
        return np.flatnonzero(self.first[:, 0])

    @cached_property
    def sizes(self) -> Indices:
        """The number of observations of each experiment."""
        return np.diff(self.starts, append=self.owner.size)

    @cached_property
    def before(self) -> Indices:
        """The number of earlier observations of the experiment (m, 1)."""
        return (np.arange(self.owner.size) - np.repeat(self.starts, self.sizes))[:, None]

    @cached_property
    def alike(self) -> tuple[Indices, ...]:
        """The rows (B, n) of B experiments with the same n gaps, for each such pattern of gaps."""
        found = dict[bytes, list[Indices]]()
        for start, count in zip(self.starts, self.sizes, strict=True):
            rows = np.arange(start, start + count)
            found.setdefault(self.gap[rows].tobytes(), []).append(rows)
        return tuple(np.array(rows) for rows in found.values())

    def totals(self, values: Array) -> Array:
        """The sum of values (m, J) over the experiment, at each of its observations (m, J)."""
        return np.repeat(np.add.reduceat(values, self.starts, axis=0), self.sizes, axis=0)


class Derivatives(NamedTuple):
    """Derivatives of the log-density of errors u (m, J) of scale one with correlations R.

    `solved` is R^-1 u, minus the derivative by u. `by_scale` is the derivative of the log-density
    of the errors themselves by the logarithm of each scale. The sums of `by_values` over an
    experiment are the derivatives by the hyperparameters of the correlation. All are (m, J).
    """

    solved: Array
    by_scale: Array
    by_values: tuple[Array, ...]


class Whitening(Protocol):
    """The factor L of the correlations R = L L' of errors u (m, J), in serial order.

    Each error is normal given the earlier ones of its experiment, with the mean `expected` and the
    standard deviation `root` (m, 1) or (m, J), the diagonal of L.
    """

    @property
    def root(self) -> Array:
        """The standard deviation of each error given the earlier ones."""

    def expected(self, u: Array) -> Array:
        """The mean of each error given the earlier ones, a linear function of these."""

    def solved(self, u: Array) -> Array:
        """R^-1 u, minus the derivative of the log-density by u."""

    def derivatives(self, u: Array) -> Derivatives:
        """The derivatives of the log-density of errors u by all that it depends on."""

    def drawn(self, z: Array) -> Array:
        """Errors L z from independent standard normal variates z."""


class ErrorCorrelation(Protocol):
    """A model of how the errors of one response within an experiment hang together.

    The hyperparameters are named without the prefix `noise.`. A new model is a class with the
    members of this protocol.
    """

    @property
    def along(self) -> str | None:
        """The column along which errors hang together; None for the order of the rows."""

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters, known or free."""

    def fault(self, gaps: Array) -> tuple[int, str, str] | None:
        """The first of the gaps between neighbours that is not admissible, with problem, remedy."""

    def marginal(self, values: Sequence[float], scale: Array) -> Array:
        """The standard deviation of each single error, where the noise has the given scale."""

    def whitening(self, values: Sequence[float], serial: SerialOrder, scale: Array) -> Whitening:
        """The factor of the correlations of errors that are divided by their scale.

        `scale` is (m, 1) or (m, J), in serial order.
        """


class WholeScale:
    """Errors of which each one alone has the scale of the noise."""

    def marginal(self, values: Sequence[float], scale: Array) -> Array:  # noqa: ARG002
        """The standard deviation of each single error: the scale itself."""
        return scale


def _remembered(known: dict[bytes, Any], most: int, key: bytes, make: Callable[[], T]) -> T:
    """The value of a key, made if it is not known; all are forgotten where there are too many."""
    if key not in known:
        if len(known) >= most:
            known.clear()
        known[key] = make()
    found: T = known[key]
    return found


def recurrence(factor: Array, values: Array) -> Array:
    """x (m, J) with x_k = factor_k x_(k-1) + values_k, for factors (m, 1); linear in m.

    >>> recurrence(np.array([[0.0], [0.5]]), np.array([[1.0], [2.0]])).tolist()
    [[1.0], [2.5]]
    """
    bands = np.ones((2, len(factor)))
    bands[1, :-1] = -factor[1:, 0]
    return np.asarray(dtbtrs(bands, values, uplo="L", diag="U")[0])


def _earlier(values: Array) -> Array:
    """Values (m, J) moved down by one row, with zeros at the beginning."""
    return np.concatenate([np.zeros((1, values.shape[1])), values[:-1]])


@dataclass(frozen=True, eq=False)
class MarkovWhitening:
    """Errors that depend on the one before: u_k = factor_k u_(k-1) + root_k z_k.

    `factor` and `root` are (m, 1), with root^2 = 1 - factor^2; the factor of the first error of an
    experiment is zero. `slopes` are the derivatives (m, 1) of the factors by the hyperparameters.
    """

    factor: Array
    root: Array
    slopes: tuple[Array, ...]

    def expected(self, u: Array) -> Array:
        """The factor times the error before."""
        return self.factor * _earlier(u)

    def solved(self, u: Array) -> Array:
        """R^-1 u, each from an error and its two neighbours."""
        pull = (u - self.factor * _earlier(u)) / self.root**2
        pull[:-1] -= self.factor[1:] * pull[1:]
        return pull

    def derivatives(self, u: Array) -> Derivatives:
        """The derivatives, each from an error and its two neighbours."""
        before = _earlier(u)
        pull = (u - self.factor * before) / self.root**2
        by_factor = self.factor / self.root**2 + pull * (before - self.factor * pull)
        solved = self.solved(u)
        return Derivatives(solved, u * solved - 1.0, tuple(by_factor * s for s in self.slopes))

    def drawn(self, z: Array) -> Array:
        """Errors that continue the one before."""
        return recurrence(self.factor, self.root * z)


_RHO = Free(-0.99, 0.99)
_SHARE = Free(0.0, 0.99)


@dataclass(frozen=True)
class AR1(WholeScale):
    """Errors that follow the one before: corr(e_j, e_k) = rho^|t_j - t_k| at whole numbers t.

    It is the autoregressive process of order one (Box, Jenkins and Reinsel, 1994), `corAR1` of
    nlme. `rho`, the hyperparameter `noise.rho`, is a number or `Free(lower, upper)` within (-1, 1),
    by default between -0.99 and 0.99. `along` names a column of whole numbers; left out, the
    measured values of an experiment follow each other in the order of the rows, one step each.
    Raises InputsError for a rho that is not within (-1, 1).

    >>> AR1().hyperparameters[0].name, AR1(0.5, along="day").along
    ('rho', 'day')
    """

    rho: Specification = _RHO
    along: str | None = None

    def __post_init__(self) -> None:
        """Check rho; InputsError if not valid."""
        _within(self.hyperparameters[0], -1.0)

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The correlation of neighbours."""
        return (resolve("rho", self.rho, (_RHO.lower, _RHO.upper)),)

    def fault(self, gaps: Array) -> tuple[int, str, str] | None:
        """Steps must be whole numbers above zero."""
        bad = np.flatnonzero((gaps <= 0.0) | (gaps != np.round(gaps)))
        if not bad.size:
            return None
        k = int(bad[0])
        if gaps[k] == 0.0:
            return k, *_TWICE
        return (
            k,
            f"the step from the value before is {gaps[k]:g}, and that of AR(1) is a whole number",
            'take the kind "car1", whose steps are any numbers (CAR1 in Python), or leave out '
            "`along`",
        )

    def whitening(
        self,
        values: Sequence[float],
        serial: SerialOrder,
        scale: Array,  # noqa: ARG002
    ) -> MarkovWhitening:
        """The factors rho^step."""
        rho, steps = float(values[0]), serial.gap[:, None]
        factor = np.where(serial.first, 0.0, rho**steps)
        slope = np.where(serial.first, 0.0, steps * rho ** np.maximum(steps - 1.0, 0.0))
        return MarkovWhitening(factor, np.sqrt(1.0 - factor**2), (slope,))


@dataclass(frozen=True)
class CAR1(WholeScale):
    """Errors that fade along a column t: corr(e_j, e_k) = exp(-|t_j - t_k|/length).

    It is the continuous autoregressive process of order one (Jones, 1993), the exponential
    correlation `corExp` of nlme, and `corCAR1` with phi = exp(-1/length). `length`, the
    hyperparameter `noise.length`, is a number or `Free(lower, upper)` in the unit of the column
    `along`; both limits are needed. Raises InputsError for limits that are missing or not positive.

    >>> CAR1("time", 2.0).hyperparameters[0].name
    'length'
    """

    along: str
    length: Specification

    def __post_init__(self) -> None:
        """Check the length; InputsError if not valid."""
        _ = self.hyperparameters

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The length over which the correlation falls to 1/e."""
        return (resolve("length", self.length, (None, None), positive=True),)

    def fault(self, gaps: Array) -> tuple[int, str, str] | None:
        """No two values may be at the same place: their errors would be equal."""
        bad = np.flatnonzero(gaps <= 0.0)
        return (int(bad[0]), *_TWICE) if bad.size else None

    def whitening(
        self,
        values: Sequence[float],
        serial: SerialOrder,
        scale: Array,  # noqa: ARG002
    ) -> MarkovWhitening:
        """The factors exp(-gap/length)."""
        away = np.where(serial.first, np.inf, serial.gap[:, None] / float(values[0]))
        factor = np.exp(-away)
        slope = factor * np.where(serial.first, 0.0, away) / float(values[0])
        return MarkovWhitening(factor, np.sqrt(-np.expm1(-2.0 * away)), (slope,))


_TWICE = (
    "another value of the experiment stands at the same place of the column, and their errors "
    "would have to be equal",
    'take the kind "gaussian_process", which has an independent error as well, or keep one of the '
    "two values",
)


@dataclass(frozen=True)
class CompoundSymmetry(WholeScale):
    """Errors of an experiment that are all alike: corr(e_j, e_k) = rho for any two of them.

    It is `corCompSymm` of nlme: an error of variance rho scale^2 that is common to the experiment,
    beside independent ones. `rho`, the hyperparameter `noise.rho`, is a number or
    `Free(lower, upper)` within [0, 1), by default between 0 and 0.99. Raises InputsError for other
    values. A parameter that moves all values of an experiment alike has the same effect as rho, and
    is not told apart from it.

    >>> CompoundSymmetry(0.3).hyperparameters[0].start
    0.3
    """

    rho: Specification = _SHARE

    along = None

    def __post_init__(self) -> None:
        """Check rho; InputsError if not valid."""
        _within(self.hyperparameters[0], 0.0)

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The correlation of any two errors of an experiment."""
        return (resolve("rho", self.rho, (_SHARE.lower, _SHARE.upper)),)

    def fault(self, gaps: Array) -> tuple[int, str, str] | None:  # noqa: ARG002
        """Any gaps are admissible."""
        return None

    def whitening(
        self,
        values: Sequence[float],
        serial: SerialOrder,
        scale: Array,  # noqa: ARG002
    ) -> SymmetricWhitening:
        """The factor of the matrix with ones on the diagonal and rho elsewhere."""
        return SymmetricWhitening(float(values[0]), serial)


@dataclass(frozen=True, eq=False)
class SymmetricWhitening:
    """Correlations rho of any two errors of an experiment."""

    rho: float
    serial: SerialOrder

    @cached_property
    def root(self) -> Array:
        """sqrt(1 - n rho c) after n errors, with the weight c = rho/(1 + (n - 1) rho) of each."""
        return np.sqrt(1.0 - self.serial.before * self.rho * self._weight)

    def expected(self, u: Array) -> Array:
        """The weighted sum of the earlier errors."""
        running = recurrence(np.where(self.serial.first, 0.0, 1.0), u)
        return self._weight * (running - u)

    def solved(self, u: Array) -> Array:
        """R^-1 u in closed form (Sherman and Morrison, 1950)."""
        return np.asarray((u - self.rho * self._share * self.serial.totals(u)) / (1.0 - self.rho))

    def derivatives(self, u: Array) -> Derivatives:
        """The derivatives in closed form."""
        share, solved = self._share, self.solved(u)
        diagonal = (1.0 - self.rho * share) / (1.0 - self.rho)
        others = self.serial.totals(solved) - solved
        by_rho = 0.5 * (solved * others - (share - diagonal))
        return Derivatives(solved, u * solved - 1.0, (by_rho,))

    def drawn(self, z: Array) -> Array:
        """Errors from their running sum, which is a recurrence of order one."""
        factor = np.where(self.serial.first, 0.0, 1.0 + self._weight)
        own = self.root * z
        running = recurrence(factor, own)
        return own + self._weight * np.where(self.serial.first, 0.0, _earlier(running))

    @cached_property
    def _share(self) -> Array:
        """The sums (m, 1) of the rows of R^-1, 1/(1 + (n - 1) rho) for n errors."""
        count = np.repeat(self.serial.sizes, self.serial.sizes)[:, None]
        return np.asarray(1.0 / (1.0 + (count - 1.0) * self.rho))

    @cached_property
    def _weight(self) -> Array:
        return np.asarray(self.rho / (1.0 + (self.serial.before - 1.0) * self.rho))


def _within(rho: Hyperparameter, least: float) -> None:
    """Raise InputsError for a correlation outside [least, 1), or outside (-1, 1)."""
    low = rho.lower > least if least < 0.0 else rho.lower >= least
    if not (low and rho.upper < 1.0):
        interval = "(-1, 1)" if least < 0.0 else "[0, 1)"
        said = f"{rho.lower:g}" if not rho.free else f"between {rho.lower:g} and {rho.upper:g}"
        raise InputsError(f"rho is {said}", f"let it lie within {interval}")
