"""How a large array is cut into blocks of rows that fit the memory or a processor's cache."""

from __future__ import annotations


def blocks(rows: int, width: int, most: int) -> list[slice]:
    """Slices that cut `rows` rows of `width` numbers each into blocks of at most `most` numbers.

    A block has at least one row, even where that row has more than `most` numbers.

    >>> blocks(5, 10, 20)
    [slice(0, 2, None), slice(2, 4, None), slice(4, 5, None)]
    >>> blocks(2, 10, 5), blocks(0, 10, 5)
    ([slice(0, 1, None), slice(1, 2, None)], [])
    """
    size = max(1, most // max(1, width))
    return [slice(first, min(first + size, rows)) for first in range(0, rows, size)]
