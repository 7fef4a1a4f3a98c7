"""The estimates: a table, profiles of the likelihood, and its surface over the weakest pair."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from scipy import stats

from aleator.inference.profile_end import DROP
from aleator.report.html import colors
from aleator.report.html.chart import Chart, axes, points, shared, straight
from aleator.report.html.markup import Section, folded, missing, paragraph, side_by_side, table
from aleator.report.html.rows import numbers
from aleator.results.printed import COLUMNS, alpha_rows, number, with_error
from aleator.results.units import label
from aleator.tasks.pictures import STEPS, finer, profile_line

Document = Mapping[str, Any]
LEVELS = (0.0, *(float(stats.chi2.ppf(p, 2)) / 2.0 for p in (0.5, 0.8, 0.95)))


def estimates(document: Document) -> Section:
    """Estimates with intervals, their profiles, and how they depend on each other."""
    pictures = document.get("pictures") or {}
    parts: list[Any] = [
        table("estimates", "Estimates", [name for name, _ in COLUMNS],
              alpha_rows(document), notes=True),
        *_correlated(document),
    ]  # fmt: skip
    profiles = pictures.get("profiles") or {}
    if not profiles:
        parts.append(
            missing(
                "There are no profiles of the likelihood in this document.",
                "They are left out where the maximum has no curvature, and of more than 3,000 "
                "observations.",
            )
        )
    alpha = document["alpha"]
    charts = [
        _profile(name, label(document, name), curve, alpha[name])
        for name, curve in profiles.items()
    ]
    parts += side_by_side(*charts)
    if pictures.get("surface") and _known(pictures["surface"]):
        parts += side_by_side(_surface(document, pictures["surface"], alpha))
    return Section.of("estimates", "Estimates", *parts)


def _correlated(document: Document) -> Iterator[str]:
    entries = document.get("parameter_correlations") or ()
    for entry in entries:
        value, error = with_error(entry["estimate"], entry["standard_error"], estimate=True)
        known = "" if entry["standard_error"] is None else f" ± {error}"
        yield paragraph(f"Correlation of {' and '.join(entry['between'])}: {value}{known}.")
    names = document["correlation"]["names"]
    if len(names) > 1:
        rows = [
            [name, *(number(value, 2) for value in row)]
            for name, row in zip(names, document["correlation"]["matrix"], strict=True)
        ]
        yield folded(
            "Correlations of the estimates",
            table("correlations", "Correlations of the estimates", ["", *names], rows),
        )


def _profile(name: str, head: str, curve: Document, entry: Document) -> Chart:
    plot = axes(head, "log-likelihood below its maximum", height=250)
    at, below = numbers(curve["at"]), numbers(curve["below"])
    source = shared({"at": at, "below": -below}, f"profile-{name}")
    plot.line(*profile_line(at, below), color=colors.BLUE, line_width=2.0)
    plot.scatter("at", "below", source=source, color=colors.BLUE, size=4.0)
    straight(plot, "width", -DROP)
    for end in entry.get("interval") or ():
        if end is not None:
            straight(plot, "height", end)
    straight(plot, "height", entry["estimate"], colors.INK)
    return Chart(
        f"profile-{name}", f"Profile of {name}",
        "The largest log-likelihood for each value. Dashed: the 95 % interval, where it has "
        "dropped by 1.92, or a limit.",
        plot, source, {"at": name, "below": "log-likelihood minus its maximum"},
    )  # fmt: skip


def _known(surface: Document) -> bool:
    """Whether there is more than a line of points."""
    below = np.isfinite([numbers(row) for row in surface["below"]])
    return bool(below.any(axis=0).sum() > 1 and below.any(axis=1).sum() > 1)


def _surface(document: Document, surface: Document, alpha: Document) -> Chart:
    first, second = surface["between"]
    plot = axes(label(document, first), label(document, second), height=380)
    x, y, below = (np.array([numbers(r) for r in surface[k]]) for k in ("first", "second", "below"))
    x, y, below = finer(x), finer(y), finer(below)
    tall = max(float(np.nanmax(below)), LEVELS[-1] + 1.0)
    plot.contour(
        x, y, below, [*LEVELS, tall], fill_color=list(colors.HEIGHTS), line_color=colors.BLUE,
        line_width=[0.0, 1.0, 1.0, 2.0, 0.0],
    )  # fmt: skip
    plot.scatter([alpha[first]["estimate"]], [alpha[second]["estimate"]], marker="cross",
                 size=14, color=colors.INK, line_width=2.0)  # fmt: skip
    grid = [side[::STEPS, ::STEPS].ravel() for side in (x, y, -below)]
    known = np.isfinite(grid[2])
    source = shared(
        {key: side[known] for key, side in zip(("x", "y", "below"), grid, strict=True)},
        name=f"surface-{first}-{second}",
    )
    points(plot, source, "x", "y", [(first, "@x"), (second, "@y"), ("below", "@below")],
           size=12.0, fill_alpha=0.0)  # fmt: skip
    return Chart(
        "surface", f"Likelihood over {first} and {second}",
        "The two estimates that are told apart worst: their correlation is "
        f"{round(surface['correlation'], 2) + 0.0:.2f}. Curves hold 50, 80 and 95 % (thick) of "
        "both together; the "
        "cross is the estimate.",
        plot, source, {"x": first, "y": second, "below": "log-likelihood minus its maximum"},
    )  # fmt: skip
