"""The parameters of single experiments: their source, and charts over the conditions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from aleator.report.html import colors
from aleator.report.html.chart import Chart, axes, points, shared
from aleator.report.html.markup import Section, side_by_side
from aleator.report.html.rows import MOST, Axis, conditions_of, numbers
from aleator.results.units import label

Document = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Individuals:
    """The individual parameters of the experiments: a source that charts share."""

    parameters: tuple[str, ...]
    source: Any
    axes: tuple[Axis, ...]
    shown: int
    count: int
    labels: Mapping[str, str]


def individuals_of(document: Document) -> Individuals | None:
    """Means and standard deviations given the observations; None where there are none."""
    entries = document["experiments"]
    if not document.get("observations") or not entries:
        return None
    count = len(entries)
    kept = np.unique(np.linspace(0, count - 1, min(count, MOST)).round().astype(int)).tolist()
    names = tuple(n for n in document.get("law_curves") or {} if n in entries[0]["mean"])
    columns: dict[str, list[Any]] = {"id": [str(entries[k]["id"]) for k in kept]}
    columns["foot"] = [0.0] * len(kept)
    for name in names:
        mean = numbers([entries[k]["mean"][name] for k in kept])
        sd = numbers([entries[k]["sd"][name] for k in kept])
        columns |= {
            f"mean_{name}": mean.tolist(),
            f"low_{name}": (mean - 1.96 * sd).tolist(),
            f"high_{name}": (mean + 1.96 * sd).tolist(),
        }
    columns["order"] = [k + 1 for k in kept]
    found = [Axis("order", "order of the table")]
    for k, (name, column) in enumerate(conditions_of(document).items()):
        texts = sorted({v for v in column if isinstance(v, str)})
        columns[f"c{k}"] = [texts.index(column[j]) if texts else column[j] for j in kept]
        found.append(Axis(f"c{k}", label(document, name), tuple(texts) or None, name))
    columns["x"] = list(columns["order"])
    source = shared(columns, "individuals")
    labels = {name: label(document, name) for name in names}
    return Individuals(names, source, tuple(found), len(kept), count, labels)


def individuals(found: Individuals, shrinkage: Mapping[str, float]) -> Section:
    """Each parameter of the experiments over a condition."""
    charts = [_over_conditions(found, name, shrinkage.get(name)) for name in found.parameters]
    return Section.of("individuals", "Parameters of single experiments", *side_by_side(*charts))


def _over_conditions(found: Individuals, name: str, share: float | None) -> Chart:
    head = found.labels[name]
    plot = axes(found.axes[0].title, head)
    plot.segment("x", f"low_{name}", "x", f"high_{name}", source=found.source,
                 color=colors.WIDE, line_width=3.0)  # fmt: skip
    points(plot, found.source, "x", f"mean_{name}",
           [("experiment", "@id"), (head, f"@{{mean_{name}}}")])  # fmt: skip
    caption = (
        "Mean and 95 % of each experiment's own law, given its observations. A trend over a "
        "condition says that the law should follow it."
    )
    if share is not None:
        caption += f" Shrinkage {100 * share:.0f} %: with much of it single means say little."
    if found.shown < found.count:
        caption += f" {found.shown} of {found.count:,} experiments are drawn."
    return Chart(
        f"individual-{name}", name, caption, plot, found.source,
        {"id": "id", "x": "x", f"mean_{name}": f"{name}, mean", f"low_{name}": f"{name}, lower",
         f"high_{name}": f"{name}, upper"},
        switched=True,
    )  # fmt: skip
