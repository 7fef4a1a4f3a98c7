"""A posterior to read on a terminal, from its document."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from aleator.report.rows import Rows, written
from aleator.results.printed import Column, number, with_error
from aleator.results.units import label

COLUMNS: Sequence[Column] = (
    ("alpha", "left"), ("maximum", "right"), ("mean", "right"), ("sd", "right"),
    ("95 % interval", "right"), ("R-hat", "right"), ("ESS", "right"), ("prior", "left"),
)  # fmt: skip


def render(result: Mapping[str, Any], files: Sequence[str] = ()) -> RenderableType:
    """The table of a posterior document (see `Posterior.to_dict`), its warnings and its verdict."""
    priors = result["priors"]
    rows = [
        _row(label(result, name), row, name in priors)
        for name, row in result["hyperparameters"].items()
    ]
    return Group(
        Text(result.get("title") or "Posterior", style="bold"),
        Text(
            f"{result['chains']} chains of {result['draws']:,} draws from the posterior of "
            f"{len(rows)} hyperparameters given {result['experiments']:,} experiments, by "
            f"{result['evaluations']:,} evaluations of the likelihood, seed {result['seed']}. "
            "The maximum is that of aleator identify; intervals hold the middle 95 % of the draws. "
            "Without a prior a hyperparameter is as likely anywhere between its limits."
        ),
        Text(),
        Rows(COLUMNS, rows),
        Text(),
        *(Text(f"Warning: {warning}") for warning in result["warnings"]),
        Text(result["verdict"], style="bold green" if result["converged"] else "bold red"),
        *written(files),
    )


def _row(name: str, row: Mapping[str, Any], has_prior: bool) -> tuple[str, ...]:
    error = row["sd"]
    mean, sd = with_error(row["mean"], error)
    low, high = (with_error(row[end], error)[0] for end in ("lower", "upper"))
    ess = min(row["ess_bulk"], row["ess_tail"])
    return (
        name, with_error(row["estimate"], error)[0], mean, sd, f"{low} .. {high}",
        f"{row['r_hat']:.3f}", number(ess, 3), "given" if has_prior else "flat",
    )  # fmt: skip
