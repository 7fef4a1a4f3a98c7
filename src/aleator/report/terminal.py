"""An identification as a report to read on a terminal, at 80 columns, with or without color."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from aleator.report import consistency, individual
from aleator.report.decisions import beyond
from aleator.report.rows import Rows, written
from aleator.results.printed import (
    COLUMNS,
    NONE,
    Column,
    alpha_rows,
    by_name,
    number,
    outside,
    principle,
    remedies,
    second_verdict,
    stated_error,
    to_three,
    verdict,
    with_error,
)
from aleator.results.units import unit_of, with_unit

Result = Mapping[str, Any]
WORST = 3
PREDICTED: Sequence[Column] = (
    ("id", "left"), ("mean", "right"), ("sd", "right"), ("median", "right"),
    ("50 % range", "right"), ("95 % range", "right"), ("beyond", "right"), ("density", "fold"),
)  # fmt: skip


def render(result: Result, files: Sequence[str] = (), details: bool = False) -> RenderableType:
    """The report of a result document (see `Identification.to_dict`); `files` are named at its end.

    It has what helps to decide; `details` are the rest: what other densities would change, surfaces
    that converged, and where the seconds went. Keys that the document lacks are left out.
    """
    parts = [
        _opening(result),
        _alpha(result),
        _log_likelihood(result),
        _densities(result) if details else None,
        individual.shrinkage(result) if individual.is_individual(result) else None,
        individual.relations(result) if details else None,
        _worst(result),
        _effort(result, details),
        *_warnings(result),
        consistency.tests(result) if details else None,
        _verdict(result, files),
    ]
    return Group(*(line for part in parts if part is not None for line in (part, Text())))


def render_predictions(
    columns: Mapping[Any, Sequence[Any]], outcome: str, transform: str = "none"
) -> RenderableType:
    """A table of predictions from its columns, one row a condition; `outcome` says of what.

    Of a logarithm it shows the median and the ranges in the unit of the outcome.
    """
    log = transform == "log"
    back = exponential if log else float
    heads = {"mean": "mean of log", "sd": "sd of log"} if log else {}
    far = any(value > 0.0 for value in columns.get("beyond", ()))
    table: Sequence[Column] = [
        (heads.get(name, name), side) for name, side in PREDICTED if far or name != "beyond"
    ]
    rows = []
    for values in zip(*columns.values(), strict=True):
        row = dict(zip(columns, values, strict=True))
        rows.append(
            (
                str(row["id"]),
                number(row["mean"]),
                number(row["standard_deviation"], 3),
                number(back(row["q0.5"])),
                f"{number(back(row['q0.25']))} .. {number(back(row['q0.75']))}",
                f"{number(back(row['q0.025']))} .. {number(back(row['q0.975']))}",
                *([beyond(row["beyond"])] if far else []),
                _words(row["status"]),
            )
        )
    return Group(Text(f"Predicted distribution of {outcome}", style="bold"), Rows(table, rows))


def exponential(value: float) -> float:
    """The outcome whose logarithm is `value`; infinite where that is too large for a number.

    >>> exponential(0.0), exponential(1e4)
    (1.0, inf)
    """
    return math.exp(value) if value < math.log(sys.float_info.max) else math.inf


def _opening(result: Result) -> RenderableType:
    alpha = result["alpha"]
    free = sum(not entry.get("fixed") for entry in alpha.values())
    search = result.get("search") or {}
    starts = f", best of {search['starts']} starts" if search.get("starts", 0) > 1 else ""
    way = (
        f" with {individual.opening(result)}"
        if individual.is_individual(result)
        else f" {principle(result)}: {result.get('density', NONE)}, propagation by "
        f"{_words(result.get('propagation'))}{_reason(result)}"
    )
    return Group(
        Text(result.get("title") or "Identification", style="bold"),
        Text(
            f"{_count(free, 'hyperparameter')} identified from "
            f"{_count(len(result['experiments']), 'experiment')}{way}{starts}, "
            f"seed {result.get('seed', NONE)}.{_logarithm(result)}"
        ),
    )


def _reason(result: Result) -> str:
    reason = result.get("propagation_reason")
    return f" ({reason})" if reason else ""


def _logarithm(result: Result) -> str:
    if result.get("transform") != "log" or individual.is_individual(result):
        return ""
    name = result["outcome"]
    return (
        f" The likelihood is that of log({name}); the outcomes, medians and ranges below are "
        f"{name} itself."
    )


def _count(number: int, what: str) -> str:
    return f"{number:,} {what}{'' if number == 1 else 's'}"


def _words(name: object) -> str:
    return str(name or NONE).replace("_", " ")


def _alpha(result: Result) -> RenderableType:
    lines = [_strongest(result.get("correlation") or {}), _correlations(result)]
    return Group(Rows(COLUMNS, [*alpha_rows(result)]), *(Text(line) for line in lines if line))


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
    return Rows((("log-likelihood", "left"), ("", "right"), ("", "fold")), [*_values(result)])


def _values(result: Result) -> Iterator[tuple[str, str, str]]:
    """The log-likelihoods of the answer and of simpler ones: name, value, what it is."""
    found = result["log_likelihood"]
    how = ", ".join(filter(None, (stated_error(found).strip(), by_name(result))))
    yield "estimated", to_three(found.get("estimated")), how
    yield from individual.likelihoods(result)
    if found.get("log_prior") is not None:
        what = "of alpha; the sum of both was maximized, and intervals are by its profile"
        yield "log prior", to_three(found["log_prior"]), what
    if found.get("verified") is not None:
        error = number(found.get("verified_standard_error"), 2)
        yield "verified", to_three(found["verified"]), f"+- {error}, a few runs of the simulator"
    if best := result.get("best_possible"):
        yield (
            "best possible law",
            to_three(best["log_likelihood"]),
            f"of any family: {number(best['gap'], 3)} more, which under this law has p = "
            f"{number(best['p_value'], 2)} by {best['replicates']:.0f} data sets (more by aleator "
            "ceiling)",
        )
    baselines = result.get("baselines") or {}
    fit, linear = baselines.get("least_squares"), baselines.get("circe")
    if fit:
        where = ", ".join(f"{k} {number(v)}" for k, v in fit.get("parameters", {}).items())
        yield (
            "least squares",
            to_three(fit.get("log_likelihood")),
            f"one value for all: {where}; rmse {number(fit.get('rmse'))}",
        )
    if linear:
        where = ", ".join(f"{k} {number(v)}" for k, v in linear.get("alpha", {}).items())
        yield (
            "linear-Gaussian",
            to_three(linear.get("log_likelihood")),
            f"simulator linearized, law normal (the model of CIRCE): {where}. This is another "
            "model: do not compare its log-likelihood with those above",
        )


def _densities(result: Result) -> RenderableType | None:
    rows = result.get("density_distances")
    if not rows:
        return None
    columns: Sequence[Column] = (
        ("moment density", "left"), ("log-likelihood", "right"), ("distance", "right"),
        ("", "fold"),
    )  # fmt: skip
    cells = [
        (
            row["density"],
            f"{row['log_likelihood']:+.3f}",
            f"{row['mean']:.2g}",
            f"no solution for {_count(row['failed'], 'experiment')}" if row["failed"] else "",
        )
        for row in rows
    ]
    head = (
        "Densities made of moments, beside the exact density of the outcome: what they change of "
        "the log-likelihood, and the earth mover's distance in standard deviations of the outcome."
    )
    return Group(Text(head), Rows(columns, cells))


def _worst(result: Result) -> RenderableType | None:
    if individual.is_individual(result):
        return individual.worst(result)

    def surprise(experiment: Mapping[str, Any]) -> tuple[bool, float, float]:
        pit, log_density = experiment.get("pit"), experiment.get("log_density")
        solved = experiment.get("status") == "solved" and pit is not None
        tail = min(pit, 1.0 - pit) if pit is not None else 0.0
        return solved, tail, log_density if log_density is not None else -math.inf

    unit = unit_of(result, str(result.get("outcome")))
    worst = sorted(result["experiments"], key=surprise)[:WORST]
    if not worst:
        return None
    columns: Sequence[Column] = (
        ("least expected", "left"), (with_unit("outcome", unit), "right"), ("median", "right"),
        ("95 % range", "right"), ("P(below)", "right"), ("density", "fold"),
    )  # fmt: skip
    log = result.get("transform") == "log"
    known = [e["pit"] for e in result["experiments"] if e.get("pit") is not None]
    note = [Text("Outside their 95 % " + outside(known))] if known else []
    return Group(Rows(columns, [_explained(experiment, log) for experiment in worst]), *note)


def _explained(experiment: Mapping[str, Any], log: bool) -> tuple[str, ...]:
    """A row in the unit of the outcome, which is the exponential of a `log`."""
    quantiles = experiment.get("quantiles") or {}

    def shown(value: float | None) -> str:
        return number(exponential(value) if log and value is not None else value)

    return (
        f"experiment {experiment['id']}",
        shown(experiment["outcome"]),
        shown(quantiles.get("0.5")),
        f"{shown(quantiles.get('0.025'))} .. {shown(quantiles.get('0.975'))}",
        number(experiment.get("pit"), 3),
        _words(experiment.get("status")),
    )


def _effort(result: Result, details: bool) -> RenderableType:
    return Rows((("", "left"), ("", "fold")), [*_efforts(result, details)])


def _efforts(result: Result, details: bool) -> Iterator[tuple[str, str]]:
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
    experiments = len(result["experiments"])
    done = surface and surface.get("converged") == surface.get("experiments", experiments)
    if surface and (details or not done):
        yield "surface", _surface(surface, experiments)
    if "runs" in result:
        yield "runs", _by_stage(result["runs"], result.get("runs_by_stage") or {}, "{:,.0f}")
    seconds = dict(result.get("seconds") or {})
    if seconds:
        total = seconds.pop("total", sum(seconds.values()))
        yield "seconds", _by_stage(total, seconds if details else {}, "{:.1f}")


def _surface(surface: Mapping[str, Any], experiments: int) -> str:
    converged, total = surface.get("converged"), surface.get("experiments", experiments)
    parts = [] if converged is None else [f"{int(converged)} of {total} converged"]
    parts += [
        f"{key.replace('_', ' ')} {100 * surface[key]:.2g} %"
        for key in ("median_error", "worst_error")
        if surface.get(key) is not None
    ]
    against = surface.get("against", "the outcome's scatter")
    return ", ".join(parts) + f" of {against} {surface.get('where', 'on the box')}"


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
    parts: list[Text] = []
    if "sound" in result:
        parts += [_headed(verdict(result), result["sound"])]
    if second := second_verdict(result):
        parts += [_headed(second, result["consistent"])]
        parts += [Text(line) for line in remedies(result)]
    return Group(*parts, *written(files)) if parts or files else None


def _headed(sentence: str, good: bool | None) -> Text:
    """A verdict whose first words have its color."""
    style = "bold yellow" if good is None else "bold green" if good else "bold red"
    text = Text(sentence)
    text.stylize(style, 0, sentence.index(":"))
    return text
