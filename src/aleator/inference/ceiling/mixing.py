"""The best weights of given points: a concave problem with a certificate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize

from aleator.threads import single_threaded
from aleator.types import Array, Indices

ENOUGH = 1e-7
"""Of the gradient function, over its largest value at the end."""
STEPS = 200
COVERED = 0.05
"""Share of its largest likelihood that each experiment has at one of the first points."""
ENTERING = 8
"""Points that enter in one step."""
SHORTEST = 1e-4
"""Of a step that is cut."""
RISE = 1e-4
"""Share of the rise that the gradient promises."""


@dataclass(frozen=True, eq=False)
class Mixing:
    """Weights (J,) of the points of a law, and log f_l (N,) of each experiment under it.

    `gradient` (J,) is D_j = mean_l L_lj / f_l - 1. No weights of these points have a
    log-likelihood above that of these by more than `gap` = N log(1 + max D).
    """

    weights: Array
    each: Array
    gradient: Array

    @property
    def log_likelihood(self) -> float:
        """sum_l log f_l."""
        return float(self.each.sum())

    @property
    def gap(self) -> float:
        """How much larger the log-likelihood of other weights can be."""
        return bound(self.gradient, self.each.size)

    @property
    def support(self) -> Indices:
        """The points that have a weight."""
        return np.flatnonzero(self.weights)


def bound(gradient: Array, experiments: int) -> float:
    """N log(1 + max D): what a law on these points may gain, by Jensen's inequality."""
    return experiments * float(np.log1p(max(gradient.max(initial=0.0), 0.0)))


@single_threaded
def mixed(log_density: Array, enough: float = ENOUGH) -> Mixing:
    """The weights w that maximize sum_l log sum_j w_j exp(log_density[l, j]), (N, J).

    Kiefer and Wolfowitz (1956) showed the estimate consistent; D <= 0 at all points marks the
    maximum (Lindsay, 1983). Solved by Newton steps whose quadratic problem on the simplex is a
    nonnegative least-squares problem, on the few points that have weight and those of largest D
    (Wang, 2007). NaN counts as -inf. An experiment that no point explains has -inf, and no part in
    the weights. Cost: some twenty products with the matrix.

    >>> found = mixed(np.log([[0.9, 0.1, 0.5], [0.1, 0.9, 0.5]]))
    >>> found.weights.round(6).tolist(), round(found.log_likelihood, 6)
    ([0.5, 0.5, 0.0], -1.386294)
    """
    log_density = np.nan_to_num(log_density, nan=-np.inf, neginf=-np.inf)
    top = log_density.max(axis=1)
    known = np.isfinite(top)
    if not known.any():
        count = log_density.shape[1]
        return Mixing(np.full(count, 1.0 / count), top, np.zeros(count))
    density = np.exp(log_density[known] - top[known, None])
    weights = _ascended(density, enough)
    each = np.full(top.size, -np.inf)
    f = density @ weights
    each[known] = top[known] + np.log(f)
    return Mixing(weights, each, _gradient(density, f))


def _ascended(density: Array, enough: float) -> Array:
    """Newton steps from the few points that explain every experiment."""
    weights = np.zeros(density.shape[1])
    first = _cover(density)
    weights[first] = 1.0 / max(first.size, 1)
    for _ in range(STEPS):
        f = density @ weights
        gradient = _gradient(density, f)
        if gradient.max(initial=0.0) <= enough:
            break
        entering = np.argsort(-gradient)[:ENTERING]
        at = np.union1d(np.flatnonzero(weights), entering[gradient[entering] > 0.0])
        moved = np.zeros_like(weights)
        moved[at] = _newton(density[:, at] / f[:, None])
        better = _searched(density, weights, moved, gradient)
        if better is None:
            break
        weights = better
    return weights


def _cover(density: Array) -> Indices:
    """Points such that each experiment has a likelihood that counts at one of them."""
    chosen, open_ = list[int](), np.ones(len(density), dtype=np.bool_)
    while open_.any():
        chosen.append(int(np.argmax(density[open_].sum(axis=0))))
        reached = density[:, chosen[-1]] >= COVERED
        if not np.any(reached & open_):
            chosen[-1] = int(np.argmax(density[np.argmax(open_)]))
            reached = density[:, chosen[-1]] >= COVERED
        open_ &= ~reached
    return np.unique(np.array(chosen, dtype=np.intp))


def _newton(ratio: Array) -> Array:
    """The weights that minimize |ratio w - 2|^2 on the simplex: the parabola of the objective.

    As sum w = 1 that is |P w|^2 with P = ratio - 2, homogeneous in w, and the constraint is met by
    scaling the minimum of |P w|^2 + (sum w - 1)^2 (Dax, 1990).
    """
    reduced = linalg.qr(ratio - 2.0, mode="r", check_finite=False)[0][: ratio.shape[1]]
    rows = np.vstack([reduced, np.ones(ratio.shape[1])])
    right = np.zeros(len(rows))
    right[-1] = 1.0
    weights = optimize.nnls(rows, right)[0]
    return np.asarray(weights / weights.sum())


def _searched(density: Array, weights: Array, moved: Array, gradient: Array) -> Array | None:
    """A point of the step at which the objective has risen; None where rounding leaves none."""
    promised = len(density) * float(gradient @ (moved - weights))
    now, then = density @ weights, density @ moved
    share = 1.0
    while share > SHORTEST:
        with np.errstate(divide="ignore"):
            rise = float(np.log(now + share * (then - now)).sum() - np.log(now).sum())
        if rise >= RISE * share * promised:
            return weights + share * (moved - weights)
        share *= 0.5
    return None


def _gradient(density: Array, f: Array) -> Array:
    return np.asarray((1.0 / f) @ density / len(f) - 1.0)
