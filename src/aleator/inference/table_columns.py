"""The columns of a table, as what residuals may depend on; and those that copy the outcomes.

`columns_of` reads a table; `copies_of` finds columns that tell the outcomes again.
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
    """How columns are read, and when they copy the outcomes; by judgement."""

    bins: int = 4
    """Parts, alike in size, of a column of more numbers."""
    pairs: int = 8
    """Pairs of neighbours that say whether a table was sorted, at least."""
    sorted: float = 0.8
    """Share of the pairs that rise (or fall) in a table that was sorted."""
    distinct: int = 7
    """Distinct values at least, of the column and of the outcome: fewer may be in one order by
    chance.

    Of seven independent values two orders in 5040 are that of the outcome, or its reverse.
    """
    rounded: float = 1e-4
    """Share of a column's variance that rounding may leave, where the outcome gives it."""
    coarse: float = 0.5
    """Distinct values that a copy has at least, for each of the outcome: rounding leaves so many.
    """
    levels: int = 6
    """A column of so many values at most is looked at value by value."""
    fewest: int = 3
    """Observations of a level that are looked at by themselves."""


COLUMNS = ColumnSettings()

ORDER = "the order of the rows"
"""The name of the column that counts rows."""
RESPONSE = "response"


@dataclass(frozen=True, eq=False)
class Column:
    """A column of the table, at the M observations.

    `ranks` (M,) are centered mid-ranks, zero where a cell is empty; None for texts. `level` (M,)
    is the part of the column that a row belongs to, -1 for none, and `labels` name the parts.
    `group` (M,) counts the distinct values. `by_experiment` tells whether the value is the same in
    all rows of each experiment. `alike` are other columns that order the rows in the same way.
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
    """All columns that vary, the response where there are several, and the row order.

    Of columns that part the rows alike only the first is kept.
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

    The normal scores (M,) then rise, or fall, from experiment to experiment under the same
    conditions, or the individual means (N, s) of a parameter do where experiments have several
    observations: the order says nothing of when they were made.
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
    """Whether nearly all of at least eight steps go one way."""
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
    """Parts of a column of numbers that have about as many rows each."""
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
    """Keys that two columns share if they part the rows alike, be it in reverse order."""
    if column.ranks is not None:
        return column.ranks.tobytes(), (-column.ranks + 0.0).tobytes()
    _, first = np.unique(column.group, return_index=True)
    order = np.argsort(np.argsort(first))
    return (b"text" + order[column.group].tobytes(),)


RARE = -math.log(math.factorial(COLUMNS.distinct) / 2)
"""The logarithm of that probability."""


def copies_of(
    columns: Sequence[Column],
    table: Experiments,
    requested: Collection[str],
    normal: Array,
    settings: ColumnSettings = COLUMNS,
) -> tuple[Column, ...]:
    """Columns that are computed from the outcome, alone or with the columns `requested`.

    Their numbers order the measured values of a response, all or under each of the conditions that
    the simulator or a law takes, as these are themselves or in reverse; or they are a sum or a
    product of the outcome and of such conditions; or of several observations of an experiment the
    first, last, least, largest or mean; or their classes part the outcomes at limits, but neither
    the `normal` scores (M,), which a condition would part as well, nor what is asked for. A
    condition does that only where nothing else scatters; so what is asked for is none. Nor are
    columns conditions that tell no more than whether an outcome was measured, or is a bound.
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
    """Names of columns whose classes part the outcomes at limits: results, or strong causes."""
    return {
        column.name
        for column in columns
        if any(classed(column, seen.lower, rows) for rows in _measured(column, seen))
    }


def classed(column: Column, values: Array, rows: Flags) -> bool:
    """Whether in the order of values (M,) the classes of a column follow one another.

    Equal values are of one class then, and no such order of the classes would come by chance.
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
    """Numbers (M,) of the combinations of groups that occur."""
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
    """Whether first, last, mean, least or largest of each series order as the column does."""
    first = np.unique(experiment, return_index=True)[1]
    count = np.diff([*first, y.size])
    sums = (
        y[first], y[first + count - 1], np.add.reduceat(y, first) / count,
        np.minimum.reduceat(y, first), np.maximum.reduceat(y, first),
    )  # fmt: skip
    together = np.zeros(first.size, dtype=np.intp)
    return any(_ordered(value, ranks[first], together, settings) for value in sums)


def _ordered(y: Array, ranks: Array, same: Indices, settings: ColumnSettings) -> bool:
    """Whether ranks rise with y, or fall, within each group, and not by chance."""
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
    """Whether within each group values rise where y rises."""
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
    """Whether a column is a linear combination, or a product of powers, of y and conditions.

    But for rounding: y must leave less than the share `rounded` of the variance that the conditions
    leave.
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
