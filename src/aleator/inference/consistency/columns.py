"""The columns of a table, as what residuals may depend on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import stats

from aleator.observations.experiments import Experiments
from aleator.types import Array, Flags, Indices

LEVELS = 6
"""A column of so many values at most is looked at value by value."""
BINS = 4
"""Parts, alike in size, of a column of more numbers."""
FEWEST = 3
"""Observations of a level that are looked at by themselves."""
ORDER = "the order of the rows"
"""The name of the column that counts rows."""
RESPONSE = "response"
PAIRS, SORTED = 8, 0.8
"""Pairs of neighbours at least, and the share that rise (or fall) in a table that was sorted."""


@dataclass(frozen=True, eq=False)
class Column:
    """A column of the table at M observations.

    `ranks` (M,) are centered mid-ranks, zero where a cell is empty; None for texts. `level` (M,)
    is the part of the column that a row belongs to, -1 for none, and `labels` name the parts.
    `group` (M,) counts the distinct values. `own` tells whether it is the same in all rows of each
    experiment. `alike` are other columns that order the rows in the same way.
    """

    name: str
    ranks: Array | None
    level: Indices
    labels: tuple[str, ...]
    group: Indices
    own: bool
    alike: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """The number of distinct values."""
        return int(self.group.max()) + 1


def columns_of(table: Experiments) -> tuple[Column, ...]:
    """Every column that is not constant, the responses where there are several, and the order.

    Of columns that part the rows alike only the first is kept.
    """
    seen, frame = table.observations, table.table
    found: list[Column] = []
    kept: dict[bytes, int] = {}
    for name, values in _values(table, frame):
        column = _column(name, values, seen.experiment)
        if column.count < 2:
            continue
        at = [kept[key] for key in _keys(column) if key in kept]
        if at:
            found[at[0]] = replace(found[at[0]], alike=(*found[at[0]].alike, name))
            continue
        kept[_keys(column)[0]] = len(found)
        found.append(column)
    return tuple(found)


def without_order(
    columns: tuple[Column, ...], experiment: Indices, normal: Array, means: Array
) -> tuple[Column, ...]:
    """The columns without the order of the rows, where the table was sorted by its outcomes.

    The normal scores (M,) then rise, or fall, from experiment to experiment under the same
    conditions, or the individual means (N, s) of a parameter do where experiments have several
    observations: the order says nothing of when they were made.
    """
    first = np.unique(experiment, return_index=True)[1]
    own = [column.group[first] for column in columns if column.own and column.name != ORDER]
    same = np.ones(first.size - 1, dtype=np.bool_)
    for group in own:
        same &= np.diff(group) == 0
    steps = [np.diff(np.add.reduceat(normal, first))[same]]
    if first.size < experiment.size:
        steps += [*np.diff(means, axis=0).T]
    if not any(map(_sorted, steps)):
        return columns
    return tuple(column for column in columns if column.name != ORDER)


def _sorted(steps: Array) -> bool:
    """Whether nearly all steps go one way, of enough."""
    share = max(np.mean(steps >= 0.0), np.mean(steps <= 0.0)) if steps.size >= PAIRS else 0.0
    return bool(share >= SORTED)


def _values(table: Experiments, frame: pd.DataFrame) -> Iterator[tuple[str, pd.Series]]:
    seen = table.observations
    for name in frame.columns:
        yield str(name), frame[name].iloc[seen.row].reset_index(drop=True)
    if len(seen.responses) > 1:
        yield RESPONSE, pd.Series([seen.responses[k].name for k in seen.response])
    order = seen.row if len(seen) == len(table.ids) else seen.experiment
    yield ORDER, pd.Series(order.astype(float))


def _column(name: str, values: pd.Series, experiment: Indices) -> Column:
    numbers = _numbers(values)
    if numbers is None:
        texts = values.astype(str).to_numpy()
        distinct_texts, group = np.unique(texts, return_inverse=True)
        few = distinct_texts.size <= LEVELS
        level = group if few else np.full(group.shape, -1)
        shown = tuple(f"{name} = {label}" for label in distinct_texts) if few else ()
        return Column(name, None, level, shown, group, _own(group, experiment))
    known = np.isfinite(numbers)
    distinct, group = np.unique(np.where(known, numbers, np.nan), return_inverse=True)
    distinct = distinct[np.isfinite(distinct)]
    ranks = np.zeros(numbers.size)
    if np.any(known):
        ranks[known] = stats.rankdata(numbers[known]) - 0.5 * (known.sum() + 1)
    if distinct.size <= LEVELS:
        labels: tuple[str, ...] = tuple(f"{name} = {value:g}" for value in distinct)
        level = np.where(known, group, -1)
    else:
        level, labels = _binned(name, numbers, ranks, known)
    return Column(name, ranks, level, labels, group, _own(group, experiment))


def _binned(
    name: str, numbers: Array, ranks: Array, known: Flags
) -> tuple[Indices, tuple[str, ...]]:
    """Parts alike in size; equal numbers are in the same part."""
    share = ranks / known.sum() + 0.5
    level = np.where(known, np.clip((BINS * share).astype(np.intp), 0, BINS - 1), -1)
    labels = []
    for part in range(BINS):
        inside = numbers[level == part]
        ends = (inside.min(), inside.max()) if inside.size else (np.nan, np.nan)
        labels.append(f"{name} from {ends[0]:g} to {ends[1]:g}")
    return level, tuple(labels)


def _numbers(values: pd.Series) -> Array | None:
    """The numbers (M,) of a column, NaN for empty cells; None where a cell is a text."""
    try:
        return np.asarray(pd.to_numeric(values), dtype=float)
    except (TypeError, ValueError):
        return None


def _own(group: ArrayLike, experiment: Indices) -> bool:
    """Whether all observations of each experiment are in one group."""
    values = np.asarray(group)
    first = np.searchsorted(experiment, experiment)
    return bool(np.all(values == values[first]))


def _keys(column: Column) -> tuple[bytes, ...]:
    """What two columns share that part the rows alike; numbers also in the reverse order."""
    if column.ranks is not None:
        return column.ranks.tobytes(), (-column.ranks + 0.0).tobytes()
    _, first = np.unique(column.group, return_index=True)
    order = np.argsort(np.argsort(first))
    return (b"text" + order[column.group].tobytes(),)
