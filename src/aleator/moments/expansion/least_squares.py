"""Weighted least squares on a nested sequence of terms, with leave-one-out errors in closed form.

One QR decomposition A = Q R of the weighted matrix serves every leading part of the terms: the
fit with the first k of them is Q_k Q_k' b, its leverages are the row sums of Q_k^2, and the
inverse of the leading block of R is the leading block of R^-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from aleator.threads import single_threaded
from aleator.types import Array, Indices

SMALLEST = 1e-10
"""Share of a column that must be left over by the columns before it; less is rounding."""


@dataclass(frozen=True, eq=False)
class NestedFits:
    """Fits of N outcomes with the first k terms, for k in `ends` (E,).

    `leave_one_out` (E, N) are mean-square errors; `corrected` are those times the factor
    J/(J - k) (1 + tr(C^-1)/J) of small samples (Chapelle, Vapnik and Bengio 2002; Blatman and
    Sudret 2011, eq. 21), by which fits with different numbers of terms are compared.
    """

    upper: Array
    projected: Array
    ends: tuple[int, ...]
    leave_one_out: Array
    corrected: Array

    def coefficients(self, end: int, which: Indices) -> Array:
        """Coefficients (k, n') of the first k terms for the outcomes `which` (n',)."""
        part = self.projected[:end, which]
        return np.asarray(linalg.solve_triangular(self.upper[:end, :end], part))


@single_threaded
def nested_fits(psi: Array, weights: Array, outcomes: Array, ends: tuple[int, ...]) -> NestedFits:
    """Fit outcomes (N, J) by the first k columns of psi (J, P) for every k in `ends`, increasing.

    Minimizes sum_j weights_j (y_j - psi_j c)^2; weights (J,) are normalized to sum to one. The
    leave-one-out residual is r_j / (1 - h_j) with the leverage h_j, without any second fit. A point
    that alone determines a coefficient (h_j = 1) makes the error infinite, and so do columns that
    depend on each other. Needs ends[-1] <= J. Cost O(J P^2 + J P N).
    """
    share = weights / weights.sum()
    root = np.sqrt(share)[:, None]
    orthogonal, upper = np.linalg.qr(root * psi[:, : ends[-1]])
    projected = orthogonal.T @ (root * outcomes.T)
    errors, corrected = [], []
    residual, leverage, begin = root * outcomes.T, np.zeros(len(share)), 0
    spread = _inverse_norms(upper)
    for end in ends:
        part = orthogonal[:, begin:end]
        residual = residual - part @ projected[begin:end]
        leverage = leverage + np.sum(part**2, axis=1)
        begin = end
        free = 1.0 - leverage
        determined = np.all(free > SMALLEST) and np.isfinite(spread[end - 1]) and end < len(share)
        error = np.sum((residual / np.maximum(free, SMALLEST)[:, None]) ** 2, axis=0)
        errors.append(error if determined else np.full_like(error, np.inf))
        count = len(share)
        factor = count / max(count - end, 1) * (1.0 + spread[end - 1] / count)
        corrected.append(errors[-1] * factor)
    return NestedFits(upper, projected, ends, np.array(errors), np.array(corrected))


def _inverse_norms(upper: Array) -> Array:
    """tr((R_k' R_k)^-1) (P,) for every leading block R_k; infinite from a dependent column on."""
    size = np.linalg.norm(upper, axis=0)
    depends = np.flatnonzero(np.abs(np.diag(upper)) <= SMALLEST * size)
    sound = int(depends[0]) if depends.size else len(upper)
    norms = np.full(len(upper), np.inf)
    inverse = linalg.solve_triangular(upper[:sound, :sound], np.eye(sound))
    norms[:sound] = np.cumsum(np.sum(inverse**2, axis=0))
    return norms
