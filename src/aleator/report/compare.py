"""A comparison of models as tables to read on a terminal: a pure function of its document."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from aleator.report.rows import Rows, written
from aleator.results.printed import NONE, Column, number, with_error

Document = Mapping[str, Any]

SMALL = 4.0
"""A difference below this is small, whatever its error says (Sivula, Magnusson, Vehtari 2020)."""
CHANCE = 2.0
"""Standard errors within which a difference may be chance."""
CRITERIA: Sequence[Column] = (
    ("model", "left"), ("log L", "right"), ("below best law", "right"), ("K", "right"),
    ("AIC", "right"), ("AICc", "right"), ("BIC", "right"),
)  # fmt: skip
PREDICTIONS: Sequence[Column] = (
    ("model", "left"), ("left out", "right"), ("+-", "right"), ("difference", "right"),
    ("+-", "right"), ("refits", "right"),
)  # fmt: skip
RATIOS: Sequence[Column] = (
    ("in", "left"), ("ratio", "right"), ("p", "right"), ("bootstrap p", "right"),
    ("reference", "fold"),
)  # fmt: skip
CRITERIA_TOLD = (
    "K free hyperparameters. Smaller AIC, AICc and BIC are better. BIC counts log N for those of "
    "laws that scatter and log M for those of the noise and of constants. Below best law: how much "
    "higher log L could be with a law of any shape (aleator ceiling judges that)."
)
PREDICTIONS_TOLD = (
    "Left out: the log-likelihood of each experiment by the maximum of the others, summed; larger "
    "is better. The difference is to the first model, its error that of the paired experiments."
)
RATIOS_TOLD = (
    "Ratio: 2 (log L of the larger - log L of the smaller). A small p speaks against the smaller."
)


def render(result: Document, files: Sequence[str] = ()) -> RenderableType:
    """The tables of a compare.json."""
    models = result["models"]
    seen = models[0]["observations"]
    parts: list[RenderableType] = [
        Text(f"{len(models)} models of the same data", style="bold"),
        Text(f"N = {result['experiments']} experiments, M = {seen} observations."),
        Text(),
        Rows(CRITERIA, [*map(_criteria, models)]),
        Text(CRITERIA_TOLD),
        Text(),
        Rows(PREDICTIONS, [_prediction(model, models[0]) for model in models]),
        Text(PREDICTIONS_TOLD),
    ]
    if result["nested"]:
        rows = [_ratio(ratio) for ratio in result["nested"]]
        parts += [Text(), Rows(RATIOS, rows), Text(RATIOS_TOLD)]
    notes = [Text(note) for note in map(_note, models) if note]
    verdicts = Text(verdict(result), style="bold")
    return Group(*parts, Text(), *notes, verdicts, *written(files))


def verdict(result: Document) -> str:
    """One sentence or two: which model predicts best, and which others may be as good.

    >>> best, other = {"name": "a", "sound": True}, {"name": "b", "sound": True}
    >>> other |= {"difference": -9.0, "difference_error": 2.0}
    >>> verdict({"models": [best, other]})
    'a predicts best; b does worse by more than chance explains.'
    """
    best, *others = result["models"]
    alike = [m["name"] for m in others if _alike(m)]
    worse = [m["name"] for m in others if not _alike(m)]
    parts = [f"{best['name']} predicts best"]
    if worse:
        does = "does" if len(worse) == 1 else "do"
        parts.append(f"{_listed(worse)} {does} worse by more than chance explains")
    if alike:
        parts.append(f"{_listed(alike)} may be as good")
    unsound = [m["name"] for m in result["models"] if not m["sound"]]
    said = "; ".join(parts) + "."
    if not unsound:
        return said
    return f"{said} NOT computed soundly: {_listed(unsound)}; deal with the warnings there first."


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:-1]) + " and " + names[-1] if len(names) > 1 else names[0]


def _alike(model: Document) -> bool:
    """Whether chance explains how much worse it is than the best."""
    gap, error = model["difference"], model["difference_error"]
    if gap is None or error is None or not math.isfinite(gap + error):
        return True
    return bool(abs(gap) < max(SMALL, CHANCE * error))


def _criteria(model: Document) -> tuple[str, ...]:
    values = [_to_two(model[key]) for key in ("aic", "aicc", "bic")]
    log_likelihood, below = (_to_two(model[key]) for key in ("log_likelihood", "below_ceiling"))
    return model["name"], log_likelihood, below, str(model["free"]), *values


def _note(model: Document) -> str:
    notes = []
    if model["consistent"] is False:
        notes.append("NOT consistent with the experiments")
    if model["not_arrived"]:
        notes.append(f"{model['not_arrived']} of the refits did not arrive")
    return f"{model['name']}: {', '.join(notes)}." if notes else ""


def _prediction(model: Document, best: Document) -> tuple[str, ...]:
    total, error = _to_two(model["elpd"]), with_error(0.0, model["elpd_error"])[1]
    gap, gap_error = with_error(model["difference"], model["difference_error"])
    if model is best:
        gap, gap_error = "0", NONE
    return model["name"], total, error, gap, gap_error, str(model["refits"])


def _ratio(ratio: Document) -> tuple[str, ...]:
    drawn = NONE if not ratio["replicates"] else f"{ratio['bootstrap_p']:.4f}"
    p = ratio["p"]
    known = p is not None and math.isfinite(p)
    return (
        f"{ratio['smaller']} < {ratio['larger']}", _to_two(ratio["ratio"]),
        number(p, 3) if known else NONE, drawn, ratio["reference"],
    )  # fmt: skip


def _to_two(value: float | None) -> str:
    return NONE if value is None or not math.isfinite(value) else f"{value:.2f}"
