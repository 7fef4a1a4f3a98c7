"""Standard errors and profile intervals of an answer; climbs on where a profile meets a better."""

from __future__ import annotations

from aleator.inference.information import Inference, infer
from aleator.inference.profile import Profile, profile_intervals
from aleator.search import SearchResult
from aleator.tasks.individual.settle import Settled, settled

CLIMBS = 3
"""Times that a profile may meet a better maximum."""


def inferred(end: Settled, found: SearchResult) -> tuple[Settled, SearchResult, Inference, Profile]:
    """The information, and profiles with as few nodes as serve."""
    for _ in range(CLIMBS):
        likelihood, alpha = end.likelihood, end.alpha
        hyperparameters = likelihood.hyperparameters
        inference = infer(likelihood.followed, alpha, hyperparameters)
        profile = profile_intervals(end.coarse.continued, alpha, hyperparameters, inference)
        if profile.better is None:
            break
        end = settled(likelihood, profile.better)
        found = found.improved(end.alpha, end.value)
    return end, found, inference, profile
