"""Moments of a polynomial chaos expansion, exact to rounding, with derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aleator.densities.moments import Moments
from aleator.errors import InputsError
from aleator.expansion.moments.basis import Basis
from aleator.expansion.moments.interface import Powers, Way
from aleator.threads import single_threaded
from aleator.types import Array

ROUNDING = 1e-14
"""A scatter below this, relative to the mean, is that of the rounding of the outcomes."""


@dataclass(frozen=True)
class ExpansionMoments:
    """Moments to `order` of Y = sum_i c_i psi_i, ready for any coefficients.

    Made by `prepare`; this is the paper's offline step, `moments` its online step.
    """

    basis: Basis
    order: int
    powers: Powers

    @single_threaded
    def moments(self, coefficients: ArrayLike) -> Moments:
        """Mean, sd and standardized moments to `order` of the expansions c (N, P).

        The mean is c_0, the variance the sum of the other c_i^2, and powers are taken of
        z = (Y - mean)/sd, whose coefficients are c_i/sd without the constant: raw moments of an
        outcome with little scatter lose all digits. An expansion without scatter has sd 0 and
        standardized moments of zero. Raises InputsError for coefficients of another shape.

        >>> from aleator.expansion.moments import Basis, Galerkin, prepare
        >>> from aleator.polynomials.recurrence import hermite_recurrence
        >>> basis = Basis((hermite_recurrence(5),), np.array([[0], [1], [2]]))
        >>> chi = prepare(basis, 4, Galerkin()).moments([[1.0, 0.0, 2**0.5]])    # Y = theta^2
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
        constant = self.basis.constant
        standardized = np.zeros((c.shape[0], self.order + 1))
        # E[z^m] = sum_i z_i E[z^(m-1) psi_i]
        standardized[:, 1:] = np.einsum("np,nmp->nm", z, projections)
        _exact_by_definition(standardized)
        scale = np.where(sd > 0.0, sd, np.inf)[:, None, None]
        jac = np.zeros((*standardized.shape, c.shape[1]))
        m = np.arange(3, self.order + 1)
        change = projections[:, 2:] - standardized[:, 3:, None] * z[:, None, :]
        jac[:, 3:] = m[:, None] * change / scale
        jac[:, :, constant] = 0.0
        mean_jac = np.zeros_like(c)
        mean_jac[:, constant] = 1.0
        return Moments(mean, sd, standardized, mean_jac, z, jac)

    def _checked(self, coefficients: ArrayLike) -> Array:
        c = np.asarray(coefficients, dtype=float)
        if c.ndim != 2 or c.shape[1] != self.basis.size:
            raise InputsError(
                f"coefficients of shape {c.shape} for a basis of {self.basis.size} functions",
                f"give an array (N, {self.basis.size}), one row an experiment",
            )
        return c

    def _standardized(self, c: Array) -> tuple[Array, Array, Array]:
        constant = self.basis.constant
        scattering = c.copy()
        scattering[:, constant] = 0.0
        # scaled before it is squared: no overflow, no underflow
        largest = np.abs(scattering).max(axis=1)
        safe = np.where(largest > 0.0, largest, 1.0)[:, None]
        sd = largest * np.linalg.norm(scattering / safe, axis=1)
        # scatter at the level of rounding is no scatter, as for weighted outcomes
        sd = np.where(sd > ROUNDING * np.abs(c[:, constant]), sd, 0.0)
        return c[:, constant].copy(), sd, scattering / np.where(sd > 0.0, sd, np.inf)[:, None]


def prepare(basis: Basis, order: int, way: Way) -> ExpansionMoments:
    """The offline step: everything about moments to `order` that the coefficients do not change.

    `order` M is at least 2. Raises InputsError where the recurrences of the basis are too short,
    or where the way needs more memory than is sensible; cost: see the way.

    >>> from aleator.expansion.moments import Basis, TensorGauss, prepare
    >>> from aleator.polynomials.recurrence import hermite_recurrence
    >>> basis = Basis((hermite_recurrence(5),), np.array([[0], [1]]))
    >>> normal = prepare(basis, 8, TensorGauss()).moments([[3.0, 0.1]])
    >>> normal.standardized.round(9).tolist()
    [[1.0, 0.0, 1.0, 0.0, 3.0, 0.0, 15.0, 0.0, 105.0]]
    """
    basis.check(order)
    return ExpansionMoments(basis, order, way.powers(basis, order))


def _exact_by_definition(standardized: Array) -> Array:
    """Columns 0, 1, 2 free of rounding, as the solvers of densities expect them."""
    standardized[:, 0], standardized[:, 1], standardized[:, 2] = 1.0, 0.0, 1.0
    return standardized
