"""The feasible box as a document and on the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from aleator.report.rows import Rows
from aleator.results.printed import Column
from aleator.results.units import label
from aleator.tasks.box import FeasibleBox, Side

GAIN = 1.5  # times the volume that make it worth to think of leaving an experiment out
COLUMNS: Sequence[Column] = (
    ("parameter", "left"), ("side", "left"), ("value", "right"), ("limited by", "fold"),
)  # fmt: skip


def document(found: FeasibleBox) -> dict[str, Any]:
    """Everything that was found, as box.json holds it."""
    return {
        "box": {name: box.tolist() for name, box in zip(found.names, found.box, strict=True)},
        "limits": {
            name: ends.tolist() for name, ends in zip(found.names, found.limits, strict=True)
        },
        "sides": [
            {
                "parameter": side.parameter,
                "side": "upper" if side.upper else "lower",
                "value": side.value,
                "experiment": side.experiment,
                "failed_at": None
                if side.at is None
                else dict(zip(found.names, side.at.tolist(), strict=True)),
            }
            for side in found.sides
        ],
        "share": found.share,
        "runs": found.runs,
        "tested": found.tested,
        "confirmed": found.confirmed,
        "without": dict(found.without),
    }


def render(found: FeasibleBox, units: Mapping[str, Any] | None = None) -> RenderableType:
    """A row for each side, and the lines that go into the study; `units` as documents have them."""
    rows = [
        (
            label(units or {}, side.parameter),
            "upper" if side.upper else "lower",
            f"{side.value:.6g}",
            _limit(found.names, side),
        )
        for side in found.sides
    ]
    lines = [f"  {line}" for line in _moved(found)]
    advice = (
        ["For the study:", *lines] if lines else ["The study's limits are feasible as they are."]
    )
    return Group(Rows(COLUMNS, rows), Text("\n".join([_cost(found), *_offer(found), *advice])))


def verdict(found: FeasibleBox) -> str:
    """One line: the box, as far as it is smaller than the limits."""
    return "; ".join(_moved(found)) or "The study's limits are feasible as they are."


def _moved(found: FeasibleBox) -> list[str]:
    """The lines of a study for the parameters whose limits are not feasible."""
    moved = {side.parameter for side in found.sides if side.experiment is not None}
    return [
        f"{name}: box = [{low:.6g}, {high:.6g}]"
        for name, (low, high) in zip(found.names, found.box, strict=True)
        if name in moved
    ]


def _limit(names: Sequence[str], side: Side) -> str:
    if side.at is None:
        return "the study's limits"
    at = ", ".join(f"{name}={value:.4g}" for name, value in zip(names, side.at, strict=True))
    return f"experiment {side.experiment}, which fails at {at}"


def _offer(found: FeasibleBox) -> list[str]:
    """What leaving out a single experiment would gain, if that is much."""
    if not found.without:
        return []
    name, share = max(found.without.items(), key=lambda entry: entry[1])
    if share < GAIN * found.share:
        return []
    return [
        f"Without experiment {name} the box would hold about {share:.0%} of the limits' volume: "
        "check its row, or leave it out and look again."
    ]


def _cost(found: FeasibleBox) -> str:
    sure = (
        "" if found.confirmed else " The last rounds still met failures: shrink the box a little."
    )
    return (
        f"The box holds {found.share:.1%} of the limits' volume. None of {found.tested:,} points "
        f"inside fails under any experiment. This took {found.runs:,} runs.{sure}"
    )
