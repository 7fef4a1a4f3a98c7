"""Polynomials of all experiments together with the runs that they are fitted to."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.errors import SimulatorError
from aleator.simulators.response_functions import Run
from aleator.surrogates.fit import (
    Judged,
    Piece,
    SmoothnessPrior,
    asymmetric,
    continued,
    evenly,
    everywhere,
    first_priors,
    fitted,
    judged,
    merged,
    outcome_range,
    search,
    shares,
    spread,
)
from aleator.surrogates.samples import Samples
from aleator.surrogates.surface import Axes, Surface, outcomes, products, widened


@dataclass(frozen=True)
class SurfaceErrorSettings:
    """Settings of the estimates of surface errors. The values are chosen by judgement."""

    rounding: float = 1e-12
    """Outcomes of an experiment that differ by less than this share of their size count as
    constant."""
    least: float = 1e-10
    """A constant that is added to a mean square error before its logarithm is taken."""
    searched: int = 6
    """The number of patterns of successful runs for which priors are searched. Where runs fail,
    each experiment has its own pattern; those with any other pattern choose among the priors that
    were found for these."""
    gain: float = 0.25
    """Other coordinates are chosen only if they reduce the mean square error to this share."""
    caution: float = 3.0
    """Factor of the error estimated after the first round of runs all over the box, since that
    estimate can be three times too small."""
    doubt: float = 0.5
    """In a later round the error estimate may fall at most to this share of the one before."""
    hole: float = 0.7
    """Factor from a leave-one-out residual to an error: a run that is left out leaves a larger hole
    than there is between the runs."""
    chance: float = 8.0
    """The estimate from M runs is enlarged by 1 + this/M, because the smallest of some forty
    leave-one-out errors is too small by chance."""
    beyond: float = 3.0
    """An outcome counts as impossible only if it lies beyond the range of its surface by more than
    this many errors."""


ERRORS = SurfaceErrorSettings()


def pairs(members: Indices, count: int) -> tuple[Indices, Indices]:
    """All pairs of A experiments and `count` points: experiment and point of each (A count,)."""
    return np.repeat(members, count), np.tile(np.arange(count), len(members))


def patterns(worked: Flags) -> list[tuple[Indices, Indices]]:
    """The different rows of `worked`, the most frequent first.

    Each is given by the experiments (A,) that have it and the columns (M,) in which it is true.

    >>> patterns(np.array([[True, False], [True, True], [True, True]]))
    [(array([1, 2]), array([0, 1])), (array([0]), array([0]))]
    """
    sets, inverse, count = np.unique(worked, axis=0, return_inverse=True, return_counts=True)
    order = np.lexsort((np.arange(len(sets)), -count))
    return [(np.flatnonzero(inverse.ravel() == k), np.flatnonzero(sets[k])) for k in order.tolist()]


def chosen_axes(
    axes: Axes,
    samples: Samples,
    members: Indices,
    pool: list[SmoothnessPrior],
    where: Array | None,
    settings: SurfaceErrorSettings = ERRORS,
) -> Axes:
    """The linear or logarithmic coordinates in which surfaces have the least leave-one-out error.

    The present `axes` are kept unless others have a far smaller error, by the median over the
    experiments `members` (A,). Only members with the most frequent pattern of successful runs are
    compared. The residuals are weighted for errors at points `where` (J, n), or all over the box.
    """
    rows, runs = patterns(samples.worked[members])[0]
    y, x = samples.outcome[np.ix_(members[rows], runs)].T, samples.x[runs]
    least = (settings.rounding * np.abs(y).max(axis=0)) ** 2 + settings.least

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
    return others[best] if change[best] < np.log(settings.gain) else axes


def chosen_priors(
    z: Array,
    values: Array,
    members: Indices,
    pool: list[SmoothnessPrior],
    at: Array | None,
    settings: SurfaceErrorSettings = ERRORS,
) -> tuple[list[tuple[SmoothnessPrior, Indices, Indices]], list[SmoothnessPrior]]:
    """Choose the prior of each experiment in `members`; return groups, and priors to try next.

    A group is a prior with the experiments that use it and the runs that they have. `values`
    (N, M) are the outcomes of all experiments at z (M, n), NaN where there is none. The residuals
    are weighted for errors at points `at` (J, n), or all over the box.
    """
    found: dict[SmoothnessPrior, None] = {}
    out = []
    for k, (rows, runs) in enumerate(patterns(np.isfinite(values[members]))):
        y, share = values[np.ix_(members[rows], runs)].T, shares(z[runs], at)
        if k < settings.searched:
            priors, best, _, more = search(pool, z[runs], y, share)
            found |= dict.fromkeys(more)
        else:
            priors, best, _, _ = search([*found], z[runs], y, share, sweeps=1)
        out += [(priors[b], members[rows[best == b]], runs) for b in np.unique(best)]
    return out, [*found] or pool


class OwnSurfaces:
    """A polynomial for each of N experiments, refined in rounds of runs; every run is kept.

    `run(index (R,), x (R, n)) -> (R,)` runs the simulator and gives NaN where a run failed. `box`
    (n, 2) is the region of the parameters that the surfaces cover; `move` changes it. `sharpen`
    makes further runs of some experiments, `judge` estimates the errors of the surfaces, and
    `surface` returns the present surfaces. The points of the runs depend on these calls alone.

    `error` (N,) is the estimated root-mean-square error (infinite where there are too few runs) and
    `scatter` (N,) the standard deviation of the outcome, both at the points of the last call of
    `judge`. `level` (N,) is the size of the outcome. `rate` (N,) is the derivative of the outcome
    by its polynomial at these points, which is not one if the polynomial is that of the logarithm.
    `reach` (N,) is the error of the polynomial over the whole box.

    The first round runs every experiment at `first` points, or only at the first `few` of them, and
    `begin` runs the others. `samples` are runs that were made before, each at a point of its own.
    An error over the box is at least as large as `floor`: the misfit of the previous round's
    surface to the runs made after it, or half of that round's `estimate` if this is larger.
    """

    def __init__(
        self, run: Run, box: Array, samples: Samples, first: int, few: int | None = None
    ) -> None:
        experiments, n = len(samples.outcome), len(box)
        self.run, self.axes, self.samples = run, Axes.plain(box), samples
        self.error = np.full(experiments, np.inf)
        self.scatter, self.level, self.reach = np.zeros((3, experiments))
        self.rate = np.ones(experiments)
        self.earlier, self.first, self.begun = samples.x, first, 0
        self.pool = first_priors(n)
        self.prior = [self.pool[0]] * experiments
        self.stale = np.ones(experiments, dtype=np.bool_)
        self.estimate = np.full(experiments, np.inf)
        self.floor = np.full(experiments, np.inf)
        z = spread(first, n)
        self.start = self.axes.outward(z if few is None else asymmetric(z, few))
        self.begin(few or first)

    @property
    def runs(self) -> Indices:
        """The number of runs of each experiment, (N,), inside the box or not."""
        return self.samples.runs

    @property
    def box(self) -> Array:
        """The region of the parameters that the surfaces cover, lower and upper limits (n, 2)."""
        return self.axes.box

    @property
    def least(self) -> int:
        """The number of successful runs that a surface needs.

        It is twice the number of terms of a linear surface, or all first runs if these are fewer.
        """
        return min(2 * len(self.box) + 2, self.begun)

    def begin(self, count: int) -> None:
        """Run every experiment at those of the first `count` starting points not yet run."""
        fresh = self.start[self.begun : count]
        everyone, place = pairs(np.arange(len(self.prior)), len(fresh))
        self.run_at(fresh, everyone, place)
        self.begun, self.pool = count, first_priors(len(self.box))
        self.stale[:] = True

    def move(self, box: Array) -> None:
        """Change the region to another box; runs that lie inside it are used again."""
        self.axes = self.axes.moved(box)
        self.prior = [self.pool[0]] * len(self.error)
        self.stale[:] = True
        self.floor[:] = np.inf

    def sharpen(self, members: Indices, draws: Array | None, growth: float, most: int) -> None:
        """Run the experiments `members` (A,) at more points, the same for all of them.

        They are spread as draws (D, n) of a law are, or without draws evenly over the box. The
        number of their points in the box grows by the share `growth`, and at least to that of a
        first round. No experiment gets more than `most` runs.
        """
        inside = self.samples.inside(self.box)
        known = self._common(members, inside)
        count = self._more(len(known), growth)
        if draws is None:
            fresh = evenly(known, count)
        else:
            fresh = continued(known, self.axes.inward(draws), count)
        index, place = pairs(members, count)
        allowed = place < most - self.runs[index]
        self.run_at(self.axes.outward(fresh), index[allowed], place[allowed])
        if draws is None:
            missed = self._guess(members, inside, fresh) - self.samples.outcome[members, -count:]
            unseen = _root_mean_square(missed)
            self.floor[members] = np.fmax(ERRORS.doubt * self.estimate[members], unseen)
        self.stale[members] = True

    def round(self, members: Indices, growth: float) -> int:
        """The largest number of runs that `sharpen` makes for one of the experiments `members`."""
        return self._more(len(self._common(members, self.samples.inside(self.box))), growth)

    def _more(self, known: int, growth: float) -> int:
        return max(int(np.ceil(growth * known)), self.first - known, 1)

    def _common(self, members: Indices, inside: Samples) -> Array:
        """The points z at which at least one of the members was run, without the given samples."""
        common = ~np.isin(inside.x[:, 0], self.earlier[:, 0])
        return self.axes.inward(inside.x[inside.attempted[members].any(axis=0) & common])

    def judge(self, where: Array | None) -> None:
        """Estimate each error as the larger of the prior's expectation and the leave-one-out error.

        The errors are those at points `where` (J, n), or (None) over the box.
        """
        samples = self.samples.inside(self.box)
        enough = samples.worked.sum(axis=1) >= self.least
        self._choose(enough, samples, where)
        z, values = self.axes.inward(samples.x), samples.outcome
        at = None if where is None else self.axes.inward(where)
        self.error = np.full(len(values), np.inf)
        for prior, members, runs in self._groups(np.flatnonzero(enough), samples.worked):
            y = values[np.ix_(members, runs)].T
            fit = judged(prior, z[runs], y, at)
            self.level[members] = np.abs(y).max(axis=0)
            constant = np.ptp(y, axis=0) <= ERRORS.rounding * self.level[members]
            # Where runs fail the surface extrapolates. No scatter exceeds half of the range.
            scatter = np.minimum(_scatter(prior, fit, at), 0.5 * np.ptp(y, axis=0))
            self.scatter[members] = np.where(constant, 0.0, scatter)
            error = np.maximum(fit.there, left_out(fit, shares(z[runs], at)))
            if where is None:
                self.estimate[members] = error
                floor = self.floor[members]
                error = np.where(np.isinf(floor), ERRORS.caution * error, np.maximum(error, floor))
            self.error[members] = np.where(constant, 0.0, error)
            self.reach[members] = np.where(constant, 0.0, fit.expected)
            self.rate[members] = fit.rate

    def surface(self, converged: Flags) -> Surface:
        """The present polynomials, with the errors of the last call of `judge`."""
        samples = self.samples.inside(self.box)
        z = self.axes.inward(samples.x)
        pieces = fitted_pieces(z, samples.outcome, self.prior, self.least)
        known = np.where(np.isfinite(self.error), self.error / self.rate, 0.0)
        indices, groups = merged(pieces, known)
        logarithmic = self._logarithmic
        surface = Surface(
            axes=self.axes,
            indices=indices,
            groups=groups,
            error=self.error.copy(),
            scatter=self.scatter.copy(),
            converged=converged,
            runs=self.runs,
            failed=self.samples.failed,
            logarithmic=logarithmic,
        )
        lower, upper = outcome_range(surface, samples.outcome)
        # The range is widened by the surface's error over the whole box: an outcome counts as
        # impossible only if it lies beyond that.
        return replace(
            surface,
            lower=widened(lower, -ERRORS.beyond * self.reach, logarithmic),
            upper=widened(upper, ERRORS.beyond * self.reach, logarithmic),
        )

    @property
    def _logarithmic(self) -> Flags:
        """Which experiments have a polynomial for the logarithm of the outcome, (N,)."""
        return np.array([prior.logarithm for prior in self.prior])

    def rough(self, tolerance: float, accuracy: float) -> Flags:
        """Which experiments are not exact enough, (N,).

        Their error is above `tolerance` times the scatter and above `accuracy` times the size of
        the outcome.
        """
        return self.error > np.maximum(tolerance * self.scatter, accuracy * self.level)

    def run_at(self, x: Array, index: Indices, place: Indices) -> None:
        """Run experiment index[r] at the point x[place[r]] for r = 0..R-1, and keep the outcomes.

        Raises SimulatorError for outcomes of a wrong shape, or infinite ones.
        """
        outcome = np.asarray(self.run(index, x[place]), dtype=np.float64)
        if outcome.shape != index.shape or np.isinf(outcome).any():
            raise SimulatorError(
                f"outcomes of shape {outcome.shape} for {len(index)} runs, or infinite",
                "return one number for each run: finite, or NaN where the run failed",
            )
        self.samples = self.samples.joined(x, index, place, outcome)

    def _guess(self, members: Indices, samples: Samples, z: Array) -> Array:
        """Predicted outcomes (A, Q) of the experiments `members` (A,) at points z (Q, n)."""
        known, out = self.axes.inward(samples.x), np.empty((len(members), len(z)))
        priors = [self.prior[row] for row in members]
        pieces = fitted_pieces(known, samples.outcome[members], priors, self.least)
        for rows, indices, coefficients in pieces:
            out[rows] = coefficients.T @ products(indices, z)
        return outcomes(out, self._logarithmic[members])

    def _choose(self, enough: Flags, samples: Samples, where: Array | None) -> None:
        """Choose the coordinates of all surfaces, and priors of experiments with new runs."""
        members = np.flatnonzero(self.stale & enough)
        if members.size:
            axes = chosen_axes(self.axes, samples, members, self.pool, where)
            if axes is not self.axes:
                self.axes, self.pool = axes, first_priors(len(self.box))
                members = np.flatnonzero(enough)
            z, at = axes.inward(samples.x), None if where is None else axes.inward(where)
            groups, self.pool = chosen_priors(z, samples.outcome, members, self.pool, at)
            for prior, some, _ in groups:
                for row in some:
                    self.prior[row] = prior
        self.stale[:] = False

    def _groups(
        self, members: Indices, worked: Flags
    ) -> list[tuple[SmoothnessPrior, Indices, Indices]]:
        """Groups of experiments with the same prior and the same successful runs."""
        alike: dict[tuple[SmoothnessPrior, bytes], list[int]] = {}
        for row in members.tolist():
            alike.setdefault((self.prior[row], worked[row].tobytes()), []).append(row)
        return [
            (prior, np.array(rows, dtype=np.intp), np.flatnonzero(worked[rows[0]]))
            for (prior, _), rows in alike.items()
        ]


def fitted_pieces(z: Array, values: Array, prior: list[SmoothnessPrior], least: int) -> list[Piece]:
    """Return the polynomials of all experiments, each with its prior, fitted to its runs.

    An experiment with fewer than `least` runs gets a constant.
    """
    n = z.shape[1]
    pieces: list[Piece] = []
    for rows, runs in patterns(np.isfinite(values)):
        if len(runs) < least:
            pieces.append(_constants(rows, values[np.ix_(rows, runs)], n))
            continue
        shared: dict[SmoothnessPrior, list[int]] = {}
        for row in rows.tolist():
            shared.setdefault(prior[row], []).append(row)
        for one, some in shared.items():
            members = np.array(some, dtype=np.intp)
            pieces.append((members, *fitted(one, z[runs], values[np.ix_(members, runs)].T)))
    return pieces


def _constants(members: Indices, outcomes: Array, n: int) -> Piece:
    """Constant surfaces of experiments with too few runs: the mean of their outcomes."""
    mean = outcomes.sum(axis=1) / max(outcomes.shape[1], 1)
    return members, np.zeros((1, n), dtype=np.intp), mean[None, :]


def left_out(fit: Judged, share: Array, settings: SurfaceErrorSettings = ERRORS) -> Array:
    """Return the error (A,) that the leave-one-out residuals suggest.

    It is the root of the mean of squares, weighted by the share (M,) of the box that is nearest to
    each run, times two factors. `hole` makes it smaller: a run that is left out leaves a hole twice
    as wide as the others, so that its residual is larger than the error elsewhere. 1 + `chance`/M
    makes it larger: the prior was chosen for the least of some forty leave-one-out errors, which is
    too small by chance if the runs are few.
    """
    return np.asarray(
        np.sqrt(share @ fit.residual**2) * settings.hole * (1.0 + settings.chance / len(share))
    )


def _root_mean_square(rows: Array) -> Array:
    """Return the root-mean-square (A,) of the finite numbers of each row (A, Q), or NaN."""
    count = np.isfinite(rows).sum(axis=1)
    return np.asarray(np.sqrt(np.nansum(rows**2, axis=1) / np.where(count > 0, count, np.nan)))


def _scatter(prior: SmoothnessPrior, fit: Judged, at: Array | None) -> Array:
    """Return the standard deviation (A,) of the surfaces at points (J, n), or over the box."""
    if at is None and not prior.logarithm:
        return np.asarray(np.sqrt((fit.coefficients[fit.indices.any(axis=1)] ** 2).sum(axis=0)))
    points = everywhere(fit.indices.shape[1]) if at is None else at
    found = prior.outcomes(fit.coefficients.T @ products(fit.indices, points))
    return np.asarray(found.std(axis=1))
