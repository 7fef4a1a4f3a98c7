"""A Gaussian process along a column beside independent errors, in a time linear in the rows.

A process with Matern's correlation of smoothness p - 1/2 is the first of p components of a Markov
process. So the errors given the earlier ones follow from the Kalman filter (Hartikainen and
Sarkka, 2010), and the derivatives from its adjoint recursions (de Jong, 1989; Koopman and Shephard,
1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb, factorial

import numpy as np
from scipy.linalg.lapack import dtbtrs

from aleator.core.types import Array, Indices
from aleator.errors import InputsError
from aleator.laws import Hyperparameter, Specification, resolve
from aleator.laws.hyperparameter import LIMITS
from aleator.observations.correlated import Chain, Derivatives, Whitening

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

    def whitening(self, values: Sequence[float], chain: Chain, scale: Array) -> Whitening:
        """The Kalman filter, kept for the next call with the same values."""
        (sd, length), states = map(float, values), round(self.smoothness + 0.5)
        key = np.array([sd, length, states]).tobytes() + np.ascontiguousarray(scale).tobytes()
        return chain.kept(key, lambda: FilteredErrors.of(chain, sd, length, sd / scale, states))


@dataclass(frozen=True, eq=False)
class FilteredErrors:
    """The Kalman filter of errors u = load f + z, with a process f and z standard normal.

    There are m errors in the order of a chain, p states, and C columns of loads `load` (m, C): one,
    or as many as columns of errors. `steps` (m,) are the distances tau between neighbours, and
    `drift` (m, p, p) moves the state by them, zero where an experiment begins. `offset`
    (m, p, p, C) is the predicted covariance of the state less the stationary one, `variance`
    (m, C) that of each error given the earlier ones, and `gain` (m, p, C) what an error adds to the
    expected state.
    """

    chain: Chain
    sd: float
    length: float
    load: Array
    steps: Array
    drift: Array
    offset: Array
    variance: Array
    gain: Array

    @classmethod
    def of(cls, chain: Chain, sd: float, length: float, load: Array, p: int) -> FilteredErrors:
        """The filter of a process of p states; a loop over the places of the longest experiment."""
        steps = np.where(chain.first[:, 0], 0.0, np.sqrt(2.0 * p - 1.0) * chain.gap / length)
        drift, whole = _drifts(steps, p), STATIONARY[p - 1]
        drift[chain.first[:, 0]] = 0.0
        shape = load.shape
        offset, gain = np.zeros((*shape, p, p)), np.empty((*shape, p))
        variance = np.empty(shape)
        after = np.zeros((chain.sizes.size, shape[1], p, p))
        for rows in _places(chain):
            own = drift[rows, None]
            before = own @ after[: len(own)] @ own.swapaxes(-1, -2)
            predicted = before + whole
            h = load[rows]
            variance[rows] = s = h * h * predicted[..., 0, 0] + 1.0
            gain[rows] = k = predicted[..., 0] * (h / s)[..., None]
            offset[rows] = before
            after = before - (k * s[..., None])[..., None] * k[..., None, :]
        return cls(
            chain, sd, length, load, steps, drift,
            np.moveaxis(offset, 1, -1), variance, np.moveaxis(gain, 1, -1),
        )  # fmt: skip

    @cached_property
    def root(self) -> Array:
        """The standard deviation (m, C) of each error given the earlier ones."""
        return np.sqrt(self.variance)

    def expected(self, u: Array) -> Array:
        """The load times the expected process."""
        return self.load * self._states(u)[:, 0]

    def drawn(self, z: Array) -> Array:
        """Errors from innovations: the state that each adds to moves on, and loads the next."""
        innovation = self.root * z
        added = self._moved(self.gain * innovation[:, None])
        moving = np.broadcast_to(self.drift[..., None], (*self.drift.shape, self.load.shape[1]))
        return self.load * _recursion(moving, added)[:, 0] + innovation

    def derivatives(self, u: Array) -> Derivatives:
        """The derivatives by the adjoint of the filter.

        With the adjoint r of the expected state and the expectation N of r r', the derivative by
        the predicted covariance is (r r' - N)/2. `solved` is a = R^-1 u, and `inverse` the diagonal
        of R^-1.
        """
        states = self._states(u)
        pull = (u - self.load * states[:, 0]) / self.variance
        source = np.zeros(states.shape)
        source[:, 0] = self.load * pull
        adjoint = _recursion(self._step, source, backward=True)
        later = np.concatenate([self._back(adjoint[1:], 1), np.zeros((1, *adjoint.shape[1:]))])
        solved = pull - np.sum(self.gain * later, axis=1)
        squares, inverse = self._expected_squares
        along = np.einsum("ab,mbcj->macj", self._generator, self.offset)
        wide = np.broadcast_to(along, (*along.shape[:-1], u.shape[1]))
        by_step = (
            np.einsum("maj,ab,mbj->mj", adjoint, self._generator, states)
            + np.einsum("maj,mabj,mbj->mj", adjoint, wide, adjoint, optimize=True)
            - np.einsum("mabj,mbaj->mj", squares, along)
        )
        by_sd = (solved * (u - solved) - (1.0 - inverse)) / self.sd
        by_length = -self.steps[:, None] * by_step / self.length
        return Derivatives(solved, solved**2 - inverse, (by_sd, by_length))

    @cached_property
    def _expected_squares(self) -> tuple[Array, Array]:
        """The expectation N (m, p, p, C) of r r', and the diagonal (m, C) of R^-1."""
        step, gain = np.moveaxis(self._step, -1, 1), np.moveaxis(self.gain, -1, 1)
        moved = (self.drift[1:, None] @ gain[:-1, ..., None])[..., 0]
        found, inverse = np.zeros(step.shape), 1.0 / self.variance
        found[..., 0, 0] = self.load**2 * inverse
        later: Indices | None = None
        for rows in reversed(_places(self.chain)):
            if later is not None:
                own, after = rows[: len(later)], found[later]
                forward = step[later]
                found[own] += forward.swapaxes(-1, -2) @ after @ forward
                by = moved[own]
                inverse[own] += np.einsum("bca,bcad,bcd->bc", by, after, by)
            later = rows
        return np.moveaxis(found, 1, -1), inverse

    def _states(self, u: Array) -> Array:
        """The expected states (m, p, J) given the earlier errors."""
        return _recursion(self._step, self._moved(self.gain * u[:, None]))

    def _moved(self, after: Array) -> Array:
        """States (m, p, J) after each error, moved to the next error."""
        first = np.zeros((1, *after.shape[1:]))
        return np.concatenate([first, np.einsum("mab,mbj->maj", self.drift[1:], after[:-1])])

    def _back(self, adjoint: Array, first: int) -> Array:
        """The adjoint at errors from number `first` on, moved to the errors before."""
        return np.asarray(np.einsum("mab,maj->mbj", self.drift[first:], adjoint))

    @cached_property
    def _step(self) -> Array:
        """The matrices (m, p, p, C) that move the expected state from one error to the next."""
        p, columns = self.drift.shape[1], self.load.shape[1]
        kept = np.broadcast_to(np.eye(p)[..., None], (len(self.load), p, p, columns)).copy()
        kept[:, :, 0] -= self.gain * self.load[:, None]
        return np.concatenate(
            [np.zeros((1, p, p, columns)), np.einsum("mab,mbcj->macj", self.drift[1:], kept[:-1])]
        )

    @property
    def _generator(self) -> Array:
        return _generator(self.drift.shape[1])


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


def _places(chain: Chain) -> list[Indices]:
    """The rows of the first, second, ... errors of all experiments, the longest first."""
    longest = np.argsort(-chain.sizes, kind="stable")
    starts, sizes = chain.starts[longest], chain.sizes[longest]
    counts = np.searchsorted(-sizes, -np.arange(sizes[0]), side="left")
    return [starts[:count] + k for k, count in enumerate(counts)]


def _recursion(step: Array, source: Array, backward: bool = False) -> Array:
    """x (m, p, J) with x_k = step_k x_(k-1) + source_k.

    Backward it is x_k = step_(k+1)' x_(k+1) + source_k. It is one banded triangular system, whose
    cost is linear in m. `step` is (m, p, p, C), with one column for all J or one for each.
    """
    m, p, _, columns = step.shape
    bands = np.zeros((2 * p, columns, m, p))
    for a in range(p):
        for b in range(p):
            bands[p + a - b, :, :-1, b] = -step[1:, a, b].T
    shape = (columns, -1, m, p)
    values = np.moveaxis(source, -1, 0).reshape(shape).transpose(0, 2, 3, 1)
    found = dtbtrs(
        bands.reshape(2 * p, -1), values.reshape(columns * m * p, -1),
        uplo="L", trans="T" if backward else "N", diag="U",
    )[0]  # fmt: skip
    parts = found.reshape(columns, m, p, -1).transpose(1, 2, 0, 3)
    return np.asarray(parts.reshape(m, p, -1))
