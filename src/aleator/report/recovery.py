"""A recovery study as a document, and as a table to read on a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from aleator.inference.information import LEVEL
from aleator.report.rows import Rows, written
from aleator.results.printed import NONE, Column, number, with_error
from aleator.tasks.recover import Recovery

CHANCE = 3.0  # standard errors that chance hardly ever exceeds
COLUMNS: Sequence[Column] = (
    ("alpha", "left"), ("truth", "right"), ("mean", "right"), ("bias", "right"), ("+-", "right"),
    ("scatter", "right"), ("coverage", "right"), ("note", "fold"),
)  # fmt: skip
BY_ERRORS: Sequence[Column] = (("alpha", "left"), ("by error", "right"), ("by sandwich", "right"))
MEANING = {
    "biased": "Biased: the estimates are off on average by more than three times the Monte Carlo "
    "error of that average. Below half of the scatter, a single estimate is off by chance more "
    "than by bias; above, correct it by the bias, or use more experiments. Standard deviations "
    "from few experiments come out too small.",
    "intervals too short": "Intervals too short: they hold the truth more rarely than in 95 % of "
    "all cases, and chance does not explain it. They rest on many experiments.",
}


def document(recovery: Recovery) -> dict[str, Any]:
    """A recovery as plain lists and numbers: the table by hyperparameter, and every replicate."""
    table = recovery.table()
    return {
        "hyperparameters": {
            str(name): {str(key): float(value) for key, value in row.items()}
            for name, row in table.iterrows()
        },
        "replicates": [
            {
                "alpha": dict(zip(recovery.names, alpha.tolist(), strict=True)),
                "intervals": dict(zip(recovery.names, intervals.tolist(), strict=True)),
                "log_likelihood": float(log_likelihood),
                "converged": bool(converged),
            }
            for alpha, intervals, log_likelihood, converged in zip(
                recovery.alpha,
                recovery.intervals,
                recovery.log_likelihood,
                recovery.converged,
                strict=True,
            )
        ],
    }


def render(result: Mapping[str, Any], files: Sequence[str] = ()) -> RenderableType:
    """The table of a recovery document: truth, mean estimate, bias, scatter, coverage."""
    replicates = result["replicates"]
    converged = sum(replicate["converged"] for replicate in replicates)
    rows = [_row(name, row, len(replicates)) for name, row in result["hyperparameters"].items()]
    notes = [MEANING[word] for word in MEANING if any(word in row[-1] for row in rows)]
    return Group(
        Text(result.get("title") or "Recovery", style="bold"),
        Text(
            f"{len(replicates)} virtual data sets drawn from the model at the truth and "
            f"identified anew, {converged} converged. Coverage is the share of the 95 % intervals "
            "that hold the truth."
        ),
        Rows(COLUMNS, rows),
        *_by_errors(result["hyperparameters"]),
        *map(Text, notes),
        *written(files),
    )


def verdict(result: Mapping[str, Any]) -> str:
    """One sentence: what is biased, and whose intervals are too short."""
    count = len(result["replicates"])
    notes = {name: _note(row, count) for name, row in result["hyperparameters"].items()}
    found = [f"{name} {note}" for name, note in notes.items() if note]
    return f"{'; '.join(found) or 'Chance explains every bias and every coverage'}."


def _row(name: str, row: Mapping[str, Any], replicates: int) -> tuple[str, ...]:
    bias, error = with_error(row["bias"], row["bias_error"])
    return (
        name, number(row["truth"]), number(row["mean"]), bias, error,
        number(row["scatter"], 2), _percent(row["coverage"]), _note(row, replicates),
    )  # fmt: skip


def _by_errors(rows: Mapping[str, Mapping[str, Any]]) -> Sequence[RenderableType]:
    """What the estimate -+ 1.96 errors would hold, in place of the profile's interval."""
    known = {name: row for name, row in rows.items() if "by_error" in row}
    if not known:
        return ()
    told = "Coverage of the estimate -+ 1.96 standard errors, or sandwich errors, where it has one:"
    cells = [
        (name, _percent(row["by_error"]), _percent(row["by_sandwich"]))
        for name, row in known.items()
    ]
    return (Text(told), Rows(BY_ERRORS, cells))


def _percent(share: float | None) -> str:
    return NONE if share is None or math.isnan(share) else f"{100 * share:.0f} %"


def _note(row: Mapping[str, Any], replicates: int) -> str:
    """What chance does not explain."""
    notes = []
    if row["bias_error"] and abs(row["bias"]) > CHANCE * row["bias_error"]:
        notes.append(f"biased by {row['bias'] / row['scatter']:+.1f} scatter")
    lowest = LEVEL - CHANCE * (LEVEL * (1.0 - LEVEL) / replicates) ** 0.5
    if row["coverage"] is not None and row["coverage"] < lowest:
        notes.append("intervals too short")
    return ", ".join(notes)
