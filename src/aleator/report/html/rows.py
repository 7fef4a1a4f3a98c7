"""What was measured, as columns for charts: of experiments, and of observations."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aleator.results.units import label
from aleator.types import Array

Document = Mapping[str, Any]
QUANTILES = ("0.025", "0.25", "0.5", "0.75", "0.975")
MOST = 600
"""Marks in a chart: more are thinned, but what lies farthest out stays."""
FARTHEST = 150


@dataclass(frozen=True)
class Axis:
    """What can be chosen for x: a column, its title, and of texts what stands for 0, 1, 2 ...

    `name` is that of a condition, without its unit.
    """

    key: str
    title: str
    labels: tuple[str, ...] | None = None
    name: str = ""


@dataclass(frozen=True, eq=False)
class Measured:
    """The observations of one response, a row each, in its own unit.

    `columns` have M values each: `id`, `value` (of a bound, that), `kind` ("measured", "at least",
    "at most", "between"), `low` and `high` ends of what is known, quantiles `q0.025` to `q0.975` of
    the law's prediction, `own` (the individual prediction) with `own_low` and `own_high`, `pit`,
    and a column for each condition. `log` tells that its axis is logarithmic, `label` is its
    name with its unit.
    """

    response: str
    log: bool
    columns: Mapping[str, list[Any]]
    axes: tuple[Axis, ...]
    label: str = ""

    def __len__(self) -> int:
        return len(self.columns["id"])

    def array(self, key: str) -> Array:
        """A column of numbers; NaN for none."""
        return numbers(self.columns[key])

    def only(self, rows: Sequence[int]) -> Measured:
        """Some of the rows."""
        part = {key: [column[k] for k in rows] for key, column in self.columns.items()}
        return Measured(self.response, self.log, part, self.axes, self.label)

    def thinned(self) -> Measured:
        """At most so many rows: those farthest out, and others evenly chosen."""
        return self if len(self) <= MOST else self.only(_thin(self.array("pit"), len(self)))


def measured(document: Document) -> list[Measured]:
    """What was measured, of each response."""
    conditions = conditions_of(document)
    if document.get("observations"):
        return _observed(document, conditions)
    return [_outcomes(document, conditions)]


def conditions_of(document: Document) -> Mapping[str, Sequence[Any]]:
    """Columns (N,) of what is the same in all rows of an experiment; none in old documents."""
    found: Mapping[str, Sequence[Any]] = (document.get("pictures") or {}).get("conditions") or {}
    count = len(document["experiments"])
    return {name: column for name, column in found.items() if len(column) == count}


def numbers(values: Sequence[Any]) -> Array:
    """JSON's null is NaN, and so is a text."""
    return np.array([float(v) if isinstance(v, int | float) else math.nan for v in values])


def _outcomes(document: Document, conditions: Mapping[str, Sequence[Any]]) -> Measured:
    entries = document["experiments"]
    log = document.get("transform") == "log"
    shown = np.exp if log else np.asarray
    columns: dict[str, list[Any]] = {"id": [str(e["id"]) for e in entries]}
    value = shown(numbers([e["outcome"] for e in entries])).tolist()
    columns |= {"value": value, "low": value, "high": value, "kind": ["measured"] * len(entries)}
    for p in QUANTILES:
        columns[f"q{p}"] = shown(numbers([e["quantiles"].get(p) for e in entries])).tolist()
    columns["pit"] = [e["pit"] for e in entries]
    columns["error"] = [e.get("surface_error") for e in entries]
    name = str(document.get("outcome") or "outcome")
    return _finished(document, name, log, columns, conditions)


def _observed(document: Document, conditions: Mapping[str, Sequence[Any]]) -> list[Measured]:
    seen = document["observations"]
    place = {str(e["id"]): k for k, e in enumerate(document["experiments"])}
    pictures = document.get("pictures") or {}
    predicted, rough = pictures.get("predicted") or {}, pictures.get("roughness") or []
    found = []
    for name, transform in document["responses"].items():
        which = [k for k, entry in enumerate(seen) if entry["response"] == name]
        own = [seen[k] for k in which]
        shown = np.exp if transform == "log" else np.asarray
        low, high = numbers([e["lower"] for e in own]), numbers([e["upper"] for e in own])
        middle, scale = numbers([e["predicted"] for e in own]), numbers([e["scale"] for e in own])
        with np.errstate(over="ignore", invalid="ignore"):
            columns: dict[str, list[Any]] = {
                "id": [str(e["id"]) for e in own],
                "row": [e["row"] for e in own],
                "value": shown(np.where(np.isnan(low), high, low)).tolist(),
                "low": shown(low).tolist(),
                "high": shown(high).tolist(),
                "kind": [_kind(*ends) for ends in zip(low, high, strict=True)],
                "own": shown(middle).tolist(),
                "own_low": shown(middle - 1.96 * scale).tolist(),
                "own_high": shown(middle + 1.96 * scale).tolist(),
                "pit": [e.get("pit") for e in own],
            }
            if len(rough) == len(seen):
                columns["error"] = [rough[k] for k in which]
            for p in QUANTILES:
                if len(predicted.get(p, ())) == len(seen):
                    quantile = numbers([predicted[p][k] for k in which])
                    columns[f"q{p}"] = shown(quantile).tolist()
        at = [place[str(e["id"])] for e in own]
        beside = {c: [column[k] for k in at] for c, column in conditions.items()}
        beside |= _varying(own)
        found.append(_finished(document, name, transform == "log", columns, beside))
    return found


def _varying(own: Sequence[Document]) -> dict[str, list[Any]]:
    names = dict.fromkeys(name for entry in own for name in entry["conditions"])
    return {name: [entry["conditions"].get(name) for entry in own] for name in names}


def _kind(low: float, high: float) -> str:
    if low == high:
        return "measured"
    if math.isnan(high):
        return "at least"
    return "at most" if math.isnan(low) else "between"


def _finished(
    document: Document,
    response: str,
    log: bool,
    columns: dict[str, list[Any]],
    conditions: Mapping[str, Sequence[Any]],
) -> Measured:
    """With the orders and the conditions as axes."""
    middle = numbers(columns["q0.5"]) if "q0.5" in columns else numbers(columns.get("own", []))
    rank = np.empty(len(middle), dtype=int)
    rank[np.lexsort((numbers(columns["value"]), np.nan_to_num(middle, nan=np.inf)))] = np.arange(
        1, len(middle) + 1
    )
    columns["order"] = rank.tolist()
    what = "predicted median" if "q0.5" in columns else "predicted value"
    found = [Axis("order", f"order of the {what}")]
    if "q0.5" in columns:
        found.append(Axis("q0.5", f"{what} of {label(document, response)}"))
    for k, (name, column) in enumerate(conditions.items()):
        key = f"c{k}"
        texts = sorted({v for v in column if isinstance(v, str)})
        columns[f"{key}_shown"] = [v if isinstance(v, str) else _short(v) for v in column]
        if texts:
            columns[key] = [texts.index(v) if isinstance(v, str) else None for v in column]
        else:
            columns[key] = list(column)
        found.append(Axis(key, label(document, name), tuple(texts) or None, name))
    return Measured(response, log, columns, tuple(found), label(document, response))


def _short(value: Any) -> str:
    return "" if value is None else f"{value:.6g}"


def _thin(pit: Array, count: int) -> list[int]:
    away = np.abs(np.nan_to_num(pit, nan=0.5) - 0.5)
    out = np.argsort(-away, kind="stable")[:FARTHEST]
    even = np.linspace(0, count - 1, MOST - FARTHEST).round().astype(int)
    return sorted({*out.tolist(), *even.tolist()})
