"""Tables as plain text that fit a width and cut no word."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Literal

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
