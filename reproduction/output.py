"""The files of a reproduction: a table and a drawing each, the claims, an index page."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from aleator.results import documents
from aleator.views.axes import save_figure
from reproduction.canvas import drawn
from reproduction.context import Context
from reproduction.document import COLUMNS, page
from reproduction.figure import Figure, Made

CLAIMS, INDEX = "claims.csv", "index.md"
FORMS = ("png", "svg")


def reproduce(figures: Sequence[Figure], context: Context, folder: Path) -> list[Made]:
    """Make the figures one after the other; what is done is on the disk, also after Ctrl-C.

    Raises AleatorError where a file cannot be written. Without matplotlib there are tables and
    claims, but no drawings.
    """
    documents.make_folder(folder)
    made: list[Made] = []
    try:
        for figure in figures:
            context.progress.stage(figure.name)
            made.append(_make(figure, context, folder))
    finally:
        documents.write_text(_csv(_claims_table(made)), folder / CLAIMS)
        documents.write_text(page(made), folder / INDEX)
    return made


def _make(figure: Figure, context: Context, folder: Path) -> Made:
    began = time.perf_counter()
    result = figure.make(context)
    names = []
    for suffix, table in result.tables.items():
        names.append(f"{figure.name}-{suffix}.csv" if suffix else f"{figure.name}.csv")
        documents.write_text(_csv(table), folder / names[-1])
    if importlib.util.find_spec("matplotlib") is not None:
        canvas = drawn(result, figure.title)
        paths = [save_figure(canvas, folder / f"{figure.name}.{form}") for form in FORMS]
        names += [path.name for path in paths]
    return Made(figure, result.claims, tuple(names), time.perf_counter() - began)


def _csv(table: pd.DataFrame) -> str:
    return table.to_csv(index=False, lineterminator="\n", float_format="%.10g")


def _claims_table(made: Sequence[Made]) -> pd.DataFrame:
    rows = [
        (m.figure.name, m.figure.place, c.statement, c.paper, c.ours, c.verdict.value, c.note)
        for m in made
        for c in m.claims
    ]
    return pd.DataFrame(rows, columns=COLUMNS)
