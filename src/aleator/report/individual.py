"""The parts of a report that only experiments with individual parameters have."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from statistics import fmean, pstdev
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from aleator.report.rows import Rows
from aleator.results.printed import NONE, Column, by_name, number, outside, principle
from aleator.results.units import label, unit_of, with_unit

Result = Mapping[str, Any]
WORST = 3


def is_individual(result: Result) -> bool:
    """Whether a document is of experiments with individual parameters."""
    return bool(result.get("observations"))


def opening(result: Result) -> str:
    """What was identified from what, and how: one sentence."""
    seen = result["observations"]
    bounded = sum(entry["lower"] is None or entry["lower"] != entry["upper"] for entry in seen)
    known = f" ({bounded:,} of them bounds only)" if bounded else ""
    return (
        f"{len(seen):,} observations{known}, {principle(result)}: integral over individual "
        f"parameters {by_name(result)}, {_simulated(result)}"
    )


def _simulated(result: Result) -> str:
    way = "on the simulator itself" if result["propagation"] == "direct" else "on surfaces of it"
    reason = result.get("propagation_reason")
    return f"{way} ({reason})" if reason else way


def shrinkage(result: Result) -> RenderableType | None:
    """How much the observations of single experiments say of their parameters, if any scatters."""
    columns: Sequence[Column] = (
        ("individual", "left"), ("shrinkage", "right"), ("means from .. to", "right"),
        ("sd of the means", "right"), ("their own sd", "right"),
    )  # fmt: skip
    experiments = result["experiments"]
    rows = []
    for name, share in result["shrinkage"].items():
        means = _finite(entry["mean"].get(name) for entry in experiments)
        sds = _finite(entry["sd"].get(name) for entry in experiments)
        if not means or not sds:
            continue
        rows.append(
            (
                label(result, name), f"{100 * share:.0f} %",
                f"{number(min(means))} .. {number(max(means))}",
                number(pstdev(means), 3), number(fmean(sds), 3),
            )
        )  # fmt: skip
    if not rows:
        return None
    head = (
        "Parameters of the experiments. Shrinkage: 0 % where the observations of an experiment "
        "alone say what its own parameter is, 100 % where only the law does."
    )
    return Group(Text(head), Rows(columns, rows), *_components(result))


def _components(result: Result) -> Iterator[Text]:
    """How many experiments are most probably of each component of a mixture."""
    every = [entry.get("components") or {} for entry in result["experiments"]]
    for name in every[0]:
        most = Counter(max(enumerate(p[name], 1), key=_probability)[0] for p in every)
        said = ", ".join(f"{c} of {number}" for c, number in sorted(most.items()))
        yield Text(f"{label(result, name)}: the most probable component is {said} experiments.")


def _probability(component: tuple[int, float | None]) -> float:
    return component[1] or 0.0


def relations(result: Result) -> RenderableType | None:
    """The individual means against columns and each other, what is least likely first."""
    found = (result.get("consistency") or {}).get("relations")
    if not found:
        return None
    columns: Sequence[Column] = (
        ("individual", "left"), ("against", "left"), ("correlation", "right"), ("p", "right"),
        ("shrinkage", "right"),
    )  # fmt: skip
    rows = [
        (
            row["parameter"], row["other"], f"{row['correlation']:+.2f}", number(row["p"], 2),
            f"{100 * result['shrinkage'][row['parameter']]:.0f} %",
        )
        for row in sorted(found, key=lambda row: row["p"])
    ]  # fmt: skip
    head = (
        "Individual means against the columns of the table and each other. p tells how often a "
        "right model, shrinkage included, has a correlation as strong; one of many is small by "
        "chance."
    )
    return Group(Text(head), Rows(columns, rows))


def worst(result: Result) -> RenderableType | None:
    """The observations that lie farthest from what the individual law predicts, in scales."""
    seen = [entry for entry in result["observations"] if entry["residual"] is not None]
    found = sorted(seen, key=lambda entry: -abs(entry["residual"]))[:WORST]
    if not found:
        return None
    names = [*result["responses"]]
    unit = (
        unit_of(result, names[0]) if names and [*result["responses"].values()] == ["none"] else None
    )
    columns: Sequence[Column] = (
        ("farthest from its prediction", "left"), (with_unit("measured", unit), "right"),
        ("predicted", "right"),
        ("error scale", "right"), ("off by", "right"),
    )  # fmt: skip
    rows = [
        (
            place(entry, len(result["responses"]) > 1), measured(entry),
            number(entry["predicted"]), number(entry["scale"], 3), f"{entry['residual']:+.2f}",
        )
        for entry in found
    ]  # fmt: skip
    logs = [name for name, transform in result["responses"].items() if transform == "log"]
    notes = [f"Of {', '.join(logs)} the logarithms."] if logs else []
    exact = [entry for entry in result["observations"] if entry["lower"] == entry["upper"]]
    known = [entry["pit"] for entry in exact if entry["pit"] is not None]
    given = "Outside their 95 %, given the earlier observations of their experiments, "
    notes += [given + outside(known)] if known else []
    return Group(Rows(columns, rows), *map(Text, notes))


def place(entry: Mapping[str, Any], several: bool) -> str:
    """An observation by its experiment, its response where there are several, its conditions.

    >>> place({"id": "308", "response": "y", "conditions": {"days": 3.0}}, False)
    'experiment 308, days 3'
    """
    parts = [f"experiment {entry['id']}"]
    parts += [str(entry["response"])] if several else []
    parts += [
        f"{name} {number(value) if isinstance(value, int | float) else value}"
        for name, value in entry["conditions"].items()
    ]
    return ", ".join(parts)


def measured(entry: Mapping[str, Any]) -> str:
    """A value, or the bounds of one.

    >>> measured({"lower": 1.0, "upper": None}), measured({"lower": 2.0, "upper": 2.0})
    ('> 1', '2')
    """
    low, high = entry["lower"], entry["upper"]
    if low == high:
        return number(low)
    if high is None:
        return f"> {number(low)}"
    return f"< {number(high)}" if low is None else f"{number(low)} .. {number(high)}"


def likelihoods(result: Result) -> Iterator[tuple[str, str, str]]:
    """How exact the integral is: name, value, words."""
    found = result.get("quadrature")
    if found:
        gap = found["gap"]
        yield (
            "more nodes",
            NONE if gap is None else f"{gap:+.3f}",
            "is what half as many nodes again change",
        )


def _finite(values: Iterator[float | None]) -> list[float]:
    return [value for value in values if value is not None and math.isfinite(value)]
