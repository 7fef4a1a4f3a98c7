"""The tables of `aleator predict`: a distribution, probability or limit for each condition."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from aleator.results.answer import words
from aleator.results.printed import (
    NONE,
    THRESHOLDS,
    Chapter,
    Content,
    Sentence,
    TextTable,
    Thresholds,
    heads,
    number,
)
from aleator.views.identification import exponential

Columns = Mapping[Any, Sequence[Any]]
"""The columns of a table of predictions (see docs/tables.md)."""


def distributions(columns: Columns, outcome: str, transform: str = "none") -> Content:
    """A table of predicted distributions: mean, standard deviation, median and ranges.

    If `transform` is "log", mean and standard deviation are those of the logarithm; median and
    ranges are in the unit of the outcome.
    """
    log = transform == "log"
    back: Callable[[float], float] = exponential if log else float

    def ends(row: Mapping[str, Any], low: str, high: str) -> str:
        return f"{number(back(row[low]))} .. {number(back(row[high]))}"

    moments = (">mean of log", ">sd of log") if log else (">mean", ">sd")
    shown = heads("id", *moments, ">median", ">50 % range", ">95 % range", ">beyond", "~density")
    rows = [
        (
            str(row["id"]), number(row["mean"]), number(row["standard_deviation"], 3),
            number(back(row["q0.5"])), ends(row, "q0.25", "q0.75"), ends(row, "q0.025", "q0.975"),
            beyond(row.get("beyond")), words(row["status"]),
        )
        for row in _rows(columns)
    ]  # fmt: skip
    return _content(f"Predicted distribution of {outcome}", TextTable(shown, rows))


def probabilities(columns: Columns, title: str) -> Content:
    """A table of probabilities with their intervals, and notes on how far they can be trusted."""
    shown = heads(
        "id", ">probability", ">95 % interval", ">+-", ">estimate alone", ">beyond", "~note"
    )
    rows = [
        (
            str(row["id"]), _chance(row["probability"]),
            NONE if math.isnan(row["lower"])
            else f"{_chance(row['lower'])} .. {_chance(row['upper'])}",
            _chance(row["error"], 1), _chance(row["at_estimate"]), beyond(row.get("beyond")),
            words(row["status"]) if row["status"] != "solved" else "",
        )
        for row in _rows(columns)
    ]  # fmt: skip
    notes = []
    if "unsettled" in columns["status"]:
        notes.append(
            "unsettled: the last runs of the simulator still change the probability, or leave open "
            "which outcomes are in the event: it may be wrong by far more than +-. Allow the "
            "surface more runs (max_runs)."
        )
    unseen = [value for value in columns["unseen"] if not math.isnan(value)]
    if unseen:
        notes.append(
            "Fresh runs all over the law look for regions that the surface does not have. By them "
            f"alone one with a probability above {_chance(max(unseen), 1)} is excluded with 95 % "
            "confidence, a smaller one is not."
        )
    return _content(title, TextTable(shown, rows), *map(Sentence, notes))


def limits(columns: Columns, title: str) -> Content:
    """A table of the tolerance limits, or of the design value, of each condition."""
    ends = [name for name in ("lower", "upper") if name in columns]
    shown = heads("id", *(f">{end} limit" for end in ends), ">+-", ">beyond")
    rows = [
        (
            str(row["id"]), *(number(row[end]) for end in ends),
            number(row["error"], 1) if "error" in row else "", beyond(row.get("beyond")),
        )
        for row in _rows(columns)
    ]  # fmt: skip
    return _content(title, TextTable(shown, rows))


def beyond(value: float | None) -> str:
    """A text on how far a new condition lies beyond the tested ones, in widths of their range.

    The text is empty for a condition within the tested ones.

    >>> beyond(0.0), beyond(0.512), beyond(float("inf"))
    ('', '0.51 ranges', 'untested')
    """
    if value is None or not value > 0.0:
        return ""
    return "untested" if math.isinf(value) else f"{number(value, 2)} ranges"


def _content(title: str, *parts: TextTable | Sentence) -> Content:
    return Content(title, sections=[Chapter("table", title, parts)])


def _rows(columns: Columns) -> list[dict[Any, Any]]:
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _chance(value: float, digits: int = 3, thresholds: Thresholds = THRESHOLDS) -> str:
    """The text of a probability; if it is near 1, as 1 minus a small number."""
    if math.isnan(value):
        return NONE
    if 0.0 < value < thresholds.rare:
        return f"{value:.{digits - 1}e}"
    if 1.0 - thresholds.rare < value < 1.0:
        return f"1 - {1.0 - value:.{digits - 1}e}"
    return number(value, digits)
