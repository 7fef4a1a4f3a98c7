"""Standard errors and profile intervals of an answer; climbs on where a profile meets a better."""

from __future__ import annotations

from dataclasses import replace

from aleator.inference.information import Inference, infer
from aleator.inference.profile import Profile, profile_intervals
from aleator.likelihood.individual import IndividualLikelihood
from aleator.search import SearchResult
from aleator.search.newton import ascend
from aleator.tasks.individual.settle import Settled, settled
from aleator.types import Array

ENOUGH = 1e-3
"""What may be left to climb, in log-likelihood, by the information at the end."""
CLIMBS = 3
"""Times that a profile may meet a better maximum."""


def _climbed_on(likelihood: IndividualLikelihood, alpha: Array, inference: Inference) -> Array:
    """Climb on with the information itself, which a search on a flat top has not learned."""
    objective, moving = likelihood.followed, inference.identified
    return ascend(objective, alpha, likelihood.hyperparameters, moving, inference.information)[0]


def inferred(end: Settled, found: SearchResult) -> tuple[Settled, SearchResult, Inference, Profile]:
    """The information, and profiles with as few nodes as serve."""
    for _ in range(CLIMBS):
        likelihood, alpha = end.likelihood, end.alpha
        hyperparameters = likelihood.hyperparameters
        inference = infer(likelihood.followed, alpha, hyperparameters)
        if inference.positive and inference.edm > ENOUGH:
            alpha = _climbed_on(likelihood, alpha, inference)
            inference = infer(likelihood.followed, alpha, hyperparameters)
            end = replace(end, alpha=alpha)
            found = found.improved(alpha, end.value)
        profile = profile_intervals(end.coarse.continued, alpha, hyperparameters, inference)
        if profile.better is None:
            break
        end = settled(likelihood, profile.better)
        found = found.improved(end.alpha, end.value)
    return end, found, inference, profile
