"""Sums of residuals over a column that are zero on average under the right model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from aleator.inference.consistency.columns import FEWEST, ORDER, Column
from aleator.types import Array, Indices

MAIN = 3.0
"""The weight of the likeliest form of dependence on a column, its trend, among its parts."""


@dataclass(frozen=True)
class Subject:
    """What a test is about: its group of tests, what of the residuals, and where.

    `of` is "outcomes", "scatter", or a hyperparameter. `column` is None where a test is about all
    observations; `where` names the part of the column, and is None for a trend along it. `weight`
    says how many times as many of the false alarms it may have as another test of its group, and
    `least` how far a right model's statistic is taken to scatter at least.
    """

    group: str
    kind: str
    of: str
    column: str | None = None
    where: str | None = None
    skewed: bool = False
    one_sided: bool = False
    weight: float = 1.0
    least: float = 0.0


@dataclass(frozen=True, eq=False)
class Contrasts:
    """Weights (T, M) of observations, each of mean zero and length one, of these columns and parts.

    The sum of independent values of variance one has then the variance one. `main` tells those
    that weigh more: the trend along a condition, and the one contrast of a column of two values.
    """

    column: tuple[Column, ...]
    where: tuple[str | None, ...]
    main: tuple[bool, ...]
    weights: Array


def contrasts_of(columns: tuple[Column, ...], count: int) -> Contrasts:
    """A trend along each column of numbers, and each part of it against the rest.

    `count` is M, of a table without a column too.
    """
    found = [(column, where, weight) for column in columns for where, weight in _of_column(column)]
    return Contrasts(
        tuple(column for column, _, _ in found),
        tuple(where for _, where, _ in found),
        tuple(_is_main(column, where) for column, where, _ in found),
        np.array([weight for _, _, weight in found]).reshape(len(found), count),
    )


def _is_main(column: Column, where: str | None) -> bool:
    return column.name != ORDER and (where is None or column.count == 2)


def _of_column(column: Column) -> Iterator[tuple[str | None, Array]]:
    if column.ranks is not None:
        yield None, column.ranks / np.linalg.norm(column.ranks)
    if column.count == 2 and column.ranks is not None:
        return
    known = column.level >= 0
    parts = range(1, 2) if len(column.labels) == 2 else range(len(column.labels))
    if column.name == ORDER:
        return
    for part in parts:
        inside = column.level == part
        if min(inside.sum(), known.sum() - inside.sum()) < FEWEST:
            continue
        weight = np.where(known, inside - inside.sum() / known.sum(), 0.0)
        yield column.labels[part], weight / np.linalg.norm(weight)


def shared(group: Indices, values: Array) -> float:
    """How alike values of variance one are within groups: their sums squared over their number.

    Only groups of two and more count; the mean is zero, whatever the sizes.
    """
    count = np.bincount(group)
    total, square = np.bincount(group, values), np.bincount(group, values**2)
    many = count > 1
    within = count[many] * (count[many] - 1.0)
    return float(np.sum(total[many] ** 2 - square[many]) / np.sqrt(2.0 * within.sum()))
