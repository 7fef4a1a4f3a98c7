"""What it took: surfaces, runs, failures, seconds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from aleator.report.html.chart import Chart, axes, models, points
from aleator.report.html.markup import Section, paragraph, table
from aleator.report.html.predicted import told
from aleator.report.html.response import simulated
from aleator.report.html.rows import Measured
from aleator.results.printed import number

Document = Mapping[str, Any]
SCATTER = "the outcome's scatter"
FAST = "The simulator is fast: no surface stands for it."
COLLOCATED = (
    "No surface stands for the simulator: it was run at the nodes of each law that was tried."
)


def surfaces(
    document: Document, all_measured: Sequence[Measured], sources: Sequence[Any]
) -> Section:
    """How rough the surfaces are that stand for the simulator, and where its runs failed."""
    parts: list[Any] = []
    surface = document.get("surface")
    if surface is None:
        parts.append(paragraph(COLLOCATED if _collocated(document) else FAST))
    else:
        parts.append(paragraph(_told(surface, len(document["experiments"]))))
        for seen, source in zip(all_measured, sources, strict=True):
            error = seen.columns.get("error")
            if error and any(value is not None for value in error):
                parts.append(_errors(seen, source, surface.get("against", SCATTER)))
    parts += simulated(document)
    return Section.of("surfaces", "The simulator", *parts,
                      *_failures(document))  # fmt: skip


def effort(document: Document) -> Section:
    """Runs and seconds, stage by stage, and what the search met."""
    stages, seconds = document.get("runs_by_stage") or {}, document.get("seconds") or {}
    rows = [
        [name, f"{stages.get(name, 0):,}", f"{seconds.get(name, 0.0):.1f}"]
        for name in dict.fromkeys([*stages, *seconds])
        if name != "total"
    ]
    rows.append(["all", f"{document['runs']:,}", f"{seconds.get('total', 0.0):.1f}"])
    search = document.get("search") or {}
    optima = [
        [
            ", ".join(
                f"{name} {number(value)}" for name, value in (one.get("alpha") or {}).items()
            ),
            number(one["log_likelihood"], 7),
            str(one["starts"]),
        ]
        for one in search.get("optima", ())
    ]
    return Section.of(
        "effort", "Runs and cost",
        table("runs", "Runs of the simulator, and seconds", ["stage", "runs", "seconds"], rows),
        paragraph(
            f"Search: {str(search.get('method', '')).replace('_', ' ')}, "
            f"{search.get('evaluations', 0):,} evaluations of the likelihood."
        ),
        table("optima", "Optima that the search met", ["alpha", "log-likelihood", "starts"],
              optima),
    )  # fmt: skip


def _collocated(document: Document) -> bool:
    return str(document.get("propagation", "")).startswith("collocation")


def _named(alpha: Document) -> str:
    return ", ".join(f"{name} {number(value)}" for name, value in alpha.items())


def _told(surface: Document, experiments: int) -> str:
    total = surface.get("experiments", experiments)
    parts = [f"{surface.get('converged', 0)} of {total} surfaces converged"]
    parts += [
        f"{key.replace('_', ' ')} {100 * surface[key]:.2g} %"
        for key in ("median_error", "worst_error")
        if surface.get(key) is not None
    ]
    against = surface.get("against", SCATTER)
    return f"{', '.join(parts)} of {against}, {surface.get('where', 'on the box')}."


def _errors(seen: Measured, source: Any, against: str) -> Chart:
    plot = axes(seen.axes[0].title, "error of the surface")
    plot.yaxis.formatter = models.NumeralTickFormatter(format="0.[0000] %")
    points(plot, source, "x", "error", [*told(seen), ("error", "@error{0.[0000] %}")])
    return Chart(
        f"rough-{source.name}", f"Where surfaces of {seen.response} are rough",
        f"Root-mean-square error of each surface under the identified law, over {against}.",
        plot, source, {"id": "id", "x": "x", "error": "error"}, switched=True,
    )  # fmt: skip


def _failures(document: Document) -> list[str]:
    failures = document.get("failures")
    if not failures:
        return [paragraph("No run failed.")]
    ids = list(failures["experiments"])
    named = ", ".join(ids[:20]) + (f" and {len(ids) - 20:,} more" if len(ids) > 20 else "")
    rows = [[name, number(ends[0]), number(ends[1])] for name, ends in failures["region"].items()]
    return [
        paragraph(
            f"{failures['runs']:,} of {failures['needed']:,} runs had no outcome, in the "
            f"experiments {named}. The first one said: {failures['message']}"
        ),
        table("failures", "Where runs failed", ["parameter", "from", "to"], rows),
    ]
