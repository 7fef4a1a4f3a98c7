"""Charts of the law, of the estimates of its hyperparameters, and of the simulator under it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from scipy import stats
from scipy.interpolate import PchipInterpolator, RectBivariateSpline, RegularGridInterpolator

from aleator.core.types import Array
from aleator.inference.pictures import PICTURES, PictureSettings
from aleator.inference.profile import DROP
from aleator.results.findings import named_values
from aleator.results.units import label, transforms, unit_of, with_unit
from aleator.views import chart
from aleator.views.chart import CHARTS, Axis, Chart, GuideLine, Mark, Series, numbers
from aleator.views.outcome_charts import Individuals

Document = Mapping[str, Any]
LEVELS = tuple(float(stats.chi2.ppf(share, 2)) / 2.0 for share in PICTURES.contours)
"""How far the log-likelihood is below its maximum at the ends of joint confidence regions.

The regions are for two hyperparameters: half of a chi-squared quantile with 2 degrees of freedom.
"""
DASHES = {"first": "dotted", "middle": "dashed", "last": "solid"}
"""The style of the line of a row, by the place of the row in its series."""
LEVEL_LOOKS = (
    (chart.BLUE, "solid"),
    (chart.VERMILION, "dashed"),
    (chart.GREEN, "dotted"),
    (chart.INK, "dashdot"),
)
"""Color and line style of the law at each level of a factor."""

# ------------------------------------------------------------------------------------ the law


def law_curves(document: Document) -> Mapping[str, Document]:
    """The curve of the density of each parameter's law, with its 95 % band if it was computed."""
    pictures = document.get("pictures") or {}
    return pictures.get("laws") or document.get("law_curves") or {}


def law_chart(
    document: Document,
    name: str,
    individuals: Individuals | None = None,
    best: Document | None = None,
) -> Chart:
    """The density of a parameter's law, with the experiments' own means as ticks.

    `best` is the content of ceiling.json; the points of its best possible law are stems.
    """
    head, told = label(document, name), (document.get("ranges") or {}).get(name) or {}
    apart = ((document.get("pictures") or {}).get("laws_by_level") or {}).get(name) or {}
    if apart:
        marks, data, caption = _by_level(document, name, apart, told)
        columns, ends = {"of": str(told.get("factor")), "x": name, "density": "density"}, []
    else:
        marks, columns, caption = _one_law(document, name)
        data = marks[0].series
        ends = [GuideLine(told[end], across=False) for end in ("lower", "upper") if told]
    if individuals is not None and name in individuals.parameters:
        mean = f"mean_{name}"
        marks.append(Mark("points", individuals.series, mean, "foot", color=chart.INK,
                          marker="tick", size=CHARTS.tick, width=CHARTS.thin, pick=True,
                          legend="experiments",
                          hover=[("experiment", "{id}"), (head, f"{{{mean}}}")]))  # fmt: skip
        caption += " Ticks are the means of single experiments."
    masses = [point for point in (best or {}).get("points", ()) if name in point]
    if masses:
        mass = {
            "x": [point[name] for point in masses],
            "foot": [0.0] * len(masses),
            "mass": [point["probability"] for point in masses],
        }
        marks.append(Mark("spans", Series(f"mass-{name}", mass), y="foot", high="mass",
                          color=chart.VERMILION, width=2.0, legend="best law",
                          right=True))  # fmt: skip
        caption += " Stems are the points of the best of all laws, with a scale on the right."
    if ends:
        caption += (
            " Dashed: the ends of the 95 %; how sure each is: half of its 95 % interval over "
            "plausible laws."
        )
    unit = unit_of(document, name)
    density = with_unit(
        "density", f"1/({unit})" if unit and not unit.isalnum() else unit and f"1/{unit}"
    )
    return Chart(
        f"law-{name}", f"Law of {name}", caption, Axis(head), Axis(density), marks, columns, ends,
        right=Axis("probability") if masses else None, data=data,
    )  # fmt: skip


def _one_law(document: Document, name: str) -> tuple[list[Mark], dict[str, str], str]:
    """The marks of one law for all experiments, the columns that are saved, and the caption."""
    curve = law_curves(document)[name]
    source = Series(f"law-{name}", {key: numbers(curve[key]) for key in curve})
    marks, columns = [], {"x": name, "density": "density"}
    caption = "The line is the density at the estimate."
    if "lower" in curve:
        marks.append(Mark("band", source, y="lower", high="upper", color=chart.WIDE,
                          legend="95 % band"))  # fmt: skip
        columns |= {"lower": "density, lower", "upper": "density, upper"}
        caption += " The band holds 95 % of the densities of plausible laws, at each value."
    marks.append(Mark("line", source, y="density", width=2.0, legend="identified law"))
    return marks, columns, caption


def _by_level(
    document: Document, name: str, apart: Mapping[str, Document], told: Document
) -> tuple[list[Mark], Series, str]:
    """The marks of the laws at the levels of a factor, their data, and the caption."""
    marks: list[Mark] = []
    rows: list[tuple[Any, ...]] = []
    for (level, curve), (color, dash) in zip(apart.items(), LEVEL_LOOKS, strict=False):
        source = Series(f"law-{name}-{len(rows)}", {key: numbers(curve[key]) for key in curve})
        said = f"{told.get('factor')} {level}"
        if "lower" in curve:
            marks.append(Mark("band", source, y="lower", high="upper", color=color,
                              alpha=CHARTS.behind))  # fmt: skip
        marks.append(Mark("line", source, y="density", color=color, dash=dash, width=2.0,
                          legend=said))  # fmt: skip
        rows.append((level, *(source.array(key).tolist() for key in ("x", "density"))))
    columns = zip(("of", "x", "density"), zip(*rows, strict=True), strict=True)
    data = Series(f"law-{name}", {key: [*column] for key, column in columns})
    marks.append(Mark("lines", data, y="density", alpha=0.0))
    caption = f"Lines are the densities at the estimate, one for each {told.get('factor')}."
    if kept := named_values(document, told.get("at") or {}):
        caption += f" The others are held at their median or most frequent: {', '.join(kept)}."
    if any("lower" in curve for curve in apart.values()):
        caption += " Bands hold 95 % of the densities of plausible laws, at each value."
    return marks, data, caption


def joint_chart(document: Document, pair: Document, individuals: Individuals | None) -> Chart:
    """The joint law of two parameters, as curves that enclose 50 % and 95 % of it."""
    first, second = pair["between"]
    rows = [(share, *curve) for share, curve in pair["curves"].items()]
    source = Series(
        f"joint-{first}-{second}",
        {
            "mass": [f"{100 * float(share):g} %" for share, _, _ in rows],
            "x": [numbers(x).tolist() for _, x, _ in rows],
            "y": [numbers(y).tolist() for _, _, y in rows],
            "width": [2.0 if share == "0.5" else CHARTS.thin for share, _, _ in rows],
        },
    )
    marks = [Mark("lines", source, width="width")]
    caption = "Within the thick curve lies half of the law, within the thin one 95 %."
    if individuals is not None and {first, second} <= {*individuals.parameters}:
        x, y = f"mean_{first}", f"mean_{second}"
        marks.append(Mark("points", individuals.series, x, y, color=chart.INK, pick=True,
                          hover=[("experiment", "{id}"), (first, f"{{{x}}}"),
                                 (second, f"{{{y}}}")]))  # fmt: skip
        caption += " Dots are the means of single experiments."
    return Chart(
        source.name, f"{first} and {second}", caption, Axis(label(document, first)),
        Axis(label(document, second)), marks, {"mass": "holds", "x": first, "y": second},
    )  # fmt: skip


# ------------------------------------------------------------------------------------ estimates


def profile_chart(document: Document, name: str, settings: PictureSettings = PICTURES) -> Chart:
    """The profile log-likelihood of a hyperparameter, with its 95 % interval.

    It is drawn to `depth` of the settings below the drop at the ends of the interval.
    """
    curve = document["pictures"]["profiles"][name]
    entry = (document.get("alpha") or {}).get(name, {})
    at, below = numbers(curve["at"]), numbers(curve["below"])
    x, y = profile_line(at, below)
    shown = below <= DROP + settings.depth
    source = Series(f"profile-{name}", {"at": at[shown], "below": -below[shown]})
    ends = [end for end in entry.get("interval") or () if end is not None]
    across = [GuideLine(end, across=False) for end in ends]
    best = [GuideLine(entry["estimate"], across=False, color=chart.INK)] if entry else []
    # Ends that are adjusted for few experiments have drops of their own.
    drops = [one for one in entry.get("drops") or () if one] if entry.get("unadjusted") else [DROP]
    told = " and ".join(f"{drop:.2f}" for drop in drops)
    return Chart(
        source.name, f"Profile of {name}",
        "The largest log-likelihood for each value. Dashed: the 95 % interval, where it has "
        f"dropped by {told}, or a limit.",
        Axis(label(document, name)), Axis("log-likelihood − maximum"),
        [
            Mark("line", Series(f"line-{name}", {"x": x, "y": y}), width=2.0),
            Mark("points", source, "at", "below", color=chart.BLUE, size=4.0),
        ],
        {"at": name, "below": "log-likelihood minus its maximum"},
        [*(GuideLine(-drop) for drop in drops), *across, *best],
        height=CHARTS.low, data=source,
    )  # fmt: skip


def surface_chart(document: Document) -> Chart | None:
    """The log-likelihood over the two most correlated estimates; None if it was not computed."""
    surface = (document.get("pictures") or {}).get("surface")
    if not surface:
        return None
    first, second = surface["between"]
    x, y, below = (np.array([numbers(r) for r in surface[k]]) for k in ("first", "second", "below"))
    known = np.isfinite(below)
    if known.any(axis=0).sum() < 2 or known.any(axis=1).sum() < 2:
        return None  # The known points lie on one line.
    best = np.unravel_index(np.nanargmin(below), below.shape)
    source = Series(
        f"surface-{first}-{second}",
        {key: side[known] for key, side in zip(("x", "y", "below"), (x, y, -below), strict=True)},
    )
    cross = Series("cross", {"x": [float(x[best])], "y": [float(y[best])]})
    return Chart(
        "surface", f"Likelihood over {first} and {second}",
        "Pairs of values that the experiments allow: inside the curves with 50, 80 and 95 % "
        "confidence (the last one thick); the cross is the estimate. Of all pairs of estimates "
        f"these are the most correlated ({round(surface['correlation'], 2) + 0.0:.2f}): near 1 or "
        "-1 a change of one is made up by a change of the other.",
        Axis(label(document, first)), Axis(label(document, second)),
        [
            Mark("contour", source, grid=(finer(x), finer(y), finer(below)), levels=LEVELS),
            Mark("points", cross, color=chart.INK, marker="cross", size=CHARTS.tick, width=2.0),
            Mark("points", source, alpha=0.0, size=CHARTS.tick, pick=True,
                 hover=[(first, "{x}"), (second, "{y}"), ("below", "{below}")]),
        ],
        {"x": first, "y": second, "below": "log-likelihood minus its maximum"},
        height=CHARTS.high,
    )  # fmt: skip


def profile_line(
    at: Array, below: Array, settings: PictureSettings = PICTURES
) -> tuple[Array, Array]:
    """A smooth line through the points of a profile log-likelihood: values x, and ordinates y.

    `below` is how far the log-likelihood is below its maximum at the ascending values `at`; the
    ordinates are minus that. The signed root of 2 `below` is interpolated, for it is nearly linear.
    The line ends where it is `depth` of the settings below the drop of a 95 % interval.

    >>> x, y = profile_line(np.array([-3.0, 0.0, 2.0]), np.array([4.5, 0.0, 2.0]))
    >>> bool(np.allclose(y, -0.5 * x**2))
    True
    """
    known = np.isfinite(below) & (np.diff(at, prepend=-np.inf) > 0.0)
    at, below = at[known], below[known]
    if at.size < 2:
        return at, -below
    root = np.sign(at - at[np.argmin(below)]) * np.sqrt(2.0 * np.maximum(below, 0.0))
    line, deepest = PchipInterpolator(at, root), np.sqrt(2.0 * (DROP + settings.depth))
    best = at[np.argmin(below)]
    left, right = (line.solve(end, extrapolate=False) for end in (-deepest, deepest))
    low = max(left[left < best], default=at[0])
    high = min(right[right > best], default=at[-1])
    x = np.union1d(np.linspace(low, high, settings.curve), at[(at >= low) & (at <= high)])
    return x, -0.5 * line(x) ** 2


def finer(grid: Array, settings: PictureSettings = PICTURES) -> Array:
    """The values of a square grid, interpolated to a finer one.

    The interpolation is a spline, or linear if some values are NaN.

    >>> side = np.arange(4.0)
    >>> steps = PICTURES.steps
    >>> bool(np.allclose(finer(np.add.outer(side, side**2))[::steps, 1], side + 1 / steps**2))
    True
    """
    at = np.arange(float(len(grid)))
    fine = np.linspace(0.0, at[-1], settings.steps * (len(grid) - 1) + 1)
    if np.all(np.isfinite(grid)):
        return np.asarray(RectBivariateSpline(at, at, grid)(fine, fine))
    between = np.meshgrid(fine, fine, indexing="ij")
    return np.asarray(RegularGridInterpolator((at, at), grid)(tuple(between)))


# ------------------------------------------------------------------------------------ the simulator


def simulator_charts(document: Document) -> Iterator[Chart]:
    """Charts of each response over each parameter, and color maps over two parameters."""
    drawn = (document.get("pictures") or {}).get("response") or {}
    for number, response in enumerate(responses_drawn(drawn)):
        shown = [entry for entry in drawn["shown"] if entry["response"] == response]
        for name in drawn.get("nodes") or drawn["over"]:
            yield response_chart(document, name, response, number)
        for place in dict.fromkeys(_place(entry) for entry in shown) if drawn.get("map") else ():
            yield _map(document, response, drawn["map"], shown, place)


def responses_drawn(drawn: Document) -> list[str]:
    """The names of the responses whose simulated values identification.json has."""
    return list(dict.fromkeys(entry["response"] for entry in drawn.get("shown", ())))


def response_chart(document: Document, name: str, response: str, number: int = 0) -> Chart:
    """A response over one parameter: a line for each experiment shown, or marks at nodes.

    With collocation the simulator ran at the nodes of the law, and there are no lines. `number` is
    the index of the response.
    """
    drawn = document["pictures"]["response"]
    shown = [entry for entry in drawn["shown"] if entry["response"] == response]
    log = transforms(document).get(response) == "log"
    at_nodes = "nodes" in drawn
    at = numbers(drawn["nodes" if at_nodes else "over"][name]).tolist()
    values = [
        numbers(entry["values"] if at_nodes else entry["curves"][name]).tolist() for entry in shown
    ]
    columns: dict[str, list[Any]] = {
        "id": [entry["id"] for entry in shown],
        "measured": [_measured(entry) for entry in shown],
        "row": [f"{_place(entry)} row" for entry in shown],
        "dash": [DASHES[_place(entry)] for entry in shown],
    }
    several = len(set(columns["row"])) > 1
    heads = {"id": "id", **({"row": "row"} if several else {}), "x": name, "y": response}
    if at_nodes:
        columns = {key: [v for v in own for _ in at] for key, own in columns.items()}
        source = Series(
            f"over-{number}-{name}",
            {**columns, "x": at * len(shown), "y": [v for own in values for v in own]},
        )
        hover = [("experiment", "{id}"), (name, "{x}"), (response, "{y}"),
                 ("measured", "{measured}")]  # fmt: skip
        mark = Mark("points", source, pick=True, hover=hover)
        caption = (
            "What the simulator returned at the nodes of the law, for some experiments. The other "
            "parameters differ from mark to mark."
        )
    else:
        source = Series(f"over-{number}-{name}", {**columns, "x": [at] * len(shown), "y": values})
        hover = [("experiment", "{id}"), ("measured", "{measured}")]
        hover[1:1] = [("", "{row}")] if several else []
        mark = Mark("lines", source, dash="dash", hover=hover, pick=True,
                    legend_by="row" if several else "")  # fmt: skip
        caption = (
            "What stands for the simulator, a line for each of some experiments, over the range of "
            "the law; all other parameters are in their middle."
        )
        caption += " Of a series: its first, middle and last row." if several else ""
    return Chart(
        source.name, f"{response} over {name}", caption, Axis(label(document, name)),
        Axis(label(document, response), log), [mark], heads | {"measured": "measured"},
    )  # fmt: skip


def _map(
    document: Document,
    response: str,
    sides: Mapping[str, Sequence[float]],
    entries: Sequence[Document],
    place: str,
) -> Chart:
    """A color map of a response over two parameters, for one row of each experiment's series.

    `place` is "first", "middle" or "last"; a curve shows where the response is the measured value.
    """
    shown = [entry for entry in entries if _place(entry) == place]
    row = "" if len(shown) == len(entries) else f"-{place}"
    (first, x), (second, y) = ((name, numbers(side)) for name, side in sides.items())
    over = np.meshgrid(x, y, indexing="ij")
    each = {
        entry["id"]: {"value": [v for row in entry["map"] for v in numbers(row).tolist()]}
        for entry in shown
    }
    levels = {entry["id"]: _level(x, y, entry) for entry in shown}
    here = shown[len(shown) // 2]["id"]
    columns = {"x": over[0].ravel().tolist(), "y": over[1].ravel().tolist(), **each[here]}
    source = Series(f"map-{response}{row}", {"id": [here] * over[0].size, **columns}, each)
    level = {"id": [here] * len(levels[here]["x"]), **levels[here]}
    line = Series(f"level-{response}{row}", level, levels)
    marks = [
        Mark("cells", source,
             step=(CHARTS.cell * float(x[1] - x[0]), CHARTS.cell * float(y[1] - y[0])),
             hover=[(first, "{x}"), (second, "{y}"), (response, "{value}")]),
        Mark("lines", line, color=chart.PAPER, width=CHARTS.halo),
        Mark("lines", line, color=chart.INK, width=CHARTS.over),
    ]  # fmt: skip
    caption = (
        f"Color: {label(document, response)} of the experiment that is marked, if it is one of "
        f"{', '.join(each)}. On the line lies what was measured."
    )
    if points := (document.get("failures") or {}).get("points"):
        failed = Series(f"failed-{response}{row}", points)
        marks += [
            Mark(
                "points",
                failed,
                first,
                second,
                color=color,
                marker="x",
                size=CHARTS.tick,
                width=width,
            )
            for color, width in ((chart.PAPER, CHARTS.halo), (chart.VERMILION, CHARTS.over))
        ]
        caption += " Crosses: failed runs of all experiments."
    return Chart(
        source.name, f"{response} over {first} and {second}{row and f', {place} row'}", caption,
        Axis(label(document, first)), Axis(label(document, second)), marks,
        {"id": "id", "x": first, "y": second, "value": response}, marked=here,
    )  # fmt: skip


def _place(entry: Document) -> str:
    """The place of an observation in its series, such as "first"; "last" in old documents."""
    return str(entry.get("place", "last"))


def _measured(entry: Document) -> float | None:
    """The measured value of an observation, or its bound if it is censored."""
    low, high = entry.get("lower"), entry.get("upper")
    return high if low is None else low


def _level(x: Array, y: Array, entry: Document) -> dict[str, list[list[float]]]:
    """The curves of a color map on which the response is the measured value."""
    from contourpy import contour_generator  # comes with the packages that draw charts

    value = _measured(entry)
    plane = np.ma.masked_invalid(np.array([numbers(row) for row in entry["map"]]).T)
    lines: Any = () if value is None else contour_generator(x, y, plane).lines(value)
    return {
        "x": [line[:, 0].tolist() for line in lines],
        "y": [line[:, 1].tolist() for line in lines],
    }
