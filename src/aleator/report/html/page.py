"""The page: all sections of an identification in one file that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from html import escape
from importlib.resources import files
from typing import Any

from aleator.report.html import colors
from aleator.report.html.bundle import bokeh_script, drawable, safe
from aleator.report.html.calibration import calibration
from aleator.report.html.effort import effort, surfaces
from aleator.report.html.estimates import estimates
from aleator.report.html.experiments import experiments
from aleator.report.html.individuals import Individuals, individuals, individuals_of
from aleator.report.html.law import law
from aleator.report.html.markup import Section
from aleator.report.html.opening import opening, warnings
from aleator.report.html.origin import origin
from aleator.report.html.predicted import predicted, source_of
from aleator.report.html.rows import Measured, measured
from aleator.report.html.series import series

Document = Mapping[str, Any]


def page(document: Document, ceiling: Document | None = None, study: str | None = None) -> str:
    """The text of report.html for an identification; the same documents give the same text.

    `document` is the content of identification.json, `ceiling` that of ceiling.json, and `study`
    the text of the study file, where they are known.
    """
    seen = measured(document)
    sources = [source_of(one, number) for number, one in enumerate(seen)]
    own = individuals_of(document)
    sections = [
        warnings(document),
        law(document, own, ceiling),
        estimates(document),
        predicted(seen, sources),
        calibration(document, seen),
        series(document, seen),
        None if own is None else individuals(own, document.get("shrinkage") or {}),
        surfaces(document, seen, sources),
        effort(document),
        experiments(document),
        origin(document, study),
    ]
    return _whole(document, [part for part in sections if part is not None], seen, own)


def _whole(
    document: Document,
    sections: Sequence[Section],
    seen: Sequence[Measured],
    own: Individuals | None,
) -> str:
    charts = [chart for section in sections for chart in section.charts]
    facts = {
        **drawable(charts),
        "charts": {
            chart.name: {
                "source": chart.source.name,
                "columns": dict(chart.columns),
                "switched": chart.switched,
            }
            for chart in charts
        },
        "axes": _axes(seen, own),
        "colors": colors.PAIRS,
    }
    title = str(document.get("title") or "Identification")
    links = "".join(f'<a href="#{s.name}">{escape(s.title)}</a>' for s in sections)
    body = "".join(
        f'<section id="{s.name}"><h2>{escape(s.title)}</h2>{_switch(s)}{s.body}</section>'
        for s in sections
    )
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_part('page.css')}</style></head><body>"
        f"<header><h1>{escape(title)}</h1>{opening(document)}</header>"
        f'<nav aria-label="Sections">{links}</nav>{_bar(document)}<main>{body}</main>'
        f'<script id="facts" type="application/json">{safe(facts)}</script>'
        f"<script>{bokeh_script()}</script><script>{_part('page.js')}</script></body></html>\n"
    )


def _axes(seen: Sequence[Measured], own: Individuals | None) -> list[dict[str, Any]]:
    """What can be chosen for x, by title: in each source the column that has it."""
    found: dict[str, dict[str, Any]] = {}
    shown = [(f"measured-{k}", one.axes) for k, one in enumerate(seen)]
    shown += [("individuals", own.axes)] if own is not None else []
    for source, axes in shown:
        for axis in axes:
            entry = found.setdefault(axis.title, {"title": axis.title, "of": {}})
            entry["of"][source] = {k: v for k, v in asdict(axis).items() if k != "title"}
    return list(found.values())


def _switch(section: Section) -> str:
    """A choice of x where a chart of the section has one; the page fills it."""
    if not any(chart.switched for chart in section.charts):
        return ""
    sources = " ".join(dict.fromkeys(str(c.source.name) for c in section.charts if c.switched))
    return (
        f'<p class="switch"><label>x axis <select data-axis="{escape(sources)}"></select>'
        "</label></p>"
    )


def _bar(document: Document) -> str:
    """What marks an experiment, by keyboard too."""
    listed = "".join(f"<option>{escape(str(e['id']))}</option>" for e in document["experiments"])
    return (
        '<div class="bar" role="toolbar" aria-label="Marked experiment"><label>Experiment '
        f'<input id="marked" list="ids" autocomplete="off" placeholder="none marked"></label>'
        f'<datalist id="ids">{listed}</datalist>'
        '<button type="button" id="previous" aria-label="previous experiment">◀</button>'
        '<button type="button" id="next" aria-label="next experiment">▶</button>'
        '<button type="button" id="clear">Clear</button>'
        '<button type="button" id="scheme">Light or dark</button>'
        '<span id="told" role="status"></span></div>'
    )


def _part(name: str) -> str:
    return (files("aleator.report.html") / name).read_text(encoding="utf-8")
