"""What runs that are left out choose: axes for all experiments, and a prior for each of them."""

from __future__ import annotations

import numpy as np

from aleator.surrogates.axes import Axes
from aleator.surrogates.fit import TINY, Prior, search
from aleator.surrogates.points import shares
from aleator.surrogates.samples import Samples
from aleator.types import Array, Flags, Indices

# Outcomes that differ by less than this part of their size do not depend on the parameters.
ROUNDING = 1e-12
# Sets of runs that worked, for which priors are searched; experiments with any other set (runs that
# fail here and there, differently in each) choose among the priors that were found for these.
SEARCHED = 6
# Share of the mean square error that other axes have to leave: what is about as good is left alone.
GAIN = 0.25


def patterns(worked: Flags) -> list[tuple[Indices, Indices]]:
    """Rows (A,) and columns (M,) of each different row of `worked`, the most frequent first.

    >>> patterns(np.array([[True, False], [True, True], [True, True]]))
    [(array([1, 2]), array([0, 1])), (array([0]), array([0]))]
    """
    sets, inverse, count = np.unique(worked, axis=0, return_inverse=True, return_counts=True)
    order = np.lexsort((np.arange(len(sets)), -count))
    return [(np.flatnonzero(inverse.ravel() == k), np.flatnonzero(sets[k])) for k in order.tolist()]


def chosen_axes(
    axes: Axes, samples: Samples, members: Indices, pool: list[Prior], where: Array | None
) -> Axes:
    """Axes in which runs left out are missed by far less, in the middle of the `members` (A,).

    Of those with the most frequent set of runs. Scales are compared at points `where` (J, n), or
    all over the box.
    """
    rows, runs = patterns(samples.worked[members])[0]
    y, x = samples.outcome[np.ix_(members[rows], runs)].T, samples.x[runs]
    least = (ROUNDING * np.abs(y).max(axis=0)) ** 2 + TINY

    def error(one: Axes) -> Array:
        at = None if where is None else one.inward(where)
        z = one.inward(x)
        left = search(pool, z, y, shares(z, at), sweeps=1).error
        return np.asarray(np.log(left + least))

    others = axes.others()
    if not others:
        return axes
    before = error(axes)
    change = [float(np.median(error(one) - before)) for one in others]
    best = int(np.argmin(change))
    return others[best] if change[best] < np.log(GAIN) else axes


def chosen_priors(
    z: Array, values: Array, members: Indices, pool: list[Prior], at: Array | None
) -> tuple[list[tuple[Prior, Indices, Indices]], list[Prior]]:
    """Return (prior, experiments, runs) that go together, and the pool of priors to go on with.

    `values` (N, M) of all experiments at z (M, n), NaN where there is none; only for `members`.
    Scales are compared at points `at` (J, n), or all over the box.
    """
    found: dict[Prior, None] = {}
    out = []
    for k, (rows, runs) in enumerate(patterns(np.isfinite(values[members]))):
        y, share = values[np.ix_(members[rows], runs)].T, shares(z[runs], at)
        if k < SEARCHED:
            priors, best, _, more = search(pool, z[runs], y, share)
            found |= dict.fromkeys(more)
        else:
            priors, best, _, _ = search([*found], z[runs], y, share, sweeps=1)
        out += [(priors[b], members[rows[best == b]], runs) for b in np.unique(best)]
    return out, [*found] or pool
