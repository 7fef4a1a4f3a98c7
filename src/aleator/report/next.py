"""The next experiments, to read on a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from aleator.report.rows import Rows, written
from aleator.results.printed import Column, number
from aleator.results.units import label

SHOWN = 10  # candidates in the terminal; the document has all
MOST = 30  # experiments of a set in the terminal
OWN = ("id", "standard_error", "chosen", "ties")


def render(result: Mapping[str, Any], files: Sequence[str] = ()) -> RenderableType:
    """What it is about, the best candidates, the best set, and what it does to each."""
    parts: list[RenderableType] = [
        Text(result.get("title") or "The next experiment", style="bold"),
        Text(_about(result)),
        *(Text(line, style="yellow") for line in _notes(result)),
        Text("\nAfter one such experiment:", style="bold"),
        _candidates(result),
        Text("\nThe best set, the most useful first:", style="bold"),
        _chosen(result),
        Text(verdict(result)),
        Text("\nWhat the set does to each:", style="bold"),
        _hyperparameters(result),
    ]
    return Group(*parts, *written(files))


def verdict(result: Mapping[str, Any]) -> str:
    """One sentence: what the set does, and what repeating all experiments would take for it."""
    chosen = result["chosen"]
    begin = (
        f"{len(chosen)} experiments: {_error(result)} {_value(result['now'])} -> "
        f"{_value(chosen[-1]['standard_error'])}"
    )
    if result["repetitions"] is None:
        return f"{begin}. Repeating the experiments that were made does not reach that."
    whole = result["repetitions"] * result["made"]
    return f"{begin}. Repeating the {result['made']} that were made takes {whole:.0f} for the same."


def _about(result: Mapping[str, Any]) -> str:
    laws = "" if result["laws"] == 1 else f", in the mean over {result['laws']} possible laws"
    return (
        f"About {result['about']}{laws}: {_error(result)} now {_value(result['now'])}. "
        f"{result['runs']:,} runs of the simulator for {len(result['candidates'])} candidates."
    )


def _error(result: Mapping[str, Any]) -> str:
    return (
        "standard errors over those now, in the mean," if result["relative"] else "standard error"
    )


def _notes(result: Mapping[str, Any]) -> list[str]:
    notes = [
        f"{name} ended on its limit, where no experiment tells anything of it: planned for "
        f"{number(value)}, the end of its interval."
        for name, value in result["planned_for"].items()
    ]
    if not result["sound"]:
        notes.append("The identification is not sound: mend that first, the plan rests on it.")
    if result["consistent"] is False:
        notes.append(
            "The model is not consistent with the experiments: the plan is one for this model."
        )
    if result["now"] is None:
        notes.append("The experiments that were made leave it open.")
    lost = [row["id"] for row in result["candidates"] if row["standard_error"] is None]
    if lost and result["now"] is None:
        notes.append(f"So does each of {len(lost)} candidates by itself.")
    elif lost:
        notes.append(f"Cannot be simulated: {', '.join(lost[:SHOWN])}.")
    largest = max(result["uncertain"].values(), default=0.0) or 0.0
    if largest > 0.0:
        notes.append(
            f"By virtual data sets: errors of candidates are known to {number(largest, 2)}."
        )
    return notes


def _candidates(result: Mapping[str, Any]) -> Rows:
    rows = result["candidates"][:SHOWN]
    names = _conditions(rows)
    columns: list[Column] = [("id", "left")]
    columns += [(label(result, name), "right") for name in names]
    columns += [("std. error", "right"), ("in the set", "right")]
    cells = [
        (
            row["id"],
            *(_cell(row[name]) for name in names),
            _value(row["standard_error"]),
            f"{row['chosen']} times" if row["chosen"] > 1 else "yes" if row["chosen"] else "",
        )
        for row in rows
    ]
    return Rows(columns, cells)


def _chosen(result: Mapping[str, Any]) -> Rows:
    rows = result["chosen"][:MOST]
    names = _conditions(rows)
    columns: list[Column] = [("", "right"), ("id", "left")]
    columns += [(label(result, name), "right") for name in names]
    columns += [("std. error", "right"), ("", "fold")]
    cells = [
        (
            str(k + 1),
            row["id"],
            *(_cell(row[name]) for name in names),
            _value(row["standard_error"]),
            f"{row['ties']} others as good" if row["ties"] else "",
        )
        for k, row in enumerate(rows)
    ]
    left = len(result["chosen"]) - len(rows)
    if left:
        cells.append(("", f"... {left} more", *("" for _ in names), "", ""))
    return Rows(columns, cells)


def _hyperparameters(result: Mapping[str, Any]) -> Rows:
    columns: Sequence[Column] = (
        ("alpha", "left"), ("std. error now", "right"), ("after", "right"),
    )  # fmt: skip
    rows = [
        (label(result, row["id"]), _value(row["now"]), _value(row["after"]))
        for row in result["hyperparameters"]
    ]
    return Rows(columns, rows)


def _conditions(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    return [name for name in rows[0] if name not in OWN]


def _cell(value: Any) -> str:
    return number(value) if isinstance(value, int | float) else str(value)


def _value(value: float | None) -> str:
    return "open" if value is None else number(value, 3)
