"""From the ends of all starts to the result: which of them are the same optimum."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aleator.laws import Hyperparameter
from aleator.search.coordinates import Coordinates
from aleator.search.counted import FLOOR, CountedObjective
from aleator.search.interface import SAME_VALUE, Ascent, Optimum, SearchResult, one_hill
from aleator.search.limits import nowhere_finite
from aleator.types import Array, Indices

SAME_PLACE = 0.3
"""... and are, if also within this many standard errors (outer product of scores)."""


def gathered(
    ascents: Sequence[Ascent],
    objective: CountedObjective,
    hyperparameters: Sequence[Hyperparameter],
) -> SearchResult:
    """Distinct optima, best first: ends that differ in value, or in place by standard errors.

    Cost: one evaluation for each optimum. Raises InputsError where no start met a finite
    log-likelihood.
    """
    arrived = sorted(
        (a for a in ascents if np.isfinite(a.log_likelihood)), key=lambda a: -a.log_likelihood
    )
    if not arrived:
        raise nowhere_finite(hyperparameters, objective.evaluations)
    groups: list[tuple[Ascent, Array, int]] = []
    for ascent in arrived:
        for g, (head, information, count) in enumerate(groups):
            step = ascent.alpha - head.alpha
            near = float(step @ information @ step) < SAME_PLACE**2
            if head.log_likelihood - ascent.log_likelihood < SAME_VALUE and near:
                groups[g] = (head, information, count + 1)
                break
        else:
            groups.append((ascent, _information(ascent, objective), 1))
    optima = tuple(Optimum(a.alpha, a.log_likelihood, count) for a, _, count in groups)
    best = optima[0]
    return SearchResult(
        best.alpha, best.log_likelihood, tuple(ascents), optima, objective.trace, objective.method
    )


def reached_once(ascents: Sequence[Ascent], objective: CountedObjective, free: Indices) -> bool:
    """Whether no two starts came to the best log-likelihood, or to the hill that it is on.

    Where the objective is rough, or a climb is cut off, ends on one hill differ in value.
    """
    best, *others = sorted(ascents, key=lambda a: -a.log_likelihood)
    if not np.isfinite(best.log_likelihood):
        return False
    if any(best.log_likelihood - a.log_likelihood < SAME_VALUE for a in others):
        return False
    scores = objective(best.alpha).scores
    assert scores is not None
    return not any(one_hill(a.alpha - best.alpha, scores, free) for a in others)


def only_point(
    objective: CountedObjective, coordinates: Coordinates, hyperparameters: Sequence[Hyperparameter]
) -> SearchResult:
    """The result where no hyperparameter is free: one evaluation, nothing to search."""
    alpha = coordinates.start
    value = float(objective.values(alpha[None, :])[0])
    if value <= FLOOR:
        raise nowhere_finite(hyperparameters, 1)
    ascent = Ascent(alpha, alpha, value, 1, converged=True)
    optima = (Optimum(alpha, value, 1),)
    return SearchResult(alpha, value, (ascent,), optima, objective.trace, objective.method)


def _information(ascent: Ascent, objective: CountedObjective) -> Array:
    scores = objective(ascent.alpha).scores
    assert scores is not None
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(scores.T @ scores)
