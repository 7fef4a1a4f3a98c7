"""Charts of an identification on matplotlib axes, for figures that a user composes.

Each function takes an identification, or the content of identification.json, draws on `ax`, and
returns the axes. Without `ax` it makes a new figure, which `axes.figure.savefig(...)` writes. Data
of a chart that the document lacks are computed if the identification was made in this session.

>>> from aleator import plot
>>> plot.__all__
['calibration', 'histogram', 'experiments', 'law', 'profile', 'surface', 'response']
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from aleator.core.types import Array
from aleator.errors import AleatorError, nearest
from aleator.results.result import Result
from aleator.tasks.identification import Identification, pictured
from aleator.views import law_charts, outcome_charts
from aleator.views.axes import draw, empty_figure, styled
from aleator.views.chart import Chart
from aleator.views.measured import measured

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["calibration", "histogram", "experiments", "law", "profile", "surface", "response"]

Identified = Result | Mapping[str, Any]
SIZE = (4.5, 3.4)
"""Width and height in inches of a figure with one chart."""


def calibration(found: Identified, ax: Axes | None = None) -> Axes:
    """Calibration: the distribution of predicted probabilities, minus the uniform distribution.

    Each measured outcome has the probability that the law predicted for smaller outcomes
    (probability integral transform). The chart shows the cumulative share of these probabilities.
    The band contains the whole curve in 95 % of all uniform samples (Kolmogorov). Raises
    AleatorError if no probability is known, or if matplotlib is not installed.

    >>> ten = [{"id": k, "pit": (k + 0.5) / 10} for k in range(10)]
    >>> calibration({"experiments": ten}).get_ylabel()
    'cumulative share − uniform'
    """
    axes = _drawn(outcome_charts.cumulative_chart(_probabilities(found)), ax)
    axes.set_xlim(0.0, 1.0)
    return axes


def histogram(found: Identified, ax: Axes | None = None) -> Axes:
    """The histogram of the predicted probabilities of outcomes below each measured outcome.

    A band shows the range of a bin's count in 95 % of all uniform samples.

    >>> ten = [{"id": k, "pit": (k + 0.5) / 10} for k in range(10)]
    >>> histogram({"experiments": ten}).get_ylabel()
    'count'
    """
    axes = _drawn(outcome_charts.histogram_chart(_probabilities(found)), ax)
    axes.set_xlim(0.0, 1.0)
    return axes


def experiments(found: Identified, ax: Axes | None = None, *, response: str | None = None) -> Axes:
    """Measured outcomes against the distributions that the law predicts, by predicted median.

    The scale is that of the likelihood: the logarithm of an outcome with transform = "log".
    `response` names one of several responses (default: the first). A censored value is drawn at its
    bound. Raises AleatorError if predictions are not known.

    >>> quantiles = {"0.025": 0.0, "0.25": 0.7, "0.5": 1.0, "0.75": 1.3, "0.975": 2.0}
    >>> one = {"id": "7", "outcome": 1.2, "quantiles": quantiles, "pit": 0.65}
    >>> experiments({"outcome": "time", "experiments": [one]}).get_ylabel()
    'time'
    """
    of = {seen.response: seen for seen in measured(_document(found), seen=True)}
    seen = of[_named([*of], response)]
    if not seen.by_law:
        raise _lacking("predictions of what was observed")
    axes = _drawn(outcome_charts.predicted_chart(seen, seen.series()), ax)
    axes.set_xlabel("ordered by predicted median")
    return axes


def law(found: Identified, parameter: str, ax: Axes | None = None) -> Axes:
    """The density of a parameter's law, with a band of 95 % of the densities of plausible laws.

    >>> curve = {"x": [0.0, 1.0], "density": [1.0, 1.0], "lower": [0.5, 0.5], "upper": [2.0, 2.0]}
    >>> law({"pictures": {"laws": {"wear": curve}}}, "wear").get_xlabel()
    'wear'
    """
    document = _document(found)
    _require((document.get("pictures") or {}).get("laws"), parameter, "laws")
    return _drawn(law_charts.law_chart(document, parameter), ax)


def profile(found: Identified, hyperparameter: str, ax: Axes | None = None) -> Axes:
    """The profile log-likelihood over a hyperparameter, with its 95 % interval.

    Dashed lines mark a drop of 1.92 below the maximum, and the ends of the interval.

    >>> curve = {"at": [0.0, 1.0, 2.0], "below": [2.0, 0.0, 2.0]}
    >>> profile({"pictures": {"profiles": {"wear.mean": curve}}}, "wear.mean").get_xlabel()
    'wear.mean'
    """
    document = _document(found)
    _require((document.get("pictures") or {}).get("profiles"), hyperparameter, "profiles")
    return _drawn(law_charts.profile_chart(document, hyperparameter), ax)


def surface(found: Identified, ax: Axes | None = None) -> Axes:
    """The log-likelihood over the two estimates with the strongest correlation.

    Contours enclose joint confidence regions of 50, 80 and 95 %. The cross is the maximum. Raises
    AleatorError if the identification has no such two estimates.
    """
    chart = law_charts.surface_chart(_document(found))
    if chart is None:
        raise _lacking("surface of the likelihood")
    return _drawn(chart, ax)


def response(
    found: Identified, parameter: str, ax: Axes | None = None, *, response: str | None = None
) -> Axes:
    """The response over one parameter, all other parameters in the middle of their range.

    Some experiments have a line each. If an experiment is a series, its first row is a dotted line,
    its middle row a dashed one and its last row a solid one. With collocation there are marks at
    the nodes of the law instead. Raises AleatorError if no response is known.

    >>> shown = [{"id": "7", "response": "way", "curves": {"k": [1.0, 2.0]}}]
    >>> drawn = {"over": {"k": [0.0, 1.0]}, "shown": shown}
    >>> response({"pictures": {"response": drawn}}, "k").get_ylabel()
    'way'
    """
    document = _document(found)
    drawn = (document.get("pictures") or {}).get("response")
    if not drawn:
        raise _lacking("response of the simulator")
    _require(drawn.get("nodes") or drawn.get("over"), parameter, "parameters that were drawn")
    name = _named(law_charts.responses_drawn(drawn), response)
    return _drawn(law_charts.response_chart(document, parameter, name), ax)


def _drawn(chart: Chart, ax: Axes | None) -> Axes:
    """The axes `ax`, or those of a new figure if `ax` is None, with the chart drawn on them."""
    if ax is not None:
        return draw(chart, ax)
    with styled():
        return draw(chart, empty_figure(None, *SIZE).subplots())


def _document(found: Identified) -> Mapping[str, Any]:
    """The content of identification.json, with the data of its charts if they can be computed."""
    if not isinstance(found, Result):
        return found
    if not found.pictures and isinstance(found, Identification) and found.session.fit is not None:
        found = pictured(found)
    return found.to_dict()


def _probabilities(found: Identified) -> Array:
    document = found.to_dict() if isinstance(found, Result) else found
    pit, _ = outcome_charts.probabilities(measured(document))
    if not pit.size:
        raise AleatorError("no probability is known", "the warnings say why")
    return pit


def _named(names: Sequence[str], response: str | None) -> str:
    """The name of a response, by default the first one; raises AleatorError for an unknown name."""
    name = names[0] if response is None else response
    if name not in names:
        raise AleatorError(
            f"there is no response '{name}'{nearest(name, names)}",
            f"the responses are {', '.join(names)}",
        )
    return name


def _require(known: Mapping[str, Any] | None, name: str, what: str) -> None:
    if not known:
        raise _lacking(what)
    if name not in known:
        raise AleatorError(
            f"there is no '{name}' among the {what}{nearest(name, [*known])}",
            f"there are {', '.join(known)}",
        )


def _lacking(what: str) -> AleatorError:
    return AleatorError(
        f"the document has no {what}",
        "identify again: `aleator identify` writes them, and in Python the fit is at hand",
    )
