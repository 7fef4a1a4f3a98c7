"""Which experiments are better with two elements, and where the border between these lies."""

from __future__ import annotations

import numpy as np
from scipy.stats import norm, qmc

from aleator.surrogates.basis import products
from aleator.surrogates.crease import Borders, border_indices
from aleator.surrogates.elements import (
    Folded,
    border_error,
    covariances,
    folded,
    residuals,
    scan,
    sharpened,
)
from aleator.surrogates.fit import Prior
from aleator.surrogates.points import fixed_shift, low_discrepancy
from aleator.threads import single_threaded
from aleator.types import Array, Indices

# Straight borders that are tried: directions, and places along each, for one, two, more parameters.
DIRECTIONS = (1, 16, 48)
PLACES = (160, 18, 14)
# Runs that these are judged by: the first points of the sequence cover the box.
SCANNED = 100
# The best of them that are improved, and by how many steps; steps of a curved border.
STARTS = 2
STEPS, CURVED = 8, 12
# Borders that are tried around the best place for a jump, of which there is no derivative.
NEARBY = 16
# What is less simple must have so much less mean square leave-one-out error: a curved border than
# a straight one, a root than a kink.
WORTH = 0.64
# Beyond these runs borders are kept as they are, and beyond these no experiment gets its first: the
# inverses get dear. In many parameters one of a few directions is too far from the true one.
MOST_RUNS = 300
MOST_WITHOUT = 120
MOST_PARAMETERS = 4


def straight(z: Array) -> Array:
    """Return straight borders (C, 1 + n) in directions spread over the half sphere, between runs.

    >>> straight(np.array([[-1.0], [0.0], [1.0]])).shape
    (160, 2)
    """
    n = z.shape[1]
    kind = min(n, len(PLACES)) - 1
    if n == 1:
        towards = np.ones((1, 1))
    elif n == 2:
        angle = np.pi * np.arange(DIRECTIONS[kind]) / DIRECTIONS[kind]
        towards = np.column_stack([np.cos(angle), np.sin(angle)])
    else:
        even = (qmc.Sobol(n, scramble=False).random_base2(7) + fixed_shift(n)) % 1.0
        normal = norm.ppf(np.clip(even, 1e-6, 1.0 - 1e-6))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        towards = normal[normal[:, 0] > 0.0][: DIRECTIONS[kind]]
    place = np.quantile(z @ towards.T, np.linspace(0.04, 0.96, PLACES[kind]), axis=0)
    slope = np.repeat(towards, len(place), axis=0)
    # the border's functions of degree one are sqrt(3) z
    return np.column_stack([-place.T.ravel(), slope / np.sqrt(3.0)])


def first_prior(n: int) -> Prior:
    """Return the prior that borders are looked for with: rough enough to bear one that is off."""
    return Prior((1.0,) * n, 2.0, 2.5, 0.25)


def later_priors(n: int) -> list[Prior]:
    """Return the priors that a surface with a known border chooses among."""
    even = (1.0,) * n
    out = [Prior(even, 2.0, s, t) for s in (2.5, 4.0, 6.0) for t in (0.0, 0.25, 0.5)]
    if n > 1:
        for i in range(n):
            for one in (0.4, 2.5):
                scale = (*even[:i], one, *even[i + 1 :])
                out.append(Prior(scale, 2.0, 4.0, 0.25))
    return out


def _centered(border: Array, basis: Array) -> Array:
    """Return borders (A, T) moved to the middle between the runs on either side, slope one."""
    n = border.shape[1] - 1
    border = border / np.sqrt(3.0) / np.linalg.norm(border[:, 1:], axis=1, keepdims=True)
    g = border @ basis[: 1 + n]
    above = np.where(g > 0.0, g, np.inf).min(axis=1)
    below = np.where(g > 0.0, -np.inf, g).max(axis=1)
    shift = np.where(np.isfinite(above) & np.isfinite(below), 0.5 * (above + below), 0.0)
    return np.column_stack([border[:, 0] - shift, border[:, 1:]])


class Search:
    """Borders for runs y (A, M) at z (M, n), and their mean square leave-one-out residuals."""

    def __init__(self, z: Array, y: Array) -> None:
        n = z.shape[1]
        self.z, self.y, self.n = z, y, n
        self.prior = np.zeros(len(y), dtype=np.intp)
        self.borders = Borders(np.zeros((len(y), len(border_indices(n)))), np.ones(len(y)))
        self.score = np.full(len(y), np.inf)

    def _take(self, rows: Indices, found: tuple[Borders, Array], worth: float = 1.0) -> None:
        """Keep what is better for experiments `rows`."""
        borders, score = found
        better = score < worth * self.score[rows]
        mine = rows[better]
        border, power = self.borders.border.copy(), self.borders.power.copy()
        border[mine] = 0.0
        border[mine, : borders.border.shape[1]] = borders.border[better]
        power[mine] = borders.power[better]
        self.borders = Borders(border, power)
        self.score[mine] = score[better]

    def from_anywhere(self, rival: Array) -> None:
        """From straight borders all over the box, where one is as good as the rival (A,)."""
        z, y = self.z[:SCANNED], self.y[:, :SCANNED]
        prior, candidates = first_prior(self.n), straight(z)
        kinks, jumps = (scan(prior, z, y, candidates, power) for power in (1.0, 0.0))
        rows = np.flatnonzero(np.minimum(kinks.min(axis=0), jumps.min(axis=0)) < rival)
        starts = [np.argsort(score, axis=0)[:STARTS, rows] for score in (kinks, jumps)]
        for start in np.concatenate(starts):
            borders = Borders(candidates[start], np.ones(len(rows)))
            self._take(rows, sharpened(prior, self.z, self.y[rows], borders, STEPS))
        rows = rows[jumps[:, rows].min(axis=0) < self.score[rows]]
        best = candidates[jumps[:, rows].argmin(axis=0)]
        self.jumps = rows, self._nearby_jumps(self.y[rows], best)

    def _with_jumps(self) -> None:
        """Take jumps where they, with what is not known of their place, leave less error."""
        rows, (borders, score) = self.jumps
        prior, y = first_prior(self.n), self.y[rows]
        wide = np.zeros((len(rows), self.borders.border.shape[1]))
        wide[:, : borders.border.shape[1]] = borders.border
        borders = Borders(wide, borders.power)
        total = []
        for some, least in ((borders, score), (self.borders[rows], self.score[rows])):
            fit = folded(prior, self.z, y, some)
            total.append(least + border_error(prior, self.z, y, some, fit) ** 2)
        taken = total[0] < WORTH * total[1]
        self.score[rows[taken]] = np.inf
        self._take(rows, (borders, np.where(taken, score, np.inf)))

    def _nearby_jumps(self, y: Array, border: Array) -> tuple[Borders, Array]:
        """The best jumps near straight borders (A, 1 + n), in the middle between the runs."""
        prior, power = first_prior(self.n), np.zeros(len(y))
        covariance = covariances(prior, self.z)
        basis = products(border_indices(self.n), self.z)
        moves = low_discrepancy(NEARBY, 1 + self.n, fixed_shift(1 + self.n))
        best, least = border, np.full(len(y), np.inf)
        for width in (0.0, 0.2, 0.1, 0.05):
            for move in moves if width else moves[:1]:
                trial = _centered(border + width * move, basis)
                factor = Borders(trial, power).factor(basis)
                score = (residuals(covariance, factor, y) ** 2).mean(axis=1)
                better = score < least
                best, least = np.where(better[:, None], trial, best), np.where(better, score, least)
            border = best
        return Borders(best, power), least

    def from_known(self, rows: Indices, borders: Borders) -> None:
        """From borders that were found through fewer runs."""
        soft = borders.power > 0.0
        rows, borders = rows[soft], borders[soft]
        found = sharpened(first_prior(self.n), self.z, self.y[rows], borders, CURVED)
        self._take(rows, found)

    def refine(self) -> list[Prior]:
        """Curve the borders, try roots, and choose a prior for each experiment."""
        rows = np.flatnonzero(np.isfinite(self.score))
        prior, y = first_prior(self.n), self.y[rows]
        if self.n > 1:
            bent = Borders(self.borders.border[rows], np.ones(len(rows)))
            self._take(rows, sharpened(prior, self.z, y, bent, CURVED), WORTH)
        for side in (1.0, -1.0):
            root = Borders(side * self.borders.border[rows], np.full(len(rows), 0.5))
            self._take(rows, sharpened(prior, self.z, y, root, STEPS), WORTH)
        self._with_jumps()
        priors = later_priors(self.n)
        basis = products(border_indices(self.n), self.z)
        factor = self.borders[rows].factor(basis)
        tried = [residuals(covariances(one, self.z), factor, y) for one in priors]
        score = (np.array(tried) ** 2).mean(axis=2)
        best = score.argmin(axis=0)
        self.score[rows] = score.min(axis=0)
        for k in np.unique(best):
            mine = rows[(best == k) & (self.borders.power[rows] > 0.0)]
            found = sharpened(priors[k], self.z, self.y[mine], self.borders[mine], STEPS)
            self._take(mine, found)
        self.prior[rows] = best
        return [priors[k] for k in self.prior]


class Creases:
    """What is known of the borders of all experiments after each round of runs."""

    def __init__(self, experiments: int, n: int) -> None:
        self.borders = Borders(
            np.zeros((experiments, len(border_indices(n)))), np.ones(experiments)
        )
        self.prior = [first_prior(n)] * experiments
        self.known = np.zeros(experiments, dtype=np.bool_)
        self.chosen = np.zeros(experiments, dtype=np.bool_)
        self.last = np.full(experiments, np.inf)

    @single_threaded
    def found(self, rows: Indices, z: Array, y: Array, rival: Array) -> Indices:
        """Look for borders of experiments `rows` with runs y (A, M); return who has one, of A.

        `rival` (A,) is the mean square leave-one-out residual of one polynomial.
        """
        if z.shape[1] > MOST_PARAMETERS:
            return np.empty(0, dtype=np.intp)
        if len(z) > MOST_RUNS:
            return np.flatnonzero(self.chosen[rows])
        if len(z) > MOST_WITHOUT:
            tried = np.flatnonzero(self.chosen[rows])
            found = self._improve(rows[tried], z, y[tried], rival[tried])
            return tried[found]
        return self._improve(rows, z, y, rival)

    def _improve(self, rows: Indices, z: Array, y: Array, rival: Array) -> Indices:
        if not rows.size:
            return np.empty(0, dtype=np.intp)
        search = Search(z, y)
        search.from_anywhere(rival)
        known = np.flatnonzero(self.known[rows])
        if known.size:
            search.from_known(known, self.borders[rows[known]])
        priors = search.refine()
        found = np.flatnonzero(search.score < WORTH * rival)
        border, power = self.borders.border.copy(), self.borders.power.copy()
        border[rows[found]], power[rows[found]] = (
            search.borders.border[found], search.borders.power[found],
        )  # fmt: skip
        self.borders = Borders(border, power)
        for a in found:
            self.prior[rows[a]] = priors[a]
        self.known[rows] = search.score < WORTH * rival
        return found

    def folded(self, rows: Indices, z: Array, y: Array) -> list[tuple[Indices, Folded]]:
        """Surfaces of two elements of experiments `rows`: which of them, and the surfaces."""
        shared: dict[Prior, list[int]] = {}
        for a, row in enumerate(rows):
            shared.setdefault(self.prior[row], []).append(a)
        return [
            (np.array(some), folded(prior, z, y[some], self.borders[rows[some]]))
            for prior, some in shared.items()
        ]

    def doubted(self, rows: Indices, estimate: Array, doubt: float) -> Array:
        """The estimated errors (A,), an error that falls fast believed by a part only."""
        out = np.maximum(estimate, doubt * self.last[rows])
        self.last[rows] = estimate
        return np.asarray(out)
