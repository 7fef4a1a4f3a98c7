"""A Gaussian process along a column beside independent errors, in a time linear in the rows.

A process with Matern's correlation of smoothness p - 1/2 is the first of p components of a Markov
process. So the errors given the earlier ones follow from the Kalman filter (Hartikainen and
Sarkka, 2010), and the derivatives from its adjoint recursions (de Jong, 1989; Koopman and Shephard,
1992). Many short experiments at the same places share the Cholesky factor of one matrix instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from math import comb, factorial

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.linalg.lapack import dtbtrs

from aleator.core.types import Array, Indices
from aleator.errors import InputsError
from aleator.laws import Hyperparameter, Specification, resolve
from aleator.laws.hyperparameter import LIMITS
from aleator.observations.correlated import Derivatives, SerialOrder, Whitening


@dataclass(frozen=True)
class DenseSettings:
    """Which experiments at the same places share dense matrices in place of the Kalman filter.

    The values are chosen by 500 curves of 100 values (docs/evidence.md).
    """

    values: int = 200
    """The largest number n of values of an experiment. A product with a matrix costs n operations
    for each error: 6 ns for 100 values, where the filter takes 150."""
    condition: float = 1e8
    """The largest number of values times the variance of the process over that of the independent
    error, which bounds the condition of the matrix: half of the digits are left."""
    shared: int = 2
    """The smallest mean number of experiments that share a matrix; by judgement."""


DENSE = DenseSettings()
STATIONARY = (
    np.eye(1),
    np.eye(2),
    np.array([[1.0, 0.0, -1.0 / 3.0], [0.0, 1.0 / 3.0, 0.0], [-1.0 / 3.0, 0.0, 1.0]]),
)
"""The covariance of the process and its derivatives by tau = sqrt(2 nu) t/length, p = 1 to 3."""


@dataclass(frozen=True)
class GaussianProcess:
    """An error that is a smooth function of a column t, beside the independent error of the noise.

    It is the discrepancy of Kennedy and O'Hagan (2001), one function for each experiment:
    y_k = eta_k + g(t_k) + e_k, with Cov(g(t), g(t')) = sd^2 M(|t - t'|/length), where M is Matern's
    correlation (Rasmussen and Williams, 2006, section 4.2.1) of `smoothness` 0.5, 1.5 or 2.5:
    exp(-r), (1 + a) exp(-a) with a = sqrt(3) r, (1 + b + b^2/3) exp(-b) with b = sqrt(5) r. e_k has
    the scale that the noise says. `sd` and `length`, the hyperparameters `noise.process_sd` in the
    unit of the response and `noise.length` in that of the column `along`, are numbers or
    `Free(lower, upper)`; both limits are needed, and a lower limit of the sd may be zero.

    Raises InputsError for limits that are missing or not positive, and for another smoothness.
    Cost: linear in the observations; more where the scale of e_k depends on eta. Where sd is zero,
    the length is not determined.

    >>> process = GaussianProcess("time", sd=0.1, length=2.0)
    >>> [h.name for h in process.hyperparameters]
    ['process_sd', 'length']
    """

    along: str
    sd: Specification
    length: Specification
    smoothness: float = 1.5

    def __post_init__(self) -> None:
        """Check the arguments; InputsError if they are not valid."""
        if self.smoothness not in (0.5, 1.5, 2.5):
            raise InputsError(f"smoothness = {self.smoothness!r}", "it is 0.5, 1.5 or 2.5")
        _ = self.hyperparameters

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The standard deviation and the length of the process."""
        return (
            resolve("process_sd", self.sd, (None, None), positive=True, least=LIMITS.zero),
            resolve("length", self.length, (None, None), positive=True),
        )

    def fault(self, gaps: Array) -> tuple[int, str, str] | None:  # noqa: ARG002
        """Any gaps are admissible; values at the same place share the process."""
        return None

    def marginal(self, values: Sequence[float], scale: Array) -> Array:
        """The standard deviation of the process and the independent error together."""
        return np.hypot(scale, float(values[0]))

    def whitening(self, values: Sequence[float], serial: SerialOrder, scale: Array) -> Whitening:
        """Matrices or the Kalman filter, kept for the next call with the same values."""
        (sd, length), states = map(float, values), round(self.smoothness + 0.5)
        key = np.array([sd, length, states]).tobytes() + np.ascontiguousarray(scale).tobytes()
        load = sd / scale
        if _is_dense(serial, load):
            own = float(load[0, 0])
            return serial.kept(key, lambda: AlikeErrors.of(serial, sd, length, own, states))
        return serial.kept(key, lambda: FilteredErrors.of(serial, sd, length, load, states))


def _is_dense(serial: SerialOrder, load: Array, settings: DenseSettings = DENSE) -> bool:
    """Whether many short experiments have the same places and one load, so that matrices serve."""
    if load.shape[1] > 1 or not load.size or np.ptp(load) > 0.0:
        return False
    longest = int(serial.sizes.max())
    if longest > settings.values or longest * load[0, 0] ** 2 > settings.condition:
        return False
    return len(serial.alike) <= len(serial.sizes) // settings.shared


@dataclass(frozen=True, eq=False)
class DenseErrors:
    """The matrices (n, n) of errors u = load f + z at the same n places, with equal load.

    R = 1 + load^2 M = L L' has Matern's correlations M. `root` (n, 1) is the diagonal of L,
    `before` gives the expectation of each error given the earlier ones, `inverse` is R^-1, and
    `by_length` the derivative of R by the length of the process.
    """

    root: Array
    factor: Array
    before: Array
    inverse: Array
    by_length: Array

    @classmethod
    def of(cls, gap: Array, length: float, load: float, p: int) -> DenseErrors:
        """The matrices of a process of p states at places with these gaps (n,)."""
        place, scale = np.cumsum(gap), np.sqrt(2.0 * p - 1.0) / length
        away = scale * np.abs(np.subtract.outer(place, place))
        value, slope = _matern(away, p)
        one = np.eye(len(gap))
        factor: Array = cholesky(one + load**2 * value, lower=True)
        whitened: Array = solve_triangular(factor, one, lower=True)
        root = np.diag(factor)[:, None]
        by_length = -(load**2) / length * away * slope
        return cls(root, factor, one - root * whitened, whitened.T @ whitened, by_length)


def _matern(away: Array, p: int) -> tuple[Array, Array]:
    """Matern's correlation of p states at distances tau = sqrt(2 p - 1) r, and its slope by tau."""
    fading = np.exp(-away)
    if p == 1:
        return fading, -fading
    if p == 2:
        return (1.0 + away) * fading, -away * fading
    return (1.0 + away + away**2 / 3.0) * fading, -(away + away**2) / 3.0 * fading


@dataclass(frozen=True, eq=False)
class AlikeErrors:
    """Errors of experiments at the same places of the column, of equal scale.

    Each pattern of n places has the matrices of one experiment, which serve all B experiments, in
    rows (B, n). `sd` is that of the process.
    """

    parts: tuple[tuple[DenseErrors, Indices], ...]
    sd: float
    size: int

    @classmethod
    def of(cls, serial: SerialOrder, sd: float, length: float, load: float, p: int) -> AlikeErrors:
        """The matrices of all patterns, for an equal load."""
        parts = []
        for rows in serial.alike:
            gap = serial.gap[rows[0]]
            key = np.array([length, load, p, *gap]).tobytes()
            parts.append((serial.shared(key, partial(DenseErrors.of, gap, length, load, p)), rows))
        return cls(tuple(parts), sd, len(serial.gap))

    @cached_property
    def root(self) -> Array:
        """The standard deviation (m, 1) of each error given the earlier ones."""
        return self._column(lambda part: part.root[:, 0])

    def expected(self, u: Array) -> Array:
        """The expected process of each experiment."""
        return self._times(lambda part: part.before, u)

    def solved(self, u: Array) -> Array:
        """R^-1 u of each experiment."""
        return self._times(lambda part: part.inverse, u)

    def drawn(self, z: Array) -> Array:
        """Errors of each experiment."""
        return self._times(lambda part: part.factor, z)

    def derivatives(self, u: Array) -> Derivatives:
        """The derivatives by v = R^-1 u: by R they are (v v' - R^-1)/2."""
        solved = self.solved(u)
        by_length = solved * self._times(lambda part: part.by_length, solved)
        by_length -= self._column(lambda part: np.sum(part.inverse * part.by_length, axis=1))
        inverse = self._column(lambda part: np.diag(part.inverse))
        by_sd = (solved * (u - solved) - (1.0 - inverse)) / self.sd
        return Derivatives(solved, solved**2 - inverse, (by_sd, 0.5 * by_length))

    def _times(self, matrix: Callable[[DenseErrors], Array], u: Array) -> Array:
        if len(self.parts) == 1:
            # The rows of a single pattern are all rows in their order.
            part, rows = self.parts[0]
            return (matrix(part) @ u.reshape(*rows.shape, -1)).reshape(u.shape)
        found = np.empty(u.shape)
        for part, rows in self.parts:
            found[rows] = matrix(part) @ u[rows]
        return found

    def _column(self, values: Callable[[DenseErrors], Array]) -> Array:
        found = np.empty((self.size, 1))
        for part, rows in self.parts:
            found[rows, 0] = values(part)
        return found


@dataclass(frozen=True, eq=False)
class FilteredErrors:
    """The Kalman filter of errors u = load f + z, with a process f and z standard normal.

    There are m errors in serial order, p states, and C columns of loads `load` (C, m): one,
    or as many as columns of errors. `steps` (m,) are the distances tau between neighbours, and
    `drift` (m, p, p) moves the state by them, zero where an experiment begins. `offset`
    (C, m, p, p) is the predicted covariance of the state less the stationary one, `variance`
    (C, m) that of each error given the earlier ones, and `gain` (C, m, p) what an error adds to the
    expected state. From the row `settled` on, which may be m, the filter is the same.
    """

    serial: SerialOrder
    sd: float
    length: float
    load: Array
    steps: Array
    drift: Array
    offset: Array
    variance: Array
    gain: Array
    settled: int

    @classmethod
    def of(
        cls, serial: SerialOrder, sd: float, length: float, load: Array, p: int
    ) -> FilteredErrors:
        """The filter of a process of p states, for loads (m, C).

        It is a loop over the places of the longest experiment, which ends where the filter of a
        single one with equal gaps is steady.
        """
        steps = np.where(serial.first[:, 0], 0.0, np.sqrt(2.0 * p - 1.0) * serial.gap / length)
        drift, whole = _drifts(steps, p), STATIONARY[p - 1]
        drift[serial.first[:, 0]] = 0.0
        shape = load.shape
        offset, gain = np.zeros((*shape, p, p)), np.empty((*shape, p))
        variance = np.empty(shape)
        after = np.zeros((serial.sizes.size, shape[1], p, p))
        steady, settled = _steady(serial, load), len(load)
        for k, rows in enumerate(places(serial)):
            own = drift[rows, None]
            before = own @ after[: len(own)] @ own.swapaxes(-1, -2)
            predicted = before + whole
            h = load[rows]
            variance[rows] = s = h * h * predicted[..., 0, 0] + 1.0
            gain[rows] = own_gain = predicted[..., 0] * (h / s)[..., None]
            offset[rows] = before
            if steady and k > 1 and _same(before[0], offset[k - 1]):
                settled = k
                offset[k:], variance[k:], gain[k:] = before[0], s[0], own_gain[0]
                break
            after = before - (own_gain * s[..., None])[..., None] * own_gain[..., None, :]
        parts = (np.ascontiguousarray(a.swapaxes(0, 1)) for a in (load, offset, variance, gain))
        load, offset, variance, gain = parts
        return cls(serial, sd, length, load, steps, drift, offset, variance, gain, settled)

    @cached_property
    def root(self) -> Array:
        """The standard deviation (m, C) of each error given the earlier ones."""
        return np.sqrt(self.variance).T

    def expected(self, u: Array) -> Array:
        """The load times the expected process."""
        return (self.load * self._states(u)[..., 0]).T

    def solved(self, u: Array) -> Array:
        """R^-1 u, by the expected states and their adjoint."""
        return self._adjoint(u, self._states(u))[1].T

    def drawn(self, z: Array) -> Array:
        """Errors from innovations: the state that each adds to moves on, and loads the next."""
        innovation = self.root * z
        moving = np.broadcast_to(self.drift, (*self.load.shape, *self.drift.shape[1:]))
        states = _recursion(_bands(moving), self._added * _before(innovation))
        return (self.load * states[..., 0]).T + innovation

    def derivatives(self, u: Array) -> Derivatives:
        """The derivatives by the adjoint of the filter.

        With the adjoint r of the expected state and the expectation N of r r', the derivative by
        the predicted covariance is (r r' - N)/2.
        """
        states, generator = self._states(u), _generator(self.drift.shape[1])
        adjoint, solved = self._adjoint(u, states)
        squares, inverse = self._expected_squares
        along = generator @ self.offset
        turned = states @ generator.T
        for b in range(len(generator)):
            turned += along[..., b] * adjoint[..., b, None]
        by_step = np.sum(adjoint * turned, axis=-1)
        by_step -= np.einsum("cmab,cmba->cm", squares, along)
        by_sd = (solved * (u.T - solved) - (1.0 - inverse)) / self.sd
        by_length = -self.steps * by_step / self.length
        return Derivatives(solved.T, (solved**2 - inverse).T, (by_sd.T, by_length.T))

    def _states(self, u: Array) -> Array:
        """The expected states (J, m, p) given the earlier errors."""
        return _recursion(self._system, self._added * _before(u))

    def _adjoint(self, u: Array, states: Array) -> tuple[Array, Array]:
        """The derivatives (J, m, p) by the expected states, and R^-1 u (J, m)."""
        pull = (u.T - self.load * states[..., 0]) / self.variance
        source = np.zeros(states.shape)
        source[..., 0] = self.load * pull
        adjoint = _recursion(self._system, source, backward=True)
        pull[:, :-1] -= np.sum(self._added[:, 1:] * adjoint[:, 1:], axis=-1)
        return adjoint, pull

    @cached_property
    def _added(self) -> Array:
        """What the error before adds to the expected state (C, m, p), per unit of the error."""
        moved = np.einsum("mab,cmb->cma", self.drift[1:], self.gain[:, :-1])
        return np.concatenate([np.zeros((len(moved), 1, moved.shape[2])), moved], axis=1)

    @cached_property
    def _step(self) -> Array:
        """The matrices (C, m, p, p) that move the expected state from one error to the next."""
        drift = np.broadcast_to(self.drift, (len(self.load), *self.drift.shape)).copy()
        drift[:, 1:, :, 0] -= self._added[:, 1:] * self.load[:, :-1, None]
        drift[:, 0] = 0.0
        return drift

    @cached_property
    def _system(self) -> Array:
        return _bands(self._step)

    @cached_property
    def _expected_squares(self) -> tuple[Array, Array]:
        """The expectation N (C, m, p, p) of r r', and the diagonal (C, m) of R^-1."""
        step, added = self._step.swapaxes(0, 1), self._added.swapaxes(0, 1)
        found, inverse = np.zeros(step.shape), 1.0 / self.variance.T
        found[..., 0, 0] = self.load.T**2 * inverse
        every = places(self.serial)
        k = len(every) - 2
        while k >= 0:
            later = every[k + 1]
            own, after = every[k][: len(later)], found[later]
            forward, by = step[later], added[later, :, :, None]
            found[own] += forward.swapaxes(-1, -2) @ after @ forward
            inverse[own] += (by.swapaxes(-1, -2) @ after @ by)[..., 0, 0]
            if k > self.settled and _same(found[k], found[k + 1]):
                found[self.settled : k], inverse[self.settled : k] = found[k], inverse[k]
                k = self.settled
            k -= 1
        return found.swapaxes(0, 1), inverse.T


def _steady(serial: SerialOrder, load: Array, equal: float = 1e-10) -> bool:
    """Whether the filter tends to a steady one: of one experiment with equal gaps and one load."""
    gaps = serial.gap[1:]
    if serial.sizes.size > 1 or load.shape[1] > 1 or gaps.size < 2 or np.ptp(load) > 0.0:
        return False
    return bool(np.ptp(gaps) <= equal * gaps[0])


def _same(values: Array, others: Array, equal: float = 1e-14) -> bool:
    """Whether two matrices are the same but for rounding errors."""
    return bool(np.max(np.abs(values - others)) <= equal * np.max(np.abs(values)))


def _before(u: Array) -> Array:
    """The errors (m, J) before each, zero before the first of all, as (J, m, 1)."""
    found = np.zeros((u.shape[1], len(u), 1))
    found[:, 1:, 0] = u[:-1].T
    return found


def _generator(p: int) -> Array:
    """The matrix F of dx/dtau = F x + white noise, by which (d/dtau + 1)^p g is white noise."""
    found = np.eye(p, k=1)
    found[-1] = [-comb(p, k) for k in range(p)]
    return found


def _drifts(steps: Array, p: int) -> Array:
    """The matrices exp(F tau) (m, p, p), where F + 1 is nilpotent."""
    nilpotent = _generator(p) + np.eye(p)
    terms = [
        np.linalg.matrix_power(nilpotent, j) / factorial(j) * steps[:, None, None] ** j
        for j in range(p)
    ]
    return np.asarray(np.exp(-steps)[:, None, None] * sum(terms))


def places(serial: SerialOrder) -> list[Indices]:
    """The rows of the first, second, ... errors of all experiments, the longest first."""
    longest = np.argsort(-serial.sizes, kind="stable")
    starts, sizes = serial.starts[longest], serial.sizes[longest]
    counts = np.searchsorted(-sizes, -np.arange(sizes[0]), side="left")
    return [starts[:count] + k for k, count in enumerate(counts)]


def _bands(step: Array) -> Array:
    """The bands (2 p, C m p) of the system of `_recursion` below its diagonal of ones.

    `step` (C, m, p, p) are the matrices, in one column for all errors or one for each.
    """
    columns, m, p, _ = step.shape
    bands = np.zeros((2 * p, columns, m, p))
    for a in range(p):
        for b in range(p):
            bands[p + a - b, :, :-1, b] = -step[:, 1:, a, b]
    return bands.reshape(2 * p, -1)


def _recursion(bands: Array, source: Array, backward: bool = False) -> Array:
    """x (J, m, p) with x_k = step_k x_(k-1) + source_k.

    Backward it is x_k = step_(k+1)' x_(k+1) + source_k. It is one banded triangular system, whose
    cost is linear in m.
    """
    values = source.reshape(-1, bands.shape[1]).T
    found = dtbtrs(bands, values, uplo="L", trans="T" if backward else "N", diag="U")[0]
    return np.asarray(found.T.reshape(source.shape))
