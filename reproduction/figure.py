"""What a reproduced figure is: its tables, its drawing, the paper's claims judged by numbers."""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pandas as pd

from reproduction.context import Context

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas


class Verdict(enum.Enum):
    """Whether a statement of the paper is true here."""

    HOLDS = "holds"
    FAILS = "does not hold"
    NOT_COMPARABLE = "not comparable"

    @classmethod
    def of(cls, true: bool) -> Verdict:
        """HOLDS or FAILS.

        >>> Verdict.of(2 > 1).value
        'holds'
        """
        return cls.HOLDS if true else cls.FAILS


@dataclass(frozen=True)
class Claim:
    """A statement of the paper beside what was measured here.

    `statement` is the paper's in our words, `paper` the value it gives (or that it gives none),
    `ours` what was measured, with its unit; `note` says what limits the comparison.
    """

    statement: str
    paper: str
    ours: str
    verdict: Verdict
    note: str = ""


@dataclass(frozen=True)
class Reproduction:
    """A figure of the paper, computed anew.

    `tables` holds everything that is drawn: the key "" is the figure's own table, any other key is
    appended to its name. `draw` fills an empty canvas of `size` (width, height) inches.
    """

    tables: Mapping[str, pd.DataFrame]
    draw: Callable[[Canvas], None]
    claims: tuple[Claim, ...]
    size: tuple[float, float] = (9.0, 4.2)


@dataclass(frozen=True)
class Figure:
    """An entry of the registry: a figure or table of the paper and the function that makes it.

    `name` is that on the command line, `place` says where the paper has it.
    """

    name: str
    title: str
    place: str
    make: Callable[[Context], Reproduction]


@dataclass(frozen=True)
class Made:
    """A figure that was reproduced: its claims, its files and the seconds that it took."""

    figure: Figure
    claims: tuple[Claim, ...]
    files: tuple[str, ...]
    seconds: float


def keyed(table: pd.DataFrame, keys: list[str], column: str) -> dict[Any, Any]:
    """A column of a table by the columns that tell its rows apart.

    >>> keyed(pd.DataFrame({"q": [2, 3], "i": [0, 1], "c": [0.5, 0.7]}), ["q", "i"], "c")[3, 1]
    0.7
    """
    return dict(table.set_index(keys)[column].items())
