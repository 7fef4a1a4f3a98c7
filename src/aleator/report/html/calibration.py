"""Calibration: are the probabilities of what was measured uniform? And all tests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from aleator.inference.calibration import counted, cumulated
from aleator.report.html import colors
from aleator.report.html.chart import Chart, axes, points, shared, straight
from aleator.report.html.markup import Section, folded, missing, side_by_side, table
from aleator.report.html.rows import MOST, Measured, numbers
from aleator.results.printed import number

Document = Mapping[str, Any]
P = "probability of a smaller value"


def calibration(document: Document, all_measured: Sequence[Measured]) -> Section:
    """Histogram and cumulative distribution of the probabilities, and the tests."""
    pit = np.concatenate([seen.array("pit") for seen in all_measured])
    ids = [one for seen in all_measured for one in seen.columns["id"]]
    known = np.isfinite(pit)
    parts: list[Any] = []
    if known.any():
        named = [one for one, is_known in zip(ids, known, strict=True) if is_known]
        parts += side_by_side(_histogram(pit[known]), _cumulative(pit[known], named))
    else:
        parts.append(missing("No probability is known.", "The warnings say why."))
    return Section.of("calibration", "Calibration and tests", *parts, *_tests(document))


def _histogram(pit: Any) -> Chart:
    found = counted(pit)
    plot = axes(P, "count")
    left, right = found.edges[:-1], found.edges[1:]
    source = shared(
        {"left": left, "right": right, "middle": 0.5 * (left + right), "count": found.counts},
        name="pit-histogram",
    )
    plot.quad(left=0.0, right=1.0, bottom=found.low, top=found.high, color=colors.BAND)
    plot.vbar("middle", 0.84 * found.edges[1], "count", source=source, color=colors.NARROW)
    straight(plot, "width", found.expected)
    plot.y_range.start = 0.0
    return Chart(
        "pit-histogram", "Each bin and its 95 % range",
        "If the model is right the bars are level, and 95 % of them end within the gray band. A "
        "hill: the law is too wide; a valley: too narrow; a slope: predictions are biased.",
        plot, source, {"left": "from", "right": "to", "count": "count"},
    )  # fmt: skip


def _cumulative(pit: Any, ids: Sequence[str]) -> Chart:
    found = cumulated(pit)
    plot = axes(P, "cumulative share − uniform")
    plot.varea(found.band_x, found.band_low, found.band_high, color=colors.BAND)
    plot.line(found.x, found.difference, color=colors.BLUE, line_width=1.6)
    order = np.argsort(pit, kind="stable")
    kept = np.unique(np.linspace(0, pit.size - 1, min(pit.size, MOST)).round().astype(int))
    share = (kept + 0.5) / pit.size
    source = shared(
        {"id": [ids[order[k]] for k in kept], "pit": pit[order][kept],
         "difference": share - pit[order][kept]},
        name="pit-cumulative",
    )  # fmt: skip
    straight(plot, "width", 0.0)
    points(plot, source, "pit", "difference", [("experiment", "@id"), (P, "@pit")], size=4.0)
    return Chart(
        "pit-cumulative", "The whole curve and its 95 % band",
        "If the model is right the whole curve stays within the gray band, in 95 % of all cases.",
        plot, source, {"id": "id", "pit": P, "difference": "cumulative share - uniform"},
    )  # fmt: skip


def _tests(document: Document) -> list[str]:
    found = (document.get("consistency") or {}).get("tests") or ()
    if not found:
        return []
    rows = [
        (row["kind"], row["of"], row["where"] or row["column"] or "", number(row["z"], 2),
         number(row["p"], 2), number(row["corrected"], 2))
        for row in sorted(found, key=lambda row: float(numbers([row["p"]])[0]))
    ]  # fmt: skip
    made = table(
        "tests", "Tests of consistency, the one that says most first",
        ["test", "of", "where", "z", "p", "p of all"], rows, text=3,
    )  # fmt: skip
    return [folded(f"All {len(rows)} tests of consistency", made) if len(rows) > 8 else made]
