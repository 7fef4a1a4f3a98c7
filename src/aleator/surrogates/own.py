"""A surface of its own for each experiment: a polynomial through the runs of that experiment."""

from __future__ import annotations

import numpy as np

from aleator.surrogates.assembly import Piece
from aleator.surrogates.basis import products
from aleator.surrogates.chosen import ROUNDING, chosen_axes, chosen_priors, patterns
from aleator.surrogates.emulator import Emulator, pairs
from aleator.surrogates.fit import Judged, Prior, first_priors, fitted, judged
from aleator.surrogates.points import (
    asymmetric,
    continued,
    evenly,
    everywhere,
    shares,
    spread,
)
from aleator.surrogates.responses import Run
from aleator.surrogates.samples import Samples
from aleator.surrogates.scales import outcomes
from aleator.surrogates.surface import Surface
from aleator.types import Array, Flags, Indices

# Of a first round all over the box the estimate can be three times too small.
CAUTION = 3.0
# Later an error that falls by more than half in one round, or seems to, is believed by half only.
DOUBT = 0.5


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
        self.ask(fresh, everyone, place)
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
        self.ask(self.axes.outward(fresh), index[allowed], place[allowed])
        if draws is None:
            missed = self._guess(members, inside, fresh) - self.samples.outcome[members, -count:]
            unseen = _root_mean_square(missed)
            self.floor[members] = np.fmax(DOUBT * self.estimate[members], unseen)
        self.stale[members] = True

    def round(self, members: Indices, growth: float) -> int:
        """Runs that each of the experiments `members` (A,) has in `sharpen`, at most."""
        return self._more(len(self._common(members, self.samples.inside(self.box))), growth)

    def _more(self, known: int, growth: float) -> int:
        return max(int(np.ceil(growth * known)), self.first - known, 1)

    def _common(self, members: Indices, inside: Samples) -> Array:
        """The points that one of the members at least has, but for those of earlier boxes."""
        common = ~np.isin(inside.x[:, 0], self.earlier[:, 0])
        return self.axes.inward(inside.x[inside.asked[members].any(axis=0) & common])

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
            constant = np.ptp(y, axis=0) <= ROUNDING * self.level[members]
            scatter = _scatter(prior, fit, at)
            self.scatter[members] = np.where(constant, 0.0, scatter)
            error = np.maximum(fit.there, left_out(fit, shares(z[runs], at)))
            if where is None:
                self.estimate[members] = error
                floor = self.floor[members]
                error = np.where(np.isinf(floor), CAUTION * error, np.maximum(error, floor))
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

    def _groups(self, members: Indices, worked: Flags) -> list[tuple[Prior, Indices, Indices]]:
        """Experiments of one prior and one set of runs."""
        alike: dict[tuple[Prior, bytes], list[int]] = {}
        for row in members.tolist():
            alike.setdefault((self.prior[row], worked[row].tobytes()), []).append(row)
        return [
            (prior, np.array(rows, dtype=np.intp), np.flatnonzero(worked[rows[0]]))
            for (prior, _), rows in alike.items()
        ]


def fitted_pieces(z: Array, values: Array, prior: list[Prior], least: int) -> list[Piece]:
    """Return the surfaces of all experiments, each with its prior, through the runs it has.

    Where these are fewer than `least` it is a constant.
    """
    n = z.shape[1]
    pieces: list[Piece] = []
    for rows, runs in patterns(np.isfinite(values)):
        if len(runs) < least:
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


def _root_mean_square(rows: Array) -> Array:
    """Return the root-mean-square (A,) of the finite numbers of each row (A, Q), or NaN."""
    count = np.isfinite(rows).sum(axis=1)
    return np.asarray(np.sqrt(np.nansum(rows**2, axis=1) / np.where(count > 0, count, np.nan)))


def _scatter(prior: Prior, fit: Judged, at: Array | None) -> Array:
    """Return the standard deviation (A,) of the surfaces at points (J, n), or over the box."""
    if at is None and not prior.logarithm:
        return np.asarray(np.sqrt((fit.coefficients[fit.indices.any(axis=1)] ** 2).sum(axis=0)))
    points = everywhere(fit.indices.shape[1]) if at is None else at
    found = prior.outcomes(fit.coefficients.T @ products(fit.indices, points))
    return np.asarray(found.std(axis=1))
