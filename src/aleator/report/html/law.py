"""The identified law: a density for each parameter, and contours of two."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from aleator.report.html import colors
from aleator.report.html.chart import Chart, axes, legend_below, models, points, shared
from aleator.report.html.individuals import Individuals
from aleator.report.html.markup import Section, missing, paragraph, side_by_side
from aleator.report.html.rows import numbers
from aleator.results.printed import number
from aleator.results.units import label

Document = Mapping[str, Any]


def law(document: Document, individuals: Individuals | None, ceiling: Document | None) -> Section:
    """Densities with the uncertainty of alpha, what single experiments say, the best law's mass."""
    pictures = document.get("pictures") or {}
    curves = pictures.get("laws") or document.get("law_curves") or {}
    parts: list[Any] = []
    if not curves:
        parts.append(
            missing(
                "The densities are not in this document.",
                "Identify again with this version: aleator identify writes them.",
            )
        )
    parts += side_by_side(
        *(_density(n, label(document, n), c, individuals, ceiling) for n, c in curves.items())
    )
    parts += side_by_side(
        *(_joint(document, pair, individuals) for pair in pictures.get("contours") or ())
    )
    if known := _best(document, ceiling):
        parts.append(paragraph(known))
    if ceiling is None:
        parts.append(
            missing(
                "Where the best of all laws has its mass is not known here.",
                "aleator ceiling STUDY.toml with the same --output writes ceiling.json, and "
                "aleator report shows it.",
            )
        )
    return Section.of("law", "The law of the parameters", *parts)


def _best(document: Document, ceiling: Document | None) -> str:
    """What a law of any family could reach, and whether that is more than chance."""
    found = document.get("best_possible") or {}
    if ceiling is not None:
        found = {**ceiling.get("log_likelihood", {}), **(ceiling.get("bootstrap") or {})}
    if "gap" not in found:
        return ""
    text = f"A law of any family would have at most {number(found['gap'], 3)} more log-likelihood"
    if found.get("p_value") is None:
        return f"{text}."
    p = number(found["p_value"], 2)
    return f"{text}. If this law is the true one, chance makes a gap as large with p = {p}."


def _density(
    name: str,
    head: str,
    curve: Document,
    individuals: Individuals | None,
    ceiling: Document | None,
) -> Chart:
    plot = axes(head, "density")
    source = shared({key: numbers(curve[key]) for key in curve}, name=f"law-{name}")
    columns = {"x": name, "density": "density"}
    caption = "The line is the density at the estimate."
    if "lower" in curve:
        plot.varea("x", "lower", "upper", source=source, color=colors.WIDE,
                   legend_label="95 % band")  # fmt: skip
        columns |= {"lower": "density, lower", "upper": "density, upper"}
        caption += " The band holds 95 % of the densities of plausible laws, at each value."
    plot.line("x", "density", source=source, color=colors.BLUE, line_width=2.0,
              legend_label="identified law")  # fmt: skip
    if individuals is not None and name in individuals.parameters:
        points(
            plot, individuals.source, f"mean_{name}", "foot",
            [("experiment", "@id"), (head, f"@{{mean_{name}}}")],
            marker="dash", angle=1.5708, size=14.0, line_width=1.2,
            legend_label="experiments",
        ).glyph.line_color = colors.INK  # fmt: skip
        caption += " Ticks are the means of single experiments."
    points_of = [p for p in (ceiling or {}).get("points", ()) if name in p]
    if points_of:
        _masses(plot, name, points_of)
        caption += " Stems are the points of the best of all laws, with a scale on the right."
    legend_below(plot)
    return Chart(f"law-{name}", f"Law of {name}", caption, plot, source, columns)


def _masses(plot: Any, name: str, found: list[Document]) -> None:
    """The points of the best of all laws as stems, on a scale of their own."""
    mass = shared(
        {"x": [p[name] for p in found], "mass": [p["probability"] for p in found]}, f"mass-{name}"
    )
    top = 1.15 * max(p["probability"] for p in found)
    plot.y_range.renderers = list(plot.renderers)  # else the stems stretch the density's axis
    plot.extra_y_ranges = {"mass": models.Range1d(0.0, top)}
    plot.add_layout(
        models.LinearAxis(
            y_range_name="mass", axis_label="probability", axis_line_color=colors.LINE,
            major_tick_line_color=colors.LINE, major_label_text_color=colors.TEXT,
            axis_label_text_color=colors.TEXT, axis_label_text_font_style="normal",
            minor_tick_line_color=None,
        ),
        "right",
    )  # fmt: skip
    plot.segment("x", 0.0, "x", "mass", source=mass, color=colors.VERMILION, line_width=2.0,
                 y_range_name="mass", legend_label="best law")  # fmt: skip


def _joint(document: Document, pair: Document, individuals: Individuals | None) -> Chart:
    first, second = pair["between"]
    plot = axes(label(document, first), label(document, second))
    rows = [(mass, *curve) for mass, curve in pair["curves"].items()]
    source = shared(
        {
            "mass": [f"{100 * float(mass):g} %" for mass, _, _ in rows],
            "x": [numbers(x).tolist() for _, x, _ in rows],
            "y": [numbers(y).tolist() for _, _, y in rows],
            "width": [2.2 if mass == "0.5" else 1.2 for mass, _, _ in rows],
        },
        name=f"joint-{first}-{second}",
    )
    plot.multi_line("x", "y", source=source, color=colors.BLUE, line_width="width")
    shown = individuals is not None and {first, second} <= set(individuals.parameters)
    if individuals is not None and shown:
        points(
            plot, individuals.source, f"mean_{first}", f"mean_{second}",
            [("experiment", "@id"), (first, f"@{{mean_{first}}}"),
             (second, f"@{{mean_{second}}}")],
        )  # fmt: skip
    caption = "Within the thick curve lies half of the law, within the thin one 95 %." + (
        " Dots are the means of single experiments." if shown else ""
    )
    return Chart(
        f"joint-{first}-{second}", f"{first} and {second}", caption, plot, source,
        {"mass": "holds", "x": first, "y": second},
    )  # fmt: skip
