"""The charts that open a report: outcomes in the bands of the law, and the laws.

Bands are those of the law before an experiment is seen, so that a point can lie outside of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aleator.core.types import Array
from aleator.views import chart
from aleator.views.chart import CHARTS, Axis, Chart, Mark, Series, evenly
from aleator.views.law_charts import law_chart, law_curves
from aleator.views.measured import QUANTILES, AxisChoice, MeasuredValues, varying
from aleator.views.outcome_charts import Individuals, hover, lines_of, predicted_chart

Document = Mapping[str, Any]
HEIGHT = 300
"""The height of a chart in pixels: the first row of charts fits on the first screen."""
COLUMNS = tuple(f"q{p}" for p in QUANTILES)
GROUP_LOOKS = (
    (chart.BLUE, "solid"),
    (chart.GREEN, "dashed"),
    (chart.GRAY, "dotted"),
    (chart.INK, "dashdot"),
)
"""Color and line style of each value of a second condition."""
BANDS = (("q0.025", "q0.975", chart.WIDE, "95 %"), ("q0.25", "q0.75", chart.NARROW, "50 %"))


@dataclass(frozen=True)
class OpeningSettings:
    """Settings of the charts that open a report. The values are chosen by judgement."""

    alike: float = 1e-3
    """Predictions under equal values of a condition are equal if they differ by less than this
    share of the width of their 95 % range.
    """
    laws: int = 4
    """The most laws on the first screen; the others follow below."""
    groups: int = 4
    """The most values of a second condition that are told apart by color."""
    values: int = 12
    """The most values of the first condition where a second one is told apart by color."""
    hair: float = 0.05
    """Share of the range of outcomes below which the median width of the 95 % ranges is hard to
    see (some ten pixels): deviations from the predicted medians are drawn then. Of 24 beams with
    frequencies from 2.4 to 8 Hz it is 0.04.
    """
    curves: int = 8
    """The most experiments whose series are drawn as curves."""
    gap: float = 0.04
    """Distance between the rows of two names on the axis, as a share of the number of all rows."""
    apart: float = 0.08
    """Distance between the bars of two values of the second condition, as a share of the least
    distance between two values of the first.
    """


OPENING = OpeningSettings()


def opening_charts(
    document: Document,
    measured: Sequence[tuple[MeasuredValues, Series]],
    individuals: Individuals | None = None,
    ceiling: Document | None = None,
) -> Iterator[Chart]:
    """The outcomes of one of the `measured` responses in the bands of the law, and the first laws.

    The response is that of the first question of the study about one, else the first of all. The
    laws stand beside the outcomes, two of them in the same row of a page.
    """
    shown = {seen.response: (seen, source) for seen, source in measured}
    asked = [answer["outcome"] for answer in document.get("answers") or ()]
    first = next((shown[name] for name in (*asked, *shown) if name in shown), None)
    if first is not None and first[0].by_law and len(first[0]):
        noise = bool(document.get("quadrature"))
        yield outcome_chart(*first, varying(document), noise=noise)
    for name in opening_laws(document):
        yield replace(law_chart(document, name, individuals, ceiling), height=HEIGHT)


def opening_laws(document: Document, settings: OpeningSettings = OPENING) -> list[str]:
    """The parameters whose laws are on the first screen."""
    return [*law_curves(document)][: settings.laws]


def outcome_chart(
    seen: MeasuredValues, source: Series, series: str | None, *, noise: bool
) -> Chart:
    """Measured outcomes in the bands with 95 % and 50 % of the law, and of the `noise` if any.

    x is the condition that alone determines the prediction: the column `series` that varies within
    experiments, else the condition that orders the predicted medians best. If no condition alone
    does, experiments with the same other conditions are drawn over the `series`, each a curve
    (see `_alike`). Without a series, a second condition of few values has a color for each; else
    all outcomes are drawn from the lowest predicted median to the highest, one after the other for
    each of a few names in a column (see `_by_name`). Deviations from the median are drawn where the
    bands would be a hair (see
    `OpeningSettings.hair`). `source` has the rows that are drawn as points.
    """
    caption = _caption(seen, noise=noise)
    choice = _condition(seen, series)
    drawn = seen
    if _is_hair(seen):
        drawn = seen.deviations()
        source = drawn.thinned().named_series("deviations")
        what = "ratio to" if seen.log else "deviation from"
        caption += (
            f" Drawn is the {what} the predicted median: outcomes themselves differ so much "
            "between conditions that their scatter could not be seen."
        )
    if choice is not None and _determines(seen, choice):
        return _bands(drawn, source, choice, caption)
    if choice is not None and series is not None:
        own, which, told = _alike(seen, choice)
        if _determines(own, choice):
            told = f"{_caption(own, noise=noise)} {told}"
            made = _bands(own, own.named_series("alike"), choice, told, f", {which}")
            lines = lines_of(own, choice, [*dict.fromkeys(own.columns["id"])])
            curves = Series("curves", {"id": [*lines], **{
                name: [line[key] for line in lines.values()]
                for name, key in (("x", "x"), ("y", "value"))
            }})  # fmt: skip
            *bands, points = made.marks
            curve = Mark("lines", curves, color=chart.GRAY, width=CHARTS.thin)
            return replace(made, marks=[*bands, curve, points])
    if choice is not None and series is None and (second := _second(seen, choice)) is not None:
        return _bars(drawn, choice, second, caption)
    factor = _factor(seen)
    if factor is not None:
        drawn, axis = _by_name(drawn, factor)
        source = drawn.thinned().named_series("by-name")
    made = predicted_chart(drawn, source)
    return replace(
        made, name="outcomes", title=_title(seen), caption=caption, height=HEIGHT, switched=False,
        wide=False, x=made.x if factor is None else axis,
    )  # fmt: skip


def _factor(seen: MeasuredValues, settings: OpeningSettings = OPENING) -> AxisChoice | None:
    """The first column of a few names on which the predictions depend, as far as the rows tell.

    They do not depend on it if rows that differ in nothing else have equal predictions.
    """
    named = [one for one in seen.choices if one.name]
    width = np.nan_to_num(seen.array("q0.975") - seen.array("q0.025"), nan=np.inf)
    for one in named:
        values = {*seen.columns[one.key]}
        if one.labels is None or None in values or not 1 < len(values) <= settings.groups:
            continue
        others = [seen.columns[other.key] for other in named if other != one]
        alike: dict[tuple[Any, ...], list[int]] = {}
        for k in range(len(seen)):
            alike.setdefault(tuple(column[k] for column in others), []).append(k)
        middle, told = seen.array("q0.5"), False
        for rows in alike.values():
            told |= len({seen.columns[one.key][k] for k in rows}) > 1
            if np.ptp(middle[rows]) > settings.alike * width[rows].max():
                return one
        if not told:
            return one
    return None


def _by_name(
    seen: MeasuredValues, factor: AxisChoice, settings: OpeningSettings = OPENING
) -> tuple[MeasuredValues, Axis]:
    """The rows in groups by the names of a column, and the axis that has these names.

    In each group the lowest predicted median is the first.
    """
    assert factor.labels is not None
    codes, group = np.unique(seen.array(factor.key), return_inverse=True)
    order = np.lexsort((seen.array("order"), group))
    place = np.empty(len(seen))
    place[order] = np.arange(len(seen)) + settings.gap * len(seen) * group[order]
    middle = [
        (
            float(np.mean([place[group == k].min(), place[group == k].max()])),
            factor.labels[int(one)],
        )
        for k, one in enumerate(codes)
    ]
    title = f"{factor.title}, each with the lowest predicted median first"
    return replace(seen, columns={**seen.columns, "order": place.tolist()}), Axis(
        title, names=middle
    )


def _is_hair(seen: MeasuredValues, settings: OpeningSettings = OPENING) -> bool:
    """Whether outcomes differ so widely that the 95 % ranges look like a line."""
    columns = np.array([seen.array(key) for key in ("q0.025", "q0.975", "value")])
    with np.errstate(invalid="ignore", divide="ignore"):
        columns = np.log(columns) if seen.log else columns
    unknown = np.any(np.isnan(columns), axis=0)
    if np.all(unknown) or np.any(np.isinf(columns)):
        return False
    columns = columns[:, ~unknown]
    low, high, _ = columns
    return bool(np.median(high - low) < settings.hair * np.ptp(columns))


def _title(seen: MeasuredValues) -> str:
    return f"{seen.response}: measured and expected"


def _caption(seen: MeasuredValues, *, noise: bool) -> str:
    """What the bands are, and how many measured values lie outside of the 95 %."""
    by = "the law and the noise" if noise else "the law"
    words = (
        f"Where 95 % and 50 % of new experiments are expected, by {by} at "
        f"the estimate. Outside the 95 % are {seen.outside_of}"
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
    changing = [one for one in seen.choices if one.name and len({*seen.columns[one.key]}) > 1]
    alone = changing == [choice]
    return values.size < at.size or alone or bool(np.all(steps >= 0.0) or np.all(steps <= 0.0))


def _alike(
    seen: MeasuredValues, series: AxisChoice, settings: OpeningSettings = OPENING
) -> tuple[MeasuredValues, str, str]:
    """The rows of a few experiments under the same conditions but for those of the `series`.

    The conditions are those of most experiments; where several are equally frequent, the middle
    ones in the order of the table. The texts name them, and say how many experiments are drawn.
    """
    others = [one for one in seen.choices if one.name and one != series]
    under: dict[tuple[Any, ...], dict[str, list[int]]] = {}
    for k, one in enumerate(seen.columns["id"]):
        at = tuple(seen.columns[other.key][k] for other in others)
        under.setdefault(at, {}).setdefault(one, []).append(k)
    most = max(map(len, under.values()))
    groups = [group for group in under.values() if len(group) == most]
    group = groups[(len(groups) - 1) // 2]
    drawn = [[*group][k] for k in evenly(len(group), settings.curves)]
    rows = [k for one in drawn for k in group[one]]
    apart = [one for one in others if len({*seen.columns[one.key]}) > 1]
    named = [f"{one.name} {seen.columns[f'{one.key}_shown'][rows[0]]}" for one in apart]
    which = ", ".join(named) if most > 1 and named else f"experiment {', '.join(drawn)}"
    count = len({*seen.columns["id"]})
    told = f"Lines join the values of each experiment; {len(drawn)} of {count:,} are drawn."
    return seen.part(rows), which, told


def _second(
    seen: MeasuredValues, first: AxisChoice, settings: OpeningSettings = OPENING
) -> AxisChoice | None:
    """The condition of few values that determines the predictions together with the `first`."""
    if np.unique(seen.array(first.key)).size > settings.values:
        return None
    for one in seen.choices:
        values = {*seen.columns[one.key]}
        if not one.name or one == first or None in values or len(values) > settings.groups:
            continue
        parts = [_rows(seen, one, value) for value in values]
        if len(values) > 1 and all(_determines(part, first) for part in parts):
            return one
    return None


def _rows(seen: MeasuredValues, choice: AxisChoice, value: Any) -> MeasuredValues:
    """The rows with one value of a condition."""
    return seen.part([k for k, own in enumerate(seen.columns[choice.key]) if own == value])


def _bars(
    seen: MeasuredValues,
    first: AxisChoice,
    second: AxisChoice,
    caption: str,
    settings: OpeningSettings = OPENING,
) -> Chart:
    """Bars over the `first` condition, side by side for the values of the `second`."""
    values = sorted({*seen.columns[second.key]})
    at = np.unique(seen.array(first.key))
    apart = settings.apart * float(np.min(np.diff(at))) if at.size > 1 else settings.apart
    whole, least, most = CHARTS.spans
    thick = float(np.clip(settings.apart * whole / at.size, least, most))

    def beside(some: MeasuredValues) -> Array:
        place = np.array([values.index(value) for value in some.columns[second.key]])
        return some.array(first.key) + apart * (place - 0.5 * (len(values) - 1))

    few = seen.thinned()
    source = few.named_series("by-two")
    source = Series(source.name, {**source.columns, "x": beside(few).tolist()})
    marks: list[Mark] = []
    for value, (color, dash) in zip(values, GROUP_LOOKS, strict=False):
        name = second.labels[value] if second.labels else f"{value:g}"
        own = _rows(seen, second, value)
        x, once = np.unique(beside(own), return_index=True)
        part = {"x": x, **{key: own.array(key)[once] for key in COLUMNS}}
        group = Series(f"by-two-{len(marks)}", part)
        marks += [
            *(Mark("spans", group, y=low, high=high, color=color, width=thick,
                   alpha=CHARTS.behind) for low, high, _, _ in BANDS),
            Mark("line", group, y="q0.5", color=color, dash=dash, width=2.0,
                 legend=f"{second.title} {name}"),
        ]  # fmt: skip
    marks.append(
        Mark("points", source, "x", "value", color="color", marker="marker", size="size",
             hover=hover(seen), pick=True)
    )  # fmt: skip
    told = f"Bars of equal {first.name} stand side by side; lines join the medians."
    return Chart(
        "outcomes", _title(seen), f"{caption} {told}", Axis(first.title),
        Axis(seen.label, seen.log), marks,
        {"id": "id", first.key: first.title, second.key: second.title, "value": seen.response},
        height=HEIGHT, data=source,
    )  # fmt: skip


def _bands(
    seen: MeasuredValues, source: Series, choice: AxisChoice, caption: str, which: str = ""
) -> Chart:
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
        "outcomes", _title(seen) + which, caption, Axis(choice.title),
        Axis(seen.label, seen.log), marks,
        {"id": "id", choice.key: choice.title, "value": seen.response}, height=HEIGHT, data=source,
    )  # fmt: skip
