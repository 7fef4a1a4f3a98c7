"""The report of an identification, made from its document, for the terminal and for report.html.

The sections are the same in both. report.html has charts and further tables too.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import RenderableType

from aleator.errors import count
from aleator.results.answer import (
    answer,
    conditional_rows,
    estimates,
    has_one_law,
    is_individual,
    log_likelihood,
    quantities,
    verdicts,
    warnings,
    words,
)
from aleator.results.findings import NOISE
from aleator.results.printed import (
    AMOUNTS,
    DETAILS,
    NONE,
    PAGE,
    THRESHOLDS,
    WHOLE,
    Amounts,
    Chapter,
    Column,
    Content,
    Part,
    Sentence,
    TextTable,
    Thresholds,
    heads,
    number,
    outside,
    percent,
    to_three,
    with_error,
)
from aleator.results.units import label, transforms, unit_of, with_unit
from aleator.views import law_charts, outcome_charts
from aleator.views.chart import Series, numbers
from aleator.views.computation import effort, missing, named_values, origin
from aleator.views.measured import AxisChoice, MeasuredValues, conditions_of, measured, varying
from aleator.views.opening import opening_charts, opening_laws
from aleator.views.outcome_charts import Individuals
from aleator.views.terminal import terminal

Document = Mapping[str, Any]
SCATTER = "the outcome's scatter"


@dataclass(frozen=True, eq=False)
class Drawn:
    """The data of the charts in report.html, the content of ceiling.json, and the study file."""

    measured: Sequence[MeasuredValues]
    sources: Sequence[Series]
    individuals: Individuals | None
    ceiling: Document | None
    study: str | None


def render(document: Document, files: Sequence[str] = (), details: bool = False) -> RenderableType:
    """The report of an identification for a terminal, with the names of the `files` at its end.

    With `details` the report also has the effect of other densities, all tests of consistency, all
    optima, and runs and seconds by stage. Parts that the document lacks are left out.
    """
    return terminal(_content(document, None), files, DETAILS if details else WHOLE)


def identification(
    document: Document, ceiling: Document | None = None, study: str | None = None
) -> tuple[Content, dict[str, Sequence[AxisChoice]]]:
    """The content of report.html, and the quantities that a reader can choose for the x axis.

    The choices are by the name of each series of data. `ceiling` is the content of ceiling.json,
    and `study` the text of the study file; each is None if it does not exist.
    """
    seen = measured(document)
    sources = [one.thinned().series(place) for place, one in enumerate(seen)]
    individuals = outcome_charts.individuals_of(document)
    choices: dict[str, Sequence[AxisChoice]] = {
        source.name: one.choices for source, one in zip(sources, seen, strict=True)
    }
    if individuals is not None:
        choices[individuals.series.name] = individuals.choices
    return _content(document, Drawn(seen, sources, individuals, ceiling, study)), choices


def _content(document: Document, drawn: Drawn | None) -> Content:
    """The content of the report: its sections, with charts only if `drawn` has their data."""
    short = answer(document)
    name = varying(document)
    sections = {
        ("law", "The law of the parameters"): _law(document, drawn),
        ("estimates", "Estimates"): _estimates(document, drawn),
        ("likelihoods", "Log-likelihoods"): _likelihoods(document),
        ("predicted", "Measured against predicted"): _predicted(document, drawn),
        ("calibration", "Calibration and tests"): _calibration(document, drawn),
        ("series", f"Observations over {name}"): _series(drawn, name),
        ("individuals", "Parameters of single experiments"): _individuals(document, drawn),
        ("surfaces", "The simulator"): _simulator(document, drawn),
        ("effort", "Runs and cost"): effort(document),
        ("experiments", "Experiments"): _experiments(document, drawn),
        ("origin", "How this was computed"): origin(document, drawn.study) if drawn else (),
    }
    made = [Chapter(*names, list(parts)) for names, parts in sections.items()]
    title = short.title or "Identification"
    opening = [*short.opening]
    if drawn is not None:
        pairs = [*zip(drawn.measured, drawn.sources, strict=True)]
        opening += opening_charts(document, pairs, drawn.individuals, drawn.ceiling)
    return Content(
        title, short.lead, [section for section in made if section.parts], warnings(document),
        verdicts(document), opening,
    )  # fmt: skip


# ------------------------------------------------------------------------------------ the law


def _law(document: Document, drawn: Drawn | None) -> Iterator[Part]:
    if drawn is None:
        return
    curves = law_charts.law_curves(document)
    if not curves:
        yield missing(
            "The densities are not in this document.",
            "Identify again with this version: aleator identify writes them.",
        )
    for name in [*curves][len(opening_laws(document)) :]:
        yield law_charts.law_chart(document, name, drawn.individuals, drawn.ceiling)
    for pair in (document.get("pictures") or {}).get("contours") or ():
        yield law_charts.joint_chart(document, pair, drawn.individuals)
    if drawn.ceiling is None:
        if has_one_law(document):
            yield missing(
                "Where the best of all laws has its mass is not known here.",
                "aleator ceiling STUDY.toml with the same --output finds it for aleator report.",
            )
        return
    best = {**drawn.ceiling.get("log_likelihood", {}), **(drawn.ceiling.get("bootstrap") or {})}
    if "gap" in best:
        yield Sentence(f"A law of any family would have {_gap(best)}.", depth=PAGE)


def _gap(best: Document) -> str:
    """A text on the log-likelihood that the best possible law gains, and whether by chance only."""
    gap = f"at most {number(best['gap'], 3)} more log-likelihood"
    if best.get("p_value") is None:
        return gap
    p = number(best["p_value"], 2)
    return f"{gap}; if this law is the true one, chance makes as much with p = {p}"


# ------------------------------------------------------------------------------------ estimates


def _estimates(document: Document, drawn: Drawn | None) -> Iterator[Part]:
    yield estimates(document)
    yield quantities(document)
    if cut := [name for name, entry in document["alpha"].items() if entry.get("cut")]:
        yield Sentence(
            f"The {'intervals' if len(cut) > 1 else 'interval'} of {', '.join(cut)} would go on "
            "beyond a limit: where that limit is not physical, widen it (box, or lower and upper) "
            "and identify again.",
            depth=WHOLE,
        )
    yield from factor_effects(document)
    yield log_likelihood(document)
    if known := document.get("criteria"):
        names = {"AIC": "aic", "AICc": "aicc", "BIC": "bic"}
        each = ", ".join(f"{head} {to_three(known[key])}" for head, key in names.items())
        free = count(known["free"], "free hyperparameter")
        yield Sentence(f"{each} ({free}; smaller is better)", depth=WHOLE)
    yield from _correlations(document)
    if drawn is None:
        return
    profiles = (document.get("pictures") or {}).get("profiles") or {}
    if not profiles:
        yield missing(
            "There are no profiles of the likelihood in this document.",
            "They are left out where the maximum has no curvature, and of more than 3,000 "
            "observations.",
        )
    for name in profiles:
        yield law_charts.profile_chart(document, name)
    if chart := law_charts.surface_chart(document):
        yield chart


def factor_effects(document: Document) -> Iterator[Part]:
    """A sentence on each factor: its largest difference between levels, and whether all differ."""
    for entry in document.get("factors") or ():
        name = entry["hyperparameter"]
        unit = unit_of(document, name.partition(".")[0])
        ends = " to ".join(number(end, 3) for end in entry["interval"])
        together = f", for all {entry['pairs']} differences together" if entry["pairs"] > 1 else ""
        yield Sentence(
            f"{name} by {entry['factor']}: largest difference {' - '.join(entry['between'])} = "
            f"{number(entry['difference'], 3)} (95 %: {ends}{together}){f' {unit}' if unit else ''}"
            f"; all levels equal: p = {number(entry['p'], 2)} (Wald)",
            depth=WHOLE,
        )


def _correlations(document: Document, thresholds: Thresholds = THRESHOLDS) -> Iterator[Part]:
    """The strongest correlation between two estimates, and the correlations of parameters."""
    correlation = document.get("correlation") or {}
    names, matrix = correlation.get("names") or [], correlation.get("matrix") or []
    pairs = [
        (abs(matrix[i][j]), i, j)
        for i in range(len(names))
        for j in range(i)
        if matrix[i][j] is not None
    ]
    if pairs and max(pairs)[0] >= thresholds.strong:
        _, i, j = max(pairs)
        yield Sentence(
            f"Correlation of the estimates of {names[j]} and {names[i]}: {matrix[i][j]:.3f}",
            depth=WHOLE,
        )
    for entry in document.get("parameter_correlations") or ():
        value, error = with_error(entry["estimate"], entry["standard_error"], estimate=True)
        known = "" if entry["standard_error"] is None else f" +- {error}"
        between = " and ".join(entry["between"])
        yield Sentence(f"Correlation of the parameters {between}: {value}{known}", depth=WHOLE)
    if pairs:
        title = "Correlations of the estimates"
        rows = [
            (name, *(number(v, 2) for v in row)) for name, row in zip(names, matrix, strict=True)
        ]
        heads: list[Column] = [("", "left"), *((name, "right") for name in names)]
        yield TextTable(heads, rows, "correlations", title, DETAILS, folded=True)


def _likelihoods(document: Document) -> Iterator[Part]:
    """Log-likelihoods of simpler models, and the effect of densities made of moments."""
    rows = [*_other_likelihoods(document)]
    columns = heads("log-likelihood of", ">", "~what it is")
    yield TextTable(columns, rows, "likelihoods", "Log-likelihoods of simpler models", WHOLE)
    if distances := document.get("density_distances"):
        yield Sentence(
            "Densities made of moments, beside the exact density of the outcome: what they change "
            "of the log-likelihood, and the earth mover's distance in standard deviations of the "
            "outcome.",
            depth=DETAILS,
        )
        columns = heads("moment density", ">log-likelihood", ">distance", "~note")
        cells = [
            (row["density"], f"{row['log_likelihood']:+.3f}", f"{row['mean']:.2g}",
             f"no solution for {count(row['failed'], 'experiment')}" if row["failed"] else "")
            for row in distances
        ]  # fmt: skip
        yield TextTable(
            columns, cells, "densities", "Densities made of moments", DETAILS, folded=True
        )


def _other_likelihoods(document: Document) -> Iterator[tuple[str, str, str]]:
    if nodes := document.get("quadrature"):
        gap = NONE if nodes["gap"] is None else f"{nodes['gap']:+.3f}"
        yield "more nodes", gap, "is what half as many nodes again change"
    if best := document.get("best_possible"):
        yield (
            "best possible law",
            to_three(best["log_likelihood"]),
            f"of any family: {_gap(best)} by {best['replicates']:.0f} data sets (more by aleator "
            "ceiling)",
        )
    baselines = document.get("baselines") or {}
    if fit := baselines.get("least_squares"):
        noise = [e.get("fixed") for name, e in document["alpha"].items() if NOISE.match(name)]
        other = (
            (
                ". The noise of the answer is known, this one is fitted: do not compare the two "
                "log-likelihoods"
            )
            if noise and all(noise)
            else ""
        )
        yield (
            "least squares",
            to_three(fit.get("log_likelihood")),
            f"one value for all: {named_values(fit.get('parameters', {}))}, with normal noise of a "
            f"fitted sd (rmse) of {number(fit.get('rmse'))}{other}",
        )
    if linear := baselines.get("circe"):
        yield (
            "linear-Gaussian",
            to_three(linear.get("log_likelihood")),
            f"simulator linearized, law normal (the model of CIRCE): "
            f"{named_values(linear.get('alpha', {}))}. This is another model: do not compare its "
            "log-likelihood with that of the answer",
        )


# ------------------------------------------------------------------------------------ outcomes


def _predicted(document: Document, drawn: Drawn | None) -> Iterator[Part]:
    yield from _worst_observed(document) if is_individual(document) else _worst(document)
    if drawn is None:
        pit = [p for seen in measured(document) for p in seen.exact_probabilities]
        ids = [entry["id"] for entry in document.get("observations") or ()]
        given = "given the earlier observations of their experiments, "
        if pit:
            said = f"Outside their 95 %, {given if len({*ids}) < len(ids) else ''}{outside(pit)}"
            yield Sentence(said, depth=WHOLE)
        return
    for seen, source in zip(drawn.measured, drawn.sources, strict=True):
        if not seen.by_law:
            yield missing(
                f"Predictions of {seen.response} by the law are not in this document.",
                "Identify again with this version: aleator identify writes them.",
            )
            continue
        yield outcome_charts.predicted_chart(seen, source)


def _worst(document: Document, amounts: Amounts = AMOUNTS) -> Iterator[Part]:
    """A table of the experiments that are least probable under the law."""

    def surprise(entry: Document) -> tuple[bool, float, float]:
        pit, log_density = entry.get("pit"), entry.get("log_density")
        if entry.get("status") != "solved" or pit is None:
            return False, 0.0, -math.inf if log_density is None else log_density
        return True, min(pit, 1.0 - pit), -math.inf if log_density is None else log_density

    log = document.get("transform") == "log"
    rows = []
    for entry in sorted(document["experiments"], key=surprise)[: amounts.worst]:
        cells = _outcome(entry, log)
        ends = f"{cells['95 % from']} .. {cells['to']}"
        known = (cells[name] for name in ("measured", "predicted median"))
        row = (*known, ends, cells["P(below)"], cells["density"])
        rows.append((f"experiment {entry['id']}", *row))
    unit = unit_of(document, str(document.get("outcome")))
    columns: Sequence[Column] = (
        ("least expected", "left"), (with_unit("outcome", unit), "right"), ("median", "right"),
        ("95 % range", "right"), ("P(below)", "right"), ("density", "fold"),
    )  # fmt: skip
    yield TextTable(columns, rows, "worst", "Least expected", WHOLE)


def _worst_observed(document: Document, amounts: Amounts = AMOUNTS) -> Iterator[Part]:
    """A table of the observations with the largest residuals, in units of the error's scale.

    The value beside each is fitted, with the parameters of its experiment; without noise it is the
    prediction by the law.
    """
    seen = [entry for entry in document["observations"] if entry["residual"] is not None]
    worst = sorted(seen, key=lambda entry: -abs(entry["residual"]))[: amounts.worst]
    responses = transforms(document)
    logs = [name for name, transform in responses.items() if transform == "log"]
    unit = unit_of(document, next(iter(responses))) if len(responses) == 1 and not logs else None
    value, title = (
        ("fitted", "Farthest from their fitted values")
        if document.get("quadrature")
        else ("predicted", "Farthest from their predictions")
    )
    columns: Sequence[Column] = (
        ("observation", "left"), (with_unit("measured", unit), "right"),
        (value, "right"), ("error scale", "right"), ("off by", "right"),
    )  # fmt: skip
    rows = [
        (place(entry, len(responses) > 1), bounds(entry), number(entry["predicted"]),
         number(entry["scale"], 3), f"{entry['residual']:+.2f}")
        for entry in worst
    ]  # fmt: skip
    yield TextTable(columns, rows, "worst", title, WHOLE)
    if logs:
        yield Sentence(f"Of {', '.join(logs)} the logarithms.", depth=WHOLE)


def place(entry: Document, several: bool) -> str:
    """The name of an observation: its experiment, its response if `several`, its conditions.

    >>> place({"id": "308", "response": "y", "conditions": {"days": 3.0}}, False)
    'experiment 308, days 3'
    """
    parts = [f"experiment {entry['id']}", *([str(entry["response"])] if several else [])]
    parts += [f"{name} {_cell(value)}" for name, value in entry["conditions"].items()]
    return ", ".join(parts)


def bounds(entry: Document) -> str:
    """The text of a measured value, or of its bounds if it is censored.

    >>> bounds({"lower": 1.0, "upper": None}), bounds({"lower": 2.0, "upper": 2.0})
    ('> 1', '2')
    """
    low, high = entry["lower"], entry["upper"]
    if low == high:
        return number(low)
    if high is None:
        return f"> {number(low)}"
    return f"< {number(high)}" if low is None else f"{number(low)} .. {number(high)}"


def _calibration(document: Document, drawn: Drawn | None) -> Iterator[Part]:
    if drawn is not None:
        pit, ids = outcome_charts.probabilities(drawn.measured)
        if pit.size:
            yield outcome_charts.histogram_chart(pit)
            yield outcome_charts.cumulative_chart(pit, ids)
        else:
            yield missing("No probability is known.", "The warnings say why.")
    tests = (document.get("consistency") or {}).get("tests") or ()
    columns = heads("test", "of", ">z", ">p", ">of all", "~where")
    rows = [
        (row["kind"], row["of"], NONE if row["z"] is None else f"{row['z']:.1f}",
         number(row["p"], 2), number(row["corrected"], 2), row["where"] or row["column"] or "")
        for row in sorted(tests, key=lambda row: float(numbers([row["p"]])[0]))
    ]  # fmt: skip
    title = f"All {len(rows)} tests of consistency, the one that says most first"
    yield TextTable(columns, rows, "tests", title, DETAILS, folded=True)


def _series(drawn: Drawn | None, name: str | None) -> Iterator[Part]:
    for place, seen in enumerate(drawn.measured if drawn and name else ()):
        yield from outcome_charts.series_charts(seen, str(name), place)


# ------------------------------------------------------------------------------------ individuals


def _individuals(document: Document, drawn: Drawn | None) -> Iterator[Part]:
    if not is_individual(document):
        return
    yield from shrinkage(document)
    if drawn is not None and drawn.individuals is not None:
        yield from outcome_charts.individual_charts(document, drawn.individuals)
    relations = (document.get("consistency") or {}).get("relations")
    if not relations:
        return
    yield Sentence(
        "Individual means against the columns of the table and each other. p tells how often a "
        "right model, shrinkage included, has a correlation as strong; one of many is small by "
        "chance.",
        depth=DETAILS,
    )
    columns = heads("individual", "against", ">correlation", ">p", ">shrinkage")
    rows = [
        (row["parameter"], row["other"], f"{row['correlation']:+.2f}", number(row["p"], 2),
         percent(document["shrinkage"][row["parameter"]]))
        for row in sorted(relations, key=lambda row: row["p"])
    ]  # fmt: skip
    yield TextTable(
        columns, rows, "relations", "Individual means and columns", DETAILS, folded=True
    )


def shrinkage(document: Document) -> Iterator[Part]:
    """A table of the parameters of single experiments: shrinkage, range and scatter of each."""
    experiments = document["experiments"]
    rows = []
    for name, share in document["shrinkage"].items():
        means, sds = (numbers(e[key].get(name) for e in experiments) for key in ("mean", "sd"))
        means, sds = means[np.isfinite(means)], sds[np.isfinite(sds)]
        if means.size and sds.size:
            ends = f"{number(means.min())} .. {number(means.max())}"
            scatter = number(means.std(), 3), number(sds.mean(), 3)
            rows.append((label(document, name), percent(share), ends, *scatter))
    if not rows:
        return
    yield Sentence(
        "Parameters of the experiments. Shrinkage: 0 % where the observations of an experiment "
        "alone say what its own parameter is, 100 % where only the law does.",
        depth=WHOLE,
    )
    columns = heads(
        "individual", ">shrinkage", ">means from .. to", ">sd of the means", ">their own sd"
    )
    yield TextTable(columns, rows, "shrinkage", "Parameters of the experiments", WHOLE)
    every = [entry.get("components") or {} for entry in experiments]
    for name in every[0]:
        most = Counter(1 + max(range(len(p[name])), key=lambda c: p[name][c] or 0.0) for p in every)
        said = ", ".join(f"{component} of {size}" for component, size in sorted(most.items()))
        head = label(document, name)
        yield Sentence(f"{head}: the most probable component is {said} experiments.", depth=WHOLE)


# ------------------------------------------------------------------------------------ the simulator


def _simulator(
    document: Document, drawn: Drawn | None, amounts: Amounts = AMOUNTS
) -> Iterator[Part]:
    """The section on the simulator: response surfaces, charts over parameters, failed runs."""
    simulator = document.get("simulator") or {}
    for note in simulator.get("notes") or ():
        yield Sentence(str(note), head=str(simulator.get("name", "simulator")), depth=WHOLE)
    surface, experiments = document.get("surface"), len(document["experiments"])
    if surface:
        done = surface.get("converged") == surface.get("experiments", experiments)
        yield Sentence(_surfaces(surface, experiments), depth=DETAILS if done else WHOLE)
    elif drawn is not None:
        collocated = str(document.get("propagation", "")).startswith("collocation")
        yield Sentence(
            "No surface stands for the simulator: it was run at the nodes of each law that was "
            "tried."
            if collocated
            else "The simulator is fast: no surface stands for it.",
            depth=PAGE,
        )
    if drawn is None:
        return
    for seen, source in zip(drawn.measured, drawn.sources, strict=True):
        against = (surface or {}).get("against", SCATTER)
        if surface and (chart := outcome_charts.roughness_chart(seen, source, against)):
            yield chart
    yield from law_charts.simulator_charts(document)
    if not (failures := document.get("failures")):
        yield Sentence("No run failed.", depth=PAGE)
        return
    ids = list(failures["experiments"])
    more = f" and {len(ids) - amounts.failed:,} more" if len(ids) > amounts.failed else ""
    yield Sentence(
        f"{failures['runs']:,} of {failures['needed']:,} runs had no outcome, in the experiments "
        f"{', '.join(ids[: amounts.failed])}{more}. Most often: {failures['message']}",
        depth=PAGE,
    )
    columns = heads("parameter", ">from", ">to")
    rows = [(name, *map(number, ends)) for name, ends in failures["region"].items()]
    yield TextTable(columns, rows, "failures", "Where runs failed", PAGE)


def _surfaces(surface: Document, experiments: int) -> str:
    if surface.get("estimates_error") is not None:
        every = ("estimates_error", "intervals_error", "log_likelihood_error")
        alpha, ends, whole = (to_three(surface.get(error)) for error in every)
        more = f" It began with {count(n, 'stored run')}." if (n := surface.get("stored")) else ""
        more += f" {count(n, 'run')} gave derivatives." if (n := surface.get("slopes")) else ""
        by = f"{alpha} standard errors, ends of intervals by {ends}, log L by {whole}"
        return f"The emulator moves the estimates by {by}.{more}"
    converged, total = surface.get("converged"), surface.get("experiments", experiments)
    parts = [] if converged is None else [f"{int(converged)} of {total} surfaces converged"]
    known = [key for key in ("median_error", "worst_error") if surface.get(key) is not None]
    parts += [f"{key.replace('_', ' ')} {100 * surface[key]:.2g} %" for key in known]
    against = surface.get("against", SCATTER)
    return f"{', '.join(parts)} of {against}, {surface.get('where', 'on the box')}."


# ------------------------------------------------------------------------------------ experiments


def _experiments(
    document: Document, drawn: Drawn | None, amounts: Amounts = AMOUNTS
) -> Iterator[Part]:
    """A table with a row for each experiment, or if they are very many, for the least probable."""
    if drawn is None:
        return
    entries = document["experiments"]
    kept = list(range(len(entries)))
    if len(entries) > amounts.experiments:
        likely = numbers([entry.get("log_density") for entry in entries])
        kept = sorted(np.argsort(likely, kind="stable")[: amounts.experiments].tolist())
    conditions = list(conditions_of(document).items())[: amounts.conditions]
    log = document.get("transform") == "log"
    rows = []
    for k in kept:
        entry = entries[k]
        own = _individual(entry) if is_individual(document) else _outcome(entry, log)
        at = {name: _cell(column[k], 6) for name, column in conditions}
        rows.append({"experiment": str(entry["id"])} | at | own)
    names = list(rows[0]) if rows else ["experiment"]
    columns: list[Column] = [
        (_head(document, name), "left" if name in ("experiment", "density") else "right")
        for name in names
    ]
    few = f", of which these {len(kept):,} are the least expected"
    title = f"{count(len(entries), 'experiment')}{few if len(kept) < len(entries) else ''}"
    told = ", ".join(label(document, name) for name in transforms(document) if name) or "outcome"
    yield Sentence(f"Measured: {told}.{conditional_rows(document)}", depth=PAGE)
    cells = [list(row.values()) for row in rows]
    yield TextTable(columns, cells, "experiments", title, PAGE, folded=True)


def _head(document: Document, name: str) -> str:
    """The head of a column of the table of experiments, with its unit."""
    if name in ("measured", "predicted median"):
        return with_unit(name, unit_of(document, str(document.get("outcome"))))
    of, comma, sd = name.partition(", ")
    return label(document, of) + comma + sd


def _outcome(entry: Document, log: bool) -> dict[str, str]:
    """The table cells of an experiment with one outcome: measured and predicted, in its unit.

    With `log` the document has logarithms, which are converted back.
    """
    quantiles = entry.get("quantiles") or {}

    def shown(value: float | None) -> str:
        return number(exponential(value) if log and value is not None else value)

    return {
        "measured": shown(entry["outcome"]),
        "predicted median": shown(quantiles.get("0.5")),
        "95 % from": shown(quantiles.get("0.025")),
        "to": shown(quantiles.get("0.975")),
        "P(below)": number(entry.get("pit"), 3),
        "log-density": number(entry.get("log_density")),
        "density": words(entry.get("status")),
    }


def _individual(entry: Document) -> dict[str, str]:
    parameters = {
        f"{name}{kind}": number(entry[key][name])
        for name in entry["mean"]
        for key, kind in (("mean", ""), ("sd", ", sd"))
    }
    components = {
        f"{name}.{c} probability": number(share, 3)
        for name, each in (entry.get("components") or {}).items()
        for c, share in enumerate(each, start=1)
    }
    known = {
        "observations": str(entry["observations"]),
        "log-density": number(entry["log_density"]),
    }
    return known | parameters | components


def exponential(value: float) -> float:
    """The outcome whose logarithm is `value`; infinity if it is too large for a number."""
    with np.errstate(over="ignore"):
        return float(np.exp(value))


def _cell(value: Any, digits: int = 4) -> str:
    return number(value, digits) if isinstance(value, int | float) else str(value or NONE)
