"""A bootstrap as a table to read on a terminal: a pure function of its document."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from aleator.report.rows import Rows, written
from aleator.results.printed import NONE, Column, number, with_error
from aleator.results.units import label
from aleator.tasks.bootstrap import ARRIVED, PARAMETRIC

Document = Mapping[str, Any]

CHANCE = 3.0
"""Standard errors that chance hardly ever exceeds."""
LARGE = 0.25
"""Share of the standard error from which a bias matters: 95 % intervals then hold 94 % or less."""
PILED = 0.01
"""Share of replicates on a limit from which it is told."""
COLUMNS: Sequence[Column] = (
    ("alpha", "left"), ("estimate", "right"), ("std. error", "right"), ("bias", "right"),
    ("95 % BCa", "right"), ("note", "fold"),
)  # fmt: skip
DRAWN = {
    PARAMETRIC: "drawn under the identified law and noise",
    "nonparametric": "made of experiments drawn with replacement",
}


def render(result: Document, files: Sequence[str] = ()) -> RenderableType:
    """The table of a bootstrap.json: estimate, standard error, bias, interval."""
    arrived = result["statuses"].get(ARRIVED, 0)
    told = f"{result['replicates']} data sets of {result['experiments']} experiments, "
    told += f"{DRAWN[result['kind']]}; {arrived} climbs arrived at a maximum."
    parts: list[RenderableType] = [
        Text(result.get("title") or "Bootstrap", style="bold"),
        Text(told),
        Rows(
            COLUMNS,
            [_row(label(result, name), row) for name, row in result["hyperparameters"].items()],
        ),
    ]
    if result["in_this_process"]:
        parts.append(Text("The simulator cannot travel to workers: all was done in one process."))
    return Group(*parts, Text(verdict(result), style="bold"), *written(files))


def verdict(result: Document) -> str:
    """One sentence: what is biased, on a limit, or not known because climbs did not arrive."""
    notes = {name: _note(row) for name, row in result["hyperparameters"].items()}
    found = [f"{name} {note}" for name, note in notes.items() if note]
    lost = result["replicates"] - result["statuses"].get(ARRIVED, 0)
    if lost:
        found.append(f"{lost} of {result['replicates']} replicates did not arrive")
    return f"{'; '.join(found) or 'No bias that matters, and no replicate on a limit'}."


def _row(name: str, row: Document) -> tuple[str, ...]:
    scale = row["standard_error"]
    estimate, error = with_error(row["estimate"], scale, estimate=True)
    bias = NONE if row["bias"] is None else with_error(row["bias"], scale, estimate=True)[0]
    interval = NONE
    if row["bca_lower"] is not None:
        ends = (row["bca_lower"], row["bca_upper"])
        interval = " .. ".join(with_error(end, scale, estimate=True)[0] for end in ends)
    return name, estimate, error, bias, interval, _note(row)


def _note(row: Document) -> str:
    notes = []
    bias, error, scatter = row["bias"], row["bias_error"], row["standard_error"]
    if scatter and abs(bias) > max(CHANCE * error, LARGE * scatter):
        notes.append(f"biased by {bias / scatter:+.1f} standard errors")
    if row["at_limit"] and row["at_limit"] >= PILED:
        notes.append(f"on a limit in {number(100.0 * row['at_limit'], 2)} %")
    return ", ".join(notes)
