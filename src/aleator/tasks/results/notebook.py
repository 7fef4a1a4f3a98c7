"""Results as a notebook shows them: a sentence, a small table, and what to make of it."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from aleator.tasks.results.printed import number

if TYPE_CHECKING:
    import pandas as pd

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
