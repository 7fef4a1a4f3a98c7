"""Functions of numbers that may be called with arrays: many runs in one call."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.errors import SurroundingsError
from aleator.observations.tables import real_numbers
from aleator.simulators.bound import Bound
from aleator.types import Array, Indices

CHECKED = 16
"""Runs at which calls with numbers and one call with arrays are compared, at most."""
_DIGITS = 16 * np.finfo(np.float64).eps
# Last digits may differ: powers and exponentials of arrays are computed by other code.


class Together:
    """Runs of an `elementwise` function in one call, which gets the rows of all one below another.

    >>> import pandas as pd
    >>> from aleator.simulators.cases import Cases
    >>> from aleator.simulators.function import FunctionSimulator
    >>> cases = Cases.of({"load": np.array([1.0, 2.0])}, 2)
    >>> together = Together(Bound(FunctionSimulator(lambda load, x: load * x), cases, ("x",)))
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
        """Values (R, W) of runs of `case` (R,) at x (R, n).

        Raises what the function raises, and TypeError for what is neither an array of the rows nor
        a number. Cost: some 15 ns a value beside the function's own.
        """
        size = len(self._form.responses)
        values = np.full((len(case), self._form.width), np.nan)
        if self._each:
            rows = self._start[case]
            if self._each > 1:
                rows = (rows[:, None] + np.arange(self._each)).ravel()
            for k, part in enumerate(self._parts(rows, np.repeat(x.T, self._each, axis=1))):
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
        """What the function returns for each response at x (n, rows): an array, or a number."""
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
        return [_numbers(part, len(rows)) for part in parts]


def elementwise(bound: Bound, case: Indices, x: Array) -> bool:
    """Whether a function gives the same values for runs of `case` (R,) at x (R, n) in one call.

    The runs, of which CHECKED are looked at, should differ in both. The same is: to the last four
    bits. A function that raises either way is not elementwise. Cost: at most CHECKED + 1 calls.

    >>> from aleator.simulators.cases import Cases
    >>> from aleator.simulators.function import FunctionSimulator
    >>> def is_so(function):
    ...     bound = Bound(FunctionSimulator(function), Cases.of({}, 1), ("x",))
    ...     return elementwise(bound, np.zeros(2, int), np.array([[1.0], [2.0]]))
    >>> is_so(lambda x: 2.0 * x), is_so(lambda x: 2.0 if x > 1.5 else x)
    (True, False)
    """
    case, x = case[:CHECKED], x[:CHECKED]
    try:
        together = Together(bound)(case, x)
        returned = bound.simulator(*bound.columns(case, x))
        each = bound.form.some(case).shaped(bound.simulator, returned, len(case))
    except (KeyboardInterrupt, SurroundingsError):
        raise
    except BaseException:
        return False
    return bool(np.allclose(together, each, rtol=_DIGITS, atol=0.0, equal_nan=True))


def _flat(column: NDArray[Any], rows: Indices) -> NDArray[Any]:
    """A column of cases as one of all their rows."""
    if column.dtype == object and len(column) and isinstance(column[0], np.ndarray):
        return np.concatenate([*column])
    return np.repeat(column, rows)


def _numbers(part: Any, rows: int) -> Array:
    numbers = real_numbers(part)
    if numbers.shape not in ((), (rows,)):
        raise TypeError(f"it returned values of shape {numbers.shape}")
    return numbers
