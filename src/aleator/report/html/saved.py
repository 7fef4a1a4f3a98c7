"""The report of an identification in Python: it shows in a notebook, and can be saved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from aleator.errors import AleatorError, installing
from aleator.results import documents

TALL = 900
"""Pixels of the frame in a notebook."""


@dataclass(frozen=True)
class Report:
    """The text of a page that needs no network; a notebook shows it in a frame.

    >>> Report("<p>Found</p>")
    Report of 12 characters: save it, or show it in a notebook
    """

    text: str

    def __repr__(self) -> str:
        return f"Report of {len(self.text):,} characters: save it, or show it in a notebook"

    def save(self, path: str | Path) -> Path:
        """Write the page. Raises AleatorError where that is not possible."""
        documents.write_text(self.text, path)
        return Path(path)

    def _repr_html_(self) -> str:
        """A frame of its own, so that the notebook's styles and scripts are not touched."""
        return (
            f'<iframe srcdoc="{escape(self.text)}" title="Report" '
            f'style="width:100%;height:{TALL}px;border:1px solid #ccc"></iframe>'
        )


def report_of(document: Mapping[str, Any]) -> Report:
    """The report of the content of identification.json.

    Raises AleatorError where Bokeh is not installed.
    """
    try:
        from aleator.report.html.page import page
    except ModuleNotFoundError as error:
        if error.name != "bokeh":
            raise
        raise AleatorError(
            "a report needs bokeh, which is not installed", installing("report")
        ) from None
    return Report(page(documents.plain(document)))
