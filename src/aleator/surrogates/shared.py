"""One surface for all experiments: the conditions are further inputs, and every run tells of all.

Each experiment is run at points of its own; a Gaussian process over conditions and parameters
(module `joint`) goes through the runs of all of them. For each experiment it is then a function of
the parameters alone, of which the polynomial is taken: the result is a `Surface` like any other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aleator.surrogates.assembly import degrees_of, merged, outcome_range
from aleator.surrogates.basis import ball, products
from aleator.surrogates.joint import Covariance, Posterior, learned
from aleator.surrogates.masked import checked_outcomes
from aleator.surrogates.points import CLUSTER, fixed_shift, low_discrepancy
from aleator.surrogates.refinement import Run
from aleator.surrogates.samples import Samples
from aleator.surrogates.sharpened import Sharpened
from aleator.surrogates.surface import Surface
from aleator.types import Array, Flags, Indices

# Runs of all experiments together that the first round has, where the experiments are few.
FIRST = 800
# Runs that one fit may have: its cost is their number cubed.
MOST = 4000
# Runs an experiment with which it may as well have its own surface.
EACH = 40
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


@dataclass(frozen=True, eq=False)
class Made:
    """Runs that were made: experiments `index` (R,), parameters x (R, n), outcomes y (R,)."""

    index: Indices
    x: Array
    y: Array

    def joined(self, index: Indices, x: Array, y: Array) -> Made:
        """With more runs."""
        return Made(
            np.concatenate([self.index, index]),
            np.vstack([self.x, x]),
            np.concatenate([self.y, y]),
        )

    @property
    def worked(self) -> Made:
        """Those with an outcome."""
        good = np.isfinite(self.y)
        return Made(self.index[good], self.x[good], self.y[good])


class Shared:
    """The shared surface after each round of runs; none of its runs is ever lost.

    `run(index (R,), x (R, n)) -> (R,)` gives NaN where a run failed; `conditions` (N, d) in [-1, 1]
    are those of the experiments (see `features`). `box` (n, 2) is where the surfaces are wanted,
    `move` takes them elsewhere. `sharpen` makes runs of some experiments where draws of a law lie,
    `judge` tells how exact the surfaces are at points of a law, `surface` gives them as they are.

    `error` (N,) is the estimated root-mean-square error and `scatter` (N,) the standard deviation
    of the surface, both at the points that were judged last; `level` (N,) is the outcome's size and
    `reach` (N,) the error over all the box. Where no run of an experiment worked `error` is
    infinite.

    Cost besides the runs: M^3 operations for M runs of all experiments together, and N M times a
    few hundred for the polynomials; 108 experiments of 20 runs some ten seconds a round.
    """

    def __init__(self, run: Run, box: Array, conditions: Array, seed: int = 0) -> None:
        experiments, n = len(conditions), len(box)
        self.run, self.box, self.conditions = run, box, conditions
        self.made = Made(np.empty(0, dtype=np.intp), np.empty((0, n)), np.empty(0))
        self.shift = np.random.default_rng(seed).random((experiments, n))
        self.covariance = Covariance.first(conditions.shape[1] + n, n)
        self.steps, self.stale = STEPS[0], True
        self.error = np.full(experiments, np.inf)
        self.scatter, self.level, self.reach = np.zeros((3, experiments))
        self._ask(np.arange(experiments), first_runs(experiments, n), None)

    @property
    def runs(self) -> Indices:
        """Runs made of each experiment, (N,), wherever they lie."""
        return np.bincount(self.made.index, minlength=len(self.conditions))

    @staticmethod
    def fits(experiments: int, n: int) -> bool:
        """Whether one fit takes the first runs and as many again."""
        return 2 * experiments * first_runs(experiments, n) <= MOST

    @property
    def full(self) -> bool:
        """Whether there are all the runs that one fit takes."""
        return len(self.made.y) + len(self.conditions) > min(MOST, EACH * len(self.conditions))

    def own_surfaces(self) -> Sharpened:
        """A surface for each experiment instead, from the runs that it has."""
        members, x, y = self.made.index, self.made.x, self.made.y
        outcome = np.full((len(self.conditions), len(y)), np.nan)
        asked = np.zeros(outcome.shape, dtype=np.bool_)
        column = np.arange(len(y))
        outcome[members, column], asked[members, column] = y, True
        return Sharpened(self.run, self.box, len(outcome), Samples(x, outcome, asked))

    def move(self, box: Array) -> None:
        """Take the surfaces to another box; runs outside still tell of it."""
        self.box, self.stale = box, True

    def sharpen(self, members: Indices, draws: Array, growth: float) -> None:
        """Run experiments `members` (A,) at more points among draws (D, n) of a law.

        As many more of each as make their runs grow by `growth`.
        """
        room = max((MOST - len(self.made.y)) // len(members), 1)
        more = int(np.ceil(growth * self.runs[members].mean()))
        self._ask(members, min(more, room), draws)

    def judge(self, where: Array, noise_sd: float = 0.0) -> None:
        """Estimate the errors at points (J, n) of a law, and the scatter of the noisy outcome."""
        self._fit()
        factor = CAUTION * self._surprise()
        self.where = where[:COMPARED]
        self.expected = self._mean(self._unit(self.where))
        self.error = factor * self._left(self._unit(where[:JUDGED]))
        box = low_discrepancy(JUDGED, len(self.box), fixed_shift(len(self.box)))
        self.reach = np.maximum(factor * self._left(box), self.error)
        self.scatter = np.hypot(self.expected.std(axis=1), noise_sd)
        good = self.made.worked
        self.level = np.zeros(len(self.conditions))
        np.maximum.at(self.level, good.index, np.abs(good.y))
        self.error[np.bincount(good.index, minlength=len(self.level)) == 0] = np.inf

    def rough(self, tolerance: float, accuracy: float) -> Flags:
        """Whose error is above `tolerance` of its scatter and `accuracy` of its size."""
        return self.error > np.maximum(tolerance * self.scatter, accuracy * self.level)

    def surface(self, converged: Flags) -> Surface:
        """The polynomials through the process, with the errors that were judged last."""
        indices, coefficients = self._polynomials()
        missed = coefficients.T @ products(indices, self._unit(self.where)) - self.expected
        error = np.hypot(self.error, np.sqrt((missed**2).mean(axis=1)))
        known = np.where(np.isfinite(error), error, 0.0)
        indices, groups, terms = merged([(np.arange(len(error)), indices, coefficients)], known)
        bad = self.made.index[~np.isfinite(self.made.y)]
        surface = Surface(
            box=self.box,
            indices=indices,
            groups=groups,
            error=error,
            scatter=self.scatter.copy(),
            converged=converged,
            runs=self.runs,
            failed=np.bincount(bad, minlength=len(error)),
            degrees=degrees_of(indices, terms, known),
        )
        lower, upper = outcome_range(surface, np.full((len(error), 1), np.nan))
        return replace(surface, lower=lower - 3.0 * self.reach, upper=upper + 3.0 * self.reach)

    def _ask(self, members: Indices, count: int, draws: Array | None) -> None:
        """Run the simulator once; each experiment has a sequence of points of its own."""
        done = self.runs[members]
        n = len(self.box)
        even = 0.5 * (low_discrepancy(int(done.max()) + count, n, np.zeros(n)) + 1.0)
        each = done[:, None] + np.arange(count)
        even = ((even[each] + self.shift[members, None]) % 1.0).reshape(-1, n)
        x = self._over_box(even) if draws is None else self._over_law(even, draws)
        index = np.repeat(members, count)
        y = checked_outcomes(self.run(index, x), (len(members), count)).ravel()
        self.made, self.stale = self.made.joined(index, x, y), True

    def _over_box(self, even: Array) -> Array:
        """Points x (R, n) that gather at the faces of the box, for even ones in [0, 1]."""
        low, high = self.box.T
        z = np.sin(CLUSTER * (2.0 * even - 1.0)) / np.sin(CLUSTER)
        return np.asarray(np.clip(0.5 * (low + high) + 0.5 * (high - low) * z, low, high))

    def _over_law(self, even: Array, draws: Array) -> Array:
        """Points x (R, n) spread as the draws are, and some over the box."""
        low, high = self.box.T
        others = np.linspace(low, high, int(ELSEWHERE * len(draws)))
        pool = np.vstack([np.clip(draws, low, high), others])
        return np.column_stack([np.quantile(pool[:, i], even[:, i]) for i in range(len(low))])

    def _fit(self) -> None:
        """Learn the covariance, from where it was, and condition on all runs."""
        if not self.stale:
            return
        good = self.made.worked
        u = np.hstack([self.conditions[good.index], self._unit(good.x)])
        some = np.sort(np.random.default_rng(len(u)).permutation(len(u))[:LEARNED])
        self.covariance = learned(
            self.covariance, good.index[some], u[some], good.y[some], self.steps
        )
        self.posterior = Posterior.of(self.covariance, good.index, u, good.y)
        self.steps, self.stale = STEPS[1], False

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
        z = self._unit(np.vstack([self._over_box(even), self._over_law(even, self.where)]))
        y = self._mean(z).T - self.posterior.level
        # Keeps what the points do not determine, in the corners of many parameters, from growing.
        ridge = np.diag(RIDGE * (1.0 + size**2))
        matrix = np.vstack([products(indices, z).T, ridge])
        fitted = np.linalg.lstsq(matrix, np.vstack([y, np.zeros((len(size), y.shape[1]))]))[0]
        fitted[0] += self.posterior.level
        return indices, np.asarray(fitted)

    def _unit(self, x: Array) -> Array:
        low, high = self.box.T
        return np.asarray((2.0 * x - low - high) / (high - low))


def first_runs(experiments: int, n: int) -> int:
    """Runs an experiment to begin with: fewer where many experiments tell of each other.

    >>> first_runs(108, 2), first_runs(1000, 2)
    (8, 2)
    """
    return int(np.clip(FIRST // experiments + 1, 2, 2 * n + 4))
