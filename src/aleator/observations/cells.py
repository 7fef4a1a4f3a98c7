"""One cell of a table, a text or a Python value: what it holds, and what to say if it is wrong."""

from __future__ import annotations

import math
import re
from numbers import Real

import numpy as np

_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_ABOVE = (">", "≥")
_BOUND = re.compile(r"(?P<side>[<>≤≥])\s*=?\s*(?P<number>[+-]?\.?\d.*)")
UNMEASURED = (
    "write a finite number there; where only a bound is known, write that and say so by the key "
    "censored; delete the row only if nothing was measured"
)
"""What to do about an outcome that is none."""
_MISSING = ("NAType", "NaTType")  # what pandas puts where there is nothing


def number_of(cell: object, decimal: str) -> tuple[float, str]:
    """The number in a cell and "", or NaN and what is wrong with the cell."""
    if isinstance(cell, Real) and not isinstance(cell, (bool, np.bool_)):
        number = float(cell)
    else:
        text = text_of(cell)
        if not text:
            return math.nan, "the cell is blank, a number is needed"
        try:
            # float() also takes 1_000, which is a slip of the pen in a table.
            number = math.nan if "_" in text else float(text.replace(decimal, "."))
        except ValueError:
            return math.nan, f"'{short(text)}' is not a number"
        if "_" in text:
            return math.nan, f"'{short(text)}' is not a number"
    if not math.isfinite(number):
        return math.nan, f"'{short(str(cell))}' is not a finite number"
    return number, ""


def bound_of(cell: object, decimal: str) -> tuple[float, int, str]:
    """The number in a cell, its sign, and what is wrong: "> 20" is 20 with the sign 1.

    The sign is -1 for what lies below the number, 0 for the number itself.

    >>> bound_of("> 20", "."), bound_of("<=0,5", ","), bound_of("3", ".")
    ((20.0, 1, ''), (0.5, -1, ''), (3.0, 0, ''))
    """
    found = _BOUND.fullmatch(text_of(cell))
    sign = 0 if found is None else 1 if found["side"] in _ABOVE else -1
    number, fault = number_of(cell if found is None else found["number"], decimal)
    return number, sign, fault


def is_blank(cell: object) -> bool:
    """Whether a cell holds nothing; a NaN that is a number, as pandas writes it, is nothing."""
    return (isinstance(cell, Real) and cell != cell) or not text_of(cell)


def text_of(cell: object) -> str:
    """A cell as stripped text; whatever pandas calls missing is blank."""
    missing = cell is None or type(cell).__name__ in _MISSING
    return "" if missing else str(cell).strip()


def short(text: str) -> str:
    """A text cut to forty characters."""
    return text if len(text) <= 40 else text[:37] + "..."


def has_decimal_comma(cell: object) -> bool:
    """Whether it is a number with a comma where a point was expected."""
    return _DECIMAL_COMMA.fullmatch(text_of(cell)) is not None


def remedy(cell: object) -> str:
    """What to write in place of a cell that is no number."""
    if has_decimal_comma(cell):
        return 'write a decimal point, or say so with the key decimal = ","'
    return "write a finite number there, or delete the row of an experiment that has none"


def outcome_remedy(cell: object) -> str:
    """What to write for a measured value: to leave out those beyond a bound would bias the law."""
    bound = _BOUND.fullmatch(text_of(cell))
    if bound is None:
        return remedy(cell) if has_decimal_comma(cell) else UNMEASURED
    return (
        "say that cells with such a sign are bounds: censored = {signs = true}; without the row "
        "the law would be biased"
    )
