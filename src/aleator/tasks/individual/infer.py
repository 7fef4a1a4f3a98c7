"""Standard errors and profile intervals of an answer; climbs on where a profile meets a better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aleator.inference.information import Inference, infer
from aleator.inference.profile import Profile
from aleator.laws.hyperparameter import limits_of
from aleator.likelihood.individual import IndividualLikelihood
from aleator.search import SearchResult
from aleator.search.newton import ascend
from aleator.tasks.individual.profiled import profiled
from aleator.tasks.individual.settle import Settled, settled
from aleator.types import Array

ENOUGH = 1e-3
"""What may be left to climb, in log-likelihood, by the information at the end."""
CLIMBS = 3
"""Times that a profile may meet a better maximum."""
LOOKS = (-1.0, -0.5, 0.5, 1.0)
"""Standard errors from an answer at which it is seen whether it is a saddle."""
HIGHER = 0.01
"""A log-likelihood there that is higher by so much than at the answer: it is."""
DETERMINED = 1e-2
"""Share of the information about each hyperparameter that there is about all directions, at least,
where it is told by scores, which have errors of their own."""


def _climbed_on(likelihood: IndividualLikelihood, alpha: Array, inference: Inference) -> Array:
    """Climb on with the information itself, which a search on a flat top has not learned."""
    objective, moving = likelihood.followed, inference.identified
    return ascend(objective, alpha, likelihood.hyperparameters, moving, inference.information)[0]


def inferred(
    end: Settled, found: SearchResult, others: Sequence[Array] = ()
) -> tuple[Settled, SearchResult, Inference, Profile]:
    """The information, and profiles with as few nodes as serve at each end.

    `others` (K,) are lower optima, whose hills the profiles may go over.
    """
    for _ in range(CLIMBS):
        before = end
        end, inference = _informed(end)
        likelihood, alpha = end.likelihood, end.alpha
        if inference.positive and inference.edm > ENOUGH:
            alpha = _climbed_on(likelihood, alpha, inference)
            inference = infer(likelihood.followed, alpha, likelihood.hyperparameters)
            end = replace(end, alpha=alpha, likelihood=likelihood.adapted(alpha))
        if end is not before:
            found = found.moved(alpha, end.value)
        profile = profiled(end, alpha, inference, others)
        if profile.better is None:
            break
        others = (alpha, *others)
        end = settled(likelihood, profile.better)
        at = end.likelihood(end.alpha)
        found = found.improved(end.alpha, at, inference.identified)
    return end, found, inference, profile


def _informed(end: Settled) -> tuple[Settled, Inference]:
    """The information at an answer, and the answer: where it is a saddle, a maximum beside it.

    Where the top is as flat as the errors of the quadrature, differences of the score may tell
    that it bends upward. It does not where the likelihood is no higher a standard error away, and
    then the scores of the experiments tell the information, if they determine all of it.
    """
    likelihood, alpha = end.likelihood, end.alpha
    objective, hyperparameters = likelihood.followed, likelihood.hyperparameters
    inference = infer(objective, alpha, hyperparameters)
    if inference.positive or not np.all(np.isfinite(inference.information)):
        return end, inference
    told = infer(objective, alpha, hyperparameters, by_scores=True)
    if not told.positive or np.linalg.eigvalsh(np.linalg.inv(told.correlation))[0] < DETERMINED:
        return end, inference
    higher = _beside_a_saddle(likelihood, alpha, inference, told)
    if higher is None:
        return end, told
    end = settled(likelihood, higher)
    return end, infer(end.likelihood.followed, end.alpha, hyperparameters)


def _beside_a_saddle(
    likelihood: IndividualLikelihood, alpha: Array, inference: Inference, told: Inference
) -> Array | None:
    """The highest point where the information tells that the likelihood bends upward, if higher."""
    inside = np.isin(inference.identified, told.free)
    errors = told.standard_error[told.free]
    bends = inference.information[np.ix_(inside, inside)] * np.outer(errors, errors)
    steepest = errors * np.linalg.eigh(bends)[1][:, 0]
    points = np.tile(alpha, (len(LOOKS), 1))
    points[:, told.free] += np.outer(LOOKS, steepest)
    points = np.clip(points, *limits_of(likelihood.hyperparameters))
    *values, here = likelihood.continued.values(np.vstack([points, alpha]))
    best = int(np.nanargmax(values))
    return points[best] if values[best] > here + HIGHER else None
