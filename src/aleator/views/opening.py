"""The two charts that open a report: outcomes in the bands of the law, and the first law.

Bands are those of the law before an experiment is seen, so that a point can lie outside of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aleator.core.types import Array
from aleator.views import chart
from aleator.views.chart import Axis, Chart, Mark, Series
from aleator.views.law_charts import law_chart, law_curves
from aleator.views.measured import QUANTILES, AxisChoice, MeasuredValues, varying
from aleator.views.outcome_charts import Individuals, hover, predicted_chart

Document = Mapping[str, Any]
HEIGHT = 300
"""The height of both charts in pixels: they fit on the first screen."""
COLUMNS = tuple(f"q{p}" for p in QUANTILES)
BANDS = (("q0.025", "q0.975", chart.WIDE, "95 %"), ("q0.25", "q0.75", chart.NARROW, "50 %"))


@dataclass(frozen=True)
class OpeningSettings:
    """Settings of the charts that open a report. The values are chosen by judgement."""

    alike: float = 1e-3
    """Predictions under equal values of a condition are equal if they differ by less than this
    share of the width of their 95 % range.
    """


OPENING = OpeningSettings()


def opening_charts(
    document: Document,
    first: tuple[MeasuredValues, Series] | None,
    individuals: Individuals | None = None,
    ceiling: Document | None = None,
) -> Iterator[Chart]:
    """The outcomes of the `first` response in the bands of the law, and the first law."""
    if first is not None and first[0].by_law and len(first[0]):
        yield outcome_chart(*first, varying(document))
    for name in [*law_curves(document)][:1]:
        yield replace(law_chart(document, name, individuals, ceiling), height=HEIGHT)


def outcome_chart(seen: MeasuredValues, source: Series, series: str | None) -> Chart:
    """Measured outcomes in the bands with 95 % and 50 % of the law and the noise.

    x is the condition that alone determines the prediction: the column `series` that varies within
    experiments, else the condition that orders the predicted medians best. If no condition alone
    does, the last experiment is drawn over its `series`, and without a series all outcomes are
    drawn in the order of their predicted medians. `source` has the rows that are drawn as points.
    """
    choice = _condition(seen, series)
    if choice is not None and _determines(seen, choice):
        return _bands(seen, source, choice)
    if choice is not None and series is not None:
        last = seen.columns["id"][int(np.argmax(seen.array("row")))]
        own = seen.part([k for k, one in enumerate(seen.columns["id"]) if one == last])
        if _determines(own, choice):
            return _bands(own, own.named_series("last"), choice, f", experiment {last}")
    return replace(
        predicted_chart(seen, source), name="outcomes", title=_title(seen), caption=_caption(seen),
        height=HEIGHT, switched=False, wide=False,
    )  # fmt: skip


def _title(seen: MeasuredValues) -> str:
    return f"{seen.response}: measured and expected"


def _caption(seen: MeasuredValues) -> str:
    """What the bands are, and how many measured values lie outside of the 95 %."""
    known = seen.exact & np.isfinite([seen.array(key) for key in seen.ends]).all(axis=0)
    words = (
        "Bands: where 95 % and 50 % of new experiments are expected, by the law and the noise at "
        f"the estimate. Outside the 95 % are {int(np.sum(seen.outside))} of {int(known.sum()):,}"
    )
    return f"{words} (diamonds)." if seen.exact.all() else f"{words}; triangles are bounds."


def _condition(seen: MeasuredValues, series: str | None) -> AxisChoice | None:
    """The column `series`, or the numeric condition with the strongest rank correlation."""
    known = [one for one in seen.choices if one.name and one.labels is None]
    if series is not None:
        return next((one for one in known if one.name == series), None)
    middle = _ranks(seen.array("q0.5"))
    strength: dict[AxisChoice, float] = {}
    for one in known:
        at = seen.array(one.key)
        if np.all(np.isfinite(at)) and np.ptp(at) > 0.0:
            strength[one] = abs(float(_ranks(at) @ middle))
    return max(strength, key=lambda one: strength[one]) if strength else None


def _ranks(values: Array) -> Array:
    """Ranks without their mean, scaled to length one; equal values have the rank of their mean."""
    _, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(counts) - 0.5 * (counts + 1.0))[inverse]
    ranks = ranks - ranks.mean()
    return np.asarray(ranks / max(float(np.linalg.norm(ranks)), 1.0))


def _determines(
    seen: MeasuredValues, choice: AxisChoice, settings: OpeningSettings = OPENING
) -> bool:
    """Whether the predictions are a function of the condition alone, as far as the rows tell.

    Rows with equal values must have equal predictions. If no two rows have equal values, it must be
    the only condition, or the predicted median must rise or fall with it throughout.
    """
    at = seen.array(choice.key)
    width = np.nan_to_num(seen.array("q0.975") - seen.array("q0.025"), nan=np.inf)
    if not np.all(np.isfinite(at)):
        return False
    values, inverse = np.unique(at, return_inverse=True)
    for key in COLUMNS:
        column = np.nan_to_num(seen.array(key), nan=np.inf)
        low, high = np.full(values.size, np.inf), np.full(values.size, -np.inf)
        np.minimum.at(low, inverse, column)
        np.maximum.at(high, inverse, column)
        with np.errstate(invalid="ignore"):
            apart = np.where(low == high, 0.0, high - low)[inverse]
        if not np.all(apart <= settings.alike * width):
            return False
    steps = np.diff(seen.array("q0.5")[np.argsort(at)])
    alone = sum(bool(one.name) for one in seen.choices) == 1
    return values.size < at.size or alone or bool(np.all(steps >= 0.0) or np.all(steps <= 0.0))


def _bands(seen: MeasuredValues, source: Series, choice: AxisChoice, which: str = "") -> Chart:
    """The bands over a condition, and the points of `source`; `which` says whose they are."""
    x, first = np.unique(seen.array(choice.key), return_index=True)
    every = np.array([seen.array(key) for key in (*COLUMNS, "value")])
    # A quantile that is infinite is drawn at the top of the chart.
    top = float(np.nanmax(every, initial=-np.inf))
    ends = {key: np.nan_to_num(seen.array(key)[first], nan=top) for key in COLUMNS}
    ribbon = Series("expected", {"x": x} | ends)
    marks = [
        *(Mark("band", ribbon, y=low, high=high, color=color, legend=share)
          for low, high, color, share in BANDS),
        Mark("line", ribbon, y="q0.5", width=2.0, legend="median"),
        Mark("points", source, choice.key, "value", color="color", marker="marker", size="size",
             hover=hover(seen), pick=True),
    ]  # fmt: skip
    return Chart(
        "outcomes", _title(seen) + which, _caption(seen), Axis(choice.title),
        Axis(seen.label, seen.log), marks,
        {"id": "id", choice.key: choice.title, "value": seen.response}, height=HEIGHT, data=source,
    )  # fmt: skip
