"""The reports of `aleator bootstrap`, `posterior` and `recover`, made from their JSON files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from aleator.errors import count
from aleator.inference.information import INTERVALS
from aleator.results.printed import (
    NONE,
    THRESHOLDS,
    Chapter,
    Content,
    Part,
    Sentence,
    TextTable,
    Thresholds,
    between,
    heads,
    number,
    percent,
    with_error,
)
from aleator.results.units import label

Document = Mapping[str, Any]


# ------------------------------------------------------------------------------------ bootstrap


def bootstrap(document: Document) -> Content:
    """The report of bootstrap.json: standard error, bias and interval of each hyperparameter."""
    arrived, size = document["statuses"].get("arrived", 0), document["replicates"]
    parametric = document["kind"] == "parametric"
    drawn = (
        "drawn under the identified law and noise"
        if parametric
        else "made of experiments drawn with replacement"
    )
    lead = (
        f"{size} data sets of {document['experiments']} experiments, {drawn}; {arrived} climbs "
        "arrived at a maximum."
    )
    rows, notes = [], []
    for name, row in document["hyperparameters"].items():
        scale, note = row["standard_error"], _bias(row)
        bias = NONE if row["bias"] is None else with_error(row["bias"], scale, estimate=True)[0]
        interval = between((row["bca_lower"], row["bca_upper"]), scale)
        shown = with_error(row["estimate"], scale, estimate=True)
        rows.append((label(document, name), *shown, bias, interval, note))
        notes += [f"{name} {note}"] if note else []
    if size > arrived:
        notes.append(f"{size - arrived} of {size} replicates did not arrive")
    columns = heads("hyperparameter", ">estimate", ">std. error", ">bias", ">95 % BCa", "~note")
    parts: list[Part] = [TextTable(columns, rows, "bootstrap", "Bootstrap")]
    if document["in_this_process"]:
        parts.append(Sentence("The simulator cannot travel to workers: one process did it all."))
    verdict = f"{'; '.join(notes) or 'No bias that matters, and no replicate on a limit'}."
    return Content.of(document.get("title") or "Bootstrap", lead, parts, verdict)


def _bias(row: Document, thresholds: Thresholds = THRESHOLDS) -> str:
    notes = []
    bias, error, scatter = row["bias"], row["bias_error"], row["standard_error"]
    if scatter and abs(bias) > max(thresholds.chance * error, thresholds.large * scatter):
        notes.append(f"biased by {bias / scatter:+.1f} standard errors")
    if row["at_limit"] and row["at_limit"] >= thresholds.piled:
        notes.append(f"on a limit in {number(100.0 * row['at_limit'], 2)} %")
    return ", ".join(notes)


# ------------------------------------------------------------------------------------ posterior


def posterior(document: Document) -> Content:
    """The report of posterior.json: mean, sd and interval of each hyperparameter, and warnings."""
    rows = []
    for name, row in document["hyperparameters"].items():
        error, ess = row["sd"], min(row["ess_bulk"], row["ess_tail"])
        mean, sd = with_error(row["mean"], error)
        rows.append((
            label(document, name), with_error(row["estimate"], error)[0], mean, sd,
            between((row["lower"], row["upper"]), error), f"{row['r_hat']:.3f}", number(ess, 3),
            "given" if name in document["priors"] else "flat",
        ))  # fmt: skip
    columns = heads(
        "hyperparameter", ">maximum", ">mean", ">sd", ">95 % interval", ">R-hat", ">ESS", "prior"
    )
    lead = (
        f"{count(document['chains'], 'chain')} of {count(document['draws'], 'draw')} from the "
        f"posterior of {count(len(rows), 'hyperparameter')} given "
        f"{count(document['experiments'], 'experiment')}, by "
        f"{count(document['evaluations'], 'evaluation')} of the likelihood, seed "
        f"{document['seed']}. "
        "The maximum is that of aleator identify; intervals hold the middle 95 % of the draws. "
        "Without a prior a hyperparameter is as likely anywhere between its limits."
    )
    return Content(
        document.get("title") or "Posterior", [Sentence(lead)],
        [Chapter("posterior", "Posterior", [TextTable(columns, rows, "posterior", "Posterior")])],
        [Sentence(warning, "warning", "Warning") for warning in document["warnings"]],
        [Sentence(document["verdict"], "good" if document["converged"] else "bad")],
    )  # fmt: skip


# ------------------------------------------------------------------------------------ recovery


MEANING = {
    "biased": "Biased: the estimates are off on average by more than three times the Monte Carlo "
    "error of that average. Below half of the scatter, a single estimate is off by chance more "
    "than by bias; above, correct it by the bias, or use more experiments. Standard deviations "
    "from few experiments come out too small.",
    "intervals too short": "Intervals too short: they hold the truth more rarely than in 95 % of "
    "all cases, and chance does not explain it. They rest on many experiments.",
}


def recovery(document: Document) -> Content:
    """The report of recovery.json: bias, scatter and coverage of each hyperparameter."""
    replicates = document["replicates"]
    converged = sum(replicate["converged"] for replicate in replicates)
    rows, verdicts = [], []
    for name, row in document["hyperparameters"].items():
        note = _unexplained(row, len(replicates))
        shown = with_error(row["bias"], row["bias_error"])
        rows.append((name, number(row["truth"]), number(row["mean"]), *shown,
                     number(row["scatter"], 2), percent(row["coverage"]), note))  # fmt: skip
        verdicts += [f"{name} {note}"] if note else []
    columns = heads(
        "hyperparameter", ">truth", ">mean", ">bias", ">+-", ">scatter", ">coverage", "~note"
    )
    parts: list[Part] = [TextTable(columns, rows, "recovery", "Recovery")]
    by_errors = [
        (name, percent(row["by_error"]), percent(row["by_sandwich"]))
        for name, row in document["hyperparameters"].items()
        if "by_error" in row
    ]
    if by_errors:
        parts.append(Sentence("Coverage of the estimate -+ 1.96 standard errors, or sandwich "
                              "errors, where it has one:"))  # fmt: skip
        columns = heads("hyperparameter", ">by error", ">by sandwich")
        parts.append(TextTable(columns, by_errors, "by-errors", "Coverage by errors"))
    parts += [
        Sentence(text) for word, text in MEANING.items() if any(word in row[-1] for row in rows)
    ]
    lead = (
        f"{len(replicates)} virtual data sets drawn from the model at the truth and identified "
        f"anew, {converged} converged. Coverage is the share of the 95 % intervals that hold the "
        "truth."
    )
    verdict = f"{'; '.join(verdicts) or 'Chance explains every bias and every coverage'}."
    return Content.of(document.get("title") or "Recovery", lead, parts, verdict)


def _unexplained(row: Document, replicates: int, thresholds: Thresholds = THRESHOLDS) -> str:
    """A note on a bias or a coverage of intervals that chance does not explain; "" if none."""
    notes = []
    if row["bias_error"] and abs(row["bias"]) > thresholds.chance * row["bias_error"]:
        notes.append(f"biased by {row['bias'] / row['scatter']:+.1f} scatter")
    lowest = (
        INTERVALS.level
        - thresholds.chance * (INTERVALS.level * (1.0 - INTERVALS.level) / replicates) ** 0.5
    )
    if row["coverage"] is not None and row["coverage"] < lowest:
        notes.append("intervals too short")
    return ", ".join(notes)
