"""A recovery study as a document, and as a table to read on a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from aleator.report.terminal import table_of
from aleator.tasks.printed import NONE, number, with_error
from aleator.tasks.recover import Recovery

BIASED = 3.0  # errors of the bias that chance hardly ever exceeds


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
    table = table_of(
        ("alpha", "left"),
        ("truth", "right"),
        ("mean", "right"),
        ("bias", "right"),
        ("+-", "right"),
        ("scatter", "right"),
        ("coverage", "right"),
        ("note", "fold"),
    )
    for name, row in result["hyperparameters"].items():
        bias, error = with_error(row["bias"], row["bias_error"])
        biased = row["bias_error"] and abs(row["bias"]) > BIASED * row["bias_error"]
        coverage = NONE if row["coverage"] is None else f"{100 * row['coverage']:.0f} %"
        table.add_row(
            Text(name), number(row["truth"]), number(row["mean"]), bias, error,
            number(row["scatter"], 2), coverage, "biased" if biased else "",
        )  # fmt: skip
    return Group(
        Text(result.get("title") or "Recovery", style="bold"),
        Text(
            f"{len(replicates)} virtual data sets drawn from the model at the truth and "
            f"identified anew, {converged} converged; coverage is that of the 95 % intervals."
        ),
        table,
        *(Text(f"Written: {file}") for file in files),
    )
