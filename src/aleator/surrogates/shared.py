"""One surface for all experiments: the conditions are further inputs, and every run tells of all.

Each experiment is run at points of its own; a Gaussian process over conditions and parameters
(module `kriging`) goes through the runs of all of them. For each experiment it is then a
function of the parameters alone, of which the polynomial is taken: a `Surface` like any other.
"""

from __future__ import annotations

import numpy as np

from aleator.surrogates.axes import Axes
from aleator.surrogates.basis import ball, products
from aleator.surrogates.emulator import Emulator, pairs
from aleator.surrogates.kriging import Covariance, Posterior, learned
from aleator.surrogates.points import (
    clustered,
    fixed_shift,
    low_discrepancy,
)
from aleator.surrogates.responses import Run
from aleator.surrogates.samples import Samples
from aleator.surrogates.surface import Surface
from aleator.types import Array, Flags, Indices

# Runs of all experiments together that the first round has, where the experiments are few.
FIRST = 800
# Runs that one fit may have: its cost is their number cubed.
MOST = 4000
# Runs from which the covariance is learned, and steps of that: at first, and later.
LEARNED = 500
STEPS = (60, 20)
# Polynomial terms for 1, 2, 3 and more parameters, and points for each term.
TERMS = (40, 136, 220, 250)
POINTS = 2.5
# Weight of the size of the polynomials' terms beside one point.
RIDGE = 0.01
# Points an experiment at which the error is expected, and at which polynomials are compared.
JUDGED, COMPARED = 16, 64
# Set on the wet clutch, where the true errors then stay below the estimate in the share that the
# tests hold.
CAUTION = 1.5
# Share of the runs that are spread over the box where those of a law are preferred.
ELSEWHERE = 0.1


class SharedSurface(Emulator):
    """One Gaussian process for all experiments, exact where it is judged (see `Emulator`).

    `conditions` (N, d) in [-1, 1] are those of the experiments (see `features`).

    Cost besides the runs: M^3 operations for M runs of all experiments together, and N M times a
    few hundred for the polynomials; 108 experiments of 20 runs some ten seconds a round.
    """

    def __init__(self, run: Run, box: Array, conditions: Array) -> None:
        experiments, n = len(conditions), len(box)
        super().__init__(run, box, Samples.none(experiments, n))
        self.conditions = conditions
        self.shift = np.random.default_rng(0).random((experiments, n))
        self.covariance = Covariance.first(conditions.shape[1] + n, n)
        self.where = self.axes.outward(low_discrepancy(COMPARED, n, fixed_shift(n)))
        self._place(np.arange(experiments), first_shared_runs(experiments, n), MOST, None)
        self.posterior = self._learned(STEPS[0])
        self.stale = False

    @staticmethod
    def fits(experiments: int, n: int) -> bool:
        """Whether one fit takes the first runs and as many again."""
        return 2 * experiments * first_shared_runs(experiments, n) <= MOST

    def move(self, box: Array) -> None:
        """Take the surfaces to another box; runs outside still tell of it."""
        self.axes, self.stale = Axes.plain(box), True

    def round(self, members: Indices, growth: float) -> int:
        """Runs that each of the experiments `members` (A,) has in `sharpen`, at most."""
        return int(np.ceil(growth * self.runs[members].max(initial=0)))

    def sharpen(self, members: Indices, draws: Array | None, growth: float, most: int) -> None:
        """Run experiments `members` (A,) at points of their own, spread as the draws are."""
        room = max((MOST - int(self.runs.sum())) // len(members), 1)
        more = int(np.ceil(growth * self.runs[members].mean()))
        self._place(members, min(more, room), most, draws)
        self.stale = True

    def judge(self, where: Array | None) -> None:
        """Estimate the errors by what the process leaves possible, times its surprise so far."""
        if self.stale:
            self.posterior, self.stale = self._learned(STEPS[1]), False
        factor = CAUTION * self._surprise()
        everywhere = low_discrepancy(COMPARED, len(self.box), fixed_shift(len(self.box)))
        points = self.axes.outward(everywhere) if where is None else where
        self.where = points[:COMPARED]
        self.error = factor * self._left(self.axes.inward(points[:JUDGED]))
        self.reach = np.maximum(factor * self._left(everywhere[:JUDGED]), self.error)
        self.scatter = self._expected().std(axis=1)
        index, _, y = self.samples.listed
        self.level = np.zeros(len(self.conditions))
        np.maximum.at(self.level, index, np.abs(y))
        self.error[~self.samples.worked.any(axis=1)] = np.inf

    def surface(self, converged: Flags) -> Surface:
        """The polynomials through the process, with the errors that were judged last."""
        indices, coefficients = self._polynomials()
        basis = products(indices, self.axes.inward(self.where))
        missed = coefficients.T @ basis - self._expected()
        error = np.hypot(self.error, np.sqrt((missed**2).mean(axis=1)))
        everyone = np.arange(len(error))
        nothing = np.full((len(error), 1), np.nan)
        plain = np.zeros(len(error), dtype=np.bool_)
        return self._surface([(everyone, indices, coefficients)], error, converged, nothing, plain)

    def _place(self, members: Indices, count: int, most: int, draws: Array | None) -> None:
        """Run each of the members at `count` more points of a sequence of its own."""
        index, place = pairs(members, count)
        n, before = len(self.box), self.runs
        even = 0.5 * (low_discrepancy(int(before[members].max()) + count, n, np.zeros(n)) + 1.0)
        even = (even[before[index] + place] + self.shift[index]) % 1.0
        x = self._over_box(even) if draws is None else self._over_law(even, draws)
        allowed = np.flatnonzero(place < most - before[index])
        self.ask(x[allowed], index[allowed], np.arange(len(allowed)))

    def _over_box(self, even: Array) -> Array:
        """Points x (R, n) that gather at the faces of the box, for even ones in [0, 1]."""
        return self.axes.outward(clustered(2.0 * even - 1.0))

    def _over_law(self, even: Array, draws: Array) -> Array:
        """Points x (R, n) spread as the draws are, and some over the box."""
        low, high = self.box.T
        others = np.linspace(low, high, int(ELSEWHERE * len(draws)))
        pool = np.vstack([np.clip(draws, low, high), others])
        return np.column_stack([np.quantile(pool[:, i], even[:, i]) for i in range(len(low))])

    def _learned(self, steps: int) -> Posterior:
        """The process given all runs; its covariance is learned on from where it was."""
        index, x, y = self.samples.listed
        u = np.hstack([self.conditions[index], self.axes.inward(x)])
        some = np.sort(np.random.default_rng(len(u)).permutation(len(u))[:LEARNED])
        self.covariance = learned(self.covariance, index[some], u[some], y[some], steps)
        return Posterior.of(self.covariance, index, u, y)

    def _surprise(self) -> Array:
        """How much larger the leave-one-out residuals (N,) are than the process expects.

        Those of the experiment, or those of the experiments like it, whichever are worse.
        """
        experiments, n = len(self.conditions), len(self.box)
        known = self.posterior
        seen = np.bincount(known.index, minlength=experiments)
        squares = np.bincount(known.index, known.surprise**2, minlength=experiments)
        alike = self.covariance.likeness(np.hstack([self.conditions, np.zeros((experiments, n))]))
        pooled = (alike @ squares) / np.maximum(alike @ seen, 1e-9)
        return np.asarray(np.sqrt(np.maximum((1.0 + squares) / (1.0 + seen), pooled)))

    def _expected(self) -> Array:
        """Expected outcomes (N, J) at the points that were judged last."""
        return self._mean(self.axes.inward(self.where))

    def _mean(self, z: Array) -> Array:
        """Expected outcomes (N, J) at points z (J, n)."""
        parts = []
        for one, condition in enumerate(self.conditions):
            u = np.hstack([np.tile(condition, (len(z), 1)), z])
            parts.append(self.posterior.mean(np.full(len(z), one), u))
        return np.array(parts)

    def _left(self, z: Array) -> Array:
        """Root-mean-square (N,) over points z (J, n) of what the runs leave possible."""
        experiments = len(self.conditions)
        index = np.repeat(np.arange(experiments), len(z))
        u = np.hstack([self.conditions[index], np.tile(z, (experiments, 1))])
        left = self.posterior.deviation(index, u).reshape(experiments, -1)
        return np.asarray(np.sqrt((left**2).mean(axis=1)))

    def _polynomials(self) -> tuple[Indices, Array]:
        """Indices (P, n) and coefficients (P, N): least squares over the box, more where judged."""
        n = len(self.box)
        indices, size = ball((1.0,) * n, 2.0, TERMS[min(n, len(TERMS)) - 1])
        even = 0.5 * (low_discrepancy(int(POINTS * len(indices)), n, fixed_shift(n)) + 1.0)
        x = np.vstack([self._over_box(even), self._over_law(even, self.where)])
        z = self.axes.inward(x)
        y = self._mean(z).T - self.posterior.level
        # Keeps what the points do not determine, in the corners of many parameters, from growing.
        ridge = np.diag(RIDGE * (1.0 + size**2))
        matrix = np.vstack([products(indices, z).T, ridge])
        fitted = np.linalg.lstsq(matrix, np.vstack([y, np.zeros((len(size), y.shape[1]))]))[0]
        fitted[0] += self.posterior.level
        return indices, np.asarray(fitted)


def first_shared_runs(experiments: int, n: int) -> int:
    """Runs an experiment to begin with: fewer where many experiments tell of each other.

    >>> first_shared_runs(108, 2), first_shared_runs(1000, 2)
    (8, 2)
    """
    return int(np.clip(FIRST // experiments + 1, 2, 2 * n + 4))
