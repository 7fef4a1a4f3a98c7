"""Profile intervals of an answer, with as few nodes as serve at each end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aleator.inference.information import Inference
from aleator.inference.profile import Profile, profile_intervals
from aleator.inference.profile_end import BETTER, LEFT
from aleator.likelihood.individual import Following, IndividualLikelihood
from aleator.search.newton import ascended, outer
from aleator.tasks.individual.settle import CLOSE, Settled
from aleator.types import Array, Flags, Indices

DIFFERS = 0.04
"""A drop of the profile by other nodes that is another one: twice what an end is found to."""
DEAR = 400
"""Nodes of an experiment beyond which a profile by them costs minutes."""
UNKNOWN = 0.2
"""A drop that more nodes change by so much is not known."""
ADAPTED = 4
"""Times that an interval is sought with nodes that were adapted to its ends."""


def profiled(end: Settled, alpha: Array, inference: Inference, rivals: Sequence[Array]) -> Profile:
    """By few nodes; by those of the answer, or by finer ones, where these tell another drop.

    The laws of experiments at an end are others than at the answer, and may need more nodes. What
    the finest change at an end is what cannot be known.
    """
    likelihood = end.likelihood
    if likelihood.parameters is not None:
        same = end.coarse.rule == likelihood.rule
        few = likelihood if same else likelihood.by(end.coarse.rule, alpha)
        return _by_held(few, alpha, inference, rivals)
    many = likelihood.nodes.xi.shape[1] > DEAR
    found = profile_intervals(
        end.coarse.continued, alpha, likelihood.hyperparameters, inference, rivals=rivals
    )
    if found.better is not None:
        return found
    found = _anew(likelihood, alpha, found, UNKNOWN if many else DIFFERS, inference, rivals)
    if many:
        return found
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
    higher = _climbed_on(likelihood, found, inference)
    rows = np.flatnonzero(np.any(_off(likelihood, alpha, higher, least), axis=1))
    if not rows.size:
        return found
    objective, hyperparameters = likelihood.continued, likelihood.hyperparameters
    again = profile_intervals(
        objective, alpha, hyperparameters, inference, rows, rivals, higher.points
    )
    return found.joined(again, rows)


def _climbed_on(likelihood: IndividualLikelihood, found: Profile, inference: Inference) -> Profile:
    """The same with the conditional maxima at its ends by the nodes of this likelihood."""
    objective, points = likelihood.continued, found.points.copy()
    for k, side in np.argwhere(found.drops > 0.0):
        moving, point = inference.identified[inference.identified != k], points[k, side]
        scores = objective(point).scores
        assert scores is not None
        points[k, side] = ascended(
            objective, point, likelihood.hyperparameters, moving, outer(scores[:, moving]), LEFT,
            bent=True,
        ).alpha  # fmt: skip
    return replace(found, points=points)


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


def _by_held(
    likelihood: IndividualLikelihood, alpha: Array, inference: Inference, rivals: Sequence[Array]
) -> Profile:
    """By nodes that are held as parameters, which take longer to find than a profile by them.

    Those that are nearest in law serve. Nodes that are adapted to an end tell whether its drop is
    right; where it is not, it is sought again with these too.
    """
    objective, nothing = likelihood.continued, np.full((alpha.size, 2), np.nan)
    found = Profile(nothing, nothing, np.full((alpha.size, 2, alpha.size), np.nan), None)
    for k in inference.identified:
        row = _row_by_held(objective, likelihood, alpha, inference, rivals, np.array([k]))
        found = found.joined(row, np.array([k]))
        if found.better is not None:
            break
    return found


def _row_by_held(
    objective: Following,
    likelihood: IndividualLikelihood,
    alpha: Array,
    inference: Inference,
    rivals: Sequence[Array],
    only: Indices,
) -> Profile:
    """The interval of one hyperparameter; a better maximum is one if nodes adapted to it say so."""
    hyperparameters, top = likelihood.hyperparameters, likelihood.evaluate(alpha).total
    off, about = np.full((alpha.size, 2), np.inf), None
    for _ in range(ADAPTED):
        found = profile_intervals(objective, alpha, hyperparameters, inference, only, rivals, about)
        if found.better is not None:
            if top - _with_own(objective, likelihood, found.better) < -BETTER:
                return found
            continue
        off, about = np.zeros((alpha.size, 2)), found.points
        for k, side in np.argwhere(found.drops > 0.0):
            drop = top - _with_own(objective, likelihood, found.points[k, side])
            off[k, side] = abs(drop - found.drops[k, side])
        if np.max(off) < DIFFERS:
            break
    return replace(found, better=None).only_known(off > UNKNOWN)


def _with_own(objective: Following, likelihood: IndividualLikelihood, point: Array) -> float:
    """The log-likelihood at a point (K,) with nodes of its own, which the objective remembers.

    Or with some that were adapted as near to it as that.
    """
    own = objective.nearest(point)
    if own.distance(point) > CLOSE:
        own = likelihood.adapted(point)
        objective.remember(own)
    return own.evaluate(point).total
