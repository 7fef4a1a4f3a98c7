"""The first runs of a study as a document, and as text for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from aleator.report.rows import Rows, written
from aleator.results.printed import Column, number
from aleator.results.units import label
from aleator.tasks.expected_cost import Cost
from aleator.tasks.first_look import Look
from aleator.types import Array

SHOWN = 12  # experiments out of reach on the terminal; the document has all


def document(look: Look, cost: Cost | None, workers: int) -> dict[str, Any]:
    """Everything that was found, as check.json holds it."""
    plan, response = look.plan, np.array(look.response)
    each = [*dict.fromkeys(look.response)]
    return {
        "runs": look.runs,
        "failed": look.failed,
        "fault": look.fault,
        "seconds_a_run": look.seconds,
        "conditions": {"all": plan.count, "looked_at": look.looked_at},
        "parameters": [
            {
                "name": plan.names[i],
                "lower": plan.region[i, 0],
                "upper": plan.region[i, 1],
                "moves": {r: float(np.nanmedian(look.swing[response == r, j])) for r in each},
                "moves_at_most": {r: float(np.nanmax(look.swing[response == r, j])) for r in each},
                "influence": not look.without_influence[j],
                "values": plan.x[plan.star[j], i],
            }
            for j, i in enumerate(plan.moving)
        ],
        "measured": {r: _range(look.lower[response == r], look.upper[response == r]) for r in each},
        "observations": [
            {
                "id": name,
                "experiment": look.owner[k],
                "response": look.response[k],
                "lower": look.lower[k],
                "upper": look.upper[k],
                "reached": look.reached[k],
                "beyond": look.beyond[k],
                "margin": look.margin[k],
                "by_parameter": [look.outcome[k][star] for star in plan.star],
            }
            for k, name in enumerate(look.ids)
        ],
        "out_of_reach": [look.ids[k] for k in look.out_of_reach],
        "cost": None
        if cost is None
        else {
            "least_runs": cost.least,
            "most_runs": cost.most,
            "direct": cost.direct,
            "workers": workers,
            "hours": [
                runs * look.seconds / 3600.0 / workers for runs in (cost.least, cost.most)
            ],
        },
    }  # fmt: skip


def render(result: Mapping[str, Any], files: Sequence[str] = ()) -> RenderableType:
    """What was run, what each parameter does, what is out of reach, and what comes."""
    parts: list[RenderableType] = [
        Text(result.get("title") or "First look", style="bold"),
        Text(_made(result)),
        _parameters(result),
        *[Text(line, style="yellow") for line in _warnings(result)],
    ]
    if result["out_of_reach"]:
        parts.append(_beyond(result))
    parts += [Text(_reach(result)), Text(_cost(result)), *written(files)]
    return Group(*parts)


def verdict(result: Mapping[str, Any]) -> str:
    """What is out of reach, and what an identification costs."""
    return f"{_reach(result)}\n{_cost(result)}"


def duration(hours: float) -> str:
    """A time in the unit that suits it.

    >>> duration(0.0001), duration(0.2), duration(5.0), duration(100.0)
    ('less than a second', '12 minutes', '5 hours', '4.2 days')
    """
    seconds = 3600.0 * hours
    for unit, size in (("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.0f} seconds" if seconds >= 1.0 else "less than a second"


def _range(lower: Array, upper: Array) -> list[float]:
    """The least and the largest measured value; bounds count by the end that is known."""
    known = np.concatenate([lower, upper])
    known = known[np.isfinite(known)]
    return [float(known.min()), float(known.max())]


def _made(result: Mapping[str, Any]) -> str:
    seen, all_of = result["conditions"]["looked_at"], result["conditions"]["all"]
    under = f"all {all_of} conditions" if seen == all_of else f"{seen} of {all_of} conditions"
    took = number(result["seconds_a_run"], 2)
    return f"{result['runs']:,} runs under {under}; one takes {took} s."


def _parameters(result: Mapping[str, Any]) -> Rows:
    columns: Sequence[Column] = (
        ("parameter", "left"), ("from", "right"), ("to", "right"),
        ("moves the outcome by", "right"), ("at most", "right"), ("note", "fold"),
    )  # fmt: skip
    several = len(result["measured"]) > 1
    return Rows(
        columns,
        [
            (
                f"{label(result, row['name'])}{f', {response}' if several else ''}",
                number(row["lower"]), number(row["upper"]), number(moves),
                number(row["moves_at_most"][response]),
                "" if row["influence"] else "no influence",
            )
            for row in result["parameters"]
            for response, moves in row["moves"].items()
        ],
    )  # fmt: skip


def _warnings(result: Mapping[str, Any]) -> list[str]:
    lines = []
    idle = [row["name"] for row in result["parameters"] if not row["influence"]]
    if idle:
        lines.append(
            f"No influence on any outcome: {', '.join(idle)}. Leave it out, or make it a known "
            "constant; if it should matter, see that the simulator uses it."
        )
    if result["failed"]:
        lines.append(
            f"{result['failed']:,} of {result['runs']:,} runs failed, the first because: "
            f"{result['fault']}. `aleator box STUDY.toml` finds the box in which all work."
        )
    return lines


def _beyond(result: Mapping[str, Any]) -> Rows:
    known = {row["id"]: row for row in result["observations"]}
    columns: Sequence[Column] = (
        ("out of reach", "left"), ("measured", "right"), ("reached from", "right"),
        ("to", "right"), ("beyond by", "right"),
    )  # fmt: skip
    rows = []
    for name in result["out_of_reach"][:SHOWN]:
        row = known[name]
        low, high = row["reached"]
        measured = row["lower"] if row["beyond"] > 0.0 else row["upper"]
        rows.append((name, number(measured), number(low), number(high), number(row["beyond"], 2)))
    return Rows(columns, rows)


def _reach(result: Mapping[str, Any]) -> str:
    count, of = len(result["out_of_reach"]), len(result["observations"])
    if not count:
        return f"All {of} measured values lie within what the simulator reaches in this region."
    more = f" ({count - SHOWN} more are in check.json)" if count > SHOWN else ""
    noisy = any(row["margin"] for row in result["observations"])
    by = (
        ", within three standard deviations of the noise, known or in the middle of its limits"
        if noisy
        else ""
    )
    return (
        f"{count} of {of} measured values are out of reach{more}: no point that was tried comes "
        f"to them{by}. Widen the limits of {_strongest(result)}, which moves the outcome most; "
        "check these rows of the table; or give [noise] an sd that covers the gap."
    )


def _strongest(result: Mapping[str, Any]) -> str:
    """The parameter that moves an outcome by most of its measured range."""

    def share(row: Mapping[str, Any]) -> float:
        widths = {name: ends[1] - ends[0] for name, ends in result["measured"].items()}
        return max(float(m / max(widths[name], 1e-300)) for name, m in row["moves"].items())

    return str(max(result["parameters"], key=share)["name"])


def _cost(result: Mapping[str, Any]) -> str:
    cost = result["cost"]
    if cost is None:
        return "Collocation runs the simulator for every alpha: its cost is not known beforehand."
    low, high = (duration(hours) for hours in cost["hours"])
    if cost["direct"]:
        return (
            "The simulator takes arrays: an identification runs it at every node, "
            f"{cost['least_runs']:,} times or more, and these runs are not kept. If it is slow, "
            'take [propagation] surfaces = "own".'
        )
    by = f"with {cost['workers']} workers" if cost["workers"] > 1 else "with one worker"
    time = low if low == high else f"{low} to {high}"
    return (
        f"An identification takes some {cost['least_runs']:,} to {cost['most_runs']:,} runs: "
        f"{time} {by}."
    )
