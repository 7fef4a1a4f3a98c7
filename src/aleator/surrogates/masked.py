"""Fits through the runs that each experiment has: grouped by which those are."""

from __future__ import annotations

import numpy as np

from aleator.errors import SimulatorError
from aleator.surrogates.assembly import Piece
from aleator.surrogates.fit import Judged, Prior, fitted, search
from aleator.types import Array, Flags, Indices

# Sets of runs that worked, for which priors are searched; experiments with any other set (runs that
# fail here and there, differently in each) choose among the priors that were found for these.
SEARCHED = 6


def least_runs(n: int) -> int:
    """Runs that must work before there is a surface in n parameters: twice a linear one's."""
    return 2 * n + 2


def checked_outcomes(outcome: object, shape: tuple[int, int]) -> Array:
    """The outcomes of runs as (A, M). Raises SimulatorError for another number, or infinite."""
    found = np.asarray(outcome, dtype=np.float64)
    if found.shape != (shape[0] * shape[1],) or np.isinf(found).any():
        raise SimulatorError(
            f"outcomes of shape {found.shape} for {shape[0] * shape[1]} runs, or infinite",
            "return one number for each run: finite, or NaN where the run failed",
        )
    return found.reshape(shape)


def patterns(worked: Flags) -> list[tuple[Indices, Indices]]:
    """Rows (A,) and columns (M,) of each different row of `worked`, the most frequent first.

    >>> patterns(np.array([[True, False], [True, True], [True, True]]))
    [(array([1, 2]), array([0, 1])), (array([0]), array([0]))]
    """
    sets, inverse, count = np.unique(worked, axis=0, return_inverse=True, return_counts=True)
    order = np.lexsort((np.arange(len(sets)), -count))
    return [(np.flatnonzero(inverse.ravel() == k), np.flatnonzero(sets[k])) for k in order.tolist()]


def chosen_priors(
    z: Array, values: Array, members: Indices, pool: list[Prior]
) -> tuple[list[tuple[Prior, Indices, Indices]], list[Prior]]:
    """Return (prior, experiments, runs) that go together, and the pool of priors to go on with.

    `values` (N, M) of all experiments at z (M, n), NaN where there is none; only for `members`.
    """
    found: dict[Prior, None] = {}
    out = []
    for k, (rows, runs) in enumerate(patterns(np.isfinite(values[members]))):
        y = values[np.ix_(members[rows], runs)].T
        if k < SEARCHED:
            priors, best, more = search(pool, z[runs], y)
            found |= dict.fromkeys(more)
        else:
            priors, best, _ = search([*found], z[runs], y, sweeps=1)
        out += [(priors[b], members[rows[best == b]], runs) for b in np.unique(best)]
    return out, [*found] or pool


def fitted_pieces(z: Array, values: Array, prior: list[Prior]) -> list[Piece]:
    """Return the surfaces of all experiments, each with its prior, through the runs it has."""
    n = z.shape[1]
    pieces: list[Piece] = []
    for rows, runs in patterns(np.isfinite(values)):
        if len(runs) < least_runs(n):
            pieces.append(_constants(rows, values[np.ix_(rows, runs)], n))
            continue
        shared: dict[Prior, list[int]] = {}
        for row in rows.tolist():
            shared.setdefault(prior[row], []).append(row)
        for one, some in shared.items():
            members = np.array(some, dtype=np.intp)
            pieces.append((members, *fitted(one, z[runs], values[np.ix_(members, runs)].T)))
    return pieces


def _constants(members: Indices, outcomes: Array, n: int) -> Piece:
    """Surfaces of experiments with hardly a run: the mean of what there is."""
    mean = outcomes.sum(axis=1) / max(outcomes.shape[1], 1)
    return members, np.zeros((1, n), dtype=np.intp), mean[None, :]


def left_out(fit: Judged, share: Array) -> Array:
    """Return the error (A,) that the leave-one-out residuals tell, weighted by each run's share.

    A run left out of well-spread ones leaves a hole twice as wide as any other, so its residual is
    larger than the error elsewhere: hence 0.7. The least of some forty leave-one-out errors is
    too small by chance when the runs are few: hence 1 + 8/M.
    """
    return np.asarray(np.sqrt(share @ fit.residual**2) * 0.7 * (1.0 + 8.0 / len(share)))
