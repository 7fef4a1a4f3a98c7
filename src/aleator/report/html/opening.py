"""The head of the page: both verdicts, warnings with their remedies, what was identified."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from typing import Any

from aleator.report.html.markup import Section, paragraph, prose
from aleator.results.printed import left_out, log_likelihood, number, second_verdict, verdict

Document = Mapping[str, Any]


def opening(document: Document) -> str:
    """Both verdicts, a sentence each, in a color that its words do not need."""
    second = second_verdict(document)
    parts = [_verdict(verdict(document), document["sound"])]
    if second:
        parts.append(_verdict(second, document["consistent"]))
    return "".join(parts) + paragraph(_identified(document), "lead")


def warnings(document: Document) -> Section:
    """Every warning and every discrepancy, with its remedy."""
    rows = [*_warned(document), *_contradicted(document)]
    body = "".join(rows) if rows else paragraph("There are no warnings.")
    return Section.of("warnings", "Warnings and remedies", body)


def _verdict(sentence: str, good: bool | None) -> str:
    head, colon, rest = sentence.partition(":")
    kind = "unknown" if good is None else "good" if good else "bad"
    return f'<p class="verdict {kind}"><strong>{escape(head)}</strong>{colon}{prose(rest)}</p>'


def _identified(document: Document) -> str:
    free = sum(not entry.get("fixed") for entry in document["alpha"].values())
    seen = document.get("observations") or ()
    values = f" with {len(seen):,} observations" if seen else ""
    found = log_likelihood(document).replace("+-", "±")
    return (
        f"{free} hyperparameters identified from {len(document['experiments']):,} experiments"
        f"{values}, with {document['runs']:,} runs of the simulator. "
        f"L{found[1:]}."
    )


def _warned(document: Document) -> Iterator[str]:
    for entry in document.get("warnings") or ():
        yield _item(f"Warning, {entry['about']}", entry["message"], entry.get("remedy"))


def _contradicted(document: Document) -> Iterator[str]:
    found = document.get("consistency") or {}
    for row in found.get("discrepancies", ()):
        p = number(row["test"]["corrected"], 1)
        yield _item("Not consistent", f"{row['message']} (p = {p})", row["remedy"])
    for row in found.get("outliers", ()):
        p = number(row["p"], 1)
        at = f", row {row['row']}" if document.get("observations") else ""
        yield _item("Outlier", f"experiment {row['id']}{at} (p = {p})", "", row["id"])
    if copies := found.get("copies"):
        yield _item("Left out of the tests", left_out(copies), "")


def _item(head: str, message: str, remedy: str | None, id: str | None = None) -> str:
    mended = f'<span class="remedy">Remedy: {prose(remedy)}</span>' if remedy else ""
    pick = (
        f' <button type="button" data-pick="{escape(id)}">Mark it</button>'
        if id is not None
        else ""
    )
    said = f"<strong>{escape(head)}:</strong> {prose(message)}"
    return f'<p class="warning">{said}{pick}{mended}</p>'
