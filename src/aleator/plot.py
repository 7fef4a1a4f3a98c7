"""Charts of an identification on matplotlib axes, for figures that a user composes.

Each function takes an identification, or the content of identification.json, draws on `ax`, and
returns the axes. Without `ax` it makes a new figure, which `axes.figure.savefig(...)` writes. Data
of a chart that the document lacks are computed if the identification was made in this session.

>>> from aleator import plot
>>> plot.__all__
['calibration', 'histogram', 'experiments', 'law', 'profile', 'surface', 'response', 'p_box']
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from aleator.core.types import Array
from aleator.errors import AleatorError
from aleator.results.result import Result
from aleator.tasks.identification import Identification, pictured
from aleator.views import law_charts, outcome_charts, p_boxes
from aleator.views.measured import measured
from aleator.views.plots import drawn, lacking, named, required

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

__all__ = [
    "calibration", "histogram", "experiments", "law", "profile", "surface", "response", "p_box",
]  # fmt: skip

Identified = Result | Mapping[str, Any]


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
    axes = drawn(outcome_charts.cumulative_chart(_probabilities(found)), ax)
    axes.set_xlim(0.0, 1.0)
    return axes


def histogram(found: Identified, ax: Axes | None = None) -> Axes:
    """The histogram of the predicted probabilities of outcomes below each measured outcome.

    A band shows the range of a bin's count in 95 % of all uniform samples.

    >>> ten = [{"id": k, "pit": (k + 0.5) / 10} for k in range(10)]
    >>> histogram({"experiments": ten}).get_ylabel()
    'count'
    """
    axes = drawn(outcome_charts.histogram_chart(_probabilities(found)), ax)
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
    seen = of[named([*of], response)]
    if not seen.by_law:
        raise lacking("predictions of what was observed")
    axes = drawn(outcome_charts.predicted_chart(seen, seen.series()), ax)
    axes.set_xlabel("ordered by predicted median")
    return axes


def law(found: Identified, parameter: str, ax: Axes | None = None) -> Axes:
    """The density of a parameter's law, with a band of 95 % of the densities of plausible laws.

    >>> curve = {"x": [0.0, 1.0], "density": [1.0, 1.0], "lower": [0.5, 0.5], "upper": [2.0, 2.0]}
    >>> law({"pictures": {"laws": {"wear": curve}}}, "wear").get_xlabel()
    'wear'
    """
    document = _document(found)
    required((document.get("pictures") or {}).get("laws"), parameter, "laws")
    return drawn(law_charts.law_chart(document, parameter), ax)


def profile(found: Identified, hyperparameter: str, ax: Axes | None = None) -> Axes:
    """The profile log-likelihood over a hyperparameter, with its 95 % interval.

    Dashed lines mark a drop of 1.92 below the maximum, and the ends of the interval.

    >>> curve = {"at": [0.0, 1.0, 2.0], "below": [2.0, 0.0, 2.0]}
    >>> profile({"pictures": {"profiles": {"wear.mean": curve}}}, "wear.mean").get_xlabel()
    'wear.mean'
    """
    document = _document(found)
    required((document.get("pictures") or {}).get("profiles"), hyperparameter, "profiles")
    return drawn(law_charts.profile_chart(document, hyperparameter), ax)


def surface(found: Identified, ax: Axes | None = None) -> Axes:
    """The log-likelihood over the two estimates with the strongest correlation.

    Contours enclose joint confidence regions of 50, 80 and 95 %. The cross is the maximum. Raises
    AleatorError if the identification has no such two estimates.
    """
    chart = law_charts.surface_chart(_document(found))
    if chart is None:
        raise lacking("surface of the likelihood")
    return drawn(chart, ax)


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
    curves = (document.get("pictures") or {}).get("response")
    if not curves:
        raise lacking("response of the simulator")
    required(curves.get("nodes") or curves.get("over"), parameter, "parameters that were drawn")
    name = named(law_charts.responses_drawn(curves), response)
    return drawn(law_charts.response_chart(document, parameter, name), ax)


def p_box(band: pd.DataFrame, ax: Axes | None = None, *, outcome: str = "outcome") -> Axes:
    """The band of distribution functions of one new outcome (probability box).

    `band` is a table of `PBox.quantiles` for one outcome; take twenty levels or more. The inner
    band holds the distribution functions over the bounded hyperparameters, the outer one has the
    uncertainty of the identified ones too. `outcome` is the title of the axis. Raises AleatorError
    if the table has several outcomes, or if matplotlib is not installed.

    >>> import pandas as pd
    >>> band = pd.DataFrame({"id": ["a", "a"], "probability": [0.05, 0.95],
    ...                      "lower": [1.0, 2.0], "upper": [1.5, 3.0]})
    >>> p_box(band, outcome="force").get_xlabel()
    'force'
    """
    if band["probability"].duplicated().any():
        raise AleatorError(
            "the table has several outcomes", 'choose one: band[band["id"] == "..."]'
        )
    axes = drawn(p_boxes.band_chart(band.to_dict("list"), outcome), ax)
    axes.set_ylim(0.0, 1.0)
    return axes


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
