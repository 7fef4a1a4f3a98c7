"""The runs that surfaces are made of, kept when the region in which they are wanted moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.types import Array, Flags, Indices


@dataclass(frozen=True, eq=False)
class Samples:
    """Runs of N experiments at M points `x` (M, n): `outcome` (N, M), NaN where there is none.

    `asked` (N, M) tells a run that failed, asked for and NaN, from one that was never made.

    >>> none = Samples.none(2, 1)
    >>> one = none.joined(np.array([[0.5]]), np.array([1]), np.array([0]), np.array([7.0]))
    >>> one.outcome.tolist(), one.asked.tolist()
    ([[nan], [7.0]], [[False], [True]])
    """

    x: Array
    outcome: Array
    asked: Flags

    @classmethod
    def none(cls, experiments: int, parameters: int) -> Samples:
        """No run."""
        return cls(
            np.empty((0, parameters)),
            np.empty((experiments, 0)),
            np.empty((experiments, 0), dtype=np.bool_),
        )

    @property
    def worked(self) -> Flags:
        """Which runs have an outcome, (N, M)."""
        return np.isfinite(self.outcome)

    @property
    def runs(self) -> Indices:
        """Runs of each experiment, (N,)."""
        return np.asarray(self.asked.sum(axis=1), dtype=np.intp)

    @property
    def failed(self) -> Indices:
        """Those of the runs without an outcome, (N,)."""
        return np.asarray(self.runs - self.worked.sum(axis=1), dtype=np.intp)

    @property
    def listed(self) -> tuple[Indices, Array, Array]:
        """The runs that worked as a list: experiments (R,), points (R, n), outcomes (R,)."""
        column, index = np.nonzero(self.worked.T)
        return index, self.x[column], self.outcome[index, column]

    def joined(self, x: Array, index: Indices, place: Indices, outcome: Array) -> Samples:
        """With the runs of experiments `index` (R,) at the points x[place], x (Q, n)."""
        values = np.full((len(self.outcome), len(x)), np.nan)
        asked = np.zeros(values.shape, dtype=np.bool_)
        values[index, place], asked[index, place] = outcome, True
        return Samples(
            np.vstack([self.x, x]),
            np.hstack([self.outcome, values]),
            np.hstack([self.asked, asked]),
        )

    def inside(self, box: Array) -> Samples:
        """Those at points in the box (n, 2)."""
        kept = np.all((self.x >= box[:, 0]) & (self.x <= box[:, 1]), axis=1)
        return Samples(self.x[kept], self.outcome[:, kept], self.asked[:, kept])
