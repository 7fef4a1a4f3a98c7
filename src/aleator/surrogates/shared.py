"""One Gaussian process over conditions and parameters for all experiments.

Each experiment is run at points of its own, and one Gaussian process (module `kriging`) is fitted
to the runs of all experiments. For the conditions of one experiment the process is a function of
the parameters alone, to which a polynomial is fitted. The result is a `Surface`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.simulators.response_functions import Run
from aleator.surrogates.emulator import Emulator, pairs
from aleator.surrogates.fit import clustered, fixed_shift, low_discrepancy
from aleator.surrogates.kriging import PROCESS, Covariance, Data, ProcessPosterior, learned
from aleator.surrogates.samples import Samples
from aleator.surrogates.surface import Axes, Surface, ball, products


@dataclass(frozen=True)
class SharingSettings:
    """Settings of the runs and points of a shared surface.

    The values are chosen by judgement, but for `caution`.
    """

    first: int = 800
    """The number of runs of all experiments together in the first round; every experiment gets at
    least two runs."""
    most: int = 4000
    """The largest number of runs of one fit, whose cost grows with the cube of this number."""
    terms: tuple[int, ...] = (40, 136, 220, 250)
    """The number of terms of the polynomials for 1, 2, 3 and more parameters."""
    points: float = 2.5
    """The number of points for each term, to which a polynomial is fitted."""
    ridge: float = 0.01
    """Weight of the penalty on the size of a polynomial's terms, relative to one point of the fit.
    """
    judged: int = 16
    """The number of points per experiment at which the expected error is computed."""
    compared: int = 64
    """The number of points per experiment at which polynomial and process are compared."""
    caution: float = 1.5
    """Factor of the estimated errors. It was set on the wet clutch: with it the true errors stay
    below the estimate as often as the tests assert."""
    elsewhere: float = 0.1
    """The share of runs spread over the whole box when the others follow a law."""
    least_seen: float = 1e-9
    """The least number of runs by which the mean of squared standardized residuals is divided."""


SHARING = SharingSettings()


class SharedSurface(Emulator):
    """One Gaussian process for all experiments; the methods are those of `Emulator`.

    `conditions` (N, d) are the conditions of the experiments as inputs in [-1, 1] (see `features`).

    Cost besides the runs: M^3 operations for M runs of all experiments together, and a few hundred
    times N M for the polynomials. A round with 108 experiments of 20 runs takes some ten seconds.
    """

    def __init__(
        self, run: Run, box: Array, conditions: Array, settings: SharingSettings = SHARING
    ) -> None:
        experiments, n = len(conditions), len(box)
        super().__init__(run, box, Samples.none(experiments, n))
        self.conditions, self.settings = conditions, settings
        self.shift = np.random.default_rng(0).random((experiments, n))
        inputs = conditions.shape[1] + n
        self.covariances = tuple(Covariance.first(inputs, n, kind) for kind in (False, True))
        self.where = self.axes.outward(low_discrepancy(self.settings.compared, n, fixed_shift(n)))
        self._place(
            np.arange(experiments), first_shared_runs(experiments, n, settings), settings.most, None
        )
        self.posterior = self._learned(PROCESS.steps[0])
        self.stale = False

    @staticmethod
    def fits(experiments: int, n: int, settings: SharingSettings = SHARING) -> bool:
        """Whether one fit can take twice the runs of the first round of so many experiments."""
        return 2 * experiments * first_shared_runs(experiments, n, settings) <= settings.most

    def move(self, box: Array) -> None:
        """Change the region to another box; runs outside it are still used in the fit."""
        self.axes, self.stale = Axes.plain(box), True

    def round(self, members: Indices, growth: float) -> int:
        """The largest number of runs that `sharpen` makes for one of the experiments `members`."""
        return int(np.ceil(growth * self.runs[members].max(initial=0)))

    def sharpen(self, members: Indices, draws: Array | None, growth: float, most: int) -> None:
        """Run the experiments `members` (A,) at points of their own, spread as the draws are."""
        room = max((self.settings.most - int(self.runs.sum())) // len(members), 1)
        more = int(np.ceil(growth * self.runs[members].mean()))
        self._place(members, min(more, room), most, draws)
        self.stale = True

    def judge(self, where: Array | None) -> None:
        """Estimate each error as the posterior standard deviation times a factor.

        The factor says how much larger the leave-one-out residuals are than the process expects.
        """
        if self.stale:
            self.posterior, self.stale = self._learned(PROCESS.steps[1]), False
        factor = self.settings.caution * self._surprise()
        everywhere = low_discrepancy(
            self.settings.compared, len(self.box), fixed_shift(len(self.box))
        )
        points = self.axes.outward(everywhere) if where is None else where
        self.where = points[: self.settings.compared]
        self.error = factor * self._left(self.axes.inward(points[: self.settings.judged]))
        self.reach = np.maximum(factor * self._left(everywhere[: self.settings.judged]), self.error)
        self.scatter = self._expected().std(axis=1)
        index, _, y = self.samples.listed
        self.level = np.zeros(len(self.conditions))
        np.maximum.at(self.level, index, np.abs(y))
        self.error[~self.samples.worked.any(axis=1)] = np.inf

    def surface(self, converged: Flags) -> Surface:
        """The polynomials fitted to the process, with the errors of the last call of `judge`."""
        indices, coefficients = self._polynomials()
        basis = products(indices, self.axes.inward(self.where))
        missed = coefficients.T @ basis - self._expected()
        error = np.hypot(self.error, np.sqrt((missed**2).mean(axis=1)))
        everyone = np.arange(len(error))
        nothing = np.full((len(error), 1), np.nan)
        plain = np.zeros(len(error), dtype=np.bool_)
        return self._surface([(everyone, indices, coefficients)], error, converged, nothing, plain)

    def _place(self, members: Indices, count: int, most: int, draws: Array | None) -> None:
        """Run each of the members at the next `count` points of its own sequence of points."""
        index, place = pairs(members, count)
        n, before = len(self.box), self.runs
        even = 0.5 * (low_discrepancy(int(before[members].max()) + count, n, np.zeros(n)) + 1.0)
        even = (even[before[index] + place] + self.shift[index]) % 1.0
        x = self._over_box(even) if draws is None else self._over_law(even, draws)
        allowed = np.flatnonzero(place < most - before[index])
        self.run_at(x[allowed], index[allowed], np.arange(len(allowed)))

    def _over_box(self, even: Array) -> Array:
        """Points x (R, n) in the box, denser at its faces, from evenly spread ones in [0, 1]."""
        return self.axes.outward(clustered(2.0 * even - 1.0))

    def _over_law(self, even: Array, draws: Array) -> Array:
        """Points x (R, n) spread as the draws (D, n) are, some over the box, from even ones."""
        low, high = self.box.T
        others = np.linspace(low, high, int(self.settings.elsewhere * len(draws)))
        pool = np.vstack([np.clip(draws, low, high), others])
        return np.column_stack([np.quantile(pool[:, i], even[:, i]) for i in range(len(low))])

    def _learned(self, steps: int) -> ProcessPosterior:
        """The process conditioned on all runs; the fit of its covariance starts from the last."""
        index, x, y = self.samples.listed
        u = np.hstack([self.conditions[index], self.axes.inward(x)])
        data = Data(index, u, y, len(self.box))
        self.covariances = learned(self.covariances, data, steps)
        return ProcessPosterior.of(self.covariances[0], data)

    def _surprise(self) -> Array:
        """How much larger the leave-one-out residuals are than the process expects, (N,).

        It is the larger of two ratios: that of the experiment's own residuals, and that of the
        residuals of experiments that correlate with it.
        """
        experiments, n = len(self.conditions), len(self.box)
        known = self.posterior
        seen = np.bincount(known.data.experiment, minlength=experiments)
        squares = np.bincount(known.data.experiment, known.surprise**2, minlength=experiments)
        alike = known.covariance.likeness(np.hstack([self.conditions, np.zeros((experiments, n))]))
        pooled = (alike @ squares) / np.maximum(alike @ seen, self.settings.least_seen)
        return np.asarray(np.sqrt(np.maximum((1.0 + squares) / (1.0 + seen), pooled)))

    def _expected(self) -> Array:
        """Expected outcomes (N, J) at the points of the last call of `judge`."""
        return self._mean(self.axes.inward(self.where))

    def _mean(self, z: Array) -> Array:
        """Expected outcomes (N, J) of all experiments at points z (J, n)."""
        parts = []
        for one, condition in enumerate(self.conditions):
            u = np.hstack([np.tile(condition, (len(z), 1)), z])
            parts.append(self.posterior.mean(np.full(len(z), one), u))
        return np.array(parts)

    def _left(self, z: Array) -> Array:
        """The posterior standard deviation of each outcome (N,), rms over points z (J, n)."""
        experiments = len(self.conditions)
        index = np.repeat(np.arange(experiments), len(z))
        u = np.hstack([self.conditions[index], np.tile(z, (experiments, 1))])
        left = self.posterior.deviation(index, u).reshape(experiments, -1)
        return np.asarray(np.sqrt((left**2).mean(axis=1)))

    def _polynomials(self) -> tuple[Indices, Array]:
        """Multi-indices (P, n) and coefficients (P, N) of the polynomials fitted to the process.

        They are fitted by least squares, at points over the box and at points of the last call of
        `judge`.
        """
        n = len(self.box)
        indices, size = ball(
            (1.0,) * n, 2.0, self.settings.terms[min(n, len(self.settings.terms)) - 1]
        )
        even = 0.5 * (
            low_discrepancy(int(self.settings.points * len(indices)), n, fixed_shift(n)) + 1.0
        )
        x = np.vstack([self._over_box(even), self._over_law(even, self.where)])
        z = self.axes.inward(x)
        y = self._mean(z).T
        level = y.mean()
        # The penalty keeps coefficients small that the points hardly determine, as those that act
        # in the corners of a box of many parameters.
        ridge = np.diag(self.settings.ridge * (1.0 + size**2))
        matrix = np.vstack([products(indices, z).T, ridge])
        fitted = np.linalg.lstsq(matrix, np.vstack([y - level, np.zeros((len(size), y.shape[1]))]))[
            0
        ]
        fitted[0] += level
        return indices, np.asarray(fitted)


def first_shared_runs(experiments: int, n: int, settings: SharingSettings = SHARING) -> int:
    """The number of first runs per experiment, fewer if many experiments share the surface.

    >>> first_shared_runs(108, 2), first_shared_runs(1000, 2)
    (8, 2)
    """
    return int(np.clip(settings.first // experiments + 1, 2, 2 * n + 4))
