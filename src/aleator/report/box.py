"""The feasible box as a document and on the terminal."""

from __future__ import annotations

from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from aleator.tasks.box import FeasibleBox


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
    }


def render(found: FeasibleBox) -> RenderableType:
    """A row for each side, and the lines that go into the study."""
    table = Table("parameter", "side", "value", "limited by")
    for side in found.sides:
        why = "the study's limits"
        if side.at is not None:
            at = ", ".join(f"{n}={v:.4g}" for n, v in zip(found.names, side.at, strict=True))
            why = f"experiment {side.experiment}, which fails at {at}"
        table.add_row(side.parameter, "upper" if side.upper else "lower", f"{side.value:.6g}", why)
    moved = {side.parameter for side in found.sides if side.experiment is not None}
    lines = [
        f"  {name}: box = [{low:.6g}, {high:.6g}]"
        for name, (low, high) in zip(found.names, found.box, strict=True)
        if name in moved
    ]
    advice = (
        ["For the study:", *lines] if lines else ["The study's limits are feasible as they are."]
    )
    sure = "" if found.confirmed else "; the last rounds still met failures, so shrink it a little"
    cost = (
        f"{found.share:.1%} of the limits' volume; no failure at {found.tested} points inside, "
        f"each run under every experiment{sure}; {found.runs:,} runs"
    )
    return Group(table, Text("\n".join([cost, *advice])))
