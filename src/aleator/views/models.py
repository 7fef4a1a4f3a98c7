"""The reports of `aleator compare` and `aleator ceiling`, made from their documents."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from aleator.errors import count
from aleator.results.printed import (
    AMOUNTS,
    NONE,
    THRESHOLDS,
    Amounts,
    Chapter,
    Column,
    Content,
    Part,
    Sentence,
    TextTable,
    Thresholds,
    heads,
    listed,
    number,
    to_three,
    with_error,
)
from aleator.results.units import label

Document = Mapping[str, Any]

# ------------------------------------------------------------------------------------ compare


def comparison(document: Document) -> Content:
    """The report of compare.json: AIC and BIC, predictions of left-out experiments, ratio tests."""
    models = document["models"]
    lead = (
        f"N = {document['experiments']} experiments, M = {models[0]['observations']} observations."
    )
    sections = [
        Chapter("criteria", "Criteria", _criteria(models)),
        Chapter("predictions", "Predictions", _predictions(models)),
        Chapter("ratios", "Likelihood ratios", _ratios(document)),
        Chapter("notes", "Notes", [Sentence(note) for note in map(_note, models) if note]),
    ]
    return Content(
        f"{len(models)} models of the same data", [Sentence(lead)], sections,
        verdicts=[Sentence(_best(document), "strong")],
    )  # fmt: skip


def _best(document: Document) -> str:
    """A sentence that names the model that predicts best, and judges the others against it.

    >>> best, other = {"name": "a", "sound": True}, {"name": "b", "sound": True}
    >>> other |= {"difference": -9.0, "difference_error": 2.0}
    >>> _best({"models": [best, other]})
    'a predicts best; b does worse by more than chance explains.'
    """
    best, *others = document["models"]
    alike = [m["name"] for m in others if _alike(m)]
    worse = [m["name"] for m in others if not _alike(m)]
    parts = [f"{best['name']} predicts best"]
    if worse:
        does = "does" if len(worse) == 1 else "do"
        parts.append(f"{listed(worse)} {does} worse by more than chance explains")
    if alike:
        parts.append(f"{listed(alike)} may be as good")
    said = "; ".join(parts) + "."
    if alike:
        said += " Intervals of a prediction take their model as right: predict with each of these."
    unsound = [m["name"] for m in document["models"] if not m["sound"]]
    if unsound:
        said += f" NOT computed soundly: {listed(unsound)}; deal with the warnings there first."
    return said


def _alike(model: Document, thresholds: Thresholds = THRESHOLDS) -> bool:
    """Whether chance explains that a model predicts worse than the best model."""
    gap, error = model["difference"], model["difference_error"]
    if gap is None or error is None or not math.isfinite(gap + error):
        return True
    return bool(abs(gap) < max(thresholds.small, thresholds.paired * error))


def _criteria(models: Sequence[Document]) -> list[Part]:
    columns = heads("model", ">log L", ">below best law", ">K", ">AIC", ">AICc", ">BIC")
    rows = [
        (model["name"], _to_two(model["log_likelihood"]), _to_two(model["below_ceiling"]),
         str(model["free"]), *(_to_two(model[key]) for key in ("aic", "aicc", "bic")))
        for model in models
    ]  # fmt: skip
    unknown: dict[str, list[str]] = {}
    for model in models:
        if model.get("no_ceiling"):
            unknown.setdefault(model["no_ceiling"], []).append(model["name"])
    return [
        TextTable(columns, rows, "criteria", "Criteria"),
        Sentence(
            "K free hyperparameters. Smaller AIC, AICc and BIC are better. BIC counts log N for "
            "those of laws that scatter and log M for those of the noise and of constants. Below "
            f"best law: {BELOW_CEILING}."
        ),
        *(
            Sentence(f"Below best law is not known for {listed(names)}: {why}.")
            for why, names in unknown.items()
        ),
    ]


def _predictions(models: Sequence[Document]) -> list[Part]:
    columns = heads("model", ">left out", ">+-", ">difference", ">+-", ">refits")
    rows = []
    for model in models:
        gap = with_error(model["difference"], model["difference_error"])
        if model is models[0]:
            gap = ("0", NONE)
        error = with_error(0.0, model["elpd_error"])[1]
        rows.append((model["name"], _to_two(model["elpd"]), error, *gap, str(model["refits"])))
    return [
        TextTable(columns, rows, "predictions", "Predictions"),
        Sentence(
            "Left out: the log-likelihood of each experiment by the maximum of the others, summed; "
            "larger is better. The difference is to the first model, its error that of the paired "
            "experiments."
        ),
    ]


def _ratios(document: Document) -> list[Part]:
    columns = heads("in", ">ratio", ">p", ">bootstrap p", "~reference")
    rows = []
    for ratio in document["nested"]:
        p = ratio["p"]
        rows.append((
            f"{ratio['smaller']} < {ratio['larger']}", _to_two(ratio["ratio"]),
            number(p, 3) if p is not None and math.isfinite(p) else NONE,
            f"{ratio['bootstrap_p']:.4f}" if ratio["replicates"] else NONE, ratio["reference"],
        ))  # fmt: skip
    without = without_ratio(document)
    if not rows:
        return [*without]
    return [
        TextTable(columns, rows, "ratios", "Likelihood ratios"),
        Sentence(
            "Ratio: 2 (log L of the larger - log L of the smaller). A small p speaks against the "
            "smaller."
        ),
        *unreferenced(document["nested"]),
        *_negative(document["nested"]),
        *without,
    ]


BELOW_CEILING = (
    "how much higher log L could be with a law of any shape. It is above zero for a right law, "
    "too: whether it is more than chance, the p value of `aleator ceiling` says "
    "(aleator.ceiling(found) in Python)"
)
"""What the gap to the best possible law is, for the table of criteria."""


def without_ratio(document: Document) -> list[Sentence]:
    """Which pairs of models have no likelihood ratio, and why.

    >>> pairs = [{"models": ["a", "b"], "reason": "r"}, {"models": ["a", "c"], "reason": "r"}]
    >>> print(*without_ratio({"without_ratio": pairs}))
    No ratio of a and b, a and c: r.
    """
    reasons: dict[str, list[str]] = {}
    for one in document.get("without_ratio") or ():
        reasons.setdefault(one["reason"], []).append(listed(one["models"]))
    return [Sentence(f"No ratio of {', '.join(pairs)}: {why}.") for why, pairs in reasons.items()]


def unreferenced(ratios: Sequence[Document]) -> list[Sentence]:
    """What gives a p value where no reference law is known and no data were drawn."""
    without = [
        f"{one['smaller']} < {one['larger']}"
        for one in ratios
        if not one["replicates"] and (one["p"] is None or not math.isfinite(one["p"]))
    ]
    if not without:
        return []
    drawn = "`aleator compare --bootstrap 200`, bootstrap=200 in Python"
    return [Sentence(f"{listed(without)}: p comes from drawn data only ({drawn}).")]


def _negative(ratios: Sequence[Document]) -> list[Sentence]:
    """What a ratio below zero says: a larger model cannot be less likely than the smaller."""
    below = [
        f"{one['smaller']} < {one['larger']}"
        for one in ratios
        if one["ratio"] is not None and round(one["ratio"], 2) < 0.0
    ]
    if not below:
        return []
    return [
        Sentence(
            f"The ratio of {listed(below)} is below zero, which exact maxima cannot have: the "
            "response surfaces of the two models differ by more than the models, or a search "
            "missed its maximum. Identify both again with more runs, or with another seed and more "
            "starts."
        )
    ]


def _note(model: Document) -> str:
    notes = []
    if model["consistent"] is False:
        notes.append("NOT consistent with the experiments")
    if model["not_arrived"]:
        notes.append(f"{model['not_arrived']} of the refits did not arrive")
    if start := model.get("raised_from"):
        notes.append(
            f"identify missed its maximum, which was found from the estimate of {start} and is "
            "used here (identify it again with another seed or more starts)"
        )
    return f"{model['name']}: {', '.join(notes)}." if notes else ""


def _to_two(value: float | None) -> str:
    return NONE if value is None or not math.isfinite(value) else f"{value:.2f}"


# ------------------------------------------------------------------------------------ ceiling


def ceiling(document: Document) -> Content:
    """The report of ceiling.json: how much more likely any law could make the experiments.

    The gap is the log-likelihood of the best possible law minus that of the chosen law.
    """
    names = ", ".join(document["region"])
    lead = (
        f"The largest log-likelihood that any law of {names} can have with these experiments: a "
        f"law of {count(len(document['points']), 'point')}."
    )
    parts = [Sentence(meaning(document)), *map(Sentence, _conditions(document))]
    return Content(
        document.get("title") or "The best possible law", [Sentence(lead)],
        [
            Chapter("log-likelihood", "Log-likelihood", [_values(document)]),
            Chapter("points", "Points of the best law", _points(document)),
            Chapter("meaning", "What it means", parts),
        ],
        verdicts=[Sentence(ceiling_verdict(document), "strong")],
    )  # fmt: skip


def ceiling_verdict(document: Document) -> str:
    """A sentence with the log-likelihoods of the best and the chosen law, and p of their gap."""
    value, test = document["log_likelihood"], document["bootstrap"]
    least = "" if document["covered"] else "at least "
    text = (
        f"best possible law: log-likelihood {least}{to_three(value['ceiling'])}, this one "
        f"{to_three(value['estimated'])}"
    )
    return text if test is None else f"{text}, {_p(test)}"


def meaning(
    document: Document, amounts: Amounts = AMOUNTS, thresholds: Thresholds = THRESHOLDS
) -> str:
    """A sentence on whether the gap to the best possible law speaks against the chosen law."""
    test, value = document["bootstrap"], document["log_likelihood"]
    if test is None:
        return (
            "Any law gains from fitting chance: whether the gap is more than that needs replicates."
        )
    if test["p_value"] < thresholds.unlikely:
        gains = sorted(document["gains"], key=lambda e: -e["gain"])[: amounts.gaining]
        named = ", ".join(f"{entry['id']} ({entry['gain']:+.1f})" for entry in gains)
        return (
            "The chosen law lacks mass where the experiments need it: of data drawn from it so "
            f"large a gap is rare ({_p(test)}). Most gain the experiments {named}. The figure "
            "shows where: the gradient function is above zero there."
        )
    return (
        f"The experiments ask for no other law: a gap of {number(value['gap'], 3)} is what chance "
        f"makes of data drawn from the chosen one ({_p(test)})."
    )


def _p(test: Document) -> str:
    return f"p = {number(test['p_value'], 2)}"


def _values(document: Document, least: float = 1e-4) -> TextTable:
    value, test = document["log_likelihood"], document["bootstrap"]
    error, gap = f"no law has {number(max(value['error'], least), 1)} more", ""
    if not document["covered"]:
        error = "at least: points cannot cover so many parameters, and there may be a better law"
    if test is not None:
        gap = f"{_p(test)}: of {test['replicates']} data sets drawn from the chosen law "
        gap += f"{test['exceeded']} have a larger one"
        gap += f"; {test['failed']} failed and count as larger" if test["failed"] else ""
    rows = [("best possible law", to_three(value["ceiling"]), error)]
    if value["verified"] is not None:
        what = "at the same points, on the simulator itself: at least this can be reached there"
        rows.append(("verified", to_three(value["verified"]), what))
    rows += [("chosen law", to_three(value["estimated"]), ""), ("gap", to_three(value["gap"]), gap)]
    columns = heads("log-likelihood", ">", "~")
    return TextTable(columns, rows, "log-likelihood", "Log-likelihood")


def _points(document: Document, amounts: Amounts = AMOUNTS) -> list[Part]:
    """A table of the best law's most probable points, in the order of their parameters."""
    points: Sequence[Mapping[str, float]] = document["points"]
    least = sorted((point["probability"] for point in points), reverse=True)[: amounts.named][-1]
    kept = [point for point in points if point["probability"] >= least][: amounts.named]
    columns: list[Column] = [(label(document, name), "right") for name in points[0]]
    rows = [[number(value) for value in point.values()] for point in kept]
    more = len(points) - len(kept)
    table = TextTable(columns, rows, "points", "Points of the best law")
    return [table, *([Sentence(f"and {more} more in ceiling.json")] if more else [])]


def _conditions(document: Document) -> list[str]:
    """Sentences on the conditions under which the best possible law was computed."""
    notes = []
    if held := document["held"]:
        named = ", ".join(f"{name} {number(value)}" for name, value in held.items())
        noise = any(name.startswith("noise.") for name in held)
        free = (
            " With the noise left free the best law may be one of points and no noise, whose "
            "likelihood has no limit."
        )
        notes.append(f"Held at the estimate meanwhile: {named}.{free if noise else ''}")
    for name in document["edges"]:
        low, high = document["region"][name]
        notes.append(
            f"The best law has mass on an edge of where {name} was looked for, {number(low)} to "
            f"{number(high)}: beyond it the ceiling may be higher."
        )
    return notes
