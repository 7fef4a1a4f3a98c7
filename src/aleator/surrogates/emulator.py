"""Surfaces of all experiments, each with runs of its own.

Two kinds: a polynomial for each experiment (module `own`), and one Gaussian process over conditions
and parameters for all of them (module `shared`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
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
    """How errors of surfaces are estimated and compared; by judgement."""

    rounding: float = 1e-12
    """Outcomes that differ by less than this part of their size do not depend on the parameters."""
    least: float = 1e-10
    """Mean square error that is compared with another, at least."""
    searched: int = 6
    """Sets of runs that worked, for which priors are searched; experiments with any other set (runs
    that fail here and there, differently in each) choose among the priors of these."""
    gain: float = 0.25
    """Share of the mean square error that other axes have to leave: what is about as good is left
    alone."""
    caution: float = 3.0
    """Of a first round all over the box the estimate can be three times too small."""
    doubt: float = 0.5
    """Later an error that falls by more than half in one round, or seems to, is believed by half
    only."""
    hole: float = 0.7
    """Error over the leave-one-out residual, as a run that is left out leaves a hole."""
    chance: float = 8.0
    """Runs by which the estimate is larger: the least of some forty errors is too small by
    chance."""
    beyond: float = 3.0
    """Errors by which an outcome may lie beyond the range of its surface."""


ERRORS = SurfaceErrorSettings()


class Emulator(ABC):
    """Response surfaces of N experiments, refined in rounds of runs; every run is kept.

    `run(index (R,), x (R, n)) -> (R,)` gives NaN where a run failed. `box` (n, 2) is the
    region that the surfaces cover: `move` changes it. `sharpen` makes runs of some experiments,
    `judge` estimates how exact the surfaces are, and `surface` gives them as they are. All points
    are determined by these calls: no run that somebody else has made changes where the next one is.

    `error` (N,) is the estimated root-mean-square error, infinite where runs are lacking, and
    `scatter` (N,) the standard deviation of the outcome, both at the points that were judged last;
    `level` (N,) is the outcome's size; `rate` (N,) is how much the outcome changes there for a
    change of the polynomial, and `reach` (N,) the error of that over all the box.
    """

    def __init__(self, run: Run, box: Array, samples: Samples) -> None:
        experiments = len(samples.outcome)
        self.run, self.axes, self.samples = run, Axes.plain(box), samples
        self.error = np.full(experiments, np.inf)
        self.scatter, self.level, self.reach = np.zeros((3, experiments))
        self.rate = np.ones(experiments)

    @property
    def runs(self) -> Indices:
        """Runs made of each experiment, (N,), wherever they lie."""
        return self.samples.runs

    @property
    def box(self) -> Array:
        """The region that the surfaces cover, (n, 2)."""
        return self.axes.box

    @abstractmethod
    def move(self, box: Array) -> None:
        """Take the surfaces to another box."""

    @abstractmethod
    def round(self, members: Indices, growth: float) -> int:
        """Runs that each of the experiments `members` (A,) has in `sharpen`, at most.

        Some of them have no more.
        """

    @abstractmethod
    def sharpen(self, members: Indices, draws: Array | None, growth: float, most: int) -> None:
        """Run experiments `members` (A,) at more points among draws (D, n) of a law.

        Without draws the points are spread evenly over the box. The runs of an experiment grow by
        about `growth`, to `most` at the most.
        """

    @abstractmethod
    def judge(self, where: Array | None) -> None:
        """Estimate the errors at points (J, n) of a law, or over the box."""

    @abstractmethod
    def surface(self, converged: Flags) -> Surface:
        """The surfaces as they are, with the errors that were judged last."""

    def rough(self, tolerance: float, accuracy: float) -> Flags:
        """Whose error is above `tolerance` of its scatter and `accuracy` of its size."""
        return self.error > np.maximum(tolerance * self.scatter, accuracy * self.level)

    def run_at(self, x: Array, index: Indices, place: Indices) -> None:
        """Run experiments `index` (R,) at the points x[place], for x (Q, n)."""
        outcome = np.asarray(self.run(index, x[place]), dtype=np.float64)
        if outcome.shape != index.shape or np.isinf(outcome).any():
            raise SimulatorError(
                f"outcomes of shape {outcome.shape} for {len(index)} runs, or infinite",
                "return one number for each run: finite, or NaN where the run failed",
            )
        self.samples = self.samples.joined(x, index, place, outcome)

    def _surface(
        self,
        pieces: Iterable[Piece],
        error: Array,
        converged: Flags,
        outcomes: Array,
        logarithmic: Flags,
    ) -> Surface:
        """The polynomials of `pieces`, of the errors (N,); `outcomes` (N, M) widen their range."""
        known = np.where(np.isfinite(error), error / self.rate, 0.0)
        indices, groups = merged(pieces, known)
        surface = Surface(
            axes=self.axes,
            indices=indices,
            groups=groups,
            error=error.copy(),
            scatter=self.scatter.copy(),
            converged=converged,
            runs=self.runs,
            failed=self.samples.failed,
            logarithmic=logarithmic,
        )
        lower, upper = outcome_range(surface, outcomes)
        # an outcome is out of reach only if it is so beyond the surface's error over all the box
        return replace(
            surface,
            lower=widened(lower, -ERRORS.beyond * self.reach, logarithmic),
            upper=widened(upper, ERRORS.beyond * self.reach, logarithmic),
        )


def pairs(members: Indices, count: int) -> tuple[Indices, Indices]:
    """Each of A experiments with each of `count` points: experiments (A count,), points alike."""
    return np.repeat(members, count), np.tile(np.arange(count), len(members))


def patterns(worked: Flags) -> list[tuple[Indices, Indices]]:
    """Rows (A,) and columns (M,) of each different row of `worked`, the most frequent first.

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
    """Axes, linear or logarithmic, in which runs that are left out are missed by far less, by the
    median over the `members` (A,).

    Only members with the most frequent set of runs are compared. Scales are compared at points
    `where` (J, n), or all over the box.
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
    """Return (prior, experiments, runs) that go together, and the pool of priors to go on with.

    `values` (N, M) of all experiments at z (M, n), NaN where there is none; only for `members`.
    Scales are compared at points `at` (J, n), or all over the box.
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


class OwnSurfaces(Emulator):
    """A polynomial for each experiment, made exact where it is judged (see `Emulator`).

    `first` points are run to begin with, or at first only `few` of them: `begin` runs the others.
    `samples` are runs that were made before, each at a point of its own. Over the box an error is
    no less than the misfit of the surface of the round before to the runs that it had not seen
    (`floor`), nor than half of its `estimate`.
    """

    def __init__(
        self, run: Run, box: Array, samples: Samples, first: int, few: int | None = None
    ) -> None:
        super().__init__(run, box, samples)
        experiments, n = len(samples.outcome), len(box)
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
    def least(self) -> int:
        """Runs that must work before there is a surface: twice a linear one's, or all of few."""
        return min(2 * len(self.box) + 2, self.begun)

    def begin(self, count: int) -> None:
        """Run everyone at the points up to `count` of those that are to begin with."""
        fresh = self.start[self.begun : count]
        everyone, place = pairs(np.arange(len(self.prior)), len(fresh))
        self.run_at(fresh, everyone, place)
        self.begun, self.pool = count, first_priors(len(self.box))
        self.stale[:] = True

    def move(self, box: Array) -> None:
        """Take the surfaces to another box, with the runs that lie inside."""
        self.axes = self.axes.moved(box)
        self.prior = [self.pool[0]] * len(self.error)
        self.stale[:] = True
        self.floor[:] = np.inf

    def sharpen(self, members: Indices, draws: Array | None, growth: float, most: int) -> None:
        """Run experiments `members` (A,) at more points, the same for all of them.

        As many more as make the points that these have in the box grow by `growth`, and at least
        as many as a first round has.
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
        """Runs that each of the experiments `members` (A,) has in `sharpen`, at most."""
        return self._more(len(self._common(members, self.samples.inside(self.box))), growth)

    def _more(self, known: int, growth: float) -> int:
        return max(int(np.ceil(growth * known)), self.first - known, 1)

    def _common(self, members: Indices, inside: Samples) -> Array:
        """The points that one of the members at least has, but for those of earlier boxes."""
        common = ~np.isin(inside.x[:, 0], self.earlier[:, 0])
        return self.axes.inward(inside.x[inside.attempted[members].any(axis=0) & common])

    def judge(self, where: Array | None) -> None:
        """Estimate the errors by what the priors expect, and by leave-one-out residuals."""
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
            # where runs fail a surface is an extrapolation: no scatter is above half of the range
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
        """The surfaces as they are, with the errors that were judged last."""
        samples = self.samples.inside(self.box)
        z = self.axes.inward(samples.x)
        pieces = fitted_pieces(z, samples.outcome, self.prior, self.least)
        return self._surface(pieces, self.error, converged, samples.outcome, self._logarithmic)

    @property
    def _logarithmic(self) -> Flags:
        """Whose polynomial is one of the logarithm, (N,)."""
        return np.array([prior.logarithm for prior in self.prior])

    def _guess(self, members: Indices, samples: Samples, z: Array) -> Array:
        """Outcomes (A, Q) at points z (Q, n) by the surfaces of members (A,) through `samples`."""
        known, out = self.axes.inward(samples.x), np.empty((len(members), len(z)))
        priors = [self.prior[row] for row in members]
        pieces = fitted_pieces(known, samples.outcome[members], priors, self.least)
        for rows, indices, coefficients in pieces:
            out[rows] = coefficients.T @ products(indices, z)
        return outcomes(out, self._logarithmic[members])

    def _choose(self, enough: Flags, samples: Samples, where: Array | None) -> None:
        """Choose axes for all, and priors of the experiments whose runs are new."""
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
        """Experiments of one prior and one set of runs."""
        alike: dict[tuple[SmoothnessPrior, bytes], list[int]] = {}
        for row in members.tolist():
            alike.setdefault((self.prior[row], worked[row].tobytes()), []).append(row)
        return [
            (prior, np.array(rows, dtype=np.intp), np.flatnonzero(worked[rows[0]]))
            for (prior, _), rows in alike.items()
        ]


def fitted_pieces(z: Array, values: Array, prior: list[SmoothnessPrior], least: int) -> list[Piece]:
    """Return the surfaces of all experiments, each with its prior, through the runs it has.

    Where these are fewer than `least` it is a constant.
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
    """Surfaces of experiments with hardly a run: the mean of what there is."""
    mean = outcomes.sum(axis=1) / max(outcomes.shape[1], 1)
    return members, np.zeros((1, n), dtype=np.intp), mean[None, :]


def left_out(fit: Judged, share: Array, settings: SurfaceErrorSettings = ERRORS) -> Array:
    """Return the error (A,) by the leave-one-out residuals, weighted by each run's share.

    A run left out of well-spread ones leaves a hole twice as wide as any other, so its residual is
    larger than the error elsewhere: hence `hole`. The least of some forty leave-one-out errors is
    too small by chance when the runs are few: hence 1 + `chance`/M.
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
