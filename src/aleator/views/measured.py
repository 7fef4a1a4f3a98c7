"""Measured values and their predictions as columns for charts, one row for each observation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.core.types import Array
from aleator.results.printed import AMOUNTS, Amounts
from aleator.results.units import label, seen_label
from aleator.views.chart import CHARTS, GRAY, GREEN, INK, VERMILION, Series, evenly, numbers

Bools = NDArray[np.bool_]
Document = Mapping[str, Any]
QUANTILES = ("0.025", "0.25", "0.5", "0.75", "0.975")
SHAPES = {"at least": "triangle", "at most": "inverted_triangle", "between": "square"}
"""The marker of a censored value, by its kind: only bounds of it are known."""


@dataclass(frozen=True)
class AxisChoice:
    """A quantity that a reader can choose for the x axis: its column `key` and its title.

    A quantity with texts has a column of numbers 0, 1, 2, ..., and `labels` are the texts. `name`
    is the name of a condition without its unit; it is empty for any other quantity.
    """

    key: str
    title: str
    labels: tuple[str, ...] | None = None
    name: str = ""


@dataclass(frozen=True, eq=False)
class MeasuredValues:
    """The M observations of one response, in its unit, with what is predicted for them.

    `columns` have M values each. `id` is the experiment. `value` is the measured value, or the
    bound of a censored value; `kind` says which ("measured", "at least", "at most", "between");
    `low` and `high` are the bounds. `q0.025` to `q0.975` are quantiles predicted by the law. `own`
    is the prediction with the parameters of the experiment itself, and `own_low` to `own_high` the
    range with 95 % of the measurement errors. `pit` is the predicted probability of a smaller
    value. Each condition has a column, too. `log` means a logarithmic axis. `label` is the name of
    the response with its unit.
    """

    response: str
    log: bool
    columns: Mapping[str, list[Any]]
    choices: tuple[AxisChoice, ...]
    label: str = ""

    def __len__(self) -> int:
        return len(self.columns["id"])

    def array(self, key: str) -> Array:
        """The numbers of a column (M,); a missing number is NaN."""
        return numbers(self.columns[key])

    @property
    def by_law(self) -> bool:
        """Whether predictions by the law are known, not only by each experiment's parameters."""
        return "q0.5" in self.columns

    @property
    def exact(self) -> Bools:
        """Which values were measured and are not censored (M,)."""
        return np.array([kind == "measured" for kind in self.columns["kind"]], dtype=bool)

    @property
    def outside(self) -> Bools:
        """Which values lie outside their predicted 95 % range (M,); False for censored ones."""
        value, (low, high) = self.array("value"), (self.array(key) for key in self.ends)
        with np.errstate(invalid="ignore"):
            return np.asarray(self.exact & ((value < low) | (value > high)))

    @property
    def outside_of(self) -> str:
        """How many values lie outside their predicted 95 % range, of all exact ones that have one.

        It reads "3 of 1,200".
        """
        ends = np.array([self.array(key) for key in self.ends])
        known = self.exact & np.isfinite(ends).all(axis=0)
        return f"{int(np.sum(self.outside))} of {int(known.sum()):,}"

    @property
    def exact_probabilities(self) -> list[float]:
        """The predicted probabilities of values below the measured ones, censored ones left out."""
        pit = self.array("pit")
        return [float(p) for p in pit[self.exact & np.isfinite(pit)]]

    @property
    def ends(self) -> tuple[str, str]:
        """The names of the two columns with the ends of the predicted 95 % range."""
        return ("q0.025", "q0.975") if self.by_law else ("own_low", "own_high")

    def thinned(self, amounts: Amounts = AMOUNTS) -> MeasuredValues:
        """These values with a limited number of rows, so that a chart can show them.

        Rows whose values are farthest from their prediction remain, and others evenly chosen.
        """
        if len(self) <= amounts.marks:
            return self
        away = np.abs(np.nan_to_num(self.array("pit"), nan=0.5) - 0.5)
        out = np.argsort(-away, kind="stable")[: amounts.farthest].tolist()
        return self.part(sorted({*out, *evenly(len(self), amounts.marks - amounts.farthest)}))

    def part(self, rows: Sequence[int]) -> MeasuredValues:
        """The values of these rows only."""
        part = {key: [column[k] for k in rows] for key, column in self.columns.items()}
        return replace(self, columns=part)

    def deviations(self) -> MeasuredValues:
        """Values and predictions less the predicted median, or over it on a logarithmic axis."""
        middle = self.array("q0.5")
        moved = ["value", "low", "high", *(f"q{p}" for p in QUANTILES)]
        with np.errstate(invalid="ignore", divide="ignore"):
            columns = {
                key: (self.array(key) / middle if self.log else self.array(key) - middle).tolist()
                for key in moved
            }
        label = (
            f"{self.response} / predicted median"
            if self.log
            else self.label.replace(self.response, f"{self.response} − median", 1)
        )
        return replace(self, columns={**self.columns, **columns}, label=label)

    def series(self, number: int = 0) -> Series:
        """The data of charts of these values; `number` is the index of the response."""
        return self.named_series(f"measured-{number}")

    def named_series(self, name: str) -> Series:
        """The data of charts with this name, with the color, marker and size of each row."""
        exact, outside = self.exact, self.outside
        known = np.isfinite([self.array(key) for key in self.ends]).all(axis=0)
        inside = np.where(known, INK, GRAY)
        marks = {
            "x": list(self.columns["order"]),
            "color": np.where(~exact, GREEN, np.where(outside, VERMILION, inside)).tolist(),
            "marker": [
                SHAPES.get(kind, "diamond" if out else "circle")
                for kind, out in zip(self.columns["kind"], outside, strict=True)
            ],
            "size": np.where(outside | ~exact, 10.0, CHARTS.dot).tolist(),
        }
        return Series(name, {**self.columns, **marks})


def measured(document: Document, seen: bool = False) -> list[MeasuredValues]:
    """The measured values of each response with their predictions, from identification.json.

    With `seen` they are on the scale of the likelihood, which is the logarithm of a response with
    transform = "log".
    """
    conditions = conditions_of(document)
    if document.get("observations"):
        return _observed(document, conditions, seen)
    return [_outcomes(document, conditions, seen)]


def varying(document: Document) -> str | None:
    """The numeric condition that varies within experiments and has the most different values.

    The result is None if no condition varies within experiments.

    >>> varying({"observations": [{"conditions": {"time": 1.0}}, {"conditions": {"time": 2.0}}]})
    'time'
    """
    values: dict[str, set[float]] = {}
    for entry in document.get("observations") or ():
        for name, value in entry["conditions"].items():
            if isinstance(value, int | float):
                values.setdefault(name, set()).add(float(value))
    return max(values, key=lambda name: len(values[name])) if values else None


def conditions_of(document: Document) -> Mapping[str, Sequence[Any]]:
    """The conditions that are constant within each experiment: a column (N,) for each name."""
    found: Mapping[str, Sequence[Any]] = (document.get("pictures") or {}).get("conditions") or {}
    count = len(document["experiments"])
    return {name: column for name, column in found.items() if len(column) == count}


def _outcomes(
    document: Document, conditions: Mapping[str, Sequence[Any]], seen: bool
) -> MeasuredValues:
    entries = document["experiments"]
    log = document.get("transform") == "log" and not seen
    shown = np.exp if log else np.asarray
    columns: dict[str, list[Any]] = {"id": [str(e["id"]) for e in entries]}
    value = shown(numbers([e.get("outcome") for e in entries])).tolist()
    columns |= {"value": value, "low": value, "high": value, "kind": ["measured"] * len(entries)}
    for p in QUANTILES:
        columns[f"q{p}"] = shown(
            numbers([(e.get("quantiles") or {}).get(p) for e in entries])
        ).tolist()
    columns["pit"] = [e["pit"] for e in entries]
    columns["error"] = [e.get("surface_error") for e in entries]
    name = str(document.get("outcome") or "outcome")
    return _finished(document, name, log, columns, conditions, seen)


def _observed(
    document: Document, conditions: Mapping[str, Sequence[Any]], as_seen: bool
) -> list[MeasuredValues]:
    seen = document["observations"]
    place = {str(e["id"]): k for k, e in enumerate(document["experiments"])}
    pictures = document.get("pictures") or {}
    predicted, rough = pictures.get("predicted") or {}, pictures.get("roughness") or []
    found = []
    for name, transform in document["responses"].items():
        which = [k for k, entry in enumerate(seen) if entry["response"] == name]
        own = [seen[k] for k in which]
        log = transform == "log" and not as_seen
        shown = np.exp if log else np.asarray
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
                "own_low": shown(middle - CHARTS.sd * scale).tolist(),
                "own_high": shown(middle + CHARTS.sd * scale).tolist(),
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
        found.append(_finished(document, name, log, columns, beside, as_seen))
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
    seen: bool,
) -> MeasuredValues:
    """The measured values of a response, from columns to which choices of the x axis are added.

    The choices are the order and the value of the prediction, and the conditions.
    """
    middle = numbers(columns["q0.5"]) if "q0.5" in columns else numbers(columns.get("own", []))
    rank = np.empty(len(middle), dtype=int)
    # Equal medians are in the order of the table: sorted values would rise along any prediction.
    order = np.argsort(np.nan_to_num(middle, nan=np.inf), kind="stable")
    rank[order] = np.arange(1, len(middle) + 1)
    columns["order"] = rank.tolist()
    what = "predicted median" if "q0.5" in columns else "fitted value"
    found = [AxisChoice("order", f"measured values, lowest {what} first")]
    if "q0.5" in columns:
        found.append(AxisChoice("q0.5", f"{what} of {label(document, response)}"))
    found += add_conditions(document, columns, conditions)
    for one in found:
        if one.name:
            texts = [v if isinstance(v, str) else _short(v) for v in conditions[one.name]]
            columns[f"{one.key}_shown"] = texts
    named = seen_label(document, response) if seen else label(document, response)
    return MeasuredValues(response, log, columns, tuple(found), named)


def add_conditions(
    document: Document, columns: dict[str, list[Any]], conditions: Mapping[str, Sequence[Any]]
) -> list[AxisChoice]:
    """Add conditions to the columns of a chart, and return them as choices of the x axis.

    Texts become numbers 0, 1, 2, ....
    """
    choices = []
    for k, (name, column) in enumerate(conditions.items()):
        texts = sorted({v for v in column if isinstance(v, str)})
        columns[f"c{k}"] = [
            texts.index(v) if isinstance(v, str) else None if texts else v for v in column
        ]
        choices.append(AxisChoice(f"c{k}", label(document, name), tuple(texts) or None, name))
    return choices


def _short(value: Any) -> str:
    return "" if value is None else f"{value:.6g}"
