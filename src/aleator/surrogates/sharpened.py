"""Surfaces that are made exact where a law has its mass, a little more in every round."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from aleator.surrogates.assembly import degrees_of, merged, outcome_range
from aleator.surrogates.basis import products
from aleator.surrogates.fit import Prior, first_priors, judged
from aleator.surrogates.masked import (
    checked_outcomes,
    chosen_priors,
    fitted_pieces,
    least_runs,
    left_out,
)
from aleator.surrogates.points import continued, shares, spread
from aleator.surrogates.samples import Samples
from aleator.surrogates.surface import Surface
from aleator.types import Array, Flags, Indices

Run = Callable[[Indices, Array], Array]

# Outcomes that differ by less than this part of their size do not depend on the parameters.
ROUNDING = 1e-12


class Sharpened:
    """The surfaces of N experiments after each round of runs; none of their runs is ever lost.

    `run(index (R,), x (R, n)) -> (R,)` gives NaN where a run failed. `box` (n, 2) is where the
    surfaces are wanted: `move` takes it elsewhere, and the runs inside serve there too. `sharpen`
    makes runs of some experiments where draws of a law lie, `judge` tells how exact the surfaces
    are at points of a law, and `surface` gives them as they are. All points are determined by
    these calls: no run that somebody else has made changes where the next one is. Runs may be
    `given` to begin with, at points that differ from experiment to experiment.

    `error` (N,) is the estimated root-mean-square error and `scatter` (N,) the standard deviation
    of the outcome, both at the points that were judged last; `level` (N,) is the outcome's size and
    `reach` (N,) the error over all the box.
    """

    def __init__(
        self, run: Run, box: Array, experiments: int, given: Samples | None = None
    ) -> None:
        n = len(box)
        self.run = run
        self.every = given or Samples.none(experiments, n)
        self.given = self.every.x
        self.pool = first_priors(n)
        self.error = np.full(experiments, np.inf)
        self.scatter, self.level, self.reach = np.zeros((3, experiments))
        self.move(box)
        self._ask(np.arange(experiments), self._real(spread(first_runs(n), n)))

    @property
    def runs(self) -> Indices:
        """Runs made of each experiment, (N,), wherever they lie."""
        return np.asarray(self.every.asked.sum(axis=1), dtype=np.intp)

    def move(self, box: Array) -> None:
        """Take the surfaces to another box, with the runs that lie inside."""
        self.box = box
        self.samples = self.every.inside(box)
        self.prior = [self.pool[0]] * len(self.error)
        self.stale = np.ones(len(self.error), dtype=np.bool_)

    def sharpen(self, members: Indices, draws: Array, growth: float) -> None:
        """Run experiments `members` (A,) at more points among draws (D, n) of a law.

        As many more as make the points that these have in the box grow by `growth`, and at least
        as many as a first round has.
        """
        x = self.samples.x
        common = ~np.isin(x[:, 0], self.given[:, 0])
        known = x[self.samples.asked[members].any(axis=0) & common]
        count = max(int(np.ceil(growth * len(known))), first_runs(len(self.box)) - len(known), 1)
        self._ask(members, self._real(continued(self._unit(known), self._unit(draws), count)))

    def judge(self, where: Array, noise_sd: float = 0.0) -> None:
        """Estimate the errors at points (J, n) of a law; an infinite one where runs are lacking.

        The scatter that they are compared with is that of the outcome with its noise.
        """
        z, at, values = self._unit(self.samples.x), self._unit(where), self.samples.outcome
        count = np.isfinite(values).sum(axis=1)
        self.error = np.full(len(values), np.inf)
        self._choose_priors(np.flatnonzero(self.stale & (count >= least_runs(len(self.box)))), z)
        for prior, members, runs in self._groups(count):
            y = values[np.ix_(members, runs)].T
            fit = judged(prior, z[runs], y, at)
            outcome = fit.coefficients.T @ products(fit.indices, at)
            self.scatter[members] = np.hypot(outcome.std(axis=1), noise_sd)
            self.level[members] = np.abs(y).max(axis=0)
            error = np.maximum(fit.there, left_out(fit, shares(z[runs], at)))
            constant = np.ptp(y, axis=0) <= ROUNDING * self.level[members]
            self.error[members] = np.where(constant, 0.0, error)
            self.reach[members] = np.where(constant, 0.0, fit.expected)

    def rough(self, tolerance: float, accuracy: float) -> Flags:
        """Whose error is above `tolerance` of its scatter and `accuracy` of its size."""
        return self.error > np.maximum(tolerance * self.scatter, accuracy * self.level)

    def surface(self, converged: Flags) -> Surface:
        """The surfaces as they are, with the errors that were judged last."""
        z, known = self._unit(self.samples.x), np.isfinite(self.error)
        pieces = fitted_pieces(z, self.samples.outcome, self.prior)
        error = np.where(known, self.error, 0.0)
        indices, groups, terms = merged(pieces, error)
        surface = Surface(
            box=self.box,
            indices=indices,
            groups=groups,
            error=self.error.copy(),
            scatter=self.scatter.copy(),
            converged=converged,
            runs=self.runs,
            failed=self.runs - self.every.worked.sum(axis=1),
            degrees=degrees_of(indices, terms, error),
        )
        lower, upper = outcome_range(surface, self.samples.outcome)
        # an outcome is out of reach only if it is so beyond the surface's error over all the box
        return replace(surface, lower=lower - 3.0 * self.reach, upper=upper + 3.0 * self.reach)

    def _choose_priors(self, members: Indices, z: Array) -> None:
        if members.size:
            groups, self.pool = chosen_priors(z, self.samples.outcome, members, self.pool)
            for prior, some, _ in groups:
                for row in some:
                    self.prior[row] = prior
        self.stale[members] = False

    def _groups(self, count: Indices) -> list[tuple[Prior, Indices, Indices]]:
        """Experiments of one prior and one set of runs, of which there are enough."""
        shared: dict[tuple[Prior, bytes], list[int]] = {}
        worked = self.samples.worked
        for row in np.flatnonzero(count >= least_runs(len(self.box))).tolist():
            shared.setdefault((self.prior[row], worked[row].tobytes()), []).append(row)
        return [
            (prior, np.array(rows, dtype=np.intp), np.flatnonzero(worked[rows[0]]))
            for (prior, _), rows in shared.items()
        ]

    def _ask(self, members: Indices, x: Array) -> None:
        index = np.repeat(members, len(x))
        outcome = self.run(index, np.tile(x, (len(members), 1)))
        found = checked_outcomes(outcome, (len(members), len(x)))
        self.every = self.every.joined(x, members, found)
        self.samples = self.every.inside(self.box)
        self.stale[members] = True

    def _unit(self, x: Array) -> Array:
        low, high = self.box.T
        return np.asarray((2.0 * x - low - high) / (high - low))

    def _real(self, z: Array) -> Array:
        low, high = self.box.T
        return np.asarray(np.clip(0.5 * (low + high) + 0.5 * (high - low) * z, low, high))


def first_runs(n: int) -> int:
    """Runs of an experiment in n parameters before anything is known of its law."""
    return 3 * n + 6
