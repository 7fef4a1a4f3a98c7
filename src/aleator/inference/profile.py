"""Intervals from the profile of the likelihood, which need not be symmetric nor have a curvature.

The interval of one hyperparameter holds the values v for which the largest log-likelihood with
that hyperparameter fixed at v is within chi2_1(0.95)/2 = 1.92 of the maximum (Wilks, 1938; the
MINOS errors of James and Roos, 1975). It stays meaningful where a standard deviation is
weakly determined or lies on its limit, where the quadratic approximation does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.inference.information import Inference
from aleator.inference.profile_end import ENDS, EndSettings, Trace
from aleator.laws import Hyperparameter
from aleator.search import Objective
from aleator.search.interface import LogLikelihood, Scored, objective_of, reach_of
from aleator.search.newton import positive


@dataclass(frozen=True)
class Profile:
    """Intervals (K, 2), NaN where fixed; `better` is a larger maximum met on the way, or None.

    `drops` (K, 2) is how far the profile has dropped at each end, as it was evaluated there: 1.92,
    less at a limit that the experiments do not rule out, or at a jump. An end whose drop could not
    be had is NaN, and so is its drop. `points` (K, 2, K) are the conditional maxima at the ends.
    """

    intervals: Array
    drops: Array
    points: Array
    better: Array | None

    def only_known(self, wrong: Flags) -> Profile:
        """The same without the ends (K, 2) that are wrong."""
        return replace(
            self,
            intervals=np.where(wrong, np.nan, self.intervals),
            drops=np.where(wrong, np.nan, self.drops),
        )

    def joined(self, other: Profile, rows: Indices) -> Profile:
        """The same with these rows of another."""
        arrays = []
        for own, others in ((self.intervals, other.intervals), (self.drops, other.drops),
                            (self.points, other.points)):  # fmt: skip
            mixed = own.copy()
            mixed[rows] = others[rows]
            arrays.append(mixed)
        return Profile(arrays[0], arrays[1], arrays[2], other.better)

    def unknown(self, identified: Indices) -> Indices:
        """Those of the hyperparameters (G,) of which an end is not known."""
        return identified[np.any(np.isnan(self.drops[identified]), axis=1)]


class _Remembering:
    """An objective that knows the last alphas: a guess is judged, and then climbed from."""

    def __init__(self, objective: Objective, size: int = 4) -> None:
        """`size` is the number of alphas that are kept."""
        self.values = objective.values
        self._size = size
        self._objective = objective
        self._last: dict[bytes, LogLikelihood] = {}

    def reach(self, alpha: Array, ahead: Array) -> float:
        """See `reach_of`."""
        return reach_of(self._objective, alpha, ahead)

    def __call__(self, alpha: Array) -> LogLikelihood:
        key = alpha.tobytes()
        if key not in self._last:
            if len(self._last) == self._size:
                del self._last[next(iter(self._last))]
            self._last[key] = self._objective(alpha)
        return self._last[key]


def profile_intervals(
    objective: Objective | Scored,
    alpha: Array,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    only: Indices | None = None,
    rivals: Sequence[Array] = (),
    about: Array | None = None,
    settings: EndSettings = ENDS,
) -> Profile:
    """The profile-likelihood interval of every free hyperparameter at the maximum alpha (K,).

    Each end is found by Newton steps on the signed root of twice the drop in log-likelihood, which
    is linear where the likelihood is normal; its slope is the score. Conditional maxima are climbed
    to from a parabola through those before, with the curvature that these taught: two or three an
    end, of one to five evaluations each, and up to thirty where a ridge is curved. What was found
    is taken for an end when the profile, climbed to anew with the curvature that the scores of the
    experiments tell, has dropped by 1.92 -+ 0.02; a limit, when it was evaluated there and has
    dropped by less. Where the profile jumps, the end is the last value before. Where an end would
    be, other maxima that are not ruled out, `rivals` (K,), are climbed from too. Stops early, with
    `better` set, when a conditional maximum exceeds the maximum. `only` some hyperparameters; the
    others are NaN. Points (K, 2, K) that are `about` the ends, where they are known, save trials.
    """
    maximum, size = objective(alpha), alpha.size
    assert maximum.scores is not None
    climbed = _Remembering(objective_of(objective))
    known = np.full((size, 2, size), np.nan) if about is None else about
    found = Profile(
        np.full((size, 2), np.nan),
        np.full((size, 2), np.nan),
        np.full((size, 2, size), np.nan),
        None,
    )
    for row, k in enumerate(inference.identified):
        if only is not None and k not in only:
            continue
        others = np.delete(np.arange(inference.identified.size), row)
        moving = inference.identified[others]
        tied = _tied(inference)
        information, coupling = positive(tied[np.ix_(others, others)]), tied[others, row]
        # along the profile the others follow the one by -I_oo^-1 I_ok
        follow = -np.linalg.pinv(information, hermitian=True) @ coupling
        trace = Trace(
            climbed, hyperparameters, k, moving, information, follow, maximum.total,
            maximum.scores, rivals, settings,
        )  # fmt: skip
        for side, sign in enumerate((-1.0, 1.0)):
            end = trace.end(alpha, sign, inference, known[k, side])
            if end.better:
                return replace(found, better=end.point)
            found.intervals[k, side], found.drops[k, side] = end.value, end.drop
            found.points[k, side] = end.point
    return found


def _tied(inference: Inference) -> Array:
    """The information (G, G) by which others follow: what is on a limit stays there.

    Where a standard deviation is on its lower limit the likelihood need not bend down, and the
    inverse would lead all others far away.
    """
    free = np.array([inference.at_bound[k] is None for k in inference.identified], dtype=np.bool_)
    alone = np.diag(np.abs(np.diag(inference.information)))
    return np.asarray(np.where(np.outer(free, free), inference.information, alone))
