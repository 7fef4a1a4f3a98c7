"""The tables of `aleator predict`: a distribution, probability or limit for each condition."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from aleator.results.answer import words
from aleator.results.printed import (
    AMOUNTS,
    NONE,
    Amounts,
    Chapter,
    Content,
    Sentence,
    TextTable,
    chance,
    heads,
    listed,
    number,
)
from aleator.views.identification import exponential

Columns = Mapping[Any, Sequence[Any]]
"""The columns of a table of predictions of one outcome: conditions, then `outcome`, then values."""


def distributions(columns: Columns, outcome: str, transform: str = "none") -> Content:
    """A table of predicted distributions: mean, standard deviation, median and 95 % range.

    If `transform` is "log", mean and standard deviation are those of the logarithm; median and
    range are in the unit of the outcome.
    """
    log = transform == "log"
    back: Callable[[float], float] = exponential if log else float
    moments = (">mean of log", ">sd of log") if log else (">mean", ">sd")
    rows = [
        (
            number(row["mean"]), number(row["standard_deviation"], 3), number(back(row["q0.5"])),
            f"{number(back(row['q0.025']))} .. {number(back(row['q0.975']))}",
            beyond(row.get("beyond")), _note(row["status"]),
        )
        for row in _rows(columns)
    ]  # fmt: skip
    values = (*moments, ">median", ">95 % range", ">beyond", "~note")
    return _content(f"Predicted distribution of {outcome}", columns, values, rows)


_COMPUTED = Sentence("+-: the standard error of the computation.")


def probabilities(columns: Columns, title: str, amounts: Amounts = AMOUNTS) -> Content:
    """A table of probabilities with their intervals, and notes on how far they can be trusted."""
    rows = [
        (
            chance(row["probability"]),
            NONE if math.isnan(row["lower"])
            else f"{chance(row['lower'])} .. {chance(row['upper'])}",
            chance(row["error"], 1), beyond(row.get("beyond")),
            _note(row["status"]),
        )
        for row in _rows(columns)
    ]  # fmt: skip
    notes = [] if all(map(math.isnan, columns["lower"])) else [_means(columns, amounts)]
    if "unsettled" in columns["status"]:
        notes.append(
            "unsettled: the last runs of the simulator still change the probability, or leave open "
            "which outcomes are in the event: it may be wrong by far more than +-. Allow the "
            "surface more runs (max_runs)."
        )
    if not {"never", "always"}.isdisjoint(columns["status"]):
        notes.append(
            "never, always: within 6.5 standard deviations of the law, no parameters lead to the "
            "event, or none to its contrary."
        )
    unseen = [value for value in columns["unseen"] if not math.isnan(value)]
    if unseen:
        notes.append(
            "Surprises: further runs of the simulator, all over the law, look for a region of the "
            "event that the response surface does not show. If there were one with a probability "
            f"above {chance(max(unseen), 1)}, they would have met it with 95 % probability. A "
            "smaller one can have escaped them, but nothing says that there is one. Runs of "
            "--checks do not count here: they lie near the event that the surface shows. This is "
            "no error of the probabilities above: theirs are the interval and +-."
        )
    values = (">probability", ">95 % interval", ">+-", ">beyond", "~note")
    return _content(title, columns, values, rows, _COMPUTED, *map(Sentence, notes))


def _means(columns: Columns, amounts: Amounts) -> str:
    """A sentence that tells the mean over plausible laws from the probability at the estimate."""
    alone = [chance(value) for value in columns["at_estimate"]]
    told = listed(alone) if len(alone) <= amounts.named else "in the column at_estimate of --output"
    return f"Probability: the mean over the plausible laws; at the estimate alone it is {told}."


def limits(columns: Columns, title: str) -> Content:
    """A table of the tolerance limits, or of the design value, of each condition."""
    ends = [name for name in ("lower", "upper") if name in columns]
    rows = [
        (
            *(number(row[end]) for end in ends),
            number(row["error"], 1) if "error" in row else "", beyond(row.get("beyond")),
        )
        for row in _rows(columns)
    ]  # fmt: skip
    values = (*(f">{end} limit" for end in ends), ">+-", ">beyond")
    return _content(title, columns, values, rows, *([_COMPUTED] if "error" in columns else []))


def beyond(value: float | None) -> str:
    """A text on how far a new condition lies beyond the tested ones, in widths of their range.

    The text is empty for a condition within the tested ones.

    >>> beyond(0.0), beyond(0.512), beyond(float("inf"))
    ('', '0.51 ranges', 'untested')
    """
    if value is None or not value > 0.0:
        return ""
    return "untested" if math.isinf(value) else f"{number(value, 2)} ranges"


def _content(
    title: str,
    columns: Columns,
    values: Sequence[str],
    rows: Sequence[Sequence[str]],
    *notes: Sentence,
) -> Content:
    """A report with a table of predictions and notes."""
    table = predicted_table(columns, values, rows)
    return Content(title, sections=[Chapter("table", title, (table, *notes))])


def predicted_table(
    columns: Columns, values: Sequence[str], rows: Sequence[Sequence[str]]
) -> TextTable:
    """The table of the conditions with the `rows` of values, under the heads `values`."""
    conditions = [*columns][: [*columns].index("outcome")]
    numeric = {n: all(isinstance(cell, int | float) for cell in columns[n]) for n in conditions}
    shown = heads(*(f"{'>' if numeric[name] else ''}{name}" for name in conditions), *values)
    cells = [
        tuple(number(row[name]) if numeric[name] else str(row[name]) for name in conditions)
        for row in _rows(columns)
    ]
    whole = [(*of, *found) for of, found in zip(cells, rows, strict=True)]
    return TextTable(shown, whole)


def _note(status: str) -> str:
    return "" if status == "solved" else words(status)


def _rows(columns: Columns) -> list[dict[Any, Any]]:
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
