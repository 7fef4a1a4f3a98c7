"""The paper's algorithm: the multinomial sum over the multi-indices that are not zero."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from aleator.errors import InputsError
from aleator.expansion.moments.basis import Basis
from aleator.expansion.moments.nonzero import NonzeroSet, nonzero_set
from aleator.expansion.moments.store import kept
from aleator.types import Array

VALUES_AT_ONCE = 1_000_000
"""Products of coefficients that are held at once: terms are taken in parts."""


@dataclass(frozen=True)
class PushFork:
    """mu_m = sum over I*_(m,p) of a_i prod_k c_k^(i_k) (paper, eq. (moments3.0)).

    The set I*_(m,p) is found offline by push and fork, in `workers` processes, and kept in the
    folder `store` if one is given, a file for each basis and order, so that it is found once.
    With more than one worker a script must be importable (`if __name__ == "__main__":`).
    Cost: offline O(C(m + p - 1, m)), online O(N |I*| m): for (n, d, m) = (4, 3, 5) 575,757
    candidates and 18,415 terms. `TensorGauss` and `Galerkin` give the same for far less; this way
    is here for the paper, and as a check of the others. Raises InputsError for workers below one.
    """

    store: Path | None = None
    workers: int = 1

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if self.workers < 1:
            raise InputsError(f"PushFork: {self.workers} workers", "use 1 or more")

    def powers(self, basis: Basis, order: int) -> TermPowers:
        """The terms of the orders 3..M; those below are known by orthonormality."""
        scattering = [self.terms(basis, m) for m in range(3, order + 1)]
        return TermPowers(
            order, basis.constant, tuple(_without(terms, basis.constant) for terms in scattering)
        )

    def terms(self, basis: Basis, m: int) -> NonzeroSet:
        """The set I*_(m,p) with its coefficients: from the store if it is there, else computed.

        >>> from aleator.polynomials.recurrence import hermite_recurrence
        >>> square = np.array([[0, 0], [0, 1], [1, 0], [0, 2], [1, 1], [2, 0]])
        >>> basis = Basis((hermite_recurrence(6), hermite_recurrence(6)), square)
        >>> terms = PushFork().terms(basis, 5)
        >>> terms.candidates, terms.coefficients.size
        (252, 61)
        """
        basis.check(max(m, 2))
        if self.store is None:
            return nonzero_set(basis, m, self.workers)
        return kept(Path(self.store), basis, m, lambda: nonzero_set(basis, m, self.workers))


def raw_moment(terms: NonzeroSet, coefficients: Array) -> Array:
    """E[Y^m] (N,) of the expansions c (N, P) as the paper has it, eq. (moments3.0).

    Loses all digits of the scatter where the mean is large against it: `prepare` does not.

    >>> from aleator.polynomials.recurrence import hermite_recurrence
    >>> basis = Basis((hermite_recurrence(3),), np.array([[0], [1]]))
    >>> raw_moment(PushFork().terms(basis, 4), np.array([[1.0, 1.0]])).round(9).tolist()
    [10.0]
    """
    return _summed(terms, np.ascontiguousarray(coefficients.T))


def _summed(terms: NonzeroSet, columns: Array) -> Array:
    total = np.zeros(columns.shape[1])
    for part in _parts(terms, columns.shape[1]):
        product = terms.coefficients[part, None] * columns[terms.factors[part, 0]]
        for j in range(1, terms.order):
            product *= columns[terms.factors[part, j]]
        total += product.sum(axis=0)
    return total


def _without(terms: NonzeroSet, constant: int) -> NonzeroSet:
    """The terms that hold no constant: its coefficient is zero after centering."""
    rows = np.all(terms.factors != constant, axis=1)
    return NonzeroSet(
        terms.order, terms.size, terms.factors[rows], terms.coefficients[rows], terms.origin
    )


@dataclass(frozen=True, eq=False)
class TermPowers:
    """The terms of the orders 3..M that hold no constant."""

    order: int
    constant: int
    terms: tuple[NonzeroSet, ...]

    def means(self, z: Array) -> Array:
        """E[Z^m] for m = 0..M, as (N, M+1)."""
        means = np.zeros((z.shape[0], self.order + 1))
        means[:, 0] = 1.0
        means[:, 2] = np.sum(z**2, axis=1)
        columns = np.ascontiguousarray(z.T)
        for terms in self.terms:
            means[:, terms.order] = _summed(terms, columns)
        return means

    def projections(self, z: Array) -> Array:
        """E[Z^m psi_i] for m = 0..M-1, as (N, M, P): derivatives of the sums, over m + 1."""
        found = np.zeros((z.shape[0], self.order, z.shape[1]))
        found[:, 1] = z
        columns = np.ascontiguousarray(z.T)
        for terms in self.terms:
            slope = np.zeros_like(columns)
            for part in _parts(terms, z.shape[0]):
                _add_slopes(terms.factors[part], terms.coefficients[part], columns, slope)
            found[:, terms.order - 1] = slope.T / terms.order
        # E[Z^m psi_0] = E[Z^m] = sum_i z_i E[Z^(m-1) psi_i]
        found[:, 0, self.constant] = 1.0
        found[:, 1:, self.constant] = np.einsum("np,nmp->nm", z, found[:, :-1])
        return found


def _add_slopes(factors: NDArray[np.int32], a: Array, columns: Array, slope: Array) -> None:
    """Add the derivatives of sum a_i prod z by every z_k to `slope` (P, N)."""
    m = factors.shape[1]
    after = [np.ones((factors.shape[0], columns.shape[1]))]
    for j in range(m - 1, 0, -1):
        after.append(after[-1] * columns[factors[:, j]])
    before = np.ones_like(after[0])
    starts = np.arange(factors.shape[0] + 1)
    for j in range(m):
        others = before * after.pop()
        scatter = sparse.csc_array((a, factors[:, j], starts), (columns.shape[0], a.size))
        slope += scatter @ others
        before *= columns[factors[:, j]]


def _parts(terms: NonzeroSet, experiments: int) -> list[slice]:
    step = max(1, VALUES_AT_ONCE // max(experiments, 1))
    return [slice(start, start + step) for start in range(0, terms.coefficients.size, step)]
