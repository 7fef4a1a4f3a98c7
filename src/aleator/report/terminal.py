"""An identification as a report to read on a terminal, at 80 columns, with or without color."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from aleator.tasks.printed import (
    COLUMNS,
    NONE,
    alpha_rows,
    number,
    to_three,
    verdict,
    with_error,
)

Result = Mapping[str, Any]
WORST = 3


def render(result: Result, files: Sequence[str] = ()) -> RenderableType:
    """The report of a result document (see `Identification.to_dict`); `files` are named at its end.

    Keys that the document lacks are left out of the report.
    """
    parts = [
        _opening(result),
        _alpha(result),
        _log_likelihood(result),
        _densities(result),
        _worst(result),
        _effort(result),
        *_warnings(result),
        _verdict(result, files),
    ]
    return Group(*(line for part in parts if part is not None for line in (part, Text())))


def render_predictions(columns: Mapping[Any, Sequence[Any]], outcome: str) -> RenderableType:
    """A table of predictions from its columns, one row a condition; `outcome` says of what."""
    table = table_of(
        ("id", "fold"),
        ("mean", "right"),
        ("sd", "right"),
        ("median", "right"),
        ("50 % range", "right"),
        ("95 % range", "right"),
        ("density", "fold"),
    )
    for values in zip(*columns.values(), strict=True):
        row = dict(zip(columns, values, strict=True))
        table.add_row(
            Text(str(row["id"])),
            number(row["mean"]),
            number(row["standard_deviation"], 3),
            number(row["q0.5"]),
            f"{number(row['q0.25'])} .. {number(row['q0.75'])}",
            f"{number(row['q0.025'])} .. {number(row['q0.975'])}",
            _words(row["status"]),
        )
    return Group(Text(f"Predicted distribution of {outcome}", style="bold"), table)


def _opening(result: Result) -> RenderableType:
    alpha = result["alpha"]
    free = sum(not entry.get("fixed") for entry in alpha.values())
    search = result.get("search") or {}
    starts = f", best of {search['starts']} starts" if search.get("starts", 0) > 1 else ""
    title = Text(result.get("title") or "Identification", style="bold")
    return Group(
        title,
        Text(
            f"{_count(free, 'hyperparameter')} identified from "
            f"{_count(len(result['experiments']), 'experiment')} by maximum likelihood: "
            f"{_words(result.get('density'))} density, propagation by "
            f"{_words(result.get('propagation'))}{starts}, seed {result.get('seed', NONE)}."
        ),
    )


def _count(number: int, what: str) -> str:
    return f"{number:,} {what}{'' if number == 1 else 's'}"


def _words(name: object) -> str:
    return str(name or NONE).replace("_", " ")


def table_of(*columns: tuple[str, str]) -> Table:
    """An empty table of columns (name, side): side is "left", "right", or "fold" to wrap."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="bold", show_edge=False)
    for name, side in columns:
        table.add_column(
            name,
            justify="right" if side == "right" else "left",
            no_wrap=side != "fold",
            overflow="fold",
            min_width=min(len(name), 7) if side == "fold" else None,
        )
    return table


def _alpha(result: Result) -> RenderableType:
    sides = ("left", "right", "right", "right", "fold")
    table = table_of(*zip(COLUMNS, sides, strict=True))
    for name, *cells, note in alpha_rows(result["alpha"]):
        table.add_row(Text(name), *cells, Text(note))
    lines = [_strongest(result.get("correlation") or {}), _correlations(result)]
    return Group(table, *(Text(line) for line in lines if line))


def _strongest(correlation: Mapping[str, Any]) -> str:
    """A line about the most correlated pair of estimates, if it is strongly correlated."""
    names, matrix = correlation.get("names") or [], correlation.get("matrix") or []
    pairs = [
        (abs(matrix[i][j]), i, j)
        for i in range(len(names))
        for j in range(i)
        if matrix[i][j] is not None
    ]
    if not pairs or max(pairs)[0] < 0.9:
        return ""
    _, i, j = max(pairs)
    return f"Correlation of the estimates of {names[j]} and {names[i]}: {matrix[i][j]:.3f}"


def _correlations(result: Result) -> str:
    """A line about the correlations of the parameters, beside the partial ones of alpha."""
    entries = []
    for entry in result.get("parameter_correlations") or []:
        estimate, error = with_error(entry["estimate"], entry["standard_error"], estimate=True)
        known = "" if entry["standard_error"] is None else f" +- {error}"
        entries.append(f"{' and '.join(entry['between'])} {estimate}{known}")
    return f"Correlation of the parameters: {', '.join(entries)}" if entries else ""


def _log_likelihood(result: Result) -> RenderableType:
    found = result["log_likelihood"]
    table = table_of(("log-likelihood", "left"), ("", "right"), ("", "fold"))
    table.add_row("estimated", to_three(found.get("estimated")), "by the densities at alpha")
    if found.get("verified") is not None:
        error = found.get("verified_standard_error")
        table.add_row(
            "verified",
            to_three(found["verified"]),
            f"+- {number(error, 2)}, Monte Carlo on the simulator",
        )
    if part := found.get("reached"):
        table.add_row(
            "verified in part",
            to_three(part["verified"]),
            f"+- {number(part['standard_error'], 2)}, Monte Carlo on the simulator of the "
            f"{part['experiments']} experiments that it reaches; their densities say "
            f"{to_three(part['estimated'])}",
        )
    baselines = result.get("baselines") or {}
    fit, linear = baselines.get("least_squares"), baselines.get("circe")
    if fit:
        where = ", ".join(f"{k} {number(v)}" for k, v in fit.get("parameters", {}).items())
        table.add_row(
            "least squares",
            to_three(fit.get("log_likelihood")),
            Text(f"one value for all: {where}; rmse {number(fit.get('rmse'))}"),
        )
    if linear:
        where = ", ".join(f"{k} {number(v)}" for k, v in linear.get("alpha", {}).items())
        table.add_row(
            "linear-Gaussian",
            to_three(linear.get("log_likelihood")),
            Text(
                "another model (CIRCE): simulator linearized, law normal; a start for the search, "
                f"not to be compared with the lines above: {where}"
            ),
        )
    return table


def _densities(result: Result) -> RenderableType | None:
    rows = result.get("density_distances")
    if not rows:
        return None
    table = table_of(
        ("moment density", "left"), ("log-likelihood", "right"), ("EMD", "right"), ("", "fold")
    )
    for row in rows:
        failed = row["failed"]
        table.add_row(
            row["density"],
            f"{row['log_likelihood']:+.3f}",
            f"{row['mean']:.2g}",
            f"no solution for {failed} experiments, a stand-in there" if failed else "",
        )
    head = "Against the exact density of the outcome; distances in standard deviations:"
    return Group(Text(head), table)


def _worst(result: Result) -> RenderableType | None:
    def surprise(experiment: Mapping[str, Any]) -> tuple[bool, float, float]:
        pit, log_density = experiment.get("pit"), experiment.get("log_density")
        solved = experiment.get("status") == "solved" and pit is not None
        tail = min(pit, 1.0 - pit) if pit is not None else 0.0
        return solved, tail, log_density if log_density is not None else -math.inf

    worst = sorted(result["experiments"], key=surprise)[:WORST]
    if not worst:
        return None
    table = table_of(
        ("explained worst", "left"),
        ("outcome", "right"),
        ("median", "right"),
        ("95 % range", "right"),
        ("P(below)", "right"),
        ("density", "fold"),
    )
    for experiment in worst:
        quantiles = experiment.get("quantiles") or {}
        low, high = number(quantiles.get("0.025")), number(quantiles.get("0.975"))
        table.add_row(
            Text(f"experiment {experiment['id']}"),
            number(experiment["outcome"]),
            number(quantiles.get("0.5")),
            f"{low} .. {high}",
            number(experiment.get("pit"), 3),
            _words(experiment.get("status")),
        )
    return table


def _effort(result: Result) -> RenderableType:
    table = Table(box=None, pad_edge=False, show_header=False, show_edge=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for name, text in _efforts(result):
        table.add_row(name, Text(text))
    return table


def _efforts(result: Result) -> Iterator[tuple[str, str]]:
    search, surface = result.get("search"), result.get("surface")
    simulator = result.get("simulator") or {}
    if simulator.get("notes"):
        yield "simulator", "\n".join([str(simulator.get("name", "")), *simulator["notes"]])
    if search:
        optima = [
            f"{to_three(found.get('log_likelihood'))} ({_count(found.get('starts', 0), 'start')})"
            for found in search.get("optima", [])[:4]
        ]
        text = f"{_words(search.get('method'))}, " if search.get("method") else ""
        text += f"{search.get('evaluations', NONE)} evaluations"
        distinct = search.get("distinct_optima", len(optima))
        text += f", {distinct} distinct optim{'um' if distinct == 1 else 'a'}"
        yield "search", f"{text}: {', '.join(optima)}" if optima else text
    if surface:
        yield "surface", _surface(surface, len(result["experiments"]))
    if "runs" in result:
        yield "runs", _by_stage(result["runs"], result.get("runs_by_stage") or {}, "{:,.0f}")
    seconds = dict(result.get("seconds") or {})
    if seconds:
        total = seconds.pop("total", sum(seconds.values()))
        yield "seconds", _by_stage(total, seconds, "{:.1f}")


def _surface(surface: Mapping[str, Any], experiments: int) -> str:
    converged, total = surface.get("converged"), surface.get("experiments", experiments)
    parts = [] if converged is None else [f"{int(converged)} of {total} converged"]
    parts += [
        f"{key.replace('_', ' ')} {100 * surface[key]:.2g} %"
        for key in ("median_error", "worst_error")
        if surface.get(key) is not None
    ]
    return ", ".join(parts) + f" of the outcome's scatter {surface.get('where', 'on the box')}"


def _by_stage(total: float, stages: Mapping[str, float], form: str) -> str:
    parts = [
        f"{stage} {form.format(value)}"
        for stage, value in stages.items()
        if form.format(value) not in ("0", "0.0")
    ]
    return form.format(total) + (f": {', '.join(parts)}" if parts else "")


def _warnings(result: Result) -> Iterator[RenderableType]:
    for warning in result.get("warnings") or []:
        text = Text()
        text.append(f"Warning, {warning.get('about', '')}: ", style="bold yellow")
        text.append(str(warning.get("message", "")))
        if warning.get("remedy"):
            text.append(f"\n  Remedy: {warning['remedy']}")
        yield text


def _verdict(result: Result, files: Sequence[str]) -> RenderableType | None:
    text = Text()
    if "accepted" in result:
        text.append(verdict(result))
        style = "bold green" if result["accepted"] else "bold red"
        text.stylize(style, 0, text.plain.index(":"))
    for file in files:
        text.append(f"\nWritten: {file}" if text.plain else f"Written: {file}")
    return text if text.plain else None
