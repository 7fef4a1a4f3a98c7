"""Reports as sentences and tables in sections, and how these are written as text and as HTML.

Pure functions make a `Content` from a document. This module turns it into text of a given width,
and into HTML for a notebook. `aleator.views` prints it on a terminal, and makes pages with charts.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Literal, Protocol

from scipy.stats import binom

from aleator.errors import count, quoted

if TYPE_CHECKING:
    import pandas as pd

NONE = "-"


@dataclass(frozen=True)
class TextSettings:
    """Settings of how numbers and tables are written. The values are chosen by judgement."""

    whole: float = 1e7
    """A number below this keeps all digits before the point, even if fewer are asked for."""
    least: float = 1e-4
    """A value below this is written with an exponent, not rounded to the digits of its error."""
    largest: float = 1e6
    """A value above this is written with an exponent, not rounded to the digits of its error."""
    decimals: int = 9
    """The largest number of decimals of a value with an error."""
    gap: int = 2
    """Blanks between two columns of a table."""
    indent: int = 4
    """Blanks before a text that did not fit beside the first cell and stands below it."""
    narrowest: int = 16
    """The least width of a column whose text is wrapped; without that much room it stands below."""


TEXT = TextSettings()

# ------------------------------------------------------------------------------------ numbers


def number(value: float | None, digits: int = 4, settings: TextSettings = TEXT) -> str:
    """A number with the given number of significant digits, "-" for None.

    >>> number(0.91234), number(None), number(123456.0), number(1.5e-7)
    ('0.9123', '-', '123456', '1.5e-07')
    """
    if value is None:
        return NONE
    if value and (abs(value) >= 10.0**digits) and abs(value) < settings.whole:
        return f"{value:.0f}"
    return f"{value:.{digits}g}"


def with_error(
    value: float, error: float | None, *, estimate: bool = False, settings: TextSettings = TEXT
) -> tuple[str, str]:
    """A value and its standard error as texts, both to the second significant digit of the error.

    An `estimate` keeps two digits of its own where the error is larger than the value.

    >>> with_error(0.912345, 0.01234), with_error(-9.37012, 0.2149), with_error(2.0, None)
    (('0.912', '0.012'), ('-9.37', '0.21'), ('2', '-'))
    """
    if error is None or not error > 0 or not settings.least < abs(value) + error < settings.largest:
        return number(value, settings=settings), number(error, 2, settings)
    scale = min(error, abs(value) or error) if estimate else error
    decimals = min(max(1 - math.floor(math.log10(scale)), 0), settings.decimals)
    # Adding zero turns a -0.0 that rounding left into 0.0.
    return f"{round(value, decimals) + 0.0:.{decimals}f}", f"{error:.{decimals}f}"


def between(ends: Sequence[float | None] | None, error: float | None) -> str:
    """An interval as text, its ends rounded by the standard error of the estimate; "-" for none.

    >>> between((0.88816, 0.93653), 0.01234), between(None, 0.1), between((None, 1.0), 0.1)
    ('0.888 .. 0.937', '-', '-')
    """
    known = [end for end in ends or () if end is not None]
    if len(known) < 2:
        return NONE
    return " .. ".join(with_error(end, error, estimate=True)[0] for end in known)


def percent(share: float | None, digits: int = 0) -> str:
    """A share in percent as text, "-" for none.

    >>> percent(0.4284), percent(0.4284, 1), percent(0.00004, 1), percent(-1e-9), percent(None)
    ('43 %', '42.8 %', '<0.1 %', '0 %', '-')
    """
    if share is None or math.isnan(share):
        return NONE
    least = 0.5 * 10.0**-digits
    if digits and 0.0 < 100.0 * share < least:
        return f"<{2.0 * least:g} %"
    return f"{100.0 * share:z.{digits}f} %"


def to_three(value: float | None) -> str:
    """A log-likelihood with three decimals, "-" for none.

    >>> to_three(262.51234), to_three(None)
    ('262.512', '-')
    """
    return NONE if value is None else f"{value:.3f}"


def outside(probabilities: Sequence[float], share: float = 0.05) -> str:
    """A sentence on how many values lie in the outer `share` of their predicted laws.

    `probabilities` are the predicted probabilities of a smaller value. If the predicted laws are
    right the number of outer values is binomial, and the sentence gives its 95 % range.

    >>> outside([0.01, 0.5, 0.99, 0.6])
    '2 of 4 are, and 0 to 1 would be of a right model, in 95 % of all cases.'
    """
    size, beyond = len(probabilities), sum(abs(p - 0.5) > 0.5 - 0.5 * share for p in probabilities)
    fewest, most = binom.ppf([0.5 * share, 1.0 - 0.5 * share], size, share).astype(int)
    return (
        f"{beyond} of {size:,} are, and {fewest} to {most} would be of a right model, in "
        f"{percent(1.0 - share)} of all cases."
    )


# ------------------------------------------------------------------------------------ content


Side = Literal["left", "right", "fold"]
Column = tuple[str, Side]
"""The head of a column and the alignment of its cells; the last column may be wrapped ("fold")."""


def heads(*names: str) -> list[Column]:
    """Columns by their heads: ">" marks a column of numbers, "~" one whose text is wrapped.

    >>> heads("alpha", ">estimate", "~note")
    [('alpha', 'left'), ('estimate', 'right'), ('note', 'fold')]
    """
    sides: dict[str, Side] = {">": "right", "~": "fold"}
    return [(name.lstrip(">~"), sides.get(name[:1], "left")) for name in names]


Depth = int
SHORT, WHOLE, DETAILS, PAGE = range(4)
"""How detailed a report is: short, whole, with details, or a page with everything."""
Kind = Literal[
    "plain", "finding", "strong", "good", "bad", "open", "warning", "missing", "heading", "code"
]
"""The role of a sentence, which decides how it is shown."""


@dataclass(frozen=True)
class Amounts:
    """The most entries that tables and charts show. The values are chosen by judgement."""

    notebook: int = 20
    """The most rows of a table in a notebook."""
    worst: int = 3
    """The most experiments, or observations, that are named as the most improbable ones."""
    experiments: int = 1000
    """The most rows of the table of experiments on a page; the most improbable ones are kept."""
    conditions: int = 8
    """The most columns of conditions in the table of experiments on a page."""
    failed: int = 20
    """The most experiments with failed runs that are named."""
    gaining: int = 5
    """The most experiments that are named because the best possible law fits them much better."""
    pairs: int = 5
    """The most pairs of parameters in the report of a sensitivity analysis."""
    candidates: int = 10
    """The most candidates in the report on the next experiment."""
    chosen: int = 30
    """The most experiments of a recommended set in the report on the next experiment."""
    failure: int = 10_000
    """The most characters of the message or the log of a failed run."""
    marks: int = 600
    """The most marks (points) in a chart."""
    farthest: int = 150
    """The most marks of a crowded chart that are kept because they are outermost."""
    named_conditions: int = 3
    """The most conditions that the sentence on a new experiment names; of more it names none."""
    new: int = 5
    """The most distinct conditions of which the sentence on a new experiment names each; of more it
    names the middle one.
    """
    hovered: int = 6
    """The most conditions in the tooltip of a mark in a chart."""
    series: int = 200
    """The most experiments whose curves over time a page shows."""
    observations: int = 20_000
    """The most observations in all curves of a page together."""
    named: int = 12
    """The most experiments, points of a law or subplots that a table or a figure shows."""
    across: int = 4
    """The number of subplots in a row of a figure."""
    farthest_panels: int = 4
    """The most subplots that are kept because of their large residuals."""
    letters: int = 18
    """The most characters of an experiment's id above a subplot."""


AMOUNTS = Amounts()


@dataclass(frozen=True)
class Thresholds:
    """Thresholds beyond which a report mentions a fact. Those without a source are by judgement."""

    sandwich: tuple[float, float] = (0.7, 1.4)
    """A ratio of the sandwich error to the standard error outside these limits is mentioned."""
    strong: float = 0.9
    """A correlation of two estimates is mentioned from this absolute value on."""
    chance: float = 3.0
    """A difference beyond this many standard errors is hardly due to chance (0.3 % of cases)."""
    large: float = 0.25
    """A bias of this many standard errors lowers the coverage of 95 % intervals to 94 %."""
    piled: float = 0.01
    """The share of replicates with their estimate on a limit from which on it is mentioned."""
    small: float = 4.0
    """A log-score difference of models below this is small (Sivula, Magnusson, Vehtari 2020)."""
    paired: float = 2.0
    """A difference of two models within this many standard errors may be due to chance."""
    unlikely: float = 0.05
    """The family of the law is doubted if its p value is below this."""
    gain: float = 1.5
    """Leaving an experiment out is suggested if it enlarges the feasible box by this factor."""
    rare: float = 1e-3
    """Probabilities below this are written with a power of ten."""
    missed: float = 0.01
    """The largest share of the variance that a good polynomial expansion may miss."""
    confounded: float = 0.96
    """Two parameters with an alignment above this are hard to distinguish. Their collinearity index
    1/sqrt(1 - |alignment|) is then above 5, beyond which Brun, Reichert and Kuensch (Water Resour.
    Res. 37 (2001)) expect poor identifiability."""


THRESHOLDS = Thresholds()


@dataclass(frozen=True)
class Sentence:
    """A sentence of a report, with a `head` before it and a `remedy` after it.

    `ids` are experiments that a page can mark in its charts. A report shows the sentence if its
    level of detail is at least `depth`.
    """

    text: str
    kind: Kind = "plain"
    head: str = ""
    remedy: str = ""
    ids: tuple[str, ...] = ()
    depth: Depth = SHORT

    def __str__(self) -> str:
        said = f"{self.head}: {self.text}" if self.head else self.text
        return f"{said}\n  Remedy: {self.remedy}" if self.remedy else said


@dataclass(frozen=True)
class TextTable:
    """A table of texts; a `folded` table on a page is closed until the reader opens it.

    Columns without any text are left out, except the first.
    """

    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]
    name: str = ""
    title: str = ""
    depth: Depth = SHORT
    folded: bool = False


class Part(Protocol):
    """A part of a section: a sentence, a table, or a chart of `aleator.views`."""

    @property
    def depth(self) -> Depth:
        """The lowest level of detail of a report that shows this part."""


@dataclass(frozen=True)
class Chapter:
    """A section of a report: parts under a heading, which only a page shows."""

    name: str
    title: str
    parts: Sequence[Part]


@dataclass(frozen=True)
class Content:
    """A whole report: title, introduction, sections, warnings, verdicts, and what opens it.

    The `opening` is the answer in sentences and, on a page, in charts.
    """

    title: str
    lead: Sequence[Sentence] = ()
    sections: Sequence[Chapter] = ()
    warnings: Sequence[Sentence] = ()
    verdicts: Sequence[Sentence] = ()
    opening: Sequence[Part] = ()

    @classmethod
    def of(cls, title: str, lead: str, parts: Sequence[Part], verdict: str) -> Content:
        """A report with one section and one verdict."""
        section = Chapter("all", title, parts)
        return cls(title, [Sentence(lead)], [section], (), [Sentence(verdict, "strong")])

    @property
    def verdict(self) -> str:
        """The text of the verdicts alone, a line each."""
        return "\n".join(sentence.text for sentence in self.verdicts)


def chance(value: float, digits: int = 3, thresholds: Thresholds = THRESHOLDS) -> str:
    """The text of a probability; if it is near 1, as 1 minus a small number.

    >>> chance(0.1234), chance(2.5e-5), chance(1.0 - 2.5e-5)
    ('0.123', '2.50e-05', '1 - 2.50e-05')
    """
    if math.isnan(value):
        return NONE
    if 0.0 < value < thresholds.rare:
        return f"{value:.{digits - 1}e}"
    if 1.0 - thresholds.rare < value < 1.0:
        return f"1 - {1.0 - value:.{digits - 1}e}"
    return number(value, digits)


def listed(names: Sequence[str]) -> str:
    """Names as a sentence has them.

    >>> listed(["a"]), listed(["a", "b", "c"])
    ('a', 'a, b and c')
    """
    return ", ".join(names[:-1]) + " and " + names[-1] if len(names) > 1 else names[0]


def verdict_head(verdict: Sentence) -> str:
    """The text of a verdict up to its reasons.

    >>> verdict_head(Sentence("Computed soundly: the search converged."))
    'Computed soundly.'
    """
    head, colon, _ = verdict.text.partition(":")
    return f"{head}." if colon else head


def paragraphs(content: Content, depth: Depth) -> Iterator[list[Sentence | TextTable]]:
    """The sentences and tables of a report in the order of reading; the verdicts come last."""

    def shown(parts: Sequence[Part]) -> list[Sentence | TextTable]:
        return [
            part
            for part in parts
            if isinstance(part, Sentence | TextTable)
            and part.depth <= depth
            and not (isinstance(part, TextTable) and not part.rows)
        ]

    yield [Sentence(content.title, "strong")] if content.title else []
    yield shown(content.opening)
    yield shown(content.lead)
    yield from (shown(section.parts) for section in content.sections)
    yield from (shown([warning]) for warning in content.warnings)
    yield shown(content.verdicts)


def text(content: Content, width: int = 80, depth: Depth = SHORT) -> str:
    """A report as plain text with lines of at most `width` characters."""
    lines: list[str] = []
    for paragraph in paragraphs(content, depth):
        for part in paragraph:
            if isinstance(part, TextTable):
                head, body = laid_out(part.columns, part.rows, width)
                lines += [*([part.title] if part.folded else []), *head, *body]
            else:
                lines += [
                    line
                    for each in quoted(str(part)).splitlines()
                    for line in textwrap.wrap(each, width)
                ]
    return "\n".join(lines)


# ------------------------------------------------------------------------------------ HTML


def prose(words: str) -> str:
    """Plain text as HTML; text in backticks becomes code.

    >>> prose("a < b, see `aleator box`")
    'a &lt; b, see <code>aleator box</code>'
    """
    return re.sub("`([^`]+)`", r"<code>\1</code>", escape(words))


def cells(table: TextTable) -> str:
    """The head and the rows of a table as HTML; columns without any text are left out.

    >>> '<td class="n">2</td>' in cells(TextTable([("a", "left"), ("b", "right")], [["1", "2"]]))
    True
    """
    columns, rows = _filled(table.columns, table.rows)
    kinds = [' class="n"' if side == "right" else "" for _, side in columns]
    head = "".join(
        f'<th scope="col"{kind}>{prose(name)}</th>'
        for kind, (name, _) in zip(kinds, columns, strict=True)
    )
    body = "".join(
        "<tr>"
        + "".join(f"<td{kind}>{prose(cell)}</td>" for kind, cell in zip(kinds, row, strict=True))
        + "</tr>"
        for row in rows
    )
    return f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody>"


def fragment(content: Content) -> str:
    """The short report as HTML for a notebook."""
    parts = [part for paragraph in paragraphs(content, SHORT) for part in paragraph]
    return "".join(
        f"<table>{cells(part)}</table>" if isinstance(part, TextTable) else _paragraph(part)
        for part in parts
    )


def _paragraph(part: Sentence) -> str:
    said = prose(part.text)
    if part.kind != "plain" and not part.head:
        said = f"<b>{said}</b>"
    head = f"<b>{escape(part.head)}:</b> " if part.head else ""
    remedy = f"<br>Remedy: {prose(part.remedy)}" if part.remedy else ""
    return f"<p>{head}{said}{remedy}</p>"


def shown(head: str, table: pd.DataFrame, *sentences: str, amounts: Amounts = AMOUNTS) -> str:
    """HTML of a heading, the first rows of a table, and sentences, of which the last is bold.

    >>> import pandas as pd
    >>> text = shown("40 replicates", pd.DataFrame({"bias": [0.123456]}, ["a <b>"]), "No bias.")
    >>> "0.1235" in text, "a &lt;b&gt;" in text, text.endswith("<p><b>No bias.</b></p>")
    (True, True, True)
    """
    rows = table.head(amounts.notebook).to_html(
        border=0, float_format=lambda value: number(value), na_rep="-", notebook=False
    )
    more = len(table) - amounts.notebook
    said = [f"and {count(more, 'more row')}"] if more > 0 else []
    said += [sentence for sentence in sentences if sentence]
    ending = "".join(_paragraph(Sentence(sentence)) for sentence in said[:-1])
    ending += "".join(_paragraph(Sentence(sentence, "strong")) for sentence in said[-1:])
    return f"<p>{escape(head)}</p>{rows}{ending}"


# ------------------------------------------------------------------------- a table as text


def _filled(
    columns: Sequence[Column], rows: Sequence[Sequence[str]]
) -> tuple[Sequence[Column], Sequence[Sequence[str]]]:
    """The table without the columns that have no text in any row; the first column is kept."""
    kept = [k for k in range(len(columns)) if not k or any(row[k] for row in rows)]
    return [columns[k] for k in kept], [[row[k] for k in kept] for row in rows]


def laid_out(
    columns: Sequence[Column],
    rows: Sequence[Sequence[str]],
    width: int = 80,
    settings: TextSettings = TEXT,
) -> tuple[list[str], list[str]]:
    """The head and the rows of a table, each as lines of at most `width` characters.

    A first cell that is too long for its column has a line of its own. A wrapped cell also has
    lines of its own if there is no room beside the other cells. If even the other columns do not
    fit, each cell has its own line and there is no head. Only a word that is longer than a line is
    cut.

    >>> head, body = laid_out([("law", "left"), ("mean", "right")],
    ...                       [("v", "1.5"), ("a_long_name", "2")], width=14)
    >>> print("\\n".join(head + body))
    law       mean
    v          1.5
    a_long_name
                 2
    """
    columns, rows = _filled(columns, rows)
    rows = [[quoted(cell) for cell in row] for row in rows]
    names = [name for name, _ in columns]
    every = [names, *rows]
    folds = columns[-1][1] == "fold" and len(columns) > 1
    fixed = len(columns) - folds
    wide = [max(len(row[k]) for row in every) for k in range(fixed)]
    rest = sum(wide[1:]) + settings.gap * (fixed - 1)
    note = _least([row[-1] for row in every], settings) if folds else 0
    if rest + note + settings.gap + max(settings.indent, len(names[0])) > width:
        note = 0
    if rest + settings.indent > width:
        return [], [line for row in rows for line in _stacked(names, row, width, settings)]
    room = width - rest - (note + settings.gap if note else 0)
    wide[0] = min(wide[0], room)
    beside = sum(wide) + settings.gap * (fixed - 1) + settings.gap if note else None
    head = _row(columns, names, wide, beside, width, settings) if any(names) else []
    return head, [
        line for row in rows for line in _row(columns, row, wide, beside, width, settings)
    ]


def _least(cells: Sequence[str], settings: TextSettings) -> int:
    """The least width of a wrapped column: at least the length of its longest word."""
    words = [len(word) for cell in cells for word in cell.split()]
    return max(min(settings.narrowest, max(map(len, cells))), *words)


def _row(
    columns: Sequence[Column],
    row: Sequence[str],
    wide: Sequence[int],
    beside: int | None,
    width: int,
    settings: TextSettings = TEXT,
) -> list[str]:
    """The lines of one row; its wrapped cell begins at column `beside`, or on a new line."""
    fixed = len(wide)
    note = row[-1] if fixed < len(columns) else ""
    cells = [*row[:fixed]]
    lines = []
    if len(cells[0]) > wide[0]:
        lines += _folded(cells[0], 0, width)
        cells[0] = ""
    placed = [
        cell.rjust(size) if side == "right" else cell.ljust(size)
        for cell, size, (_, side) in zip(cells, wide, columns, strict=False)
    ]
    line = (" " * settings.gap).join(placed)
    if beside is None:
        return [*lines, line.rstrip(), *_folded(note, settings.indent, width)]
    first, *others = _folded(note, beside, width) or [""]
    return [*lines, (line + first[len(line) :]).rstrip(), *others]


def _stacked(
    names: Sequence[str], row: Sequence[str], width: int, settings: TextSettings = TEXT
) -> list[str]:
    """The lines of a row in which each cell has a line of its own."""
    lines = _folded(row[0], 0, width)
    for name, cell in zip(names[1:], row[1:], strict=True):
        lines += (
            _folded(f"{name}: {cell}" if name else cell, settings.indent, width) if cell else []
        )
    return lines


def _folded(text: str, indent: int, width: int) -> list[str]:
    """The lines of a text wrapped at words, each with `indent` leading blanks."""
    margin = " " * indent
    return [
        line
        for part in text.splitlines()
        for line in textwrap.wrap(
            part, width, initial_indent=margin, subsequent_indent=margin, break_on_hyphens=False
        )
    ]
