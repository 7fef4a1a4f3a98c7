"""The non-zero set I*_(m,p) and its coefficients: the paper's offline step."""

from __future__ import annotations

import enum
import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from aleator.errors import InputsError
from aleator.expansion.moments.basis import Basis
from aleator.expansion.moments.inner_products import InnerProducts, inner_products
from aleator.expansion.moments.multi_indices import count, exponents, multinomials, stacks
from aleator.types import Array

CANDIDATES_AT_ONCE = 1 << 16
"""Multi-indices that are held at once; of a larger number each costs more, not less."""

MOST_CANDIDATES = 2_000_000_000
"""Some minutes of work; beyond it the other ways are better by orders of magnitude."""


class Origin(enum.Enum):
    """Where a non-zero set came from."""

    COMPUTED = "computed"
    STORED = "read from the store"
    REPLACED = "computed, because the file in the store is damaged or of something else"


@dataclass(frozen=True, eq=False)
class NonzeroSet:
    """The terms of mu_m = sum_(i in I*) a_i prod_k c_k^(i_k) (paper, eq. (moments3.0)).

    `factors` (T, m) holds for each term the positions of its m coefficients in the basis, in
    increasing order; `coefficients` (T,) the a_i: multinomial coefficient times inner product.
    The terms come in the order of push and fork.
    """

    order: int
    size: int
    factors: NDArray[np.int32]
    coefficients: Array
    origin: Origin = Origin.COMPUTED

    @property
    def exponents(self) -> NDArray[np.int64]:
        """The multi-indices i themselves, (T, p)."""
        return exponents(self.size - 1 - self.factors.astype(np.int64), self.size)

    @property
    def candidates(self) -> int:
        """|I_(m,p)| = C(m + p - 1, m), of which the terms are what is not zero."""
        return count(self.order, self.size)


def nonzero_set(basis: Basis, m: int, workers: int = 1) -> NonzeroSet:
    """Try every multi-index of I_(m,p) and keep those whose inner product is not zero.

    The candidates are made and tried in blocks, in `workers` processes if more than one; the
    result does not depend on their number. Cost: about 0.1 microseconds a candidate, memory that of
    the terms that remain. Raises InputsError for more than 2e9 candidates.

    >>> from aleator.polynomials.recurrence import hermite_recurrence
    >>> basis = Basis((hermite_recurrence(4),), np.array([[0], [1], [2]]))
    >>> terms = nonzero_set(basis, 3)     # E[Y^3] = c0^3 + 3 c0 c1^2 + 3 c0 c2^2 + ...
    >>> terms.exponents.tolist()
    [[0, 0, 3], [0, 2, 1], [1, 0, 2], [1, 2, 0], [3, 0, 0]]
    >>> terms.coefficients.round(4).tolist()
    [2.8284, 4.2426, 3.0, 3.0, 1.0]
    """
    candidates = count(m, basis.size)
    if candidates > MOST_CANDIDATES:
        raise InputsError(
            f"push and fork would try {candidates:.3g} multi-indices of order {m} on "
            f"{basis.size} functions",
            "use TensorGauss() or Galerkin()",
        )
    tables = tuple(inner_products(basis, k, m) for k in range(len(basis.degrees)))
    work = partial(_terms, m=m, indices=basis.indices, tables=tables)
    blocks = [
        (start, min(start + CANDIDATES_AT_ONCE, candidates))
        for start in range(0, candidates, CANDIDATES_AT_ONCE)
    ]
    factors, coefficients = zip(*_mapped(work, blocks, workers), strict=True)
    return NonzeroSet(m, basis.size, np.concatenate(factors), np.concatenate(coefficients))


def _mapped(
    work: partial[tuple[NDArray[np.int32], Array]], blocks: list[tuple[int, int]], workers: int
) -> Iterator[tuple[NDArray[np.int32], Array]]:
    if workers < 2 or len(blocks) < 2:
        yield from map(work, blocks)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(workers, len(blocks)), mp_context=context) as pool:
        chunk = -(-len(blocks) // (4 * workers))
        yield from pool.map(work, blocks, chunksize=chunk)


def _terms(
    block: tuple[int, int],
    *,
    m: int,
    indices: NDArray[np.int64],
    tables: tuple[InnerProducts, ...],
) -> tuple[NDArray[np.int32], Array]:
    """Factors and coefficients of what is not zero among the candidates of a block."""
    p = indices.shape[0]
    found = stacks(*block, m, p)
    product = np.ones(found.shape[0])
    for k, table in enumerate(tables):
        value = table.of(indices[::-1, k][found])
        kept = value != 0.0
        found, product = found[kept], product[kept] * value[kept]
    return (p - 1 - found).astype(np.int32), product * multinomials(found)
