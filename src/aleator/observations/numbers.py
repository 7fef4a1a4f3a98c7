"""Real numbers out of whatever arrays people have."""

from __future__ import annotations

from typing import Any

import numpy as np

from aleator.types import Array

_MISSING = ("NoneType", "NAType", "NaTType")


def real_numbers(values: Any) -> Array:
    """The same numbers as float64, of the same shape; NaN where one is masked or missing.

    Objects that are numbers (of Decimal, Fraction, a data frame) are taken. Raises TypeError for
    texts, truth values, complex numbers and dates: none of them is an outcome.

    >>> real_numbers(np.ma.masked_array([1, 2], mask=[True, False])).tolist()
    [nan, 2.0]
    >>> real_numbers(np.array([1.5, None], dtype=object)).tolist()
    [1.5, nan]
    >>> real_numbers(["1.5"])
    Traceback (most recent call last):
        ...
    TypeError: values of type <U3
    """
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values
    array = np.asarray(values)
    if array.dtype.kind == "O":
        array = np.array([_real(value) for value in array.ravel()], np.float64).reshape(array.shape)
    elif array.dtype.kind not in "fiu":
        raise TypeError(f"values of type {array.dtype}")
    numbers = array.astype(np.float64)
    if isinstance(values, np.ma.MaskedArray):
        numbers[np.ma.getmaskarray(values)] = np.nan
    return numbers


def _real(value: Any) -> float:
    kind = type(value)
    if kind.__name__ in _MISSING or value is np.ma.masked:
        return np.nan
    if isinstance(value, (bool, np.bool_, complex, np.complexfloating)) or not hasattr(
        kind, "__float__"
    ):
        raise TypeError(f"values of type {kind.__name__}")
    try:
        return float(value)
    except OverflowError:
        return np.inf
