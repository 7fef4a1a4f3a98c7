"""One line of the table that `make bench` prints, and the table."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from rich.table import Table


@dataclass(frozen=True)
class Row:
    """One line of the table: what, Aleator's number, the peer's or the target's, their ratio."""

    what: str
    ours: str
    theirs: str
    ratio: float


def seconds_row(what: str, ours: float, target: float) -> Row:
    """Seconds against a target of seconds."""
    return Row(what, f"{ours:.2f} s", f"target {target:g} s", ours / target)


def ms(seconds: float) -> str:
    """Seconds as text in milliseconds."""
    return f"{seconds * 1e3:.1f} ms"


def table_of(title: str, rows: Iterable[Row]) -> Table:
    """The rows; a ratio below one is a target kept or a peer beaten in time."""
    table = Table("what", "Aleator", "against", "ratio", title=title)
    for row in rows:
        table.add_row(row.what, row.ours, row.theirs, f"{row.ratio:.3g}")
    return table
