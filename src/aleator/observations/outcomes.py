"""Measured values out of the columns of a table, exact or censored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.errors import ExperimentsError, nearest
from aleator.observations.responses import Observations, Response, require_responses, responses_of
from aleator.observations.tables import UNMEASURED, Table

Words = str | int | Sequence[str | int]
"""A word of a column, or several; a whole number is the word that it is written as."""


class ColumnValues(NamedTuple):
    """Values of one column in the original unit: the row (m,) of each, and its two ends (m,)."""

    row: Indices
    lower: Array
    upper: Array


@dataclass(frozen=True)
class Censoring:
    """How a table tells that a value is not known exactly, but only bounds of it.

    The `column` holds words. Where the word is one of `right`, the value is above the outcome
    (no failure up to so many cycles); where it is one of `left`, it is below (under the limit of
    detection). Every other word says that the outcome was measured. If there are two such words
    or more, they are listed in `measured`, so that no slip of the pen makes a bound a measurement;
    a blank cell needs no word.

    The column `upper` makes intervals: the outcome is then the lower end. Where it is blank, or
    equal to the outcome, the outcome was measured.

    With `signs` the cells of the outcome tell it themselves: "> 20" is above 20, "<0.5" below 0.5,
    and a number was measured.

    Raises ExperimentsError for words without a column, a word in two lists, and signs beside words.

    >>> table = Table("a.csv", {"y": ["1", "2"], "s": ["", "out"]}, ("row 2", "row 3"))
    >>> Censoring("s", right="out").read(table, "y", np.arange(2)).upper.tolist()
    [1.0, inf]
    """

    column: str | None = None
    right: Words = ()
    left: Words = ()
    upper: str | None = None
    measured: Words = ()
    signs: bool = False

    def __post_init__(self) -> None:
        words = self._all_words
        if (self.column is None) == bool(words):
            raise ExperimentsError(
                f"censored: column = {self.column!r}, and the words are {words}",
                'give both: column="status", right="run-out"; an upper column needs neither',
            )
        if self.column is None and self.upper is None and not self.signs:
            raise ExperimentsError(
                "censored: neither a column of words nor one of upper ends",
                'write column="status", right="run-out", or upper="upper_end", or signs=true',
            )
        if self.signs and self.columns:
            raise ExperimentsError(
                f"censored: signs in the cells, and the column '{self.columns[0]}' as well",
                "keep one of the two: a value must not be told to be a bound in two ways",
            )
        twice = [word for k, word in enumerate(words) if word in words[:k]]
        if twice:
            raise ExperimentsError(
                f"censored: the word '{twice[0]}' is listed twice", "list it once"
            )

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns that say what is censored."""
        return tuple(name for name in (self.column, self.upper) if name is not None)

    @property
    def _all_words(self) -> list[str]:
        return [*_words(self.right), *_words(self.left), *_words(self.measured)]

    def read(self, table: Table, outcome: str, rows: Indices) -> ColumnValues:
        """The ends of the outcomes in these rows, without those that have none at all.

        Raises ExperimentsError with the row for a censored value without a bound, an interval
        without its lower end or with the ends swapped, and a word that is not listed.
        """
        for name in self.columns:
            table.require(name, "censored:")
        if self.signs:
            return _signed(table, outcome, rows)
        right, left = self._censored_sides(table, rows)
        value = table.numbers_or_blank(outcome)[rows]
        above = value if self.upper is None else table.numbers_or_blank(self.upper)[rows]
        above = np.where(np.isnan(above), value, above)
        upper = np.where(right, np.inf, above)
        lower = np.where(left, -np.inf, value)
        self._check(table, outcome, rows, lower, upper, right | left)
        given = ~np.isnan(lower)
        return ColumnValues(rows[given], lower[given], upper[given])

    def _censored_sides(self, table: Table, rows: Indices) -> tuple[Flags, Flags]:
        """Which of the rows are right-censored, and which left-censored."""
        if self.column is None:
            return np.zeros(len(rows), dtype=bool), np.zeros(len(rows), dtype=bool)
        texts = table.texts(self.column)
        words = np.array([_word(texts[row]) for row in rows], dtype=object)
        there, listed = [*dict.fromkeys(words.tolist())], self._all_words
        place = f"{table.source}: column '{self.column}'"
        for word in listed:
            if word not in there:
                raise ExperimentsError(
                    f"{place}: the word '{word}' never occurs{nearest(word, there)}",
                    f"correct or leave it out; the words there are {_quoted(there)}",
                )
        others = [word for word in there if word and word not in listed]
        if len(others) > 1 or (others and _words(self.measured)):
            row = rows[[*words].index(others[-1])]
            raise ExperimentsError(
                f"{table.where(row, self.column)}: '{others[-1]}' is not among the words of "
                f"censored{nearest(others[-1], listed)}",
                "list it in right or left; or list all words of measured values: "
                f"measured = [{_quoted(others)}]",
            )
        right, left = (np.isin(words, _words(w)) for w in (self.right, self.left))
        return right, left

    def _check(
        self, table: Table, outcome: str, rows: Indices, lower: Array, upper: Array, told: Flags
    ) -> None:
        without = np.isnan(lower) | np.isnan(upper)
        half = np.isnan(lower) != np.isnan(upper)
        for fault, problem, remedy in (
            (told & without, "the value is censored and has no bound", "write the bound there"),
            (
                half, f"there is an upper end in '{self.upper}', and no lower end",
                "write the lower end there, or mark the value as left-censored by a word",
            ),
        ):  # fmt: skip
            if np.any(fault):
                row = int(rows[np.flatnonzero(fault)[0]])
                raise ExperimentsError(f"{table.where(row, outcome)}: {problem}", remedy)
        crossed = np.flatnonzero(lower > upper)
        if crossed.size:
            k = int(crossed[0])
            raise ExperimentsError(
                f"{table.where(int(rows[k]), str(self.upper))}: the upper end {upper[k]:g} is "
                f"below the lower end {lower[k]:g} in '{outcome}'",
                "swap the two ends",
            )


def _signed(table: Table, outcome: str, rows: Indices) -> ColumnValues:
    """Bounds whose cells say so by a sign."""
    value, sign = (of[rows] for of in table.bounds(outcome))
    lower, upper = np.where(sign < 0, -np.inf, value), np.where(sign > 0, np.inf, value)
    given = ~np.isnan(value)
    return ColumnValues(rows[given], lower[given], upper[given])


def _words(words: Words) -> list[str]:
    return [_word(str(w)) for w in ((words,) if isinstance(words, str | int) else words)]


def _word(text: str) -> str:
    """A word; whole numbers are one word however pandas writes them, 1 or 1.0."""
    return text[:-2] if text.endswith(".0") and text[:-2].lstrip("+-").isdigit() else text


def _quoted(words: Sequence[str]) -> str:
    return ", ".join(f'"{word}"' for word in words)


Censored = Censoring | Mapping[str, Censoring] | None
"""How values are censored: all, or those of each response, or none."""


@dataclass(frozen=True)
class OutcomeColumns:
    """Which columns of a table hold what was measured.

    Wide: each of the `columns` is a response of its name. Long: there is one column of values, and
    the column `response` says which response each is. `transform` and `censored` are one for all
    responses, or one for each that has one.

    Raises ExperimentsError for columns that cannot be read so.

    >>> table = Table("a.csv", {"time": ["1", "2"], "torque": ["", "5"]}, ("row 2", "row 3"))
    >>> seen = OutcomeColumns(("time", "torque")).read(table, np.array([0, 0]))
    >>> seen.lower.tolist(), seen.names, seen.response.tolist()
    ([1.0, 2.0, 5.0], ('time', 'torque'), [0, 0, 1])
    """

    columns: tuple[str, ...]
    response: str | None = None
    transform: str | Mapping[str, str] = "none"
    censored: Censored = None

    def __post_init__(self) -> None:
        if not self.columns or len({*self.columns}) != len(self.columns):
            raise ExperimentsError(
                f"the outcomes are {list(self.columns)}", "name each measured column once"
            )
        if self.response is not None and len(self.columns) > 1:
            raise ExperimentsError(
                f"the column '{self.response}' names the response of each value, and there are "
                f"{len(self.columns)} columns of values",
                "name one outcome, or leave out the response",
            )
        if isinstance(self.censored, Censoring) and len(self.columns) > 1:
            raise ExperimentsError(
                f"censored: which of the responses {', '.join(self.columns)} is meant is not said",
                f"say it for each that is censored: censored = {{{self.columns[0]} = {{...}}}}",
            )

    @property
    def taken(self) -> tuple[str, ...]:
        """The columns that hold what was measured, and are no conditions."""
        censored = self.censored if isinstance(self.censored, Mapping) else {"": self.censored}
        said = [name for one in censored.values() if one is not None for name in one.columns]
        return (*self.columns, *([] if self.response is None else [self.response]), *said)

    def require(self, table: Table, conditions: Sequence[str] | None) -> None:
        """Raise ExperimentsError for a column that is not there, or that is a condition too."""
        for name in self.columns:
            table.require(name, "the outcome")
        if self.response is not None:
            table.require(self.response, "the response")
        both = [name for name in self.taken if name in (conditions or ())]
        if both:
            raise ExperimentsError(
                f"{table.source}: '{both[0]}' is both of the outcome and a condition",
                "leave it out of the conditions: a simulator must not know what was measured",
            )

    def read(self, table: Table, experiment: Indices) -> Observations:
        """The observations of a table whose rows are of the experiments (R,)."""
        rows = self._long(table) if self.response else dict.fromkeys(self.columns, None)
        responses = responses_of([*rows], self.transform)
        if isinstance(self.censored, Mapping):
            require_responses(self.censored, [*rows], "censored")
        every = np.arange(len(table))
        found = [self._values(table, r, every if of is None else of) for r, of in rows.items()]
        self._require_values(table, found)
        seen = [
            _transformed(table, values, self._columns(response.name), response)
            for values, response in zip(found, responses, strict=True)
        ]
        row, lower, upper = (np.concatenate([part[k] for part in seen]) for k in range(3))
        which = np.repeat(np.arange(len(seen)), [len(part.row) for part in seen])
        order = np.lexsort((which, row, experiment[row]))
        row, which = row[order], which[order]
        return Observations(experiment[row], row, which, lower[order], upper[order], responses)

    def _long(self, table: Table) -> dict[str, Indices]:
        """The rows of each word of the column of responses, in order of appearance."""
        assert self.response is not None
        words = table.texts(self.response)
        if "" in words:
            raise ExperimentsError(
                f"{table.where(words.index(''), self.response)}: the response is blank",
                "write which response the value of this row is",
            )
        of = np.array(words)
        return {name: np.flatnonzero(of == name) for name in dict.fromkeys(words)}

    def _values(self, table: Table, response: str, rows: Indices) -> ColumnValues:
        column, censoring = self._columns(response)[0], self._censoring(response)
        if censoring is not None:
            return censoring.read(table, column, rows)
        values = table.numbers_or_blank(column)[rows]
        given = ~np.isnan(values)
        return ColumnValues(rows[given], values[given], values[given])

    def _require_values(self, table: Table, found: Sequence[ColumnValues]) -> None:
        """Raise ExperimentsError for a row without any value."""
        given = np.zeros(len(table), dtype=bool)
        for values in found:
            given[values.row] = True
        if not np.all(given):
            row = int(np.flatnonzero(~given)[0])
            raise ExperimentsError(
                f"{table.where(row, self.columns[0])}: the cell is blank, a number is needed"
                + (f" there or in {', '.join(self.columns[1:])}" if len(self.columns) > 1 else ""),
                UNMEASURED,
            )

    def _censoring(self, response: str) -> Censoring | None:
        censored = self.censored
        return censored.get(response) if isinstance(censored, Mapping) else censored

    def _columns(self, response: str) -> tuple[str, str]:
        """The columns of the lower and of the upper ends of a response."""
        column = response if self.response is None else self.columns[0]
        censoring = self._censoring(response)
        return column, (censoring.upper if censoring else None) or column


def _transformed(
    table: Table, values: ColumnValues, columns: tuple[str, str], response: Response
) -> ColumnValues:
    """The values as the likelihood sees them; raises ExperimentsError where it cannot."""
    ends: list[Array] = []
    for raw, column in zip((values.lower, values.upper), columns, strict=True):
        ends.append(np.where(np.isinf(raw), raw, response.transform(raw)))
        lost = np.flatnonzero(np.isfinite(raw) & ~np.isfinite(ends[-1]))
        if lost.size:
            k = int(lost[0])
            raise ExperimentsError(
                f"{table.where(int(values.row[k]), column)}: {response.transform.fault(raw[k])}",
                f'correct the outcome, or leave out transform = "{response.transform}"',
            )
    return ColumnValues(values.row, ends[0], ends[1])
