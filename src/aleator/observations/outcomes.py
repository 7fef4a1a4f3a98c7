"""Reads measured values, exact or censored, from the columns of a table."""

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
"""One word of a column, or several; a whole number stands for the word that is its text."""


class ColumnValues(NamedTuple):
    """Values of one response in the original unit: rows (m,), and lower and upper bounds (m,)."""

    row: Indices
    lower: Array
    upper: Array


@dataclass(frozen=True)
class Censoring:
    """How a table marks values of which only bounds are known (censored values).

    There are three ways. The first is a `column` of words. If its word is one of `right`, the true
    value is above the number in the outcome column (as no failure up to so many cycles). If it is
    one of `left`, the true value is below it (as under a limit of detection). Any other word, or a
    blank cell, says that the outcome was measured exactly. Two or more such other words must be
    listed in `measured`, so that a misspelt word does not turn a bound into a measurement.

    The second way is a column `upper`, which makes intervals whose lower end is the outcome. Where
    it is blank, or equal to the outcome, the outcome was measured exactly.

    The third way is `signs` in the cells of the outcome: "> 20" is above 20, "<0.5" is below 0.5,
    and a plain number was measured exactly.

    Raises ExperimentsError for words without a column, a word in two lists, or signs together with
    another way.

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
        """The names of the columns that mark censored values."""
        return tuple(name for name in (self.column, self.upper) if name is not None)

    @property
    def _all_words(self) -> list[str]:
        return [*_words(self.right), *_words(self.left), *_words(self.measured)]

    def read(self, table: Table, outcome: str, rows: Indices) -> ColumnValues:
        """The bounds of the outcomes in these rows; rows without any value are left out.

        Raises ExperimentsError, which names the row, for a censored value without a bound, an
        interval without its lower end or with its ends swapped, and a word that is not listed.
        """
        for name in self.columns:
            table.require(name, "censored:")
        if self.signs:
            value, sign = (of[rows] for of in table.bounds(outcome))
            above, left, right = value, sign < 0, sign > 0
        else:
            left, right = self._sides(table, rows)
            value = table.numbers_or_blank(outcome)[rows]
            above = value if self.upper is None else table.numbers_or_blank(self.upper)[rows]
            above = np.where(np.isnan(above), value, above)
        lower, upper = np.where(left, -np.inf, value), np.where(right, np.inf, above)
        present = self._checked(table, outcome, rows, lower, upper, left | right)
        return ColumnValues(rows[present], lower[present], upper[present])

    def _sides(self, table: Table, rows: Indices) -> tuple[Flags, Flags]:
        """Which rows are left-censored, and which are right-censored, by the words of `column`."""
        if self.column is None:
            return np.zeros(len(rows), dtype=bool), np.zeros(len(rows), dtype=bool)
        texts = table.texts(self.column)
        words = [_word(texts[row]) for row in rows]
        there, listed = [*dict.fromkeys(words)], self._all_words
        for word in listed:
            if word not in there:
                raise ExperimentsError(
                    f"{table.source}: column '{self.column}': the word '{word}' never occurs"
                    f"{nearest(word, there)}",
                    f"correct or leave it out; the words there are {_quoted(there)}",
                )
        others = [word for word in there if word and word not in listed]
        if len(others) > 1 or (others and _words(self.measured)):
            row = rows[words.index(others[-1])]
            raise ExperimentsError(
                f"{table.where(row, self.column)}: '{others[-1]}' is not among the words of "
                f"censored{nearest(others[-1], listed)}",
                "list it in right or left; or list all words of measured values: "
                f"measured = [{_quoted(others)}]",
            )
        cells = np.array(words, dtype=object)
        return np.isin(cells, _words(self.left)), np.isin(cells, _words(self.right))

    def _checked(
        self, table: Table, outcome: str, rows: Indices, lower: Array, upper: Array, bound: Flags
    ) -> Flags:
        """Which rows have a value. Raises ExperimentsError for missing or contradictory bounds."""
        lacking, half = np.isnan(lower), np.isnan(lower) != np.isnan(upper)
        for fault, problem, remedy in (
            (
                bound & (lacking | half),
                "the value is censored and has no bound", "write the bound there",
            ),
            (
                half, f"there is an upper end in '{self.upper}', and no lower end",
                "write the lower end there, or mark the value as left-censored by a word",
            ),
        ):  # fmt: skip
            if np.any(fault):
                where = table.where(int(rows[np.argmax(fault)]), outcome)
                raise ExperimentsError(f"{where}: {problem}", remedy)
        if np.any(lower > upper):
            k = int(np.argmax(lower > upper))
            raise ExperimentsError(
                f"{table.where(int(rows[k]), str(self.upper))}: the upper end {upper[k]:g} is "
                f"below the lower end {lower[k]:g} in '{outcome}'",
                "swap the two ends",
            )
        return ~lacking


def _words(words: Words) -> list[str]:
    return [_word(str(w)) for w in ((words,) if isinstance(words, str | int) else words)]


def _word(text: str) -> str:
    """The word of a cell, in which the whole number 1.0, as pandas may write it, becomes 1."""
    return text[:-2] if text.endswith(".0") and text[:-2].lstrip("+-").isdigit() else text


def _quoted(words: Sequence[str]) -> str:
    return ", ".join(f'"{word}"' for word in words)


Censored = Censoring | Mapping[str, Censoring] | None
"""The censoring of all values, a mapping from each censored response to its own, or None."""


@dataclass(frozen=True)
class OutcomeColumns:
    """The columns of a table that hold the measured values.

    In a wide table each of the `columns` is a response with its name. In a long table there is one
    column of values, and the column `response` names the response of each value. `transform` and
    `censored` hold for all responses, or are mappings from responses to their own.

    Raises ExperimentsError if these choices contradict each other.

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
        """All columns with measured values or marks of them; these are never conditions."""
        censored = self.censored if isinstance(self.censored, Mapping) else {"": self.censored}
        said = [name for one in censored.values() if one is not None for name in one.columns]
        return (*self.columns, *([] if self.response is None else [self.response]), *said)

    def require(self, table: Table, conditions: Sequence[str] | None) -> None:
        """Raise ExperimentsError for a column that is missing, or that is a condition too."""
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
        """The observations in a table; `experiment` (R,) is the experiment of each of its rows."""
        rows = self._rows(table)
        responses = responses_of([*rows], self.transform)
        if isinstance(self.censored, Mapping):
            require_responses(self.censored, [*rows], "censored")
        parts = [self._values(table, of, rows[of.name]) for of in responses]
        row, lower, upper = (np.concatenate([part[k] for part in parts]) for k in range(3))
        blank = np.flatnonzero(~np.isin(np.arange(len(table)), row))
        if blank.size:
            raise ExperimentsError(
                f"{table.where(int(blank[0]), self.columns[0])}: the cell is blank, a number is "
                "needed"
                + (f" there or in {', '.join(self.columns[1:])}" if len(self.columns) > 1 else ""),
                UNMEASURED,
            )
        which = np.repeat(np.arange(len(parts)), [len(part.row) for part in parts])
        order = np.lexsort((which, row, experiment[row]))
        row, which = row[order], which[order]
        return Observations(experiment[row], row, which, lower[order], upper[order], responses)

    def _rows(self, table: Table) -> dict[str, Indices]:
        """The rows of each response by its name; a long table gives them in order of appearance."""
        if self.response is None:
            return dict.fromkeys(self.columns, np.arange(len(table)))
        words = table.texts(self.response)
        if "" in words:
            raise ExperimentsError(
                f"{table.where(words.index(''), self.response)}: the response is blank",
                "write which response the value of this row is",
            )
        of = np.array(words)
        return {name: np.flatnonzero(of == name) for name in dict.fromkeys(words)}

    def _values(self, table: Table, response: Response, rows: Indices) -> ColumnValues:
        """The transformed values of a response in the given rows.

        Raises ExperimentsError if a value has no logarithm where one is asked for.
        """
        column = response.name if self.response is None else self.columns[0]
        censored = self.censored
        censoring = censored.get(response.name) if isinstance(censored, Mapping) else censored
        if censoring is None:
            values = table.numbers_or_blank(column)[rows]
            present = ~np.isnan(values)
            found = ColumnValues(rows[present], values[present], values[present])
        else:
            found = censoring.read(table, column, rows)
        upper = (censoring.upper if censoring else None) or column
        ends: list[Array] = []
        for raw, name in ((found.lower, column), (found.upper, upper)):
            ends.append(np.where(np.isinf(raw), raw, response.transform(raw)))
            lost = np.flatnonzero(np.isfinite(raw) & ~np.isfinite(ends[-1]))
            if lost.size:
                k = int(lost[0])
                raise ExperimentsError(
                    f"{table.where(int(found.row[k]), name)}: {response.transform.fault(raw[k])}",
                    f'correct the outcome, or leave out transform = "{response.transform}"',
                )
        return ColumnValues(found.row, *ends)
