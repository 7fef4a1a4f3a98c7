"""The store of runs on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from aleator.simulators.inventory import Holding, KeptRun

SHORT = 8
"""Letters of a fingerprint that are shown, and suffice to name it."""

_WHOLE = ("fingerprint", "runs", "failed", "seconds", "last run", "run", "when")


def holdings(found: Sequence[Holding], current: str | None, store: str) -> RenderableType:
    """A row for each simulator; the one with the fingerprint `current` is the study's."""
    if not found:
        return Text(f"{store} holds no runs.")
    columns = ("simulator", "fingerprint", "runs", "failed", "seconds", "last run")
    rows = [
        (
            f"{held.simulator.name} {held.simulator.version}".strip(),
            held.simulator.fingerprint[:SHORT],
            f"{held.runs:,}",
            f"{held.failures:,}",
            f"{held.seconds:.3g}",
            "-" if held.last is None else moment(held.last),
            "this study's" if held.simulator.fingerprint == current else "",
        )
        for held in found
    ]
    return Group(Text(f"Runs in {store}", style="bold"), _table((*columns, ""), rows))


def runs(found: Sequence[KeptRun], more: int) -> RenderableType:
    """A row for each run; `more` are not shown."""
    if not found:
        return Text("There is no such run.")
    rows = [
        (
            str(run.number),
            _values(run.conditions),
            _values(run.parameters),
            f"{run.outcome:.6g}" if run.outcome is not None else f"failed: {run.failure}",
            moment(run.time),
        )
        for run in found
    ]
    columns = ("run", "conditions", "parameters", "outcome", "when")
    note = [Text(f"and {more:,} before these")] if more else []
    return Group(_table(columns, rows), *note)


def one(run: KeptRun) -> RenderableType:
    """All of one run, with what it printed."""
    simulator = run.simulator
    rows = [
        ("simulator", f"{simulator.name} ({simulator.description}) {simulator.version}".strip()),
        ("fingerprint", simulator.fingerprint),
        *((f"condition {name}", _value(value)) for name, value in run.conditions.items()),
        *((f"parameter {name}", repr(value)) for name, value in run.parameters.items()),
        ("outcome", "none" if run.outcome is None else repr(run.outcome)),
        ("failure", run.failure or "none"),
        ("seconds", "-" if run.seconds is None else f"{run.seconds:.3g}"),
        ("when", f"{moment(run.time)}, attempt {run.attempt}, on {run.host or 'an unknown host'}"),
    ]
    parts: list[RenderableType] = [_table(("run", str(run.number)), rows)]
    return Group(*parts, *([Text("Its log:"), Text(run.log)] if run.log else []))


def moment(seconds: float) -> str:
    """A time of the clock on the wall."""
    return datetime.fromtimestamp(seconds).strftime("%Y-%m-%d %H:%M:%S")


def _values(values: dict[str, Any]) -> str:
    return ", ".join(f"{name}={_value(value)}" for name, value in values.items())


def _value(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for name in columns:
        table.add_column(name, overflow="fold", no_wrap=name in _WHOLE)
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    return table
