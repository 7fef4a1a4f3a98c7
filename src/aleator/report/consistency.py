"""All tests of consistency as a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import RenderableType

from aleator.report.rows import Rows
from aleator.results.printed import Column, number


def tests(result: Mapping[str, Any]) -> RenderableType | None:
    """All tests of consistency, the one that says most first."""
    found = (result.get("consistency") or {}).get("tests")
    if not found:
        return None
    columns: Sequence[Column] = (
        ("test", "left"), ("of", "left"), ("z", "right"), ("p", "right"), ("of all", "right"),
        ("", "fold"),
    )  # fmt: skip
    cells = [
        (
            row["kind"],
            row["of"],
            "-" if row["z"] is None else f"{row['z']:.1f}",
            number(row["p"], 2),
            number(row["corrected"], 2),
            row["where"] or row["column"] or "",
        )
        for row in sorted(found, key=lambda row: row["p"])
    ]
    return Rows(columns, cells)
