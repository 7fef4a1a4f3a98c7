"""The tables of `aleator runs`: the simulators in a store of runs, their runs, and one run."""

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
    """Settings of lists of runs. The values are chosen by judgement.

    moment: the number of characters of a time that are shown, up to the minute. fingerprint: the
    number of characters of a fingerprint that are shown, enough to identify it.
    """

    moment: int = 16
    fingerprint: int = 8


LISTED = RunListSettings()
HOLDINGS = heads("simulator", "fingerprint", ">runs", ">failed", ">seconds", "last run", "~")
RUNS = heads(">run", "when", ">outcome", "~of")


def holdings(stored: Sequence[SimulatorRuns], current: str | None, store: str) -> RenderableType:
    """A table of the simulators in a store, with the number and the cost of their runs.

    The simulator with the fingerprint `current` is marked as the study's.
    """
    if not stored:
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
        for held in stored
    ]
    return _shown(f"Runs in {store}", TextTable(HOLDINGS, rows))


def runs(stored: Sequence[StoredRun], more: int) -> RenderableType:
    """A table of runs; `more` is the number of earlier runs that are not shown."""
    if not stored:
        return terminal(Content("There is no such run."))
    rows = [
        (
            str(run.number),
            moment(run.time),
            "failed" if run.outcome is None else _outcome(run.outcome),
            _values_of(run),
        )
        for run in stored
    ]
    note = [Sentence(f"and {more:,} before these")] if more else []
    return _shown("", TextTable(RUNS, rows), *note)


def one(run: StoredRun) -> RenderableType:
    """A table of all that is stored about one run, and the log of the run."""
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
    """The text of an outcome; of several values, the first one and their number."""
    if isinstance(outcome, float):
        return f"{outcome:.6g}"
    return f"{outcome[0]:.6g}, ... ({len(outcome)} values)"


def _outcomes(run: StoredRun) -> list[tuple[str, str]]:
    """Rows of a table with the outcome of a run, or with the values of each response."""
    if not isinstance(run.outcome, tuple):
        return [("outcome", "none" if run.outcome is None else repr(run.outcome))]
    names = [f"outcome {name}" for name in run.responses] or ["outcome"]
    parts = (run.outcome[k :: len(names)] for k in range(len(names)))
    return [(name, ", ".join(map(repr, p))) for name, p in zip(names, parts, strict=True)]


def moment(seconds: float) -> str:
    """The text of a time in seconds since 1970, as local date and time of day."""
    return datetime.fromtimestamp(seconds).strftime("%Y-%m-%d %H:%M:%S")


def _cut(text: str, start: bool = True, amounts: Amounts = AMOUNTS) -> str:
    """A text cut to a readable length, because a failing program may print very much.

    Its start is kept, or else its end.
    """
    if len(text) <= amounts.failure:
        return text
    left_out = f"... ({len(text) - amounts.failure:,} letters are left out) ..."
    return (
        f"{text[: amounts.failure]} {left_out}"
        if start
        else f"{left_out} {text[-amounts.failure :]}"
    )


def _values_of(run: StoredRun) -> str:
    """A text with the conditions and parameters of a run, and the reason of its failure if any."""
    parts = [_values(run.conditions), _values(run.parameters), _cut(run.failure or "")]
    return "; ".join(part for part in parts if part)


def _values(values: dict[str, Any]) -> str:
    return ", ".join(f"{name}={_short(value)}" for name, value in values.items())


def _short(value: Any) -> str:
    """The text of a condition or parameter; of a series, its first and its last value."""
    if isinstance(value, list) and len(value) > 1:
        return f"{_value(value[0])}...{_value(value[-1])}"
    return _value(value)


def _value(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
