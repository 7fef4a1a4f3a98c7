"""Coefficients by sparse regression: few of many terms, found by least angles."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aleator.errors import AleatorError, InputsError
from aleator.expansion.basis import Basis
from aleator.expansion.design import Design, drawn
from aleator.expansion.expansion import Expansion, checked
from aleator.expansion.least_squares import nested_fits
from aleator.polynomials.indices import IndexSet
from aleator.types import Array, Indices

Order = Callable[[Array, Array, int], Indices]

FULLEST = 0.6
"""Terms for each run that a path may reach."""


@dataclass(frozen=True)
class Sparse:
    """Least-angle regression among all `terms`, then least squares on those selected.

    LARS orders the terms by their use for one experiment; for every number k of leading terms the
    ordinary least-squares fit is judged by its corrected leave-one-out error, and the best k is
    taken ("hybrid LAR": Blatman and Sudret, J. Comput. Phys. 230 (2011)), over degrees 1 to that
    of the terms. There may be far more terms than runs. `runs` points of the law itself are drawn.
    The reported error is the corrected one: the uncorrected is too small after a selection.
    Needs scikit-learn (`pip install 'aleator[sparse]'`). Raises InputsError for fewer than 4 runs.
    Cost: a path of O(k) steps of O(P k) for every experiment and degree, so for P of some
    thousands and a hundred experiments a minute.

    >>> from aleator.polynomials.indices import TotalDegree
    >>> from aleator.laws import Normal
    >>> basis = Basis((Normal(0.0, 1.0),) * 10, (np.array([0.0, 1.0]),) * 10)
    >>> way = Sparse(TotalDegree(3), runs=60)                       # of 286 terms
    >>> design = way.design(basis)
    >>> y = way.fit(basis, design, (design.x[:, 0] + design.x[:, 4] * design.x[:, 9])[None])
    >>> y.indices.shape, y.variance.round(9).tolist()
    ((3, 10), [2.0])
    """

    terms: IndexSet
    runs: int
    seed: int = 0

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if self.runs < 4:
            raise InputsError(f"{self.runs} runs are too few", "allow at least ten a parameter")

    def design(self, basis: Basis) -> Design:
        """Points of the law; fewer runs are the beginning of more."""
        return drawn(basis, self.runs, self.seed)

    def fit(self, basis: Basis, design: Design, outcomes: Array) -> Expansion:
        """The expansion from outcomes (N, J) at the points of the design, or of any other."""
        order, outcomes = _least_angles(), checked(design, outcomes)
        indices = self.terms.indices(basis.limits)
        psi = basis.evaluate(design.germ, indices)
        place = {tuple(row): k for k, row in enumerate(indices.tolist())}
        best = np.full(len(outcomes), np.inf)
        coefficients = np.zeros((len(outcomes), len(indices)))
        for degree in range(self.terms.degree + 1):
            lower = self.terms.lowered(degree).indices(basis.limits)
            among = np.array([place[tuple(row)] for row in lower.tolist()])
            found, error = _paths(psi[:, among], design.weights, outcomes, order)
            better = error < best
            best = np.where(better, error, best)
            coefficients[better] = 0.0
            coefficients[np.ix_(better, among)] = found[better]
        used = np.any(coefficients != 0.0, axis=0)
        used[0] = True
        return Expansion(basis, indices[used], coefficients[:, used], np.sqrt(best))


def _paths(psi: Array, weights: Array, outcomes: Array, order: Order) -> tuple[Array, Array]:
    """Coefficients (N, P) and corrected mean-square errors (N,) of the best fit on each path."""
    root = np.sqrt(weights / weights.sum())[:, None]
    columns, measured = root * psi[:, 1:], root * outcomes.T
    # the constant is always in: what it explains is taken off before the others compete
    columns, measured = columns - root * (root.T @ columns), measured - root * (root.T @ measured)
    size = np.linalg.norm(columns, axis=0)
    columns = columns / np.where(size > 0.0, size, 1.0)
    gram, correlation = columns.T @ columns, columns.T @ measured
    longest = min(psi.shape[1] - 1, int(FULLEST * len(psi)))
    coefficients, errors = np.zeros((len(outcomes), psi.shape[1])), np.empty(len(outcomes))
    for row, outcome in enumerate(outcomes):
        picked = np.concatenate([[0], 1 + order(gram, correlation[:, row], longest)])
        ends = tuple(range(1, len(picked) + 1))
        fits = nested_fits(psi[:, picked], weights, outcome[None], ends)
        k = int(np.argmin(fits.corrected[:, 0]))
        coefficients[row, picked[: k + 1]] = fits.coefficients(k + 1, np.array([0]))[:, 0]
        errors[row] = fits.corrected[k, 0]
    return coefficients, errors


def _least_angles() -> Order:
    """The order in which LARS takes up the columns, from their Gram matrix and correlations."""
    try:
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.linear_model import lars_path_gram
    except ImportError:
        raise AleatorError(
            "sparse regression needs scikit-learn, which is not installed",
            "pip install 'aleator[sparse]', or use Regression",
        ) from None

    def order(gram: Array, correlation: Array, longest: int) -> Indices:
        if longest == 0 or not np.any(correlation):
            return np.zeros(0, dtype=np.intp)
        with warnings.catch_warnings():
            # it drops columns that depend on others and says so
            warnings.simplefilter("ignore", ConvergenceWarning)
            # some of its steps take up no column: twice as many reach the longest path
            _, active, _ = lars_path_gram(
                correlation, gram, n_samples=1, max_iter=2 * longest, method="lar"
            )
        return np.array(active[:longest], dtype=np.intp)

    return order
