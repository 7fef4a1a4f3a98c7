"""Runs that are cheaper to make than to store: made in this process, many of them by one call."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.core.blocks import blocks
from aleator.core.types import Array, Indices
from aleator.errors import AleatorError, SurroundingsError
from aleator.observations.tables import real_numbers
from aleator.simulators.dispatch import Batch, make
from aleator.simulators.function import FunctionSimulator
from aleator.simulators.protocol import BLOCKS, RunStopped
from aleator.simulators.runs import NOT_FINITE, Failure, Runs
from aleator.simulators.units import Bound


@dataclass(frozen=True)
class DirectSettings:
    """Settings for runs that are not remembered. The values are chosen by judgement."""

    checked: int = 16
    """The largest number of test runs in which calls with single numbers are compared with one call
    with arrays. The test runs differ in their conditions and in every parameter."""
    relative: float = 1e-12
    """The tolerated relative difference. Powers and exponentials of arrays are computed by other
    code, which may change the last four bits; a difference of two such values loses more."""
    remembered: int = 1000
    """The largest number of failed runs whose reasons are kept for messages."""


SETTINGS = DirectSettings()


class ArrayCalls:
    """Calls an elementwise function once for many runs, with the rows of all runs in one array.

    >>> import pandas as pd
    >>> from aleator.simulators.units import Cases
    >>> from aleator.simulators.function import FunctionSimulator
    >>> cases = Cases.of({"load": np.array([1.0, 2.0])}, 2)
    >>> together = ArrayCalls(Bound(FunctionSimulator(lambda load, x: load * x), cases, ("x",)))
    >>> together(np.array([0, 1, 1]), np.array([[1.0], [1.0], [3.0]])).tolist()
    [[1.0], [2.0], [6.0]]
    """

    def __init__(self, bound: Bound) -> None:
        self._bound, self._form = bound, bound.form
        rows = self._form.rows
        self._rows = np.ones(len(bound.cases), dtype=np.intp) if rows is None else rows
        self._start = np.cumsum(self._rows) - self._rows
        self._columns = {
            name: _flat(column, self._rows) for name, column in bound.cases.columns.items()
        }
        most = int(self._rows.max(initial=1))
        self._each = most if np.all(self._rows == most) else 0

    def __call__(self, case: Indices, x: Array) -> Array:
        """Values (R, W) of runs under conditions number `case` (R,) with parameters `x` (R, n).

        Raises whatever the function raises, and TypeError if the function returns neither an array
        with a value for each row nor a number. Cost: some 15 ns a value, and the function itself.
        """
        size = len(self._form.responses)
        values = np.full((len(case), self._form.width), np.nan)
        if self._each:
            rows = self._start[case]
            columns = x.T.copy()
            if self._each > 1:
                rows = (rows[:, None] + np.arange(self._each)).ravel()
                columns = np.repeat(columns, self._each, axis=1)
            for k, part in enumerate(self._parts(rows, columns)):
                values[:, k::size] = part.reshape(len(case), -1) if part.ndim else part
            return values
        sizes = self._rows[case]
        run = np.repeat(np.arange(len(case)), sizes)
        place = np.arange(len(run)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        parts = self._parts(self._start[case][run] + place, x[run].T.copy())
        for k, part in enumerate(parts):
            values[run, place * size + k] = part
        return values

    def _parts(self, rows: Indices, x: Array) -> list[Array]:
        """The function's value for each response at x (n, rows): an array (rows,) or one number."""
        columns = {name: column[rows] for name, column in self._columns.items()}
        simulator: Any = self._bound.simulator
        with np.errstate(all="ignore"):
            returned = simulator.function(
                **columns, **dict(zip(self._bound.parameters, x, strict=True))
            )
        names = self._form.responses
        if not isinstance(returned, Mapping) and len(names) > 1:
            raise TypeError("it named no responses")
        parts = [returned[n] for n in names] if isinstance(returned, Mapping) else [returned]
        return [_values(part, len(rows)) for part in parts]


def elementwise(bound: Bound, case: Indices, x: Array, settings: DirectSettings = SETTINGS) -> bool:
    """Whether one call of a function with arrays gives the same values as a call for each run.

    Up to `checked` runs are compared, out of those under conditions number `case` (R,) with
    parameters `x` (R, n); they should differ in both. Relative differences up to `relative` are
    tolerated. A function that raises an exception in either way is not elementwise. The call with
    arrays comes first, so that a slow function that takes no arrays costs one call. Cost: at most
    checked + 1 calls.

    >>> from aleator.simulators.units import Cases
    >>> from aleator.simulators.function import FunctionSimulator
    >>> def is_so(function):
    ...     bound = Bound(FunctionSimulator(function), Cases.of({}, 1), ("x",))
    ...     return elementwise(bound, np.zeros(2, int), np.array([[1.0], [2.0]]))
    >>> is_so(lambda x: 2.0 * x), is_so(lambda x: 2.0 if x > 1.5 else x)
    (True, False)
    """
    case, x = case[: settings.checked], x[: settings.checked]
    try:
        together = ArrayCalls(bound)(case, x)
        returned = bound.simulator(*bound.columns(case, x))
        each = bound.form.some(case).shaped(bound.simulator, returned, len(case))
    except (KeyboardInterrupt, SurroundingsError):
        raise
    except BaseException:
        return False
    return bool(np.allclose(together, each, rtol=settings.relative, atol=0.0, equal_nan=True))


def _flat(column: NDArray[Any], rows: Indices) -> NDArray[Any]:
    """A column (C,) over distinct conditions, expanded to an entry for each row of their series."""
    if column.dtype == object and len(column) and isinstance(column[0], np.ndarray):
        return np.concatenate([*column])
    return np.repeat(column, rows)


def _values(part: Any, rows: int) -> Array:
    numbers = real_numbers(part)
    if numbers.shape not in ((), (rows,)):
        raise TypeError(f"it returned values of shape {numbers.shape}")
    return numbers


Failures = Mapping[int, Failure]


class DirectRuns:
    """Makes runs that are not remembered: `count` counts them, `lost` counts the failed ones.

    A run has failed if it lacks a measured value; `failures` has the first failed runs. After a
    call of `find_arrays`, a function of single numbers is called with arrays, if its values are the
    same then.

    >>> inverse = FunctionSimulator(lambda x: 1.0 / x, vectorized=True)
    >>> from aleator.simulators.units import Cases
    >>> direct = DirectRuns(Bound(inverse, Cases.of({}, 1), ("x",)))
    >>> direct(np.array([0, 0]), np.array([[2.0], [0.0]])).tolist()
    [[0.5], [inf]]
    """

    def __init__(self, bound: Bound, settings: DirectSettings = SETTINGS) -> None:
        self._bound, self._simulator, self._form = bound, bound.simulator, bound.form
        self._settings = settings
        observed = np.zeros((len(bound.cases), self._form.width), dtype=np.bool_)
        self._unmeasured = replace(bound, form=replace(bound.form, observed=observed))
        self._together: ArrayCalls | None = None
        self.count = self.lost = self.repeated = 0
        self.failures = Runs.planned(np.empty(0, np.intp), np.empty((0, len(bound.parameters))))

    def __call__(self, case: Indices, x: Array) -> Array:
        """Values (R, W) of runs under conditions number `case` (R,) with parameters `x` (R, n).

        The values of a run that raises an exception are NaN; an infinite value is kept. Raises
        SimulatorError for a wrong shape or type, and SurroundingsError for a fault of the machine.
        Cost: some 20 ns a run of a vectorized function, and the function itself.
        """
        self.count += len(case)
        values = np.empty((len(case), self._form.width))
        for rows in blocks(len(case), 1, self._size):
            values[rows], failures = self._block(case[rows], x[rows])
            self._note(case[rows], x[rows], values[rows], failures)
        return values

    def again(self, case: Indices, x: Array) -> Array:
        """Values (R, W) of runs that are made once more, as a check; `repeated` counts them."""
        self.repeated += len(case)
        parts = blocks(len(case), 1, self._size)
        return np.concatenate([self._block(case[rows], x[rows])[0] for rows in parts])

    @property
    def _size(self) -> int:
        together = max(BLOCKS.arrays // self._form.width, 1)
        return together if self._together else self._simulator.block

    def find_arrays(self, region: Array) -> bool:
        """Whether the simulator takes arrays: it is vectorized, or an elementwise function.

        An unvectorized function is tried at some points of the parameter region (n, 2), each under
        other conditions. A function with a time limit is not, since one call would make many runs.
        """
        simulator = self._simulator
        if not isinstance(simulator, FunctionSimulator) or simulator.vectorized:
            return getattr(simulator, "vectorized", False) is True
        if simulator.timeout is not None or simulator.sloped:
            return False
        count = self._settings.checked
        case = np.linspace(0, len(self._bound.cases) - 1, count).astype(np.intp)
        share = np.random.default_rng(0).random((count, len(region)))
        points = region[:, 0] + share * (region[:, 1] - region[:, 0])
        self.count += count
        found = elementwise(self._bound, case, points, self._settings)
        self._together = ArrayCalls(self._bound) if found else None
        return found

    def _note(self, case: Indices, x: Array, values: Array, failures: Failures) -> None:
        """Remember the reasons of the runs that have no outcome."""
        gone = np.isnan(values)
        if not gone.any():
            return
        form = self._form.some(case)
        gone = gone if form.observed is None else gone & form.observed
        runs = np.flatnonzero(gone.any(axis=1))
        self.lost += len(runs)
        first = runs[: self._settings.remembered - len(self.failures)]
        if not len(first):
            return
        noted = {}
        for k, run in enumerate(first.tolist()):
            fault = form.fault(run, int(np.argmax(gone[run])), np.nan)
            noted[k] = failures.get(run) or Failure(fault, kind=NOT_FINITE)
        lost = replace(Runs.planned(case[first], x[first]), failures=noted)
        self.failures = Runs.joined([self.failures, lost])

    def _block(self, case: Indices, x: Array) -> tuple[Array, Failures]:
        try:
            if self._together is not None:
                return self._together(case, x), {}
            returned = self._simulator(*self._bound.columns(case, x))
            found = self._form.some(case).shaped(self._simulator, returned, len(case))
            return found[:, : self._form.width], {}
        except (AleatorError, KeyboardInterrupt):
            raise
        except BaseException as error:
            if isinstance(error.__cause__, KeyboardInterrupt) and isinstance(error, RunStopped):
                raise error.__cause__ from None
            return self._carefully(case, x)

    def _carefully(self, case: Indices, x: Array) -> tuple[Array, Failures]:
        """Values (R, W) of runs of which some raise an exception; the values of these are NaN."""
        runs = Runs.planned(case, x, self._form.width)
        made = make(self._simulator, Batch.of(self._unmeasured, runs), np.inf)
        if made.stopped:
            raise made.stopped
        return made.outcome[:, : self._form.width], made.failures
