"""What surfaces are made of: runs of experiments at points, and conditions as numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.core.types import Array, Flags, Indices
from aleator.simulators import Runner
from aleator.simulators.response_functions import Run, completed


@dataclass(frozen=True, eq=False)
class Samples:
    """Runs of N experiments at M points `x` (M, n): `outcome` (N, M), NaN where there is none.

    A run that was `attempted` (N, M) and is NaN has failed; any other NaN was never run.

    >>> none = Samples.none(2, 1)
    >>> one = none.joined(np.array([[0.5]]), np.array([1]), np.array([0]), np.array([7.0]))
    >>> one.outcome.tolist(), one.attempted.tolist()
    ([[nan], [7.0]], [[False], [True]])
    """

    x: Array
    outcome: Array
    attempted: Flags

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
        return np.asarray(self.attempted.sum(axis=1), dtype=np.intp)

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
        attempted = np.zeros(values.shape, dtype=np.bool_)
        values[index, place], attempted[index, place] = outcome, True
        return Samples(
            np.vstack([self.x, x]),
            np.hstack([self.outcome, values]),
            np.hstack([self.attempted, attempted]),
        )

    def inside(self, box: Array) -> Samples:
        """Those at points in the box (n, 2)."""
        kept = np.all((self.x >= box[:, 0]) & (self.x <= box[:, 1]), axis=1)
        return Samples(self.x[kept], self.outcome[:, kept], self.attempted[:, kept])


@dataclass(frozen=True)
class FeatureSettings:
    """Conditions as inputs of a shared surface; by judgement."""

    decade: float = 10.0
    """Largest over least value, from which a positive condition is taken as its logarithm."""
    texts: int = 6
    """Different texts of one condition; with more there is nothing to learn from."""


FEATURES = FeatureSettings()


def features(
    columns: Mapping[str, NDArray[Any]], settings: FeatureSettings = FEATURES
) -> Array | None:
    """Return conditions (N,) by name as inputs (N, d) in [-1, 1], or None where they cannot be.

    Numbers are scaled to their range, or their logarithms are. A text is one input for each of its
    values, 1 where it has it and -1 elsewhere: how far apart texts are is for the data to say.
    Columns that do not vary are left out. None where a column is neither numbers nor text of at
    most 6 values, a number is not finite, or none varies.

    >>> features({"speed": np.array([1.0, 2.0, 3.0]), "oil": np.array(["a", "b", "a"], object)})
    array([[-1.,  1., -1.], [ 0., -1.,  1.], [ 1.,  1., -1.]])
    """
    parts: list[Array] = []
    for column in columns.values():
        if column.dtype == object:
            kinds = sorted({str(cell) for cell in column})
            if len(kinds) > settings.texts:
                return None
            texts = column.astype(str)
            parts += [np.where(texts == kind, 1.0, -1.0) for kind in kinds if len(kinds) > 1]
        else:
            numbers = column.astype(np.float64)
            if not np.isfinite(numbers).all():
                return None
            parts += [_scaled(numbers, settings)] if np.ptp(numbers) > 0.0 else []
    return np.column_stack(parts) if parts else None


def _scaled(numbers: Array, settings: FeatureSettings = FEATURES) -> Array:
    if numbers.min() > 0.0 and numbers.max() > settings.decade * numbers.min():
        numbers = np.log(numbers)
    low, high = numbers.min(), numbers.max()
    return np.asarray((2.0 * numbers - low - high) / (high - low))


@dataclass(frozen=True, eq=False)
class Sites:
    """The distinct values that surfaces are made of: `case` and `column` (U,) of each.

    `unit` (U,) is a unit of each case, and `of` (M,) the site of each observation.
    """

    unit: Indices
    column: Indices
    of: Indices

    @classmethod
    def seen(cls, runner: Runner, unit: Indices, column: Indices) -> Sites:
        """Those of observations that are values of these units (M,), in these columns (M,)."""
        case = runner.cases.condition[unit]
        pairs = np.stack([case, column], axis=1)
        distinct, of = np.unique(pairs, axis=0, return_inverse=True)
        return cls(runner.cases.first[distinct[:, 0]], distinct[:, 1], of.ravel())

    def __len__(self) -> int:
        return self.unit.size

    def run(self, runner: Runner, region: Array) -> Run:
        """`run(index (R,), x (R, moving)) -> (R,)` of the sites, NaN where a run fails."""

        def run(index: Indices, x: Array) -> Array:
            values = runner.values(self.unit[index], completed(region, x))
            return np.asarray(values[np.arange(len(x)), self.column[index]])

        return run

    def together(self, members: Flags) -> Flags:
        """With all sites of the units of some: the same runs give them their values."""
        return np.isin(self.unit, self.unit[members])
