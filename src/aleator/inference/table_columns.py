"""The columns of a table on which residuals may depend, and columns computed from the outcomes.

`columns_of` reads a table; `copies_of` finds columns that only repeat the outcomes in another form.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import special, stats

from aleator.core.types import Array, Flags, Indices
from aleator.observations.experiments import Experiments
from aleator.observations.responses import Observations, Transform


@dataclass(frozen=True)
class ColumnSettings:
    """Settings of reading columns and of finding copies of the outcomes, chosen by judgement."""

    bins: int = 4
    """Number of parts, of equal size, into which a column with many different numbers is divided.
    """
    pairs: int = 8
    """Least number of pairs of neighbours from which it is judged whether a table was sorted."""
    sorted: float = 0.8
    """Share of the pairs that rise (or fall) from which a table counts as sorted."""
    distinct: int = 7
    """Least number of distinct values of the column and of the outcome; a smaller number may have
    the same order by chance.

    Of the 5040 orders of seven independent values, two are the order of the outcome or its reverse.
    """
    rounded: float = 1e-4
    """Largest share of a column's variance that is left, by rounding, when it is computed from the
    outcome.
    """
    coarse: float = 0.5
    """Least ratio of the numbers of distinct values of a copy and of the outcome; rounding lowers
    it.
    """
    levels: int = 6
    """Largest number of distinct values for which each value of a column is a part by itself."""
    fewest: int = 3
    """Least number of observations in a part of a column that is tested."""


COLUMNS = ColumnSettings()

ORDER = "the order of the rows"
"""The name of the column of row numbers."""
RESPONSE = "response"


@dataclass(frozen=True, eq=False)
class Column:
    """A column of the table, with one entry for each of the M observations.

    `ranks` (M,) are centered mid-ranks, zero where a cell is empty; None for a column of text.
    `level` (M,) is the part of the column to which a row belongs, -1 for none, and `labels` are the
    names of the parts. `group` (M,) numbers the distinct values. `by_experiment` says whether the
    value is the same in all rows of each experiment. `alike` are other columns that order the rows
    in the same way.
    """

    name: str
    ranks: Array | None
    level: Indices
    labels: tuple[str, ...]
    group: Indices
    by_experiment: bool
    alike: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """The number of distinct values."""
        return int(self.group.max()) + 1


def columns_of(table: Experiments, settings: ColumnSettings = COLUMNS) -> tuple[Column, ...]:
    """All columns that vary, the response if there are several, and the order of the rows.

    Of several columns that divide the rows in the same way only the first is kept.
    """
    seen, frame = table.observations, table.table
    found: list[Column] = []
    kept: dict[bytes, int] = {}
    for name, values in _values(table, frame):
        column = _column(name, values, seen.experiment, settings)
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
    columns: tuple[Column, ...],
    experiment: Indices,
    normal: Array,
    means: Array,
    settings: ColumnSettings = COLUMNS,
) -> tuple[Column, ...]:
    """The columns without the order of the rows, where the table was sorted by its outcomes.

    In a sorted table the normal scores (M,) rise, or fall, from experiment to experiment under the
    same conditions. With several observations per experiment, the individual means (N, s) of a
    parameter may rise or fall instead. The order of a sorted table is not the order in which
    experiments were made.
    """
    first = np.unique(experiment, return_index=True)[1]
    own = [
        column.group[first] for column in columns if column.by_experiment and column.name != ORDER
    ]
    same = np.ones(first.size - 1, dtype=np.bool_)
    for group in own:
        same &= np.diff(group) == 0
    steps = [np.diff(np.add.reduceat(normal, first))[same]]
    if first.size < experiment.size:
        steps += [*np.diff(means, axis=0).T]
    if not any(_sorted(each, settings) for each in steps):
        return columns
    return tuple(column for column in columns if column.name != ORDER)


def _sorted(steps: Array, settings: ColumnSettings) -> bool:
    """Whether nearly all of at least eight steps have the same sign."""
    share = (
        max(np.mean(steps >= 0.0), np.mean(steps <= 0.0)) if steps.size >= settings.pairs else 0.0
    )
    return bool(share >= settings.sorted)


def _values(table: Experiments, frame: pd.DataFrame) -> Iterator[tuple[str, pd.Series]]:
    seen = table.observations
    for name in frame.columns:
        yield str(name), frame[name].iloc[seen.row].reset_index(drop=True)
    if len(seen.responses) > 1:
        yield RESPONSE, pd.Series([seen.responses[k].name for k in seen.response])
    order = seen.row if len(seen) == len(table.ids) else seen.experiment
    yield ORDER, pd.Series(order.astype(float))


def _column(name: str, values: pd.Series, experiment: Indices, settings: ColumnSettings) -> Column:
    numbers = _numbers(values)
    if numbers is None:
        texts = values.astype(str).to_numpy()
        distinct_texts, group = np.unique(texts, return_inverse=True)
        few = distinct_texts.size <= settings.levels
        level = group if few else np.full(group.shape, -1)
        shown = tuple(f"{name} = {label}" for label in distinct_texts) if few else ()
        return Column(name, None, level, shown, group, _own(group, experiment))
    known = np.isfinite(numbers)
    distinct, group = np.unique(np.where(known, numbers, np.nan), return_inverse=True)
    distinct = distinct[np.isfinite(distinct)]
    ranks = np.zeros(numbers.size)
    if np.any(known):
        ranks[known] = stats.rankdata(numbers[known]) - 0.5 * (known.sum() + 1)
    if distinct.size <= settings.levels:
        labels: tuple[str, ...] = tuple(f"{name} = {value:g}" for value in distinct)
        level = np.where(known, group, -1)
    else:
        level, labels = _binned(name, numbers, ranks, known, settings)
    return Column(name, ranks, level, labels, group, _own(group, experiment))


def _binned(
    name: str, numbers: Array, ranks: Array, known: Flags, settings: ColumnSettings
) -> tuple[Indices, tuple[str, ...]]:
    """The parts of a column of numbers, with about equal numbers of rows."""
    share = ranks / known.sum() + 0.5
    level = np.where(
        known, np.clip((settings.bins * share).astype(np.intp), 0, settings.bins - 1), -1
    )
    labels = []
    for part in range(settings.bins):
        inside = numbers[level == part]
        ends = (inside.min(), inside.max()) if inside.size else (np.nan, np.nan)
        labels.append(f"{name} from {ends[0]:g} to {ends[1]:g}")
    return level, tuple(labels)


def _numbers(values: pd.Series) -> Array | None:
    """The numbers (M,) of a column, NaN for empty cells; None if a cell is a text."""
    try:
        return np.asarray(pd.to_numeric(values), dtype=float)
    except (TypeError, ValueError):
        return None


def _own(group: ArrayLike, experiment: Indices) -> bool:
    """Whether the value is the same in all observations of each experiment."""
    values = np.asarray(group)
    first = np.searchsorted(experiment, experiment)
    return bool(np.all(values == values[first]))


def _keys(column: Column) -> tuple[bytes, ...]:
    """Keys that two columns share if they divide the rows alike, also in reverse order."""
    if column.ranks is not None:
        return column.ranks.tobytes(), (-column.ranks + 0.0).tobytes()
    _, first = np.unique(column.group, return_index=True)
    order = np.argsort(np.argsort(first))
    return (b"text" + order[column.group].tobytes(),)


RARE = -math.log(math.factorial(COLUMNS.distinct) / 2)
"""The logarithm of the probability that seven random values are in a given order or its reverse."""


def copies_of(
    columns: Sequence[Column],
    table: Experiments,
    requested: Collection[str],
    normal: Array,
    settings: ColumnSettings = COLUMNS,
) -> tuple[Column, ...]:
    """Columns that are computed from the outcome, alone or with the columns `requested`.

    `requested` are the columns that the simulator or a law uses; they are never copies. Another
    column is a copy in each of these cases:

    - It has the order of a response's measured values, or its reverse, among all observations or
      under each condition.
    - It is a sum or a product of the outcome and of requested columns.
    - It has the order of the first, last, least, largest or mean value of each experiment's series.
    - Its classes divide the outcomes at limits, but neither the `normal` scores (M,), which a
      condition would divide too, nor a requested column.
    - It only says whether an outcome was measured or is a bound.

    A real condition could do this only if nothing else scattered.
    """
    seen = table.observations
    taken = [c for c in columns if {c.name, *c.alike} & set(requested)]
    same = _together([c.group for c in taken], len(seen))
    causes = [normal, *(c.ranks for c in taken if c.ranks is not None)]
    return tuple(
        column
        for column in columns
        if column.name not in {ORDER, RESPONSE}
        and column not in taken
        and (
            _censoring(column, seen)
            or any(
                _copied(column, seen, rows, same, settings)
                or _computed(column, table, rows, taken, settings)
                or (
                    classed(column, seen.lower, rows)
                    and not any(classed(column, values, rows) for values in causes)
                )
                for rows in _measured(column, seen)
            )
        )
    )


def classes_of(columns: Sequence[Column], seen: Observations) -> set[str]:
    """Names of columns whose classes divide the outcomes at limits: results or causes."""
    return {
        column.name
        for column in columns
        if any(classed(column, seen.lower, rows) for rows in _measured(column, seen))
    }


def classed(column: Column, values: Array, rows: Flags) -> bool:
    """Whether the classes of a column follow one another when sorted by the values (M,).

    Equal values must be of one class, and such an order of the classes must be improbable by
    chance.
    """
    size = np.bincount(column.group[rows])
    size = size[size > 0]
    if size.size < 2:
        return False
    chance = special.gammaln(size + 1).sum() - special.gammaln(size.sum() + 1)
    if chance + special.gammaln(size.size + 1) > RARE:
        return False
    value, group = np.unique([values[rows], column.group[rows]], axis=1)
    return bool(np.all(np.diff(value) > 0.0) and np.sum(np.diff(group) != 0.0) == size.size - 1)


def _measured(column: Column, seen: Observations) -> Iterator[Flags]:
    """For each response the rows (M,) that were measured and have a value of the column."""
    known = seen.measured & ((column.level >= 0) | (column.ranks is None))
    for response in range(len(seen.responses)):
        rows = known & (seen.response == response)
        if np.any(rows):
            yield rows


def _together(groups: Sequence[Indices], size: int) -> Indices:
    """The combination of groups to which each observation belongs, as a number (M,)."""
    if not groups:
        return np.zeros(size, dtype=np.intp)
    return np.unique(np.stack(groups, axis=1), axis=0, return_inverse=True)[1].ravel()


def _censoring(column: Column, seen: Observations) -> bool:
    """Whether a column only says which observations are bounds, and which bounds."""
    if np.all(seen.measured):
        return False
    ends = np.where(seen.measured[:, None], 0.0, np.stack([seen.lower, seen.upper], axis=1))
    kind = np.unique(np.column_stack([seen.measured, ends]), axis=0, return_inverse=True)[1].ravel()
    pairs = np.unique(np.column_stack([kind, column.group]), axis=0)
    return bool(len(pairs) == kind.max() + 1)


def _copied(
    column: Column, seen: Observations, rows: Flags, same: Indices, settings: ColumnSettings
) -> bool:
    if column.ranks is None:
        return False
    y, ranks = seen.lower[rows], column.ranks[rows]
    if column.by_experiment and len(seen) > seen.experiment[-1] + 1:
        return _of_series(y, ranks, seen.experiment[rows], settings)
    everywhere = np.zeros(y.size, dtype=np.intp)
    return _ordered(y, ranks, everywhere, settings) or _ordered(y, ranks, same[rows], settings)


def _of_series(y: Array, ranks: Array, experiment: Indices, settings: ColumnSettings) -> bool:
    """Whether the first, last, mean, least or largest value of a series has the column's order."""
    first = np.unique(experiment, return_index=True)[1]
    count = np.diff([*first, y.size])
    sums = (
        y[first], y[first + count - 1], np.add.reduceat(y, first) / count,
        np.minimum.reduceat(y, first), np.maximum.reduceat(y, first),
    )  # fmt: skip
    together = np.zeros(first.size, dtype=np.intp)
    return any(_ordered(value, ranks[first], together, settings) for value in sums)


def _ordered(y: Array, ranks: Array, same: Indices, settings: ColumnSettings) -> bool:
    """Whether ranks rise with y in each group, or fall in each, and not by chance."""
    few, many = sorted(
        (len(np.unique([same, y], axis=1).T), len(np.unique([same, ranks], axis=1).T))
    )
    groups = same.max() + 1
    distinct = np.bincount(np.unique([same, y], axis=1)[0].astype(np.intp))
    if few < settings.coarse * many or few - groups < settings.distinct - 1:
        return False
    if -special.gammaln(distinct + 1).sum() > RARE:
        return False
    return _rising(y, ranks, same) or _rising(y, -ranks, same)


def _rising(y: Array, values: Array, same: Indices) -> bool:
    """Whether values rise where y rises, within each group."""
    order = np.lexsort((values, y, same))
    inside = np.diff(same[order]) == 0
    return bool(np.all(np.diff(values[order])[inside] >= 0.0))


def _computed(
    column: Column,
    table: Experiments,
    rows: Flags,
    taken: Sequence[Column],
    settings: ColumnSettings,
) -> bool:
    """Whether a column is a linear combination, or a product of powers, of y and the conditions.

    Rounding is allowed for: y must explain all but the share `rounded` of the variance that the
    conditions do not explain.
    """
    if column.ranks is None or rows.sum() < len(taken) + settings.distinct:
        return False
    seen = table.observations
    log = seen.responses[int(seen.response[rows][0])].transform is Transform.LOG
    y = np.exp(seen.lower[rows]) if log else seen.lower[rows]
    own, *others = (
        table.table[c.name].iloc[seen.row[rows]].to_numpy(dtype=float)
        for c in (column, *(c for c in taken if c.ranks is not None))
    )
    values = np.stack([own, y, *others])
    forms = [values, np.log(values)] if np.all(values > 0.0) else [values]
    for form in forms:
        if not np.all(np.isfinite(form)):
            continue
        design = np.stack([np.ones(y.size), *form[2:]], axis=1)
        c, y_left = form[:2] - (design @ np.linalg.lstsq(design, form[:2].T)[0]).T
        slope = c @ y_left / max(y_left @ y_left, np.finfo(float).tiny)
        if np.sum((c - slope * y_left) ** 2) < settings.rounded * (c @ c):
            return True
    return False
