"""The store of runs on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from rich.console import RenderableType

from aleator.results.printed import (
    AMOUNTS,
    Amounts,
    Chapter,
    Content,
    Sentence,
    TextTable,
    heads,
    number,
)
from aleator.simulators.records import SimulatorRuns, StoredRun
from aleator.views.terminal import terminal


@dataclass(frozen=True)
class RunListSettings:
    """How runs are listed; by judgement.

    moment: letters of a time to the minute. fingerprint: letters of a fingerprint that are shown,
    and suffice to name it.
    """

    moment: int = 16
    fingerprint: int = 8


LISTED = RunListSettings()
HOLDINGS = heads("simulator", "fingerprint", ">runs", ">failed", ">seconds", "last run", "~")
RUNS = heads(">run", "when", ">outcome", "~of")


def holdings(found: Sequence[SimulatorRuns], current: str | None, store: str) -> RenderableType:
    """A row for each simulator; the one with the fingerprint `current` is the study's."""
    if not found:
        return terminal(Content(f"{store} holds no runs."))
    rows = [
        (
            f"{held.simulator.name} {held.simulator.version}".strip(),
            held.simulator.fingerprint[: LISTED.fingerprint],
            f"{held.runs:,}",
            f"{held.failures:,}",
            number(held.seconds, 3),
            "-" if held.last is None else moment(held.last)[: LISTED.moment],
            "this study's" if held.simulator.fingerprint == current else "",
        )
        for held in found
    ]
    return _shown(f"Runs in {store}", TextTable(HOLDINGS, rows))


def runs(found: Sequence[StoredRun], more: int) -> RenderableType:
    """A row for each run; `more` are not shown."""
    if not found:
        return terminal(Content("There is no such run."))
    rows = [
        (
            str(run.number),
            moment(run.time),
            "failed" if run.outcome is None else _outcome(run.outcome),
            _values_of(run),
        )
        for run in found
    ]
    note = [Sentence(f"and {more:,} before these")] if more else []
    return _shown("", TextTable(RUNS, rows), *note)


def one(run: StoredRun) -> RenderableType:
    """All of one run, with what it printed."""
    simulator = run.simulator
    rows = [
        ("simulator", f"{simulator.name} ({simulator.description}) {simulator.version}".strip()),
        ("fingerprint", simulator.fingerprint),
        *((f"condition {name}", _value(value)) for name, value in run.conditions.items()),
        *((f"parameter {name}", repr(value)) for name, value in run.parameters.items()),
        *_outcomes(run),
        ("failure", _cut(run.failure or "none")),
        ("seconds", "-" if run.seconds is None else f"{run.seconds:.3g}"),
        ("when", f"{moment(run.time)}, attempt {run.attempt}, on {run.host or 'an unknown host'}"),
    ]
    table = TextTable((("run", "left"), (str(run.number), "fold")), rows)
    return _shown(
        "", table, *([Sentence(_cut(run.log, start=False), head="log")] if run.log else [])
    )


def _shown(title: str, *parts: TextTable | Sentence) -> RenderableType:
    return terminal(Content(title, sections=[Chapter("runs", title, parts)]))


def _outcome(outcome: float | tuple[float, ...]) -> str:
    """A number, or the first of several values and how many there are."""
    if isinstance(outcome, float):
        return f"{outcome:.6g}"
    return f"{outcome[0]:.6g}, ... ({len(outcome)} values)"


def _outcomes(run: StoredRun) -> list[tuple[str, str]]:
    """A line for the outcome, or one for each response with its values row by row."""
    if not isinstance(run.outcome, tuple):
        return [("outcome", "none" if run.outcome is None else repr(run.outcome))]
    names = [f"outcome {name}" for name in run.responses] or ["outcome"]
    parts = (run.outcome[k :: len(names)] for k in range(len(names)))
    return [(name, ", ".join(map(repr, p))) for name, p in zip(names, parts, strict=True)]


def moment(seconds: float) -> str:
    """A time of the clock on the wall."""
    return datetime.fromtimestamp(seconds).strftime("%Y-%m-%d %H:%M:%S")


def _cut(text: str, start: bool = True, amounts: Amounts = AMOUNTS) -> str:
    """A text that somebody may read: programs that fail may print millions of letters."""
    if len(text) <= amounts.failure:
        return text
    left_out = f"... ({len(text) - amounts.failure:,} letters are left out) ..."
    return (
        f"{text[: amounts.failure]} {left_out}"
        if start
        else f"{left_out} {text[-amounts.failure :]}"
    )


def _values_of(run: StoredRun) -> str:
    """Conditions and parameters of a run, and why it failed."""
    parts = [_values(run.conditions), _values(run.parameters), _cut(run.failure or "")]
    return "; ".join(part for part in parts if part)


def _values(values: dict[str, Any]) -> str:
    return ", ".join(f"{name}={_short(value)}" for name, value in values.items())


def _short(value: Any) -> str:
    """A value, or the first and the last of a series."""
    if isinstance(value, list) and len(value) > 1:
        return f"{_value(value[0])}...{_value(value[-1])}"
    return _value(value)


def _value(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
