"""The page of two identifications side by side: verdicts, estimates, laws, and predictions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from aleator.results.answer import estimates, lead, log_likelihood, verdicts
from aleator.results.printed import (
    AMOUNTS,
    PAGE,
    Amounts,
    Chapter,
    Column,
    Content,
    Part,
    Sentence,
    TextTable,
    heads,
    to_three,
)
from aleator.results.units import label
from aleator.views import chart
from aleator.views.chart import Axis, Chart, GuideLine, Mark, Series, evenly, numbers
from aleator.views.computation import missing
from aleator.views.law_charts import law_curves
from aleator.views.measured import AxisChoice, measured
from aleator.views.outcome_charts import (
    PROBABILITY,
    curve_and_band,
    predicted_chart,
    probabilities,
)
from aleator.views.page import written

Document = Mapping[str, Any]
Pair = Mapping[str, Document]
LOOKS = ((chart.BLUE, "solid"), (chart.VERMILION, "dashed"))
"""Color and line style of each identification; the style serves readers who see no colors."""


def compared_page(documents: Pair) -> str:
    """The HTML page of two identifications; `documents` has the content of each by its name.

    Equal documents give equal text.
    """
    choices: dict[str, Sequence[AxisChoice]] = {}
    predicted: list[Part] = []
    number = 0
    for name, document in documents.items():
        predicted.append(Sentence(name, "heading"))
        for seen in measured(document):
            source = seen.thinned().series(number)
            choices[source.name] = seen.choices
            drawn = replace(predicted_chart(seen, source), wide=False)
            predicted += [drawn] if seen.by_law else []
            number += 1
    sections = [
        Chapter("estimates", "Estimates", [*_estimates(documents)]),
        Chapter("law", "The laws of the parameters", [*_laws(documents)]),
        Chapter("prefer", "Which experiments prefer which", [*_experiments(documents)]),
        Chapter("calibration", "Calibration", [_calibration(documents)]),
        Chapter("predicted", "Measured against predicted", predicted),
    ]
    said = [
        replace(one, text=f"{name}: {one.text}")
        for name, document in documents.items()
        for one in (*lead(document), log_likelihood(document))
    ]
    both = [
        replace(one, text=f"{name}, {one.text}")
        for name, document in documents.items()
        for one in verdicts(document)
    ]
    warned = [Sentence("Each report has those of its own.")]
    return written(Content(" and ".join(documents), said, sections, warned, both), choices)


def _estimates(documents: Pair) -> Iterator[Part]:
    rows = {name: {row[0]: row for row in estimates(d).rows} for name, d in documents.items()}
    every = dict.fromkeys(alpha for own in rows.values() for alpha in own)
    columns: list[Column] = [("hyperparameter", "left")]
    columns += [(f"{what}, {name}", "right") for name in documents
              for what in ("estimate", "std. error", "95 % interval")]  # fmt: skip
    none = ("", "-", "-", "-", "")
    cells = [
        (alpha, *(cell for own in rows.values() for cell in own.get(alpha, none)[1:4]))
        for alpha in every
    ]
    yield TextTable(columns, cells, "estimates", "Estimates")
    likelihoods = [
        (name, to_three(d["log_likelihood"]["estimated"]),
         str(sum(not entry.get("fixed") for entry in d["alpha"].values())))
        for name, d in documents.items()
    ]  # fmt: skip
    columns = heads("model", ">log-likelihood", ">identified")
    yield TextTable(columns, likelihoods, "likelihoods", "Log-likelihoods")
    if _same_data(documents):
        yield Sentence("Both saw the same outcomes.")
    else:
        yield missing(
            "The two did not see the same outcomes: their log-likelihoods cannot be compared.",
            "Identify both from the same table, with the same transform.",
        )
    yield Sentence("To judge which model is to be believed, use aleator compare.")


def _same_data(documents: Pair) -> bool:
    def data(document: Document) -> list[Any]:
        if seen := document.get("observations"):
            return sorted((e["id"], e["row"], e["lower"] or 0, e["upper"] or 0) for e in seen)
        return sorted((e["id"], k, e["outcome"]) for k, e in enumerate(document["experiments"]))

    first, second = (data(document) for document in documents.values())
    return first == second


def _laws(documents: Pair) -> Iterator[Chart]:
    curves = {name: law_curves(document) for name, document in documents.items()}
    for parameter in dict.fromkeys(parameter for own in curves.values() for parameter in own):
        labels = {label(document, parameter) for document in documents.values()}
        lines = {
            name: (numbers(own[parameter]["x"]), numbers(own[parameter]["density"]))
            for name, own in curves.items()
            if parameter in own
        }
        head = labels.pop() if len(labels) == 1 else parameter
        yield _two(f"law-{parameter}", f"Law of {parameter}", "The densities at the estimates.",
                   (head, "density"), [*documents], lines)  # fmt: skip


def _two(
    name: str,
    title: str,
    caption: str,
    heads: tuple[str, str],
    names: Sequence[str],
    lines: Mapping[str, tuple[Any, Any]],
    behind: Sequence[Mark] = (),
) -> Chart:
    """A chart of two identifications, with a line for each of them that has the quantity."""
    marks = []
    for model, (color, dash) in zip(names, LOOKS, strict=True):
        if model in lines:
            source = Series(model, dict(zip("xy", lines[model], strict=True)))
            marks.append(Mark("line", source, color=color, dash=dash, width=2.0, legend=model))
    x, y = zip(*([side.tolist() for side in line] for line in lines.values()), strict=True)
    every = Series(name, {"of": [*lines], "x": x, "y": y})
    clear = Mark("lines", every, alpha=0.0)
    return Chart(
        name, title, caption, Axis(heads[0]), Axis(heads[1]), [*behind, *marks, clear],
        {"of": "of", "x": heads[0], "y": heads[1]}, data=every,
    )  # fmt: skip


def _experiments(documents: Pair, amounts: Amounts = AMOUNTS) -> Iterator[Part]:
    """The difference between two identifications in the log-density of each experiment."""
    each = [
        {str(e["id"]): e["log_density"] for e in d["experiments"] if e["log_density"] is not None}
        for d in documents.values()
    ]
    ids = [one for one in each[0] if one in each[1]]
    if not ids or not _same_data(documents):
        yield missing("There are no experiments in common.", "")
        return
    gain = np.array([each[1][one] - each[0][one] for one in ids])
    order = np.argsort(gain, kind="stable")
    kept = evenly(len(ids), amounts.marks)
    first, second = documents
    source = Series(
        "prefer",
        {"id": [ids[order[k]] for k in kept], "place": [k + 1 for k in kept],
         "gain": gain[order][kept]},
    )  # fmt: skip
    yield Chart(
        "prefer", f"{second} minus {first}",
        f"Above zero: {second} makes the experiment more likely. One far out says what decides.",
        Axis("experiments, in the order of the difference"), Axis("log-density, difference"),
        [Mark("points", source, "place", "gain", color=chart.INK, pick=True,
              hover=[("experiment", "{id}"), ("difference", "{gain}")])],
        {"id": "id", "gain": f"log-density of {second} minus {first}"}, [GuideLine(0.0)], wide=True,
    )  # fmt: skip


def _calibration(documents: Pair) -> Part:
    known = {name: probabilities(measured(document))[0] for name, document in documents.items()}
    marks = {name: curve_and_band(pit) for name, pit in known.items() if pit.size}
    if not marks:
        return Sentence("No probability is known.", "missing", depth=PAGE)
    lines = {
        name: (line.series.array("x"), line.series.array("y")) for name, (_, line) in marks.items()
    }
    band, _ = next(iter(marks.values()))
    found = _two(
        "calibration", "The whole curves and the 95 % band",
        "Of a right model the whole curve stays within the gray band, in 95 % of all cases. The "
        "band is that of the first.",
        (PROBABILITY, "cumulative share − uniform"), [*documents], lines, [band],
    )  # fmt: skip
    return replace(found, rules=[GuideLine(0.0)], wide=True)
