"""The data of response surfaces: outcomes of runs at points, and conditions turned into numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.core.types import Array, Flags, Indices
from aleator.errors import InputsError
from aleator.simulators import Runner
from aleator.simulators.response_functions import Run, completed, moving_parameters


@dataclass(frozen=True, eq=False)
class Samples:
    """Runs of N experiments at M points `x` (M, n) of the parameters.

    `outcome` (N, M) is NaN where there is no outcome: the run failed if it was `attempted` (N, M),
    otherwise it was never made.

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
        """Samples of so many experiments and parameters, without any run."""
        return cls(
            np.empty((0, parameters)),
            np.empty((experiments, 0)),
            np.empty((experiments, 0), dtype=np.bool_),
        )

    @property
    def worked(self) -> Flags:
        """Whether each experiment has an outcome at each point, (N, M)."""
        return np.isfinite(self.outcome)

    @property
    def runs(self) -> Indices:
        """The number of attempted runs of each experiment, (N,)."""
        return np.asarray(self.attempted.sum(axis=1), dtype=np.intp)

    @property
    def failed(self) -> Indices:
        """The number of failed runs of each experiment, (N,)."""
        return np.asarray(self.runs - self.worked.sum(axis=1), dtype=np.intp)

    @property
    def listed(self) -> tuple[Indices, Array, Array]:
        """The successful runs as a list: experiments (R,), points (R, n), outcomes (R,)."""
        column, index = np.nonzero(self.worked.T)
        return index, self.x[column], self.outcome[index, column]

    def joined(self, x: Array, index: Indices, place: Indices, outcome: Array) -> Samples:
        """These samples with R further runs.

        Run r is of experiment index[r] at the point x[place[r]] of the new points x (Q, n), and has
        the outcome outcome[r].
        """
        values = np.full((len(self.outcome), len(x)), np.nan)
        attempted = np.zeros(values.shape, dtype=np.bool_)
        values[index, place], attempted[index, place] = outcome, True
        return Samples(
            np.vstack([self.x, x]),
            np.hstack([self.outcome, values]),
            np.hstack([self.attempted, attempted]),
        )

    def inside(self, box: Array) -> Samples:
        """The samples at the points that lie inside a box of the parameters (n, 2)."""
        kept = np.all((self.x >= box[:, 0]) & (self.x <= box[:, 1]), axis=1)
        return Samples(self.x[kept], self.outcome[:, kept], self.attempted[:, kept])


@dataclass(frozen=True)
class FeatureSettings:
    """Settings for conditions as inputs of a process. The values are chosen by judgement."""

    decade: float = 10.0
    """A positive condition enters by its logarithm if its largest value exceeds this many times its
    smallest value."""
    texts: int = 6
    """The largest number of different texts of one condition; with more, too few experiments have
    the same text."""


FEATURES = FeatureSettings()


def features(
    columns: Mapping[str, NDArray[Any]], cases: int, settings: FeatureSettings = FEATURES
) -> Array:
    """Return conditions, given as columns (N,), as inputs (N, d) of a process in [-1, 1].

    A column of numbers, or of their logarithms, is scaled to its range. A column of texts becomes
    one input for each different text, 1 for the experiments that have it and -1 for the others, so
    that the data determine how similar texts are. A column of series of equal length becomes one
    input for each row. Left out are columns that do not vary, inputs that equal others, texts with
    more than 6 different values, numbers that are not finite and series of unequal length.

    >>> features({"speed": np.array([1.0, 2.0, 3.0]), "oil": np.array(["a", "b", "a"], object)}, 3)
    array([[-1.,  1., -1.], [ 0., -1.,  1.], [ 1.,  1., -1.]])
    """
    parts: list[Array] = []
    for column in columns.values():
        for one in _numbers(column, settings):
            if not any(np.array_equal(one, other) for other in parts):
                parts.append(one)
    return np.column_stack(parts) if parts else np.empty((cases, 0))


def _numbers(column: NDArray[Any], settings: FeatureSettings) -> list[Array]:
    """The inputs (N,) of one column of conditions."""
    if column.dtype != object:
        numbers = column.astype(np.float64)
        usable = np.isfinite(numbers).all() and np.ptp(numbers) > 0.0
        return [_scaled(numbers, settings)] if usable else []
    if isinstance(column[0], np.ndarray):
        if len({np.shape(cell) for cell in column}) > 1:
            return []
        rows = np.stack([np.asarray(cell) for cell in column], axis=1)
        return [one for row in rows for one in _numbers(row, settings)]
    texts = np.array([str(cell) for cell in column])
    kinds = sorted(set(texts))
    if not 1 < len(kinds) <= settings.texts:
        return []
    return [np.where(texts == kind, 1.0, -1.0) for kind in kinds]


def _scaled(numbers: Array, settings: FeatureSettings = FEATURES) -> Array:
    if numbers.min() > 0.0 and numbers.max() > settings.decade * numbers.min():
        numbers = np.log(numbers)
    low, high = numbers.min(), numbers.max()
    return np.asarray((2.0 * numbers - low - high) / (high - low))


@dataclass(frozen=True, eq=False)
class Sites:
    """The U different simulated values that the M observations need, each with its own surface.

    A simulated value is one column of the simulator's output under one distinct condition. A unit
    is what one run computes: a row of the table, or a whole experiment. `unit` (U,) is a unit with
    the condition of each value, `column` (U,) its column, and `of` (M,) the number of the value
    that each observation needs.
    """

    unit: Indices
    column: Indices
    of: Indices

    @classmethod
    def seen(cls, runner: Runner, unit: Indices, column: Indices) -> Sites:
        """The different values that M observations need, each in a column of a unit's output.

        `unit` (M,) and `column` (M,) are the unit and the column of each observation.
        """
        case = runner.cases.condition[unit]
        pairs = np.stack([case, column], axis=1)
        distinct, of = np.unique(pairs, axis=0, return_inverse=True)
        return cls(runner.cases.first[distinct[:, 0]], distinct[:, 1], of.ravel())

    def __len__(self) -> int:
        return self.unit.size

    def run(self, runner: Runner, region: Array) -> Run:
        """A function that runs the simulator for values number index (R,) at points x (R, n).

        The points hold the parameters that vary in the `region`. It returns outcomes (R,), NaN
        where a run fails.
        """

        def run(index: Indices, x: Array) -> Array:
            values = runner.values(self.unit[index], completed(region, x))
            return np.asarray(values[np.arange(len(x)), self.column[index]])

        return run

    def attempts(self, runner: Runner, region: Array) -> Run:
        """The function `run`; raises InputsError if no parameter varies in the region (n, 2)."""
        if moving_parameters(region).size == 0:
            raise InputsError(
                "every parameter is known: there is nothing to identify but noise",
                "free a hyperparameter, or give a parameter a law",
            )
        return self.run(runner, region)

    def together(self, members: Flags) -> Flags:
        """The values marked in `members`, and all others of their units, which share their runs."""
        return np.isin(self.unit, self.unit[members])
