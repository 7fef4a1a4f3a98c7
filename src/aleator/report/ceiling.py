"""The best possible law as a document, and as a report to read on a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
from rich.console import Group, RenderableType
from rich.text import Text

from aleator.report.rows import Rows, written
from aleator.results.printed import Column, number, to_three
from aleator.results.units import label
from aleator.tasks.ceiling import Ceiling

Document = Mapping[str, Any]
UNLIKELY = 0.05
"""A p value below which the family of the law is doubted."""
GAINING, SHOWN = 5, 12
"""Experiments, and points of the best law, that are named."""
FREE = (
    " With the noise left free the best law may be one of points and no noise, whose likelihood "
    "has no limit."
)


def document(found: Ceiling) -> dict[str, Any]:
    """A best possible law as plain lists and numbers, as ceiling.json holds it."""
    test = found.judged
    return {
        "log_likelihood": {
            "ceiling": found.log_likelihood,
            "error": found.error,
            "verified": found.verified,
            "estimated": found.estimated,
            "gap": found.gap,
        },
        "bootstrap": None if test is None else dict(vars(test)),
        "points": found.points.to_dict("records"),
        "gains": [{"id": name, "gain": gain} for name, gain in found.gains.items()],
        "region": {name: list(ends) for name, ends in found.region.items()},
        "held": dict(found.held),
        "covered": found.covered,
        "edges": list(found.edges),
        "curves": {name: curve.to_dict("list") for name, curve in found.curves.items()},
        "map": None if found.map is None else _map(found.map),
    }


def verdict(result: Document) -> str:
    """One sentence: both log-likelihoods, and what the gap means."""
    value, test = result["log_likelihood"], result["bootstrap"]
    text = (
        f"best possible law: log-likelihood {_least(result)}{to_three(value['ceiling'])}, "
        f"this one {to_three(value['estimated'])}"
    )
    return text if test is None else f"{text}, {_p(test)}"


def render(result: Document, files: Sequence[str] = ()) -> RenderableType:
    """The report of a ceiling document; `files` are named at its end."""
    parts: list[RenderableType] = [
        Group(Text(result.get("title") or "The best possible law", style="bold"), _opening(result)),
        _values(result),
        _points(result),
        Text(meaning(result)),
        *map(Text, _notes(result)),
    ]
    lines = [line for part in parts for line in (part, Text())]
    return Group(*lines, *written(files))


def meaning(result: Document) -> str:
    """What the gap says of the family of the chosen law."""
    test, value = result["bootstrap"], result["log_likelihood"]
    if test is None:
        return (
            "Any law gains from fitting chance: whether the gap is more than that needs replicates."
        )
    if test["p_value"] < UNLIKELY:
        gains = sorted(result["gains"], key=lambda e: -e["gain"])[:GAINING]
        named = ", ".join(f"{entry['id']} ({entry['gain']:+.1f})" for entry in gains)
        return (
            "The chosen law lacks mass where the experiments need it: of data drawn from it so "
            f"large a gap is rare ({_p(test)}). Most gain the experiments {named}. The figure "
            "shows where: the gradient function is above zero there."
        )
    return (
        f"The experiments ask for no other law: a gap of {number(value['gap'], 3)} is what chance "
        f"makes of data drawn from the chosen one ({_p(test)})."
    )


def _opening(result: Document) -> Text:
    names = ", ".join(result["region"])
    return Text(
        f"The largest log-likelihood that any law of {names} can have with these experiments: a "
        f"law of {len(result['points'])} points."
    )


def _values(result: Document) -> Rows:
    value, test = result["log_likelihood"], result["bootstrap"]
    error = f"no law has {number(max(value['error'], 1e-4), 1)} more"
    if not result["covered"]:
        error = "at least: points cannot cover so many parameters, and there may be a better law"
    rows = [
        ("best possible law", to_three(value["ceiling"]), error),
        *_on_the_simulator(value),
        ("chosen law", to_three(value["estimated"]), ""),
        ("gap", to_three(value["gap"]), "" if test is None else _drawn(test)),
    ]
    return Rows((("log-likelihood", "left"), ("", "right"), ("", "fold")), rows)


def _least(result: Document) -> str:
    return "" if result["covered"] else "at least "


def _on_the_simulator(value: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    if value["verified"] is None:
        return []
    what = "at the same points, on the simulator itself: at least this can be reached there"
    return [("verified", to_three(value["verified"]), what)]


def _drawn(test: Mapping[str, Any]) -> str:
    failed = f"; {test['failed']} failed and count as larger" if test["failed"] else ""
    return (
        f"{_p(test)}: of {test['replicates']} data sets drawn from the chosen law "
        f"{test['exceeded']} have a larger one{failed}"
    )


def _p(test: Mapping[str, Any]) -> str:
    return f"p = {number(test['p_value'], 2)}"


def _points(result: Mapping[str, Any]) -> RenderableType:
    """The points of most probability, in the order of their parameters."""
    points: Sequence[Mapping[str, float]] = result["points"]
    names = [*points[0]]
    columns: list[Column] = [(label(result, name), "right") for name in names]
    least = sorted((point["probability"] for point in points), reverse=True)[:SHOWN][-1]
    kept = [point for point in points if point["probability"] >= least][:SHOWN]
    table = Rows(columns, [[number(point[name]) for name in names] for point in kept])
    more = len(points) - len(kept)
    return Group(table, Text(f"and {more} more in ceiling.json")) if more else table


def _notes(result: Document) -> list[str]:
    """What the value stands on."""
    notes = []
    if result["held"]:
        named = ", ".join(f"{name} {number(value)}" for name, value in result["held"].items())
        noise = any(name.startswith("noise.") for name in result["held"])
        notes.append(f"Held at the estimate meanwhile: {named}.{FREE if noise else ''}")
    for name in result["edges"]:
        low, high = result["region"][name]
        notes.append(
            f"The best law has mass on an edge of where {name} was looked for, {number(low)} to "
            f"{number(high)}: beyond it the ceiling may be higher."
        )
    return notes


def _map(values: pd.DataFrame) -> dict[str, Any]:
    return {
        "first": values.columns.tolist(),
        "second": values.index.tolist(),
        "gradient": values.to_numpy().tolist(),
    }
