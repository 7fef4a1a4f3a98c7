"""Two identifications side by side: verdicts, estimates, laws, predictions, experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from aleator.inference.calibration import cumulated
from aleator.report.html import colors
from aleator.report.html.chart import Chart, axes, legend_below, points, shared, straight
from aleator.report.html.frame import whole_page
from aleator.report.html.markup import Section, missing, paragraph, side_by_side, table
from aleator.report.html.opening import opening
from aleator.report.html.predicted import predicted, source_of
from aleator.report.html.rows import MOST, Measured, measured, numbers
from aleator.results.printed import alpha_rows, to_three
from aleator.results.units import label

Document = Mapping[str, Any]
LOOKS = ((colors.BLUE, "solid"), (colors.VERMILION, "dashed"))
"""Color and dash of each of the two: for those who see no color, too."""


def compared_page(documents: Mapping[str, Document]) -> str:
    """The text of a page of two identifications, by name; the same documents give the same text."""
    names = list(documents)
    found = {name: measured(document) for name, document in documents.items()}
    seen = [one for own in found.values() for one in own]
    sources = [source_of(one, number) for number, one in enumerate(seen)]
    sections = [
        _estimates(documents),
        _laws(documents),
        _experiments(documents),
        _calibration(found),
        _predicted(found, sources),
    ]
    heads = "".join(
        f"<div><h2>{escape(name)}</h2>{paragraph(str(document.get('title') or ''))}"
        f"{opening(document)}</div>"
        for name, document in documents.items()
    )
    return whole_page(
        " and ".join(names), f'<div class="row">{heads}</div>', sections,
        {str(s.name): one.axes for s, one in zip(sources, seen, strict=True)},
        list(dict.fromkeys(one for source in sources for one in source.data["id"])),
    )  # fmt: skip


def _estimates(documents: Mapping[str, Document]) -> Section:
    rows = {name: {row[0]: row for row in alpha_rows(d)} for name, d in documents.items()}
    every = dict.fromkeys(alpha for own in rows.values() for alpha in own)
    none = ("", "-", "-", "-", "")
    head = ["alpha", *(f"{what}, {name}" for name in documents
                       for what in ("estimate", "std. error", "95 % interval"))]  # fmt: skip
    cells = [
        [alpha, *(cell for own in rows.values() for cell in own.get(alpha, none)[1:4])]
        for alpha in every
    ]
    likelihoods = [
        [name, to_three(d["log_likelihood"]["estimated"]),
         str(sum(not entry.get("fixed") for entry in d["alpha"].values()))]
        for name, d in documents.items()
    ]  # fmt: skip
    alike = _same_data(documents)
    return Section.of(
        "estimates", "Estimates",
        table("estimates", "Estimates", head, cells),
        table("likelihoods", "Log-likelihoods", ["", "log-likelihood", "identified"], likelihoods),
        paragraph("Both saw the same outcomes.")
        if alike
        else missing(
            "The two did not see the same outcomes: their log-likelihoods cannot be compared.",
            "Identify both from the same table, with the same transform.",
        ),
        paragraph("Which model is to be believed is asked with aleator compare."),
    )  # fmt: skip


def _same_data(documents: Mapping[str, Document]) -> bool:
    def data(document: Document) -> list[Any]:
        seen = document.get("observations")
        if seen:
            return sorted((e["id"], e["row"], e["lower"] or 0, e["upper"] or 0) for e in seen)
        return sorted((e["id"], k + 1, e["outcome"], e["outcome"])
                      for k, e in enumerate(document["experiments"]))  # fmt: skip

    first, second = (data(document) for document in documents.values())
    return first == second


def _laws(documents: Mapping[str, Document]) -> Section:
    curves = {
        name: (d.get("pictures") or {}).get("laws") or d.get("law_curves") or {}
        for name, d in documents.items()
    }
    every = dict.fromkeys(parameter for own in curves.values() for parameter in own)
    charts = [_law(parameter, _labelled(documents, parameter), curves) for parameter in every]
    return Section.of("law", "The laws of the parameters", *side_by_side(*charts))


def _labelled(documents: Mapping[str, Document], name: str) -> str:
    """With its unit, where all agree on that."""
    found = {label(document, name) for document in documents.values()}
    return found.pop() if len(found) == 1 else name


def _law(parameter: str, head: str, curves: Mapping[str, Document]) -> Chart:
    plot = axes(head, "density")
    columns: dict[str, list[Any]] = {"of": [], "x": [], "density": []}
    for (name, own), (color, dash) in zip(curves.items(), LOOKS, strict=True):
        if parameter not in own:
            continue
        x, density = numbers(own[parameter]["x"]), numbers(own[parameter]["density"])
        plot.line(x, density, color=color, line_dash=dash, line_width=2.0, legend_label=name)
        columns["of"].append(name)
        columns["x"].append(x.tolist())
        columns["density"].append(density.tolist())
    source = shared(columns, f"law-{parameter}")
    plot.multi_line("x", "density", source=source, line_alpha=0.0)
    legend_below(plot)
    return Chart(f"law-{parameter}", f"Law of {parameter}", "The densities at the estimates.",
                 plot, source, {"of": "of", "x": parameter, "density": "density"})  # fmt: skip


def _experiments(documents: Mapping[str, Document]) -> Section:
    """The log-density of each experiment under the one and under the other."""
    each = [
        {str(e["id"]): e["log_density"] for e in d["experiments"] if e["log_density"] is not None}
        for d in documents.values()
    ]
    ids = [one for one in each[0] if one in each[1]]
    title = "Which experiments prefer which"
    if not ids or not _same_data(documents):
        return Section.of("prefer", title, missing("There are no experiments in common.", ""))
    gain = np.array([each[1][one] - each[0][one] for one in ids])
    order = np.argsort(gain, kind="stable")
    kept = np.unique(np.linspace(0, len(ids) - 1, min(len(ids), MOST)).round().astype(int))
    first, second = documents
    plot = axes("experiments, in the order of the difference", "log-density, difference")
    source = shared(
        {"id": [ids[order[k]] for k in kept], "place": kept + 1, "gain": gain[order][kept]},
        "prefer",
    )
    straight(plot, "width", 0.0)
    points(plot, source, "place", "gain", [("experiment", "@id"), ("difference", "@gain")])
    chart = Chart(
        "prefer", f"{second} minus {first}",
        f"Above zero: {second} makes the experiment more likely. One far out says what decides.",
        plot, source, {"id": "id", "gain": f"log-density of {second} minus {first}"},
    )  # fmt: skip
    return Section.of("prefer", title, chart)


def _calibration(found: Mapping[str, Sequence[Measured]]) -> Section:
    plot = axes("probability of a smaller value", "cumulative share − uniform")
    columns: dict[str, list[Any]] = {"of": [], "pit": [], "difference": []}
    for (name, own), (color, dash) in zip(found.items(), LOOKS, strict=True):
        pit = np.concatenate([seen.array("pit") for seen in own])
        pit = pit[np.isfinite(pit)]
        if not pit.size:
            continue
        curve = cumulated(pit)
        if not columns["of"]:
            plot.varea(curve.band_x, curve.band_low, curve.band_high, color=colors.BAND)
        plot.line(curve.x, curve.difference, color=color, line_dash=dash, line_width=1.8,
                  legend_label=name)  # fmt: skip
        columns["of"].append(name)
        columns["pit"].append(curve.x.tolist())
        columns["difference"].append(curve.difference.tolist())
    if not columns["of"]:
        return Section.of("calibration", "Calibration", missing("No probability is known.", ""))
    source = shared(columns, "calibration")
    plot.multi_line("pit", "difference", source=source, line_alpha=0.0)
    legend_below(plot)
    return Section.of(
        "calibration", "Calibration",
        Chart("calibration", "The whole curves and the 95 % band",
              "Of a right model the whole curve stays within the gray band, in 95 % of all cases. "
              "The band is that of the first.",
              plot, source, {"of": "of", "pit": "probability", "difference": "difference"}),
    )  # fmt: skip


def _predicted(found: Mapping[str, Sequence[Measured]], sources: Sequence[Any]) -> Section:
    bodies: list[str] = []
    charts: list[Chart] = []
    begun = 0
    for name, own in found.items():
        part = predicted(own, sources[begun : begun + len(own)])
        bodies.append(f"<div><h3>{escape(name)}</h3>{part.body}</div>")
        charts += part.charts
        begun += len(own)
    body = f'<div class="row">{"".join(bodies)}</div>'
    return Section("predicted", "Measured against predicted", body, tuple(charts))
