"""Functions of numbers that may be called with arrays: many runs in one call."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.simulators.form import Form
from aleator.simulators.function import FunctionSimulator
from aleator.simulators.protocol import Columns
from aleator.types import Array

CHECKED = 16
"""Runs at which calls with numbers and one call with arrays are compared, at most."""
_DIGITS = 16 * np.finfo(np.float64).eps
# Last digits may differ: powers and exponentials of arrays are computed by other code.


def elementwise(
    simulator: FunctionSimulator, conditions: Columns, parameters: Columns, form: Form
) -> bool:
    """Whether a function gives the same values for R runs in one call with arrays.

    `conditions` and `parameters` are the columns (R,) of at most CHECKED runs, which should differ
    in both. A series gets the rows of all runs one below the other. The same is: to the last
    four bits. A function that raises either way is not elementwise. Cost: at most R + 1 calls.

    >>> columns = {"x": np.array([1.0, 2.0])}
    >>> elementwise(FunctionSimulator(lambda x: 2.0 * x), {}, columns, Form())
    True
    >>> elementwise(FunctionSimulator(lambda x: 2.0 if x > 1.5 else x), {}, columns, Form())
    False
    """
    rows = slice(CHECKED)
    some = {name: column[rows] for name, column in conditions.items()}
    given = {name: column[rows] for name, column in parameters.items()}
    form = form.some(rows)
    try:
        together = in_one_call(simulator, some, given, form)
        returned = simulator(some, given)
        each = form.shaped(simulator, returned, len(together))
    except KeyboardInterrupt:
        raise
    except BaseException:
        return False
    return bool(np.allclose(together, each, rtol=_DIGITS, atol=0.0, equal_nan=True))


def in_one_call(
    simulator: FunctionSimulator, conditions: Columns, parameters: Columns, form: Form
) -> Array:
    """Values (R, W) of R runs of an `elementwise` function, in one call with arrays.

    Raises what the function raises, and TypeError for what is neither an array of the rows nor a
    number.
    """
    columns = {**conditions, **parameters}
    count, size = len(next(iter(parameters.values()))), len(form.responses)
    if form.rows is None:
        parts = _parts(simulator, columns, form, count)
        return np.stack(np.broadcast_arrays(np.empty(count), *parts)[1:], axis=1)
    run = np.repeat(np.arange(count), form.rows)
    place = np.arange(len(run)) - np.repeat(np.cumsum(form.rows) - form.rows, form.rows)
    rows = {name: _of_rows(column, run) for name, column in columns.items()}
    values = np.full((count, form.width), np.nan)
    for k, part in enumerate(_parts(simulator, rows, form, len(run))):
        values[run, place * size + k] = part
    return values


def _parts(simulator: FunctionSimulator, columns: Columns, form: Form, count: int) -> list[Array]:
    """What the function returned for each response: an array (count,), or a number."""
    with np.errstate(all="ignore"):
        returned = simulator.function(**columns)
    named = isinstance(returned, Mapping)
    parts = [returned[name] for name in form.responses] if named else [returned]
    if len(parts) != len(form.responses):
        raise TypeError("it named no responses")
    return [_numbers(part, count) for part in parts]


def _of_rows(column: NDArray[Any], run: NDArray[np.intp]) -> NDArray[Any]:
    """A column of runs as one of rows."""
    if column.dtype == object and len(column) and isinstance(column[0], np.ndarray):
        return np.concatenate([*column])
    return column[run]


def _numbers(part: Any, rows: int) -> Array:
    numbers = np.asarray(part)
    if numbers.shape not in ((), (rows,)) or numbers.dtype.kind not in "fiu":
        raise TypeError(f"it returned {numbers.dtype} values of shape {numbers.shape}")
    return numbers.astype(np.float64)
