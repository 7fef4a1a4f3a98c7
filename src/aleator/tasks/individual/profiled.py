"""Profile intervals of an answer, with as few nodes as serve at each end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aleator.inference.information import Inference
from aleator.inference.profile import Profile, profile_intervals
from aleator.inference.profile_end import BETTER
from aleator.likelihood.individual import IndividualLikelihood
from aleator.search.interface import Scored
from aleator.search.value import LogLikelihood
from aleator.tasks.individual.settle import Settled
from aleator.types import Array, Flags

DIFFERS = 0.04
"""A drop of the profile by other nodes that is another one: twice what an end is found to."""
DEAR = 400
"""Nodes of an experiment beyond which a profile by them costs minutes."""
UNKNOWN = 0.2
"""A drop that more nodes change by so much is not known."""
ADAPTED = 4
"""Times that ends are looked at with nodes that are adapted to them."""


def profiled(end: Settled, alpha: Array, inference: Inference, rivals: Sequence[Array]) -> Profile:
    """By few nodes; by those of the answer, or by finer ones, where these tell another drop.

    The laws of experiments at an end are others than at the answer, and may need more nodes. What
    the finest change at an end is what cannot be known.
    """
    likelihood = end.likelihood
    many = likelihood.nodes.xi.shape[1] > DEAR
    if many and likelihood.parameters is not None:
        return _by_held(likelihood, alpha, inference, rivals)
    found = profile_intervals(
        end.coarse.continued, alpha, likelihood.hyperparameters, inference, rivals=rivals
    )
    if found.better is not None:
        return found
    if many:
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


def _by_held(
    likelihood: IndividualLikelihood, alpha: Array, inference: Inference, rivals: Sequence[Array]
) -> Profile:
    """By nodes that are held as parameters, which take longer to find than a profile by them.

    Those of the answer mostly serve as far as an interval reaches. Where they do not, an end is
    sought again with nodes that are adapted to it, until these tell its drop.
    """
    top, rows = likelihood.evaluate(alpha).total, inference.identified
    nothing = np.full((alpha.size, 2), np.nan)
    found = Profile(nothing, nothing, np.tile(alpha, (alpha.size, 2, 1)), None)
    objectives: dict[int, Scored] = dict.fromkeys(rows.tolist(), likelihood.__call__)
    for _ in range(ADAPTED):
        for k, objective in objectives.items():
            found = _with_row(objective, likelihood, alpha, inference, rivals, found, k)
            if found.better is not None:
                return found
        off, wrong = np.zeros(found.drops.shape), dict[int, Scored]()
        for k in objectives:
            ends = [
                likelihood.adapted(point) if drop > 0.0 else likelihood
                for point, drop in zip(found.points[k], found.drops[k], strict=True)
            ]
            value = [e.evaluate(p).total for e, p in zip(ends, found.points[k], strict=True)]
            drop = np.subtract(top, value)
            off[k] = np.where(found.drops[k] > 0.0, np.abs(drop - found.drops[k]), 0.0)
            if np.min(drop) < -BETTER:
                # too far for the nodes of the answer, which did not see how high it is there
                return replace(found, better=found.points[k, int(np.argmin(drop))])
            if np.any(off[k] > DIFFERS):
                values = np.array([alpha[k], *found.points[k, :, k]])
                wrong[k] = _Nearest(k, values, [likelihood, *ends])
        objectives = wrong
    return found.only_known(off > UNKNOWN)


def _with_row(
    objective: Scored,
    likelihood: IndividualLikelihood,
    alpha: Array,
    inference: Inference,
    rivals: Sequence[Array],
    found: Profile,
    k: int,
) -> Profile:
    """The same with the interval of hyperparameter k by this objective.

    A better maximum is one only if nodes that are adapted to it say so: a law that has become much
    narrower than its nodes lie apart may look likelier than it is. Then no end is known there.
    """
    only = np.array([k])
    again = profile_intervals(objective, alpha, likelihood.hyperparameters, inference, only, rivals)
    if again.better is not None:
        there = likelihood.adapted(again.better).evaluate(again.better).total
        if there > likelihood.evaluate(alpha).total + BETTER:
            return replace(found, better=again.better)
    points = np.where(np.isnan(again.points), alpha, again.points)
    return found.joined(replace(again, points=points, better=None), only)


@dataclass(frozen=True, eq=False)
class _Nearest:
    """The log-likelihood with the nodes, held, that were adapted to the nearest value of one of it.

    `values` (A,) of hyperparameter k, of the answer and at the ends of its interval so far.
    """

    k: int
    values: Array
    held: Sequence[IndividualLikelihood]

    def __call__(self, alpha: Array) -> LogLikelihood:
        return self.held[int(np.argmin(np.abs(self.values - alpha[self.k])))](alpha)
