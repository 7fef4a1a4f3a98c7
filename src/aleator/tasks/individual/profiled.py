"""Profile intervals of an answer, with as few nodes as serve at each end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aleator.inference.information import Inference
from aleator.inference.profile import Profile, profile_intervals
from aleator.likelihood.individual import IndividualLikelihood
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
    hyperparameters = likelihood.hyperparameters
    found = profile_intervals(likelihood.__call__, alpha, hyperparameters, inference, rivals=rivals)
    top, rows = likelihood.evaluate(alpha).total, inference.identified
    for left in reversed(range(ADAPTED)):
        if found.better is not None:
            break
        off = np.zeros(found.drops.shape)
        ends = {}
        for k in rows:
            ends[k] = [
                likelihood.adapted(point) if drop > 0.0 else likelihood
                for point, drop in zip(found.points[k], found.drops[k], strict=True)
            ]
            value = [e.evaluate(p).total for e, p in zip(ends[k], found.points[k], strict=True)]
            drop = np.subtract(top, value)
            off[k] = np.abs(drop - np.where(found.drops[k] > 0.0, found.drops[k], drop))
        if not left:
            return found.only_known(off > UNKNOWN)
        rows = np.flatnonzero(np.any(off > DIFFERS, axis=1))
        for k in rows:
            values = np.array([alpha[k], *found.points[k, :, k]])
            objective, only = _Nearest(int(k), values, [likelihood, *ends[k]]), rows[rows == k]
            again = profile_intervals(objective, alpha, hyperparameters, inference, only, rivals)
            found = found.joined(again, only)
    return found


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
