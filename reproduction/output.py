"""The files of a reproduction: a table and a figure each, the claims, an index page."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from aleator.errors import AleatorError
from aleator.tasks import documents
from reproduction.canvas import drawn
from reproduction.context import Context
from reproduction.figure import Claim, Figure, Verdict

CLAIMS, INDEX = "claims.csv", "index.md"
FORMS = ("png", "svg")


@dataclass(frozen=True)
class Made:
    """A figure that was reproduced: its claims, its files and the seconds that it took."""

    figure: Figure
    claims: tuple[Claim, ...]
    files: tuple[str, ...]
    seconds: float


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
        name = f"{figure.name}-{suffix}.csv" if suffix else f"{figure.name}.csv"
        documents.write_text(_csv(table), folder / name)
        names.append(name)
    if importlib.util.find_spec("matplotlib") is not None:
        for form in FORMS:
            name = f"{figure.name}.{form}"
            _write_bytes(drawn(result, figure.title, form), folder / name)
            names.append(name)
    return Made(figure, result.claims, tuple(names), time.perf_counter() - began)


def _csv(table: pd.DataFrame) -> str:
    return table.to_csv(index=False, lineterminator="\n", float_format="%.10g")


def _write_bytes(image: bytes, path: Path) -> None:
    try:
        path.write_bytes(image)
    except OSError as error:
        raise AleatorError(
            f"{path}: the figure cannot be written: {error.strerror}",
            "choose another folder with --output",
        ) from None


def _claims_table(made: Sequence[Made]) -> pd.DataFrame:
    columns = ("figure", "place", "statement", "paper", "ours", "verdict", "note")
    rows = [
        (m.figure.name, m.figure.place, c.statement, c.paper, c.ours, c.verdict.value, c.note)
        for m in made
        for c in m.claims
    ]
    return pd.DataFrame(rows, columns=columns)


def counts(made: Sequence[Made]) -> str:
    """How many claims hold, as a sentence.

    >>> counts([])
    '0 claims: 0 hold, 0 do not hold, 0 not comparable.'
    """
    return count_sentence([claim for m in made for claim in m.claims])


def count_sentence(claims: Sequence[Claim]) -> str:
    """How many of these claims hold."""
    verdicts = [claim.verdict for claim in claims]
    hold, fail = verdicts.count(Verdict.HOLDS), verdicts.count(Verdict.FAILS)
    return (
        f"{len(verdicts)} claims: {hold} hold, {fail} do not hold, "
        f"{len(verdicts) - hold - fail} not comparable."
    )


def page(made: Sequence[Made]) -> str:
    """The index page: every figure with what the paper says and what was measured here."""
    parts = [
        "# The paper, reproduced\n",
        "Every statement of the paper that a figure supports, beside what was measured here. "
        "The measurements of the wet clutch are synthetic, because the authors' are not public: "
        "numbers differ, and each line says whether the claim holds here all the same.\n",
        f"{counts(made)}\n",
    ]
    for m in made:
        parts.append(f"## {m.figure.name} ({m.figure.place})\n")
        parts.append(f"{m.figure.title}.\n")
        pictures = [name for name in m.files if name.endswith(".png")]
        parts += [f"![{m.figure.title}]({name})\n" for name in pictures]
        parts.append(claims_table(m.claims))
        listed = ", ".join(f"[{name}]({name})" for name in m.files)
        parts.append(f"Files: {listed}\n")
    return "\n".join(parts)


def claims_table(claims: Sequence[Claim]) -> str:
    """Claims as a Markdown table."""
    lines = ["| the paper | its value | here | verdict |", "|---|---|---|---|"]
    for claim in claims:
        ours = f"{claim.ours}<br>*{claim.note}*" if claim.note else claim.ours
        cells = (claim.statement, claim.paper, ours, f"**{claim.verdict.value}**")
        lines.append("| " + " | ".join(cell.replace("|", "&#124;") for cell in cells) + " |")
    return "\n".join(lines) + "\n"
