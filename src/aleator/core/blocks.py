"""Rows of large arrays in blocks that fit the memory, or a core's cache."""

from __future__ import annotations


def blocks(rows: int, width: int, most: int) -> list[slice]:
    """Slices of rows of `width` numbers: at most `most` numbers in each, and at least one row.

    >>> blocks(5, 10, 20)
    [slice(0, 2, None), slice(2, 4, None), slice(4, 5, None)]
    >>> blocks(2, 10, 5), blocks(0, 10, 5)
    ([slice(0, 1, None), slice(1, 2, None)], [])
    """
    size = max(1, most // max(1, width))
    return [slice(first, min(first + size, rows)) for first in range(0, rows, size)]
