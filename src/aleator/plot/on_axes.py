"""Charts of an identification on matplotlib axes of your own, for figures that you compose.

Each takes an identification, or the content of identification.json, draws on `ax`, and returns the
axes. Without `ax` it makes a figure of its own: `axes.figure.savefig(...)` writes it. What is not
in the document is computed where the fit is at hand.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from aleator.errors import AleatorError, nearest
from aleator.inference.profile_end import DROP
from aleator.plot.identification import (
    draw_cumulative,
    draw_histogram,
    draw_intervals,
    draw_outcomes,
)
from aleator.plot.style import BLUE, GRAY, empty_figure, styled
from aleator.results.result import Result
from aleator.results.units import label, seen_label
from aleator.tasks.identification import Identification
from aleator.tasks.pictures import finer, pictured, profile_line
from aleator.types import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Found = Result | Mapping[str, Any]
QUANTILES = ("0.025", "0.25", "0.5", "0.75", "0.975")
BAND = "#cfe3f1"
SIZE = (4.5, 3.4)
"""Inches of a figure that is made for one chart."""
LEVELS = (0.69, 1.61, 3.0)
"""How far the log-likelihood has dropped at the ends of 50, 80 and 95 % of two together (chi2)."""
DASHES = {"first": ":", "middle": "--", "last": "-"}
"""Lines of rows of a series, by their place in it."""


def calibration(found: Found, ax: Axes | None = None) -> Axes:
    """The cumulative share of the probabilities of what was measured, minus the uniform one.

    The band holds the whole curve in 95 % of all uniform samples (Kolmogorov). Raises AleatorError
    where no probability is known, and where matplotlib is not installed.

    >>> ten = {"experiments": [{"id": k, "pit": (k + 0.5) / 10} for k in range(10)]}
    >>> calibration(ten).get_ylabel()
    'cumulative share − uniform'
    """
    axes = _axes(ax)
    draw_cumulative(axes, _probabilities(_document(found)))
    axes.set(xlim=(0.0, 1.0), xlabel="probability of a smaller value")
    axes.set_ylabel("cumulative share − uniform")
    return axes


def histogram(found: Found, ax: Axes | None = None) -> Axes:
    """The histogram of these probabilities, with the 95 % range of each bin (binomial).

    >>> ten = {"experiments": [{"id": k, "pit": (k + 0.5) / 10} for k in range(10)]}
    >>> histogram(ten).get_ylabel()
    'count'
    """
    axes = _axes(ax)
    draw_histogram(axes, _probabilities(_document(found)))
    axes.set(xlim=(0.0, 1.0), xlabel="probability of a smaller value", ylabel="count")
    return axes


def experiments(found: Found, ax: Axes | None = None, *, response: str | None = None) -> Axes:
    """Measured outcomes in the distributions that the law predicts, by predicted median.

    On the scale of the likelihood: of a logarithm that is the logarithm. Of several responses one
    is named; a censored value stands at its bound. Raises AleatorError where predictions are not
    known.

    >>> quantiles = {"0.025": 0.0, "0.25": 0.7, "0.5": 1.0, "0.75": 1.3, "0.975": 2.0}
    >>> one = {"id": "7", "outcome": 1.2, "quantiles": quantiles, "pit": 0.65}
    >>> experiments({"outcome": "time", "experiments": [one]}).get_ylabel()
    'time'
    """
    document = _document(found, with_pictures=True)
    outcome, quantiles, name = _measured(document, response)
    order = np.lexsort((outcome, quantiles[:, 2]))
    outcome, quantiles = outcome[order], quantiles[order]
    known = np.asarray(np.isfinite(quantiles).all(axis=1))
    with np.errstate(invalid="ignore"):
        outside = np.asarray(known & ((outcome < quantiles[:, 0]) | (outcome > quantiles[:, -1])))
    axes = _axes(ax)
    draw_intervals(axes, quantiles, known)
    draw_outcomes(axes, outcome, outside, known)
    axes.set(xlabel="ordered by predicted median", ylabel=seen_label(document, name))
    return axes


def law(found: Found, parameter: str, ax: Axes | None = None) -> Axes:
    """The density of a parameter's law, with a band of 95 % of the densities of plausible laws.

    >>> curve = {"x": [0.0, 1.0], "density": [1.0, 1.0], "lower": [0.5, 0.5], "upper": [2.0, 2.0]}
    >>> law({"pictures": {"laws": {"wear": curve}}}, "wear").get_xlabel()
    'wear'
    """
    document = _document(found, with_pictures=True)
    curve = _of(document, "laws", parameter)
    axes = _axes(ax)
    x = _numbers(curve["x"])
    if "lower" in curve:
        axes.fill_between(x, _numbers(curve["lower"]), _numbers(curve["upper"]), color=BAND, lw=0)
    axes.plot(x, _numbers(curve["density"]), color=BLUE)
    axes.set(xlabel=label(document, parameter), ylabel="density")
    return axes


def profile(found: Found, hyperparameter: str, ax: Axes | None = None) -> Axes:
    """The profile of the likelihood over a hyperparameter, and where it has dropped by 1.92.

    Dashed: that drop, and the 95 % interval.

    >>> curve = {"at": [0.0, 1.0, 2.0], "below": [2.0, 0.0, 2.0]}
    >>> profile({"pictures": {"profiles": {"wear.mean": curve}}}, "wear.mean").get_xlabel()
    'wear.mean'
    """
    document = _document(found, with_pictures=True)
    curve = _of(document, "profiles", hyperparameter)
    axes = _axes(ax)
    axes.axhline(-DROP, color=GRAY, lw=0.8, ls="--")
    at, below = _numbers(curve["at"]), _numbers(curve["below"])
    axes.plot(*profile_line(at, below), color=BLUE)
    axes.plot(at, -below, color=BLUE, marker="o", ms=3.0, ls="none")
    entry = (document.get("alpha") or {}).get(hyperparameter, {})
    for end in entry.get("interval") or ():
        axes.axvline(end, color=GRAY, lw=0.8, ls="--")
    axes.set(xlabel=label(document, hyperparameter), ylabel="log-likelihood − maximum")
    return axes


def surface(found: Found, ax: Axes | None = None) -> Axes:
    """The likelihood over the two estimates that are told apart worst: 50, 80 and 95 % of both.

    The cross is the largest value. Raises AleatorError where there are no two.
    """
    document = _document(found, with_pictures=True)
    drawn = (document.get("pictures") or {}).get("surface")
    if not drawn:
        raise _lacking("surface of the likelihood")
    axes = _axes(ax)
    x, y, below = (np.array([_numbers(r) for r in drawn[k]]) for k in ("first", "second", "below"))
    fine = finer(x), finer(y), np.ma.masked_invalid(finer(below))
    axes.contour(*fine, levels=LEVELS, colors=BLUE)
    best = np.unravel_index(np.nanargmin(below), below.shape)
    axes.plot(x[best], y[best], "+", color=GRAY)
    first, second = (label(document, name) for name in drawn["between"])
    axes.set(xlabel=first, ylabel=second)
    return axes


def response(
    found: Found, parameter: str, ax: Axes | None = None, *, response: str | None = None
) -> Axes:
    """What stands for the simulator over a parameter, the others in their middle.

    A line for each of some experiments; of a series its first row is dotted, the middle one dashed.
    With collocation, marks at the nodes of the law. Raises AleatorError where nothing is known.

    >>> shown = [{"id": "7", "response": "way", "curves": {"k": [1.0, 2.0]}}]
    >>> drawn = {"over": {"k": [0.0, 1.0]}, "shown": shown}
    >>> response({"pictures": {"response": drawn}}, "k").get_ylabel()
    'way'
    """
    document = _document(found, with_pictures=True)
    drawn = (document.get("pictures") or {}).get("response") or {}
    if not drawn:
        raise _lacking("response of the simulator")
    marks = "nodes" in drawn
    at = _of({"pictures": drawn}, "nodes" if marks else "over", parameter)
    names = list(dict.fromkeys(entry["response"] for entry in drawn["shown"]))
    name = _named(names, response)
    axes = _axes(ax)
    for entry in drawn["shown"]:
        if entry["response"] == name:
            values = entry["values"] if marks else entry["curves"][parameter]
            style = "." if marks else DASHES[entry.get("place", "last")]
            axes.plot(_numbers(at), _numbers(values), style, color=BLUE, lw=0.9, ms=4.0)
    axes.set(xlabel=label(document, parameter), ylabel=label(document, name))
    return axes


def _axes(ax: Axes | None) -> Axes:
    """The axes, or those of a new figure."""
    if ax is not None:
        return ax
    with styled():
        return empty_figure(None, *SIZE).subplots()


def _document(found: Found, with_pictures: bool = False) -> Mapping[str, Any]:
    if not isinstance(found, Result):
        return found
    if with_pictures and not found.pictures and isinstance(found, Identification):
        found = found if found.session.fit is None else pictured(found)
    return found.to_dict()


def _probabilities(document: Mapping[str, Any]) -> Array:
    entries = document.get("observations") or document["experiments"]
    pit = _numbers([entry["pit"] for entry in entries])
    pit = np.sort(pit[np.isfinite(pit)])
    if not pit.size:
        raise AleatorError("no probability is known", "the warnings say why")
    return pit


def _measured(document: Mapping[str, Any], response: str | None) -> tuple[Array, Array, str]:
    """Outcomes (M,), their predicted quantiles (M, 5), and their name."""
    seen = document.get("observations")
    if not seen:
        entries = document["experiments"]
        quantiles = [_numbers([e["quantiles"][p] for p in QUANTILES]) for e in entries]
        name = str(document.get("outcome") or "outcome")
        return _numbers([e["outcome"] for e in entries]), np.array(quantiles), name
    name = _named([*document["responses"]], response)
    predicted = (document.get("pictures") or {}).get("predicted")
    if not predicted:
        raise _lacking("predictions of what was observed")
    which = [k for k, entry in enumerate(seen) if entry["response"] == name]
    ends = [seen[k]["lower"] if seen[k]["lower"] is not None else seen[k]["upper"] for k in which]
    quantiles = [_numbers([predicted[p][k] for p in QUANTILES]) for k in which]
    return _numbers(ends), np.array(quantiles), name


def _named(names: list[str], response: str | None) -> str:
    """The response that is meant, by default the first."""
    name = names[0] if response is None else response
    if name not in names:
        raise AleatorError(
            f"there is no response '{name}'{nearest(name, names)}",
            f"the responses are {', '.join(names)}",
        )
    return name


def _of(document: Mapping[str, Any], what: str, name: str) -> Any:
    known = (document.get("pictures") or {}).get(what) or {}
    if not known:
        raise _lacking(what)
    if name not in known:
        raise AleatorError(
            f"there is no '{name}' among the {what}{nearest(name, [*known])}",
            f"there are {', '.join(known)}",
        )
    return known[name]


def _lacking(what: str) -> AleatorError:
    return AleatorError(
        f"the document has no {what}",
        "identify again: `aleator identify` writes them, and in Python the fit is at hand",
    )


def _numbers(values: Any) -> Array:
    """JSON's null is NaN."""
    return np.array([np.nan if value is None else float(value) for value in values])
