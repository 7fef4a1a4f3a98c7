"""The page of an identification: which sections it has, in which order."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from aleator.report.html.calibration import calibration
from aleator.report.html.effort import effort, surfaces
from aleator.report.html.estimates import estimates
from aleator.report.html.experiments import experiments
from aleator.report.html.frame import whole_page
from aleator.report.html.individuals import individuals, individuals_of
from aleator.report.html.law import law
from aleator.report.html.opening import opening, warnings
from aleator.report.html.origin import origin
from aleator.report.html.predicted import predicted, source_of
from aleator.report.html.rows import measured
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
    axes = {str(s.name): one.axes for s, one in zip(sources, seen, strict=True)}
    if own is not None:
        axes |= {str(own.source.name): own.axes}
    return whole_page(
        str(document.get("title") or "Identification"),
        opening(document),
        [part for part in sections if part is not None],
        axes,
        list(dict.fromkeys(one for source in sources for one in source.data["id"])),
    )
