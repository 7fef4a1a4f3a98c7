"""The tables of `aleator pbox`, and the chart of a band of distribution functions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from aleator.results.answer import words
from aleator.results.printed import (
    Content,
    Part,
    Sentence,
    TextTable,
    chance,
    number,
    percent,
)
from aleator.results.units import label
from aleator.views import chart
from aleator.views.chart import Axis, Chart, Mark, Series, numbers
from aleator.views.predictions import Columns, beyond, predicted_table

Document = Mapping[str, Any]


def bounds(document: Document) -> Content:
    """The bounds of quantiles or of a probability, and what each bounded hyperparameter matters."""
    probable, rows = document["event"] is not None, document["rows"]
    names = ", ".join(dict.fromkeys(label(document, str(row["outcome"])) for row in rows))
    title = f"Bounds of the probability of {document['event']}" if probable else (
        f"Bounds of quantiles of {names}"
    )  # fmt: skip
    known = ", ".join(
        f"{one} in {number(low)} .. {number(high)}"
        for one, (low, high) in document["bounded"].items()
    )
    lead = f"Only bounded, with no probability within: {known}."
    parts: list[Part] = [_table(document["rows"], probable=probable)]
    if document["pinched"]:
        parts.append(Sentence("How much narrower the bounds become where one is known:"))
        parts.append(_pinched(document["pinched"], probable=probable))
    return Content.of(title, lead, parts, _verdict(document["rows"], probable=probable))


def _verdict(rows: Sequence[Document], *, probable: bool) -> str:
    held = (
        "The bounds hold for every value that the experiments do not rule out, all other "
        "hyperparameters identified again; the 95 % bounds have the uncertainty of these too."
    )
    if not probable:
        return held
    worst = max(rows, key=lambda row: float(row["upper"]))
    return (
        f"The largest probability is {chance(worst['upper'])}, and {chance(worst['highest'])} with "
        f"the uncertainty of what was identified. {held}"
    )


def _columns(rows: Sequence[Document]) -> Columns:
    return {name: [row[name] for row in rows] for name in rows[0]}


def _table(rows: Sequence[Document], *, probable: bool) -> TextTable:
    shown = chance if probable else number
    several = len({row["outcome"] for row in rows}) > 1
    found = []
    for row in rows:
        own = () if probable else (number(row["probability"]),)
        note = "" if row["status"] == "solved" else words(row["status"])
        ends = [_ends(row, pair, shown) for pair in (("lower", "upper"), ("lowest", "highest"))]
        outcome = (str(row["outcome"]),) if several else ()
        found.append((*outcome, *own, *ends, beyond(row.get("beyond")), note))
    heads = (*(("outcome",) if several else ()), *(() if probable else (">probability",)))
    return predicted_table(
        _columns(rows), (*heads, ">bounds", ">95 % bounds", ">beyond", "~note"), found
    )


def _ends(row: Document, pair: tuple[str, str], shown: Any) -> str:
    return " .. ".join(shown(row[end]) for end in pair) if pair[0] in row else "-"


def _pinched(rows: Sequence[Document], *, probable: bool) -> TextTable:
    shown = chance if probable else number
    found = [
        (
            row["pinched"], number(row["at"]), _ends(row, ("lower", "upper"), shown),
            "-" if row["reduction"] is None or math.isnan(row["reduction"])
            else percent(row["reduction"]),
        )
        for row in rows
    ]  # fmt: skip
    return predicted_table(_columns(rows), ("known", ">at", ">bounds", ">reduction"), found)


def band_chart(columns: Columns, outcome: str) -> Chart:
    """The band of distribution functions of one new outcome, from bounds of its quantiles.

    The distribution function at t is the probability whose quantile is t. So the upper edge of the
    band is the inverse of the lower quantiles, and the lower edge that of the upper ones.
    """
    level = numbers(columns["probability"])
    order = np.argsort(level)
    pairs = [("lower", "upper", chart.NARROW, "bounds")]
    if "lowest" in columns:
        pairs.insert(0, ("lowest", "highest", chart.WIDE, "95 % bounds"))
    ends = {key: numbers(columns[key])[order] for pair in pairs for key in pair[:2]}
    every, level = np.unique(np.concatenate([*ends.values()])), level[order]
    edges: dict[str, Any] = {"x": every}
    for low, high, _, _ in pairs:
        edges[f"above_{low}"] = np.interp(every, ends[low], level, left=0.0, right=1.0)
        edges[f"below_{high}"] = np.interp(every, ends[high], level, left=0.0, right=1.0)
    source = Series("p-box", edges)
    marks = [
        Mark("band", source, y=f"below_{high}", high=f"above_{low}", color=color, legend=legend)
        for low, high, color, legend in pairs
    ]
    return Chart(
        "p-box", "Band of distribution functions",
        "The distribution function of the outcome lies within the band.", Axis(outcome),
        Axis("probability of a smaller value"), marks, dict.fromkeys(edges, ""),
    )  # fmt: skip
