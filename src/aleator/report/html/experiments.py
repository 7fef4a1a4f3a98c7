"""The experiments as a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from aleator.report.html.markup import Section, folded, paragraph, table
from aleator.report.html.rows import conditions_of, numbers
from aleator.results.printed import number
from aleator.results.units import label, transforms, unit_of, with_unit

Document = Mapping[str, Any]
MOST = 1000
"""Rows of the table; of more experiments, the least expected."""
CONDITIONS = 8


def experiments(document: Document) -> Section:
    """A row for each experiment, with what was measured or what is known of it."""
    entries = document["experiments"]
    order = np.argsort(_expected(document), kind="stable")[:MOST] if len(entries) > MOST else None
    kept = sorted(order.tolist()) if order is not None else list(range(len(entries)))
    conditions = {
        name: [column[k] for k in kept]
        for name, column in list(conditions_of(document).items())[:CONDITIONS]
    }
    individual = bool(document.get("observations"))
    log = document.get("transform") == "log" and not individual
    own = [_individual(entries[k]) if individual else _outcome(entries[k], log) for k in kept]
    names = [*conditions, *(own[0] if own else {})]
    head = ["experiment", *(_head(document, name) for name in names)]
    beside = list(zip(*conditions.values(), strict=True)) or [()] * len(kept)
    rows = [
        [str(entries[k]["id"]), *(_cell(v) for v in at), *cells.values()]
        for k, at, cells in zip(kept, beside, own, strict=True)
    ]
    said = f"{len(entries):,} experiments"
    if len(kept) < len(entries):
        said += f", of which these {len(kept):,} are the least expected"
    made = table("experiments", said, head, rows)
    what = paragraph(f"Measured: {_measured(document)}.")
    return Section.of("experiments", "Experiments", what, folded("Show the table", made))


def _head(document: Document, name: str) -> str:
    """The head of a column, with the unit of what stands there."""
    if name in ("measured", "predicted median"):
        return with_unit(name, unit_of(document, str(document.get("outcome"))))
    of, comma, sd = name.partition(", ")
    return label(document, of) + comma + sd


def _measured(document: Document) -> str:
    """The responses with their units."""
    return ", ".join(label(document, name) for name in transforms(document) if name) or "outcome"


def _expected(document: Document) -> Any:
    return numbers([entry.get("log_density") for entry in document["experiments"]])


def _outcome(entry: Document, log: bool) -> dict[str, str]:
    def shown(value: Any) -> str:
        with np.errstate(over="ignore"):
            return number(float(np.exp(value)) if log and value is not None else value)

    return {
        "measured": shown(entry["outcome"]),
        "predicted median": shown(entry["quantiles"].get("0.5")),
        "95 % from": shown(entry["quantiles"].get("0.025")),
        "to": shown(entry["quantiles"].get("0.975")),
        "P(below)": number(entry["pit"], 3),
        "log-density": number(entry["log_density"]),
        "density": str(entry["status"]).replace("_", " "),
    }


def _individual(entry: Document) -> dict[str, str]:
    parts = {
        f"{name}{kind}": number(entry[key][name])
        for name in entry["mean"]
        for key, kind in (("mean", ""), ("sd", ", sd"))
    }
    return {
        "observations": str(entry["observations"]),
        "log-density": number(entry["log_density"]),
        **parts,
        **{
            f"{name}.{c} probability": number(one, 3)
            for name, each in (entry.get("components") or {}).items()
            for c, one in enumerate(each, start=1)
        },
    }


def _cell(value: Any) -> str:
    return value if isinstance(value, str) else number(value, 6)
