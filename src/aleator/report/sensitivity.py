"""A sensitivity study as a document, and as tables to read on a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Group, RenderableType
from rich.text import Text

from aleator.report.rows import Rows, written
from aleator.results.printed import Column, number
from aleator.tasks.screen import CONFOUNDED, GOOD, Sensitivity

SHOWN = 5  # pairs in the terminal; the document has all


def document(found: Sensitivity) -> dict[str, Any]:
    """A sensitivity study as plain lists and numbers, as sensitivity.json holds it."""
    expansion, sobol = found.expansion, found.sobol
    return {
        "parameters": _rows(found.parameters()),
        "pairs": _rows(found.pairs()),
        "expansion": {
            "runs": found.runs,
            "terms": len(expansion.indices),
            "degree": int(expansion.indices.sum(axis=1).max()),
            "converged": found.converged,
            "unexplained": {
                name: float(np.quantile(expansion.unexplained, share))
                for name, share in (("median", 0.5), ("nine_in_ten", 0.9), ("largest", 1.0))
            },
        },
        "experiments": [
            {
                "id": name,
                "mean": expansion.mean[l],
                "standard_deviation": np.sqrt(sobol.variance[l]),
                "unexplained": expansion.unexplained[l],
                "first": _named(found, sobol.first[l]),
                "total": _named(found, sobol.total[l]),
                "effect": _named(found, found.effects[l]),
                "second": sobol.second[l],
            }
            for l, name in enumerate(found.ids)
        ],
    }


def render(result: Mapping[str, Any], files: Sequence[str] = ()) -> RenderableType:
    """The tables of a sensitivity document: parameters, the best pairs, and what to make of it."""
    expansion = result["expansion"]
    parts: list[RenderableType] = [
        Text(result.get("title") or "Sensitivity", style="bold"),
        Text(_what(expansion, result["study"]["outcome"], len(result["experiments"]))),
        _parameters(result["parameters"]),
    ]
    if result["pairs"]:
        parts += [_pairs(result["pairs"]), Text(_meaning())]
    if not expansion["converged"]:
        parts.append(Text(_rough(expansion["runs"]), style="yellow"))
    return Group(*parts, *written(files))


def verdict(result: Mapping[str, Any]) -> str:
    """One sentence: the parameters that explain most."""
    first = [
        f"{row['parameter']} {_percent(row['mean_total'])}" for row in result["parameters"][:3]
    ]
    rough = "" if result["expansion"]["converged"] else "; the expansions are rough"
    return f"Shares of the variance of {result['study']['outcome']}: {', '.join(first)}{rough}."


def _what(expansion: Mapping[str, Any], outcome: str, experiments: int) -> str:
    missed = expansion["unexplained"]
    return (
        f"Shares of the variance of {outcome} over {experiments} experiments, from expansions of "
        f"degree {expansion['degree']} with {expansion['terms']} terms and {expansion['runs']} "
        f"runs an experiment. They miss {_percent(missed['median'])} of the variance in the "
        f"median, {_percent(missed['largest'])} at most (leave-one-out)."
    )


def _parameters(rows: Sequence[Mapping[str, Any]]) -> Rows:
    columns: Sequence[Column] = (
        ("parameter", "left"), ("alone", "right"), ("with others", "right"), ("at most", "right"),
        ("linear effect", "right"), ("varied", "fold"),
    )  # fmt: skip
    cells = [
        (
            row["parameter"],
            _percent(row["mean_first"]),
            _percent(row["mean_total"]),
            _percent(row["max_total"]),
            number(row["effect"], 3),
            f"{row['spread']}; most in {row['experiment']}",
        )
        for row in rows
    ]
    return Rows(columns, cells)


def _pairs(rows: Sequence[Mapping[str, Any]]) -> Rows:
    columns: Sequence[Column] = (
        ("pair", "left"), ("explains", "right"), ("alignment", "right"), ("", "fold"),
    )  # fmt: skip
    cells = [
        (
            f"{row['first']}, {row['second']}",
            _percent(row["explained"]),
            "-" if row["alignment"] is None else f"{row['alignment']:+.3f}",
            "hard to tell apart" if row["confounded"] else "",
        )
        for row in rows[:SHOWN]
    ]
    return Rows(columns, cells)


def _meaning() -> str:
    return (
        "Shares are means over the experiments: of a parameter alone (first-order Sobol' index) "
        "and with its interactions (total), at most in the experiment named. The linear effect is "
        "the straight part of what one standard deviation does, in the outcome's unit; what bends, "
        "as x^2 about zero, is seen in the shares only. Alignment is the cosine between the linear "
        "effects of two parameters "
        f"over the experiments: beyond {CONFOUNDED:g} the experiments hardly tell them apart."
    )


def _rough(runs: int) -> str:
    return (
        f"The expansions are rough: more than one in ten misses over {GOOD:.0%} of the variance. "
        f"Shares smaller than that mean little; allow more runs (--runs {4 * runs})."
    )


def _percent(share: float | None) -> str:
    """A share to a tenth of a percent, "-" for none.

    >>> _percent(0.4284), _percent(0.00004), _percent(None)
    ('42.8 %', '<0.1 %', '-')
    """
    if share is None or np.isnan(share):
        return "-"
    return f"{100.0 * share:.1f} %" if share >= 0.0005 or share == 0.0 else "<0.1 %"


def _named(found: Sensitivity, values: Any) -> dict[str, float]:
    return dict(zip(found.names, values.tolist(), strict=True))


def _rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    return [{str(key): value for key, value in row.items()} for row in table.to_dict("records")]
