"""Censored values: which columns say that only bounds of a value are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aleator.errors import ExperimentsError, nearest
from aleator.observations.tables import Table
from aleator.types import Array, Flags, Indices

Words = str | int | Sequence[str | int]
"""A word of a column, or several; a whole number is the word that it is written as."""


class Values(NamedTuple):
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
        words = self._listed
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
    def _listed(self) -> list[str]:
        return [*_words(self.right), *_words(self.left), *_words(self.measured)]

    def read(self, table: Table, outcome: str, rows: Indices) -> Values:
        """The ends of the outcomes in these rows, without those that have none at all.

        Raises ExperimentsError with the row for a censored value without a bound, an interval
        without its lower end or with the ends swapped, and a word that is not listed.
        """
        for name in self.columns:
            table.require(name, "censored:")
        if self.signs:
            return _signed(table, outcome, rows)
        right, left = self._told(table, rows)
        value = table.numbers_or_blank(outcome)[rows]
        above = value if self.upper is None else table.numbers_or_blank(self.upper)[rows]
        above = np.where(np.isnan(above), value, above)
        upper = np.where(right, np.inf, above)
        lower = np.where(left, -np.inf, value)
        self._check(table, outcome, rows, lower, upper, right | left)
        given = ~np.isnan(lower)
        return Values(rows[given], lower[given], upper[given])

    def _told(self, table: Table, rows: Indices) -> tuple[Flags, Flags]:
        """Which of the rows are right-censored, and which left-censored."""
        if self.column is None:
            return np.zeros(len(rows), dtype=bool), np.zeros(len(rows), dtype=bool)
        texts = table.texts(self.column)
        words = np.array([_word(texts[row]) for row in rows], dtype=object)
        there, listed = [*dict.fromkeys(words.tolist())], self._listed
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


def _signed(table: Table, outcome: str, rows: Indices) -> Values:
    """Bounds whose cells say so by a sign."""
    value, sign = (of[rows] for of in table.bounds(outcome))
    lower, upper = np.where(sign < 0, -np.inf, value), np.where(sign > 0, np.inf, value)
    given = ~np.isnan(value)
    return Values(rows[given], lower[given], upper[given])


def _words(words: Words) -> list[str]:
    return [_word(str(w)) for w in ((words,) if isinstance(words, str | int) else words)]


def _word(text: str) -> str:
    """A word; whole numbers are one word however pandas writes them, 1 or 1.0."""
    return text[:-2] if text.endswith(".0") and text[:-2].lstrip("+-").isdigit() else text


def _quoted(words: Sequence[str]) -> str:
    return ", ".join(f'"{word}"' for word in words)
