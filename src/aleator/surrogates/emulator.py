"""What every kind of surfaces does: run where it is asked, say how exact it is, give polynomials.

Two kinds: a polynomial for each experiment (module `own`), and one Gaussian process over conditions
and parameters for all of them (module `shared`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from aleator.errors import SimulatorError
from aleator.surrogates.assembly import Piece, degrees_of, merged, outcome_range
from aleator.surrogates.axes import Axes
from aleator.surrogates.responses import Run
from aleator.surrogates.samples import Samples
from aleator.surrogates.scales import widened
from aleator.surrogates.surface import Surface
from aleator.types import Array, Flags, Indices


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

    def ask(self, x: Array, index: Indices, place: Indices) -> None:
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
        indices, groups, terms = merged(pieces, known)
        surface = Surface(
            axes=self.axes,
            indices=indices,
            groups=groups,
            error=error.copy(),
            scatter=self.scatter.copy(),
            converged=converged,
            runs=self.runs,
            failed=self.samples.failed,
            degrees=degrees_of(indices, terms, known),
            logarithmic=logarithmic,
        )
        lower, upper = outcome_range(surface, outcomes)
        # an outcome is out of reach only if it is so beyond the surface's error over all the box
        return replace(
            surface,
            lower=widened(lower, -3.0 * self.reach, logarithmic),
            upper=widened(upper, 3.0 * self.reach, logarithmic),
        )


def pairs(members: Indices, count: int) -> tuple[Indices, Indices]:
    """Each of A experiments with each of `count` points: experiments (A count,), points alike."""
    return np.repeat(members, count), np.tile(np.arange(count), len(members))
