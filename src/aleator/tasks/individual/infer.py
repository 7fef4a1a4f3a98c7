"""Standard errors and profile intervals of an answer; climbs on where a profile meets a better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aleator.inference.information import Inference, infer
from aleator.inference.profile import Profile, profile_intervals
from aleator.likelihood.individual import IndividualLikelihood
from aleator.search import SearchResult
from aleator.search.newton import ascend
from aleator.tasks.individual.settle import Settled, settled
from aleator.types import Array, Flags

ENOUGH = 1e-3
"""What may be left to climb, in log-likelihood, by the information at the end."""
CLIMBS = 3
"""Times that a profile may meet a better maximum."""
DIFFERS = 0.04
"""A drop of the profile by other nodes that is another one: twice what an end is found to."""
DEAR = 400
"""Nodes of an experiment beyond which a profile by them costs minutes."""
UNKNOWN = 0.2
"""A drop that more nodes change by so much is not known."""


def _climbed_on(likelihood: IndividualLikelihood, alpha: Array, inference: Inference) -> Array:
    """Climb on with the information itself, which a search on a flat top has not learned."""
    objective, moving = likelihood.followed, inference.identified
    return ascend(objective, alpha, likelihood.hyperparameters, moving, inference.information)[0]


def inferred(end: Settled, found: SearchResult) -> tuple[Settled, SearchResult, Inference, Profile]:
    """The information, and profiles with as few nodes as serve at each end."""
    for _ in range(CLIMBS):
        likelihood, alpha = end.likelihood, end.alpha
        hyperparameters = likelihood.hyperparameters
        inference = infer(likelihood.followed, alpha, hyperparameters)
        if inference.positive and inference.edm > ENOUGH:
            alpha = _climbed_on(likelihood, alpha, inference)
            inference = infer(likelihood.followed, alpha, hyperparameters)
            end = replace(end, alpha=alpha)
            found = found.improved(alpha, end.value)
        profile = _profile(end, alpha, inference, found.rivals)
        if profile.better is None:
            break
        end = settled(likelihood, profile.better)
        found = found.improved(end.alpha, end.value)
    return end, found, inference, profile


def _profile(end: Settled, alpha: Array, inference: Inference, rivals: Sequence[Array]) -> Profile:
    """By few nodes; by those of the answer, or by finer ones, where these tell another drop.

    The laws of experiments at an end are others than at the answer, and may need more nodes. What
    the finest change at an end is what cannot be known.
    """
    likelihood = end.likelihood
    found = profile_intervals(
        end.coarse.continued, alpha, likelihood.hyperparameters, inference, rivals=rivals
    )
    if found.better is not None:
        return found
    if likelihood.nodes.xi.shape[1] > DEAR:
        return found.only_known(_off(likelihood, alpha, found, UNKNOWN))
    found = _anew(likelihood, alpha, found, DIFFERS, inference, rivals)
    finer = _finer(likelihood, alpha)
    if finer is None or found.better is not None:
        return found
    if finer.nodes.xi.shape[1] > DEAR:
        return found.only_known(_off(finer, alpha, found, UNKNOWN))
    again = _anew(finer, alpha, found, UNKNOWN, inference, rivals)
    finest = _finer(finer, alpha)
    if again is found or again.better is not None or finest is None:
        return again
    return again.only_known(_off(finest, alpha, again, UNKNOWN))


def _anew(
    likelihood: IndividualLikelihood,
    alpha: Array,
    found: Profile,
    least: float,
    inference: Inference,
    rivals: Sequence[Array],
) -> Profile:
    """The same, with the ends sought anew whose drop by these nodes is another one by so much."""
    rows = np.flatnonzero(np.any(_off(likelihood, alpha, found, least), axis=1))
    if not rows.size:
        return found
    objective, hyperparameters = likelihood.continued, likelihood.hyperparameters
    again = profile_intervals(objective, alpha, hyperparameters, inference, rows, rivals)
    return found.joined(again, rows)


def _finer(likelihood: IndividualLikelihood, alpha: Array) -> IndividualLikelihood | None:
    """The likelihood by more nodes about one mode, or by finer panels; None where there is none."""
    if likelihood.rule.centers > 1:
        return None
    rules = likelihood.rule.finer(likelihood.inputs.scattering)
    return likelihood.by(rules[0], alpha) if rules else None


def _off(likelihood: IndividualLikelihood, alpha: Array, profile: Profile, least: float) -> Flags:
    """Ends (K, 2) whose drop is another one with the nodes of this likelihood, by so much."""
    top = likelihood.adapted(alpha).evaluate(alpha).total
    wrong = np.zeros(profile.drops.shape, dtype=np.bool_)
    for k, side in np.argwhere(profile.drops > 0.0):
        point = profile.points[k, side]
        drop = top - likelihood.adapted(point).evaluate(point).total
        wrong[k, side] = not abs(drop - profile.drops[k, side]) < least
    return wrong
