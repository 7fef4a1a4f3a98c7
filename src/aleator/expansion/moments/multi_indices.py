"""The multi-indices of the multinomial theorem, in the order of push and fork.

I_(m,p) holds the ways to lay m items on p locations (paper, "Estimation of high-order moments").
A multi-index is here either its exponents (p,), or its `stack` (m,): how far each item lies from
the last location, s_1 >= s_2 >= ... .
Push and fork visit the stacks in lexicographic order, so that the position of a stack is known in
closed form (the combinatorial number system) and any part of the set can be made on its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from math import comb

import numpy as np
from numpy.typing import NDArray

Stacks = NDArray[np.int64]
Ranks = NDArray[np.int64]


def push_and_fork(m: int, p: int) -> Iterator[tuple[int, ...]]:
    """The multi-indices of I_(m,p) one by one, each from the one before it (paper, Fig. sets).

    All items start in the last location. Where the last location holds an item, one is pushed to
    the location before it; otherwise the trailing nonempty location is forked: one of its items
    moves to the location before it, the others return to the last.

    >>> list(push_and_fork(2, 3))
    [(0, 0, 2), (0, 1, 1), (0, 2, 0), (1, 0, 1), (1, 1, 0), (2, 0, 0)]
    """
    row = [0] * p
    row[-1] = m
    yield tuple(row)
    while row[0] < m:
        if row[-1] > 0:
            row[-1] -= 1
            row[-2] += 1
        else:
            trailing = max(k for k in range(p) if row[k])
            items, row[trailing] = row[trailing], 0
            row[trailing - 1] += 1
            row[-1] = items - 1
        yield tuple(row)


def count(m: int, p: int) -> int:
    """|I_(m,p)| = C(m + p - 1, m).

    >>> count(5, 10), count(5, 35)
    (2002, 575757)
    """
    return comb(m + p - 1, m)


def stacks(start: int, stop: int, m: int, p: int) -> Stacks:
    """Stacks (stop - start, m) of the multi-indices at positions start..stop-1 of push and fork.

    The position of s is sum_j C(s_j + m - j, m - j + 1), j = 1..m; each s_j is the largest that the
    rest of the position allows. Cost O(m log p) a multi-index.

    >>> exponents(stacks(2, 5, 2, 3), 3).tolist()
    [[0, 2, 0], [1, 0, 1], [1, 1, 0]]
    """
    rest = np.arange(start, stop, dtype=np.int64)
    found = np.empty((rest.size, m), dtype=np.int64)
    for j, table in enumerate(_position_tables(m, p)):
        found[:, j] = np.searchsorted(table, rest, side="right") - 1
        rest -= table[found[:, j]]
    return found


def positions(found: Stacks, p: int) -> Ranks:
    """Positions (...,) of stacks (..., m) in push and fork: the inverse of `stacks`.

    >>> positions(stacks(0, 6, 2, 3), 3).tolist()
    [0, 1, 2, 3, 4, 5]
    """
    tables = _position_tables(found.shape[-1], p)
    parts = [table[found[..., j]] for j, table in enumerate(tables)]
    return np.asarray(np.sum(parts, axis=0), dtype=np.int64)


def exponents(found: Stacks, p: int) -> NDArray[np.int64]:
    """Exponents (T, p) of stacks (T, m)."""
    rows = np.zeros((found.shape[0], p), dtype=np.int64)
    np.add.at(rows, (np.arange(found.shape[0])[:, None], p - 1 - found), 1)
    return rows


def multinomials(found: Stacks) -> NDArray[np.float64]:
    """Multinomial coefficients m!/(i_1! .. i_p!) of stacks (T, m), exact to m = 18.

    >>> multinomials(stacks(0, 6, 2, 3)).tolist()
    [1.0, 2.0, 1.0, 2.0, 2.0, 1.0]
    """
    coefficient = np.ones(found.shape[0])
    run = np.ones(found.shape[0])
    for j in range(1, found.shape[1]):
        # m! over the product of how often each item's location has occurred so far
        run = np.where(found[:, j] == found[:, j - 1], run + 1.0, 1.0)
        coefficient = coefficient * (j + 1) / run
    return coefficient


@lru_cache(maxsize=32)
def _position_tables(m: int, p: int) -> tuple[NDArray[np.int64], ...]:
    tables = []
    for j in range(1, m + 1):
        rows = [comb(s + m - j, m - j + 1) for s in range(p)]
        tables.append(np.array(rows, dtype=np.int64))
        tables[-1].setflags(write=False)
    return tuple(tables)
