"""report.html of a folder of results: what is read for it, and the writing."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aleator.errors import AleatorError
from aleator.results import documents
from aleator.results.schema import read_ceiling

REPORT = "report.html"
COMPARED = "compared.html"
CEILING = "ceiling.json"

Document = Mapping[str, Any]


def write_report(document: Document, folder: Path, study: Path | None = None) -> Path:
    """Write report.html of an identification into its folder, with what stands there beside it.

    `study` is its study file. Raises AleatorError where Bokeh is not installed.
    """
    from aleator.views.page import page

    path = folder / REPORT
    documents.write_text(page(document, _ceiling(document, folder), _text(document, study)), path)
    return path


def write_compared(document: Document, other: Document, folder: Path, beside: Path) -> Path:
    """Write compared.html of two identifications, which are called as their folders are."""
    from aleator.views.compared import compared_page

    names = [folder.name, beside.name]
    if names[0] == names[1]:
        names = [str(folder), str(beside)]
    if names[0] == names[1]:
        raise AleatorError(f"{folder}: it is compared with itself", "name another folder")
    path = folder / COMPARED
    pair = dict(zip(names, (document, other), strict=True))
    documents.write_text(compared_page(pair), path)
    return path


def study_of(document: Document, folder: Path) -> Path | None:
    """The study file that a document names, if it is there."""
    file = documents.study_entry(document).get("file")
    return folder / file if isinstance(file, str) else None


def _ceiling(document: Document, folder: Path) -> Document | None:
    """The ceiling of the same study that was written beside it; that of another is none."""
    if not (folder / CEILING).exists():
        return None
    found = read_ceiling(folder / CEILING)
    same = documents.study_entry(found).get("sha256")
    return found if same == documents.study_entry(document).get("sha256") else None


def _text(document: Document, study: Path | None) -> str | None:
    """The text of the study file; none where it is not the one that was identified."""
    try:
        content = b"" if study is None else study.read_bytes()
    except OSError:
        return None
    if hashlib.sha256(content).hexdigest() != documents.study_entry(document).get("sha256"):
        return None
    return content.decode("utf-8", "replace")
