"""Coefficients by weighted least squares on points that the polynomials themselves choose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.errors import InputsError
from aleator.moments.expansion.basis import Basis
from aleator.moments.expansion.design import Design, induced
from aleator.moments.expansion.expansion import Expansion, checked
from aleator.moments.expansion.indices import IndexSet
from aleator.moments.expansion.least_squares import nested_fits
from aleator.types import Array, Indices

OVERSAMPLING = 2
"""Runs for each term, where the user does not choose their number."""
FULLEST = 0.8
"""Terms for each run that an adaptive fit may use; beyond, the errors are no longer told apart."""


@dataclass(frozen=True)
class Regression:
    """Weighted least squares on points of the induced distribution (see `design.induced`).

    All N experiments share the points, one QR decomposition and its leverages. With `runs` (default
    twice the number of terms) well above the number of terms the matrix is well conditioned by
    construction, whatever law and terms. With `adaptive` every lower degree is tried too, and each
    experiment takes the degree of the least corrected leave-one-out error. Exact for polynomials
    in the set. Raises InputsError for runs below one, and if there are fewer runs than terms and
    the degree may not be lowered.

    >>> from aleator.moments.expansion.indices import TotalDegree
    >>> basis = Basis.normal(10)
    >>> way = Regression(TotalDegree(2))
    >>> design = way.design(basis)                                  # 2 * 66 runs
    >>> y = way.fit(basis, design, np.sum(design.x, axis=1)[None] ** 2)
    >>> len(design), y.mean.round(9).tolist(), y.variance.round(9).tolist()   # E = 10, Var = 200
    (132, [10.0], [200.0])
    """

    terms: IndexSet
    runs: int | None = None
    adaptive: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if self.runs is not None and self.runs < 1:
            raise InputsError(f"{self.runs} runs make no design", "allow at least one run")

    def design(self, basis: Basis) -> Design:
        """Points of the induced distribution; fewer runs are the beginning of more."""
        indices = self.terms.indices(basis.limits)
        return induced(basis, indices, self.runs or OVERSAMPLING * len(indices), self.seed)

    def fit(self, basis: Basis, design: Design, outcomes: Array) -> Expansion:
        """The expansion from outcomes (N, J) at the points of the design, or of any other."""
        outcomes = checked(design, outcomes)
        indices, ends = self._nested(basis, len(design))
        psi = basis.evaluate(design.t, indices[: ends[-1]])
        fits = nested_fits(psi, design.weights, outcomes, ends)
        best = np.argmin(fits.corrected, axis=0)
        coefficients = np.zeros((len(outcomes), ends[-1]))
        for k in np.unique(best):
            which = np.flatnonzero(best == k)
            coefficients[which, : ends[k]] = fits.coefficients(ends[k], which).T
        error = np.sqrt(np.take_along_axis(fits.leave_one_out, best[None], axis=0)[0])
        return Expansion(basis, indices[: ends[-1]], coefficients, error)

    def _nested(self, basis: Basis, runs: int) -> tuple[Indices, tuple[int, ...]]:
        """The terms, those of a lower degree first, and how many there are up to each degree."""
        sets = [
            self.terms.lowered(degree).indices(basis.limits)
            for degree in range(0 if self.adaptive else self.terms.degree, self.terms.degree + 1)
        ]
        seen: dict[tuple[int, ...], None] = {}
        ends = []
        for indices in sets:
            seen.update(dict.fromkeys(map(tuple, indices.tolist())))
            ends.append(len(seen))
        allowed = FULLEST * runs if self.adaptive else runs
        kept = tuple(sorted({end for end in ends if end <= allowed}))
        if not kept:
            raise InputsError(
                f"{runs} runs do not determine {ends[0]} coefficients",
                "allow more runs, lower the degree, or set adaptive=True",
            )
        return np.array(list(seen), dtype=np.intp), kept
