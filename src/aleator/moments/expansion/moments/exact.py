"""Moments of a polynomial chaos expansion, exact to rounding, with derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from aleator.errors import InputsError
from aleator.moments.densities.moments import Moments
from aleator.moments.expansion.basis import Basis
from aleator.moments.expansion.indices import constant
from aleator.moments.expansion.moments.cheapest import cheapest
from aleator.threads import single_threaded
from aleator.types import Array, Indices

EXPANSIONS = 50_000
"""Expansions that a search asks the moments of: some hundred evaluations, some hundred outcomes."""
ROUNDING = 1e-14
"""A scatter below this, relative to the mean, is that of the rounding of the outcomes."""


class Powers(Protocol):
    """Means of powers of Z = sum_i z_i psi_i, exact for any coefficients z (N, P).

    The coefficient of the constant is zero: Z has mean zero. All that does not depend on z was
    computed before.
    """

    def means(self, z: Array) -> Array:
        """E[Z^m] for m = 0..M, as (N, M+1)."""
        ...

    def projections(self, z: Array) -> Array:
        """E[Z^m psi_i] for m = 0..M-1, as (N, M, P): the derivative of E[Z^(m+1)]/(m+1) by z_i."""
        ...


class Way(Protocol):
    """A choice of how exact moments are computed."""

    def powers(self, basis: Basis, indices: Indices, order: int) -> Powers:
        """The offline step: what moments to `order` need of the polynomials alone."""
        ...


@dataclass(frozen=True)
class ExpansionMoments:
    """Moments to `order` of Y = sum_i c_i psi_i, ready for any coefficients.

    Made by `prepare`; this is the paper's offline step, `moments` its online step.
    """

    indices: Indices
    order: int
    powers: Powers

    @single_threaded
    def moments(self, coefficients: ArrayLike) -> Moments:
        """Mean, sd and standardized moments to `order` of the expansions c (N, P).

        The mean is c_0, the variance the sum of the other c_i^2, and powers are taken of
        z = (Y - mean)/sd, whose coefficients are c_i/sd without the constant: raw moments of an
        outcome with little scatter lose all digits. An expansion without scatter has sd 0 and
        standardized moments of zero. Raises InputsError for coefficients of another shape.

        >>> indices = np.array([[0], [1], [2]])
        >>> ready = prepare(Basis.normal(1), indices, 4)
        >>> chi = ready.moments([[1.0, 0.0, 2**0.5]])                            # Y = theta^2
        >>> chi.mean.tolist(), chi.sd.round(6).tolist(), chi.standardized[0, 3:].round(6).tolist()
        ([1.0], [1.414214], [2.828427, 15.0])
        """
        c = self._checked(coefficients)
        mean, sd, z = self._standardized(c)
        return Moments(mean, sd, _exact_by_definition(self.powers.means(z)))

    @single_threaded
    def moments_with_gradient(self, coefficients: ArrayLike) -> Moments:
        """Moments as `moments`, with derivatives by the coefficients: the last axis is P.

        d mu_m/d c_i = m E[(Y - mean)^(m-1) psi_i] of the central moments, hence
        d E[z^m]/d c_i = (m/sd) (E[z^(m-1) psi_i] - E[z^m] z_i), and zero for the constant.
        """
        c = self._checked(coefficients)
        mean, sd, z = self._standardized(c)
        projections = self.powers.projections(z)
        mean_at = constant(self.indices)
        standardized = np.zeros((c.shape[0], self.order + 1))
        # E[z^m] = sum_i z_i E[z^(m-1) psi_i]
        standardized[:, 1:] = np.einsum("np,nmp->nm", z, projections)
        _exact_by_definition(standardized)
        scale = np.where(sd > 0.0, sd, np.inf)[:, None, None]
        jac = np.zeros((*standardized.shape, c.shape[1]))
        m = np.arange(3, self.order + 1)
        change = projections[:, 2:] - standardized[:, 3:, None] * z[:, None, :]
        jac[:, 3:] = m[:, None] * change / scale
        jac[:, :, mean_at] = 0.0
        mean_jac = np.zeros_like(c)
        mean_jac[:, mean_at] = 1.0
        return Moments(mean, sd, standardized, mean_jac, z, jac)

    def _checked(self, coefficients: ArrayLike) -> Array:
        c = np.asarray(coefficients, dtype=float)
        if c.ndim != 2 or c.shape[1] != len(self.indices):
            raise InputsError(
                f"coefficients of shape {c.shape} for {len(self.indices)} polynomials",
                f"give an array (N, {len(self.indices)}), one row an experiment",
            )
        return c

    def _standardized(self, c: Array) -> tuple[Array, Array, Array]:
        mean_at = constant(self.indices)
        scattering = c.copy()
        scattering[:, mean_at] = 0.0
        # scaled before it is squared: no overflow, no underflow
        largest = np.abs(scattering).max(axis=1)
        safe = np.where(largest > 0.0, largest, 1.0)[:, None]
        sd = largest * np.linalg.norm(scattering / safe, axis=1)
        # scatter at the level of rounding is no scatter, as for weighted outcomes
        sd = np.where(sd > ROUNDING * np.abs(c[:, mean_at]), sd, 0.0)
        return c[:, mean_at].copy(), sd, scattering / np.where(sd > 0.0, sd, np.inf)[:, None]


def prepare(basis: Basis, indices: Indices, order: int, way: Way | None = None) -> ExpansionMoments:
    """The offline step: everything about moments to `order` that the coefficients do not change.

    `indices` (P, n) are the polynomials in the order of the coefficients, in any order and of any
    shape, the constant among them; `order` M is at least 2. The way is the cheapest for as many
    expansions as a search asks for, unless one is given. Raises InputsError for indices that are
    negative, double or without the constant, and where the way needs more memory than is sensible;
    cost: see the way.

    >>> normal = prepare(Basis.normal(1), np.array([[0], [1]]), 8).moments([[3.0, 0.1]])
    >>> normal.standardized.round(9).tolist()
    [[1.0, 0.0, 1.0, 0.0, 3.0, 0.0, 15.0, 0.0, 105.0]]
    """
    if order < 2:
        raise InputsError(f"order {order} of the moments", "ask for order 2 or more")
    indices = _checked(basis, indices)
    chosen = way or cheapest(basis, indices, order, EXPANSIONS)
    return ExpansionMoments(indices, order, chosen.powers(basis, indices, order))


def _checked(basis: Basis, given: ArrayLike) -> Indices:
    """The multi-indices (P, n) as whole numbers that nobody can change."""
    array = np.asarray(given)
    indices = np.array(array, dtype=np.intp, order="C", copy=True)
    if indices.ndim != 2 or indices.shape[1] != len(basis.laws) or indices.size == 0:
        raise InputsError(
            f"multi-indices of shape {array.shape} for {len(basis.laws)} parameters",
            "give an array (P, n), a row for each polynomial",
        )
    if np.any(indices != array) or indices.min() < 0:
        raise InputsError("a multi-index is negative or not whole", "give degrees 0, 1, 2, ...")
    if len(np.unique(indices, axis=0)) < len(indices):
        raise InputsError("a multi-index occurs twice", "give each once")
    if np.all(indices.any(axis=1)):
        raise InputsError(
            "the multi-indices lack the constant", "add the row of zeros: it carries the mean"
        )
    indices.setflags(write=False)
    return indices


def _exact_by_definition(standardized: Array) -> Array:
    """Columns 0, 1, 2 free of rounding, as the solvers of densities expect them."""
    standardized[:, 0], standardized[:, 1], standardized[:, 2] = 1.0, 0.0, 1.0
    return standardized
