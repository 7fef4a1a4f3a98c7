"""Columns of a table as numbers, and what they do within its experiments."""

from __future__ import annotations

import keyword
from collections.abc import Sequence

import numpy as np

from aleator.errors import ExperimentsError
from aleator.observations.tables import Table
from aleator.types import Array

LEVELS = 6
"""A column of texts with more different ones is no covariate."""
EACH = 10
"""Experiments for each covariate that is proposed."""


def numbers_of(table: Table, name: str) -> Array | None:
    """The numbers of a column, NaN where blank, and of "> 20" the 20.

    None where it has none, or anything else.
    """
    try:
        numbers, _ = table.bounds(name)
    except ExperimentsError:
        return None
    return numbers if np.any(np.isfinite(numbers)) else None


def varies_within(table: Table, name: str, id: str | None) -> bool:
    """Whether a column has several values within any experiment."""
    if id is None:
        return False
    texts = table.texts(name)
    return len({*zip(table.texts(id), texts, strict=True)}) > len({*table.texts(id)})


def covariates_in(table: Table, names: Sequence[str], id: str | None) -> dict[str, str]:
    """Of these columns those that a law may follow, each with its term in a formula.

    They have no blank cell and one value an experiment. Texts have few levels, each of two
    experiments or more; numbers differ, and do not merely count the rows. One for each ten
    experiments at most, but one always.

    >>> cells = {"by": ["a", "a", "b", "b"], "t": ["20", "25", "20", "30"]}
    >>> covariates_in(Table("a.csv", cells, ["row"] * 4), ["by", "t"], None)
    {'by': 'C(by)'}
    """
    first = _first_rows(table, id)
    found = {name: _term(table, name, first) for name in names if _can_be_named(name)}
    known = [
        (name, term) for name, term in found.items() if term and not varies_within(table, name, id)
    ]
    return dict(known[: max(len(first) // EACH, 1)])


def _first_rows(table: Table, id: str | None) -> list[int]:
    """The first row of each experiment."""
    if id is None:
        return [*range(len(table))]
    return [*{text: row for row, text in reversed([*enumerate(table.texts(id))])}.values()]


def _term(table: Table, name: str, rows: Sequence[int]) -> str:
    """The column as a term of a formula; empty where it is no covariate."""
    texts = [table.texts(name)[row] for row in rows]
    numbers = numbers_of(table, name)
    if "" in texts or len({*texts}) < 2:
        return ""
    if numbers is None:
        fit = len({*texts}) <= LEVELS and min(map(texts.count, {*texts})) > 1
        return f"C({name})" if fit else ""
    steps = np.diff(numbers[sorted(rows)])
    return "" if np.all(steps == 1.0) else f"center({name})"


def _can_be_named(name: str) -> bool:
    """Whether a formula can name the column."""
    return name.isidentifier() and not keyword.iskeyword(name)
