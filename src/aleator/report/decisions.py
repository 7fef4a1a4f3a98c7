"""Probabilities and limits as tables on the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from aleator.report.rows import Rows
from aleator.results.printed import Column, number

Columns = Mapping[Any, Sequence[Any]]

PROBABILITIES: Sequence[Column] = (
    ("id", "left"), ("probability", "right"), ("95 % interval", "right"),
    ("+-", "right"), ("estimate alone", "right"), ("beyond", "right"), ("note", "fold"),
)  # fmt: skip
SMALL = 1e-3
"""Probabilities below are written with a power of ten."""


def render_probabilities(columns: Columns, title: str) -> RenderableType:
    """A table of probabilities from its columns, a row for each row of the conditions."""
    rows = [
        (
            str(row["id"]),
            _chance(row["probability"]),
            _between(row["lower"], row["upper"], _chance),
            _chance(row["error"], 1),
            _chance(row["at_estimate"]),
            beyond(row.get("beyond")),
            str(row["status"]).replace("_", " ") if row["status"] != "solved" else "",
        )
        for row in _rows(columns)
    ]
    table = Rows(_filled(PROBABILITIES, rows), _cells(rows))
    return Group(Text(title, style="bold"), table, *map(Text, _doubts(columns)))


def _doubts(columns: Columns) -> list[str]:
    """What is not settled, and what no run can exclude, in sentences."""
    found = []
    if "unsettled" in columns["status"]:
        found.append(
            "unsettled: the last runs of the simulator still change the probability, or leave open "
            "which outcomes are in the event: it may be wrong by far more than +-. Allow the "
            "surface more runs (max_runs)."
        )
    unseen = [value for value in columns["unseen"] if not math.isnan(value)]
    if unseen:
        found.append(
            "Fresh runs all over the law look for regions that the surface does not have. By them "
            f"alone one with a probability above {_chance(max(unseen), 1)} is excluded with 95 % "
            "confidence, a smaller one is not."
        )
    return found


def render_limits(columns: Columns, title: str) -> RenderableType:
    """A table of tolerance limits from its columns."""
    ends = [name for name in ("lower", "upper") if name in columns]
    heads: list[Column] = [("id", "left"), *((f"{end} limit", "right") for end in ends)]
    heads += [("+-", "right")] if "error" in columns else []
    heads.append(("beyond", "right"))
    rows = [
        (
            str(row["id"]),
            *(number(row[end]) for end in ends),
            *([number(row["error"], 1)] if "error" in columns else []),
            beyond(row.get("beyond")),
        )
        for row in _rows(columns)
    ]
    return Group(Text(title, style="bold"), Rows(_filled(heads, rows), _cells(rows)))


def beyond(value: float | None) -> str:
    """How far a row is beyond the tested conditions; nothing for one within.

    >>> beyond(0.0), beyond(0.512), beyond(float("inf"))
    ('', '0.51 ranges', 'untested')
    """
    if value is None or not value > 0.0:
        return ""
    return "untested" if math.isinf(value) else f"{number(value, 2)} ranges"


def _rows(columns: Columns) -> list[dict[Any, Any]]:
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _chance(value: float, digits: int = 3) -> str:
    """A probability, near zero and one with the digits that differ."""
    if math.isnan(value):
        return "-"
    if 0.0 < value < SMALL:
        return f"{value:.{digits - 1}e}"
    if 1.0 - SMALL < value < 1.0:
        return f"1 - {1.0 - value:.{digits - 1}e}"
    return number(value, digits)


def _between(low: float, high: float, written: Any) -> str:
    return "-" if math.isnan(low) else f"{written(low)} .. {written(high)}"


def _filled(heads: Sequence[Column], rows: Sequence[Sequence[str]]) -> list[Column]:
    """The columns of which any cell has something."""
    return [head for k, head in enumerate(heads) if k == 0 or any(row[k] for row in rows)]


def _cells(rows: Sequence[Sequence[str]]) -> list[tuple[str, ...]]:
    kept = [k for k in range(len(rows[0])) if k == 0 or any(row[k] for row in rows)] if rows else []
    return [tuple(row[k] for k in kept) for row in rows]
