"""Results as text that fits a width, and as HTML for a notebook: tables, numbers, sentences."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, Literal

from scipy.stats import binom

from aleator.results.units import label

if TYPE_CHECKING:
    import pandas as pd

Document = Mapping[str, Any]
NONE = "-"
COLUMNS: Sequence[Column] = (
    ("alpha", "left"), ("estimate", "right"), ("std. error", "right"), ("95 % interval", "right"),
    ("note", "fold"),
)  # fmt: skip


def number(value: float | None, digits: int = 4) -> str:
    """A number with so many significant digits, "-" for none.

    >>> number(0.91234), number(None), number(123456.0), number(1.5e-7)
    ('0.9123', '-', '123456', '1.5e-07')
    """
    if value is None:
        return NONE
    if value and (abs(value) >= 10.0**digits) and abs(value) < 1e7:
        return f"{value:.0f}"
    return f"{value:.{digits}g}"


def with_error(value: float, error: float | None, *, estimate: bool = False) -> tuple[str, str]:
    """A value and its standard error, both to the second digit of the error.

    An `estimate` keeps two digits of its own where the error is larger than itself.

    >>> with_error(0.912345, 0.01234), with_error(-9.37012, 0.2149), with_error(2.0, None)
    (('0.912', '0.012'), ('-9.37', '0.21'), ('2', '-'))
    """
    if error is None or not error > 0 or not 1e-4 < abs(value) + error < 1e6:
        return number(value), number(error, 2)
    scale = min(error, abs(value) or error) if estimate else error
    decimals = min(max(1 - math.floor(math.log10(scale)), 0), 9)
    # Adding zero turns a -0.0 that rounding left into 0.0.
    return f"{round(value, decimals) + 0.0:.{decimals}f}", f"{error:.{decimals}f}"


def outside(probabilities: Sequence[float]) -> str:
    """How many independent values lie outside their 95 %, and how many of a right model would.

    By their `probabilities` P(below), of which none is missing; the count is binomial.

    >>> outside([0.01, 0.5, 0.99, 0.6])
    '2 of 4 are, and 0 to 1 would be of a right model, in 95 % of all cases.'
    """
    count, found = len(probabilities), sum(abs(p - 0.5) > 0.475 for p in probabilities)
    fewest, most = binom.ppf([0.025, 0.975], count, 0.05).astype(int)
    return (
        f"{found} of {count:,} are, and {fewest} to {most} would be of a right model, in 95 % of "
        "all cases."
    )


def to_three(value: float | None) -> str:
    """A log-likelihood, "-" for none.

    >>> to_three(262.51234), to_three(None)
    ('262.512', '-')
    """
    return NONE if value is None else f"{value:.3f}"


def alpha_rows(document: Document) -> Iterator[tuple[str, str, str, str, str]]:
    """A row for each hyperparameter: name with unit, estimate, standard error, interval, note."""
    for name, entry in document["alpha"].items():
        error_of = entry.get("standard_error")
        estimate, error = with_error(entry["estimate"], error_of, estimate=True)
        interval = NONE
        if entry.get("interval") and None not in entry["interval"]:
            low, high = (with_error(e, error_of, estimate=True)[0] for e in entry["interval"])
            interval = f"{low} .. {high}"
        yield label(document, name), estimate, error, interval, _note(entry)


def _note(entry: Document) -> str:
    if entry.get("fixed"):
        return "fixed"
    if entry.get("at_bound"):
        return f"at its {entry['at_bound']} bound"
    notes = []
    error, sandwich = entry.get("standard_error"), entry.get("sandwich_error")
    if error and sandwich and not 0.7 < sandwich / error < 1.4:
        notes.append(f"sandwich error {number(sandwich, 2)}")
    if entry.get("cut"):
        notes.append(_to_limit(entry["cut"], entry.get("drops")))
    return ", ".join(notes)


def _to_limit(cut: str, drops: Sequence[float] | None) -> str:
    """Which ends of an interval are limits, and how far the profile has dropped there.

    >>> _to_limit("lower", (1.263, 1.92)), _to_limit("both", (0.5, 0.004))
    ('to its lower limit (drop 1.26)', 'from limit to limit (drops 0.50, 0.00)')
    """
    if cut == "both":
        told = f" (drops {drops[0]:.2f}, {drops[1]:.2f})" if drops else ""
        return f"from limit to limit{told}"
    return f"to its {cut} limit" + (f" (drop {drops[cut == 'upper']:.2f})" if drops else "")


def verdict(document: Document) -> str:
    """One sentence: whether the answer can be used, and why.

    >>> verdict({"sound": False, "warnings": [{"about": "search"}, {"about": "check"}]})
    'NOT computed soundly: do not use alpha before the warnings are dealt with (search, check).'
    """
    if document["sound"]:
        return f"Computed soundly: {_reasons(document)}."
    about = dict.fromkeys(str(entry["about"]) for entry in document.get("warnings") or [])
    named = f" ({', '.join(about)})" if about else ""
    return f"NOT computed soundly: do not use alpha before the warnings are dealt with{named}."


def second_verdict(document: Document) -> str:
    """One sentence: whether the model is consistent with the experiments, and what is not.

    Empty where the document does not say. A probability is that of all tests together.

    >>> second_verdict({"consistent": None, "consistency": {"reason": "there are only 4"}})
    'Not tested whether consistent with the experiments: there are only 4.'
    """
    found = document.get("consistency")
    if not found:
        return ""
    if document["consistent"] is None:
        return f"Not tested whether consistent with the experiments: {found['reason']}."
    if document["consistent"]:
        left = f"; {_columns(copies)} left out" if (copies := found.get("copies")) else ""
        return (
            f"Consistent with the experiments: none of {len(found['tests'])} tests contradicts the "
            f"model (p = {number(found['p'], 2)}){left}."
        )
    told = [
        f"{place}{row['message']} (p = {number(row['test']['corrected'], 1)})"
        for place, row in _counted("({}) ", found["discrepancies"])
    ]
    return f"NOT consistent with the experiments: {'; '.join(told)}."


def verdicts(document: Document) -> list[str]:
    """Both verdicts, a sentence each; the second where it is known."""
    return [line for line in (verdict(document), second_verdict(document)) if line]


def remedies(document: Document) -> list[str]:
    """What may mend a model that is not consistent, the outliers by name, what was left out."""
    found = document.get("consistency") or {}
    rows = [
        f"  Remedy{place}: {row['remedy']}."
        for place, row in _counted(" ({})", found.get("discrepancies", ()))
    ]
    outliers = [
        f"{row['id']}{_row_of(document, row)} (p = {number(row['p'], 1)})"
        for row in found.get("outliers", ())
    ]
    if outliers:
        rows += [f"  Outliers: {', '.join(outliers)}."]
    if copies := found.get("copies"):
        rows += [f"  Left out of the tests: {left_out(copies)}"]
    return rows


def left_out(copies: Sequence[str]) -> str:
    """Why columns had no say in the second verdict, and what to do if they should.

    >>> left_out(["travel_in"])[:41]
    '`travel_in`, which the outcome determines'
    """
    return (
        f"{_columns(copies)}, which the outcome determines, as in another unit, a rank, a class "
        "(pass or fail) or a ratio. If it is a condition of the tests, let the simulator or a law "
        "take it."
    )


def _columns(names: Sequence[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _counted(form: str, rows: Sequence[Document]) -> Iterator[tuple[str, Document]]:
    """Rows with a number before each; one alone needs none."""
    for place, row in enumerate(rows, start=1):
        yield form.format(place) if len(rows) > 1 else "", row


def _row_of(document: Document, outlier: Document) -> str:
    return f", row {outlier['row']}" if document.get("observations") else ""


def _reasons(document: Document) -> str:
    if not document.get("observations"):
        return f"the search converged, every density was solved{_checked(document)}"
    what = "the search converged, and more nodes do not change the answer"
    return f"{what}{_checked(document)}"


def _checked(document: Document) -> str:
    found = document["log_likelihood"]
    if document["propagation"] == "direct":
        return "; the simulator itself was integrated over"
    agrees = found.get("verified") is not None
    return ", and the simulator itself agrees" if agrees else "; not verified on the simulator"


def text(document: Document) -> str:
    """The answer in short: alpha, log-likelihood, warnings, verdict."""
    head, body = laid_out(COLUMNS, [*alpha_rows(document)])
    sentences = [log_likelihood(document)]
    for warning in document["warnings"]:
        sentences += [f"Warning, {warning['about']}: {warning['message']}"]
        sentences += [f"  Remedy: {warning['remedy']}"] if warning["remedy"] else []
    ending = (*sentences, *verdicts(document), *remedies(document))
    folded = [textwrap.fill(line, WIDTH) for line in ending]
    return "\n".join([textwrap.fill(_head(document), WIDTH), *head, *body, *folded])


def html(document: Document) -> str:
    """The same for a notebook."""
    head = "".join(f"<th>{escape(name)}</th>" for name, _ in COLUMNS)
    rows = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>"
        for row in alpha_rows(document)
    )
    warnings = "".join(
        f"<p><b>Warning, {escape(w['about'])}:</b> {escape(w['message'])}<br>"
        f"Remedy: {escape(w['remedy'])}</p>"
        for w in document["warnings"]
    )
    return (
        f"<p>{escape(_head(document))}</p>"
        f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
        f"<p>{escape(log_likelihood(document))}</p>{warnings}"
        + "".join(f"<p><b>{escape(line)}</b></p>" for line in verdicts(document))
        + "".join(f"<p>{escape(line)}</p>" for line in remedies(document))
    )


def _head(document: Document) -> str:
    free = sum(not entry["fixed"] for entry in document["alpha"].values())
    seen = document.get("observations")
    values = f" with {len(seen):,} observations" if seen else ""
    return (
        f"{free} hyperparameters identified from {len(document['experiments'])} experiments"
        f"{values}, {document['runs']:,} runs of the simulator"
    )


def principle(document: Document) -> str:
    """By what alpha was found: the maximum of the likelihood, or with priors of the posterior."""
    prior = document["log_likelihood"].get("log_prior")
    return "by maximum likelihood" if prior is None else "by maximum a posteriori"


def stated_error(likelihood: Mapping[str, Any]) -> str:
    """The error of a log-likelihood behind it, where it is known."""
    error = likelihood.get("error")
    return "" if error is None else f" +- {number(error, 2)}"


def by_name(document: Document) -> str:
    """What made the log-likelihood and those of the experiments, which sum to it.

    >>> by_name({"density": "level sets"}), by_name({})
    ('by level sets', '')
    """
    name = document.get("density")
    return f"by {name}" if name else ""


def log_likelihood(document: Document) -> str:
    """The log-likelihood, by what, with the log prior and what the check says: a sentence."""
    found = document["log_likelihood"]
    value = f"{to_three(found['estimated'])}{stated_error(found)}"
    line = f"log-likelihood {value} {by_name(document)}".rstrip()
    if (prior := found.get("log_prior")) is not None:
        line += f", log prior {to_three(prior)} (maximum a posteriori)"
    if found.get("verified") is None:
        return line
    error = number(found.get("verified_standard_error"), 2)
    return f"{line}; on the simulator itself {to_three(found['verified'])} +- {error}"


# ---------------------------------------------------------------------------------- tables of text


Side = Literal["left", "right", "fold"]
Column = tuple[str, Side]
"""The head of a column, and where its cells stand; the last column may "fold", at words."""

WIDTH = 80
GAP = 2
INDENT = 4
"""Columns by which what does not fit beside the first cell stands under it."""
NARROWEST = 16
"""A column that folds is no narrower, if its cells are as long: else it stands below."""


def laid_out(
    columns: Sequence[Column], rows: Sequence[Sequence[str]], width: int = WIDTH
) -> tuple[list[str], list[str]]:
    """The head and the rows of a table, each as lines of at most `width` letters.

    A first cell too long for its column has a line of its own; so has a folding cell where there
    is no room beside the others. Where even the other columns do not fit, each cell has a line
    and there is no head. Only a word that is longer than a line is cut.

    >>> head, body = laid_out([("law", "left"), ("mean", "right")],
    ...                       [("v", "1.5"), ("a_long_name", "2")], width=14)
    >>> print("\\n".join(head + body))
    law       mean
    v          1.5
    a_long_name
                 2
    """
    if columns[-1][1] == "fold" and not any(row[-1] for row in rows):
        columns, rows = columns[:-1], [row[:-1] for row in rows]
    names = [name for name, _ in columns]
    every = [names, *rows]
    folds = columns[-1][1] == "fold" and len(columns) > 1
    fixed = len(columns) - folds
    wide = [max(len(row[k]) for row in every) for k in range(fixed)]
    rest = sum(wide[1:]) + GAP * (fixed - 1)
    note = _least([row[-1] for row in every]) if folds else 0
    if rest + note + GAP + max(INDENT, len(names[0])) > width:
        note = 0
    if rest + INDENT > width:
        return [], [line for row in rows for line in _stacked(names, row, width)]
    room = width - rest - (note + GAP if note else 0)
    wide[0] = min(wide[0], room)
    beside = sum(wide) + GAP * (fixed - 1) + GAP if note else None
    head = _row(columns, names, wide, beside, width) if any(names) else []
    return head, [line for row in rows for line in _row(columns, row, wide, beside, width)]


def _least(cells: Sequence[str]) -> int:
    """The least width of a folding column: no less than its longest word."""
    words = [len(word) for cell in cells for word in cell.split()]
    return max(min(NARROWEST, max(map(len, cells))), *words)


def _row(
    columns: Sequence[Column],
    row: Sequence[str],
    wide: Sequence[int],
    beside: int | None,
    width: int,
) -> list[str]:
    """A row whose folding cell begins at the column `beside`, or on a line of its own."""
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
    line = (" " * GAP).join(placed)
    if beside is None:
        return [*lines, line.rstrip(), *_folded(note, INDENT, width)]
    first, *others = _folded(note, beside, width) or [""]
    return [*lines, (line + first[len(line) :]).rstrip(), *others]


def _stacked(names: Sequence[str], row: Sequence[str], width: int) -> list[str]:
    """A row with a line for each cell."""
    lines = _folded(row[0], 0, width)
    for name, cell in zip(names[1:], row[1:], strict=True):
        lines += _folded(f"{name}: {cell}" if name else cell, INDENT, width) if cell else []
    return lines


def _folded(text: str, indent: int, width: int) -> list[str]:
    """Paragraphs folded at words; every line begins with `indent` spaces."""
    margin = " " * indent
    return [
        line
        for part in text.splitlines()
        for line in textwrap.wrap(
            part, width, initial_indent=margin, subsequent_indent=margin, break_on_hyphens=False
        )
    ]


# ----------------------------------------------------------------------------------- in a notebook


ROWS = 20
"""Rows of a table that are shown; the first of them."""


def shown(head: str, table: pd.DataFrame, *sentences: str) -> str:
    """A result in HTML: its head, the first rows of its table, and sentences, the last one bold.

    >>> import pandas as pd
    >>> text = shown("40 replicates", pd.DataFrame({"bias": [0.123456]}, ["a <b>"]), "No bias.")
    >>> "0.1235" in text, "a &lt;b&gt;" in text, text.endswith("<p><b>No bias.</b></p>")
    (True, True, True)
    """
    rows = table.head(ROWS).to_html(
        border=0, float_format=lambda value: number(value), na_rep="-", notebook=False
    )
    more = len(table) - ROWS
    told = [f"and {more:,} more rows"] if more > 0 else []
    *others, last = [*told, *(text for text in sentences if text)] or [""]
    ending = "".join(f"<p>{escape(text)}</p>" for text in others)
    ending += f"<p><b>{escape(last)}</b></p>" if last else ""
    return f"<p>{escape(head)}</p>{rows}{ending}"
