"""One step of Fisher scoring, with the information matrix from outer products of the scores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.core.types import Array


@dataclass(frozen=True)
class ScoringStep:
    """The step J^-1 s (F,) towards the maximum, and the inverse information J^-1 (F, F)."""

    step: Array
    inverse: Array

    @property
    def in_standard_errors(self) -> Array:
        """The step (F,) divided by the standard errors from J, the roots of diag(J^-1)."""
        return np.asarray(self.step / np.sqrt(np.diag(self.inverse)))


def scoring_step(
    scores: Array, prior: Array | None = None, smallest: float = 1e-8
) -> ScoringStep | None:
    """The step J^-1 s of the scores s_l (N, F) of N experiments: s = sum s_l, J = sum s_l s_l'.

    J is the information matrix from outer products (Berndt, Hall, Hall and Hausman, 1974). Unlike
    the observed information it is usable far from the maximum and with an inaccurate density. A
    small step is right in sign and size; a large step shows only that the maximum is far. The score
    of a `prior` (F,) is added to s. Returns None where J does not have full rank, that is where the
    correlation matrix of the scores has an eigenvalue below `smallest` (by judgement). Cost
    O(N F^2).

    >>> found = scoring_step(np.array([[1.0], [-1.0], [1.0], [0.0]]))
    >>> found.step.round(6).tolist(), found.in_standard_errors.round(6).tolist()
    ([0.333333], [0.57735])
    """
    size = np.sqrt(np.sum(scores**2, axis=0))
    if size.size == 0 or not np.all(size > 0.0):
        return None
    values, vectors = np.linalg.eigh(scores.T @ scores / np.outer(size, size))
    if values[0] < smallest:
        return None
    inverse = (vectors / values) @ vectors.T / np.outer(size, size)
    whole = scores.sum(axis=0)
    return ScoringStep(inverse @ (whole if prior is None else whole + prior), inverse)
