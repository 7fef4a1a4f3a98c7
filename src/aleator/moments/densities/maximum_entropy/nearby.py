"""Densities whose moments are near those of densities that are known: Newton from a prediction.

A search asks for one alpha after the other, and most are near the last one. In powers of u the
exponent p(u) = lambda.phi(t(u)) of a density that is known changes with the moments c by

    dp = sum_k (P_k . dc) psi_k(u),

with psi_k orthonormal under it and P_k their coefficients in powers of u (see `partials`). That is
where undamped Newton steps begin; three of them reach rounding. The dual is convex and has one
minimum, so that what is found does not depend on where the way began.
"""

from __future__ import annotations

import numpy as np

from aleator.moments.densities.maximum_entropy.dual import CLOSE, expectations
from aleator.moments.densities.maximum_entropy.legendre import Rule, cholesky, substitute
from aleator.types import Array, Flags

_PASSES = 6
_FARTHEST = 0.3
"""Newton decrement from which an undamped step is not to be trusted."""
_SHRINKS = 0.25
"""Of the decrement in one step, at least: it falls with the square of the distance."""


def predicted(exponent: Array, powers: Array, change: Array, in_powers: Array) -> Array:
    """Multipliers (N, M) where the moments have changed by `change` (N, M+1).

    `exponent` (N, M+1) and psi, `powers` (N, M+1, M+1), are in powers of u, `in_powers` (N, M+1,
    M+1) has phi there on the new support: a triangular matrix.
    """
    delta = (powers @ change[:, :, None])[:, 1:]
    moved = exponent + (delta * powers[:, 1:]).sum(axis=1)
    multipliers: Array = np.empty_like(moved)
    for k in reversed(range(moved.shape[1])):
        multipliers[:, k] = moved[:, k] / in_powers[:, k, k]
        moved -= multipliers[:, k, None] * in_powers[:, k]
    return multipliers[:, 1:]


def follow(target: Array, start: Array, rule: Rule) -> tuple[Array, Flags]:
    """Multipliers (N, M) with E phi = target (N, M), and whether Newton's steps led there.

    They are given up where the start is far, or where they do not shrink as near a minimum. Cost:
    some 3 passes of O(N Q M).
    """
    position, least = start.copy(), np.full(len(start), _FARTHEST)
    followed = np.isfinite(start).all(axis=1)
    for _ in range(_PASSES):
        with np.errstate(all="ignore"):
            law = expectations(position, rule)
            gradient = law.mean - target
            step = -substitute(cholesky(law.covariance)[0], gradient)
            decrement = -np.einsum("nk,nk->n", gradient, step)
        followed &= decrement < least
        np.add(position, step, out=position, where=followed[:, None])
        arrived = followed & (decrement < CLOSE)
        if np.all(arrived | ~followed):
            break
        least = np.maximum(_SHRINKS * decrement, CLOSE)
    return position, arrived
