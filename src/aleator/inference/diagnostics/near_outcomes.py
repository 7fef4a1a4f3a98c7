"""What the errors of surfaces near the measured outcomes do to estimates and to the log-likelihood.

Surfaces are made exact where the law has its mass. An outcome far out is explained elsewhere, and
where the law is narrow an error there that is small beside the scatter decides on the estimates.
Near an extreme of the response its density is singular, and no kernel sees what an error does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aleator.inference.check import Checked
from aleator.inference.diagnostics.naming import chosen, named
from aleator.inference.information import Inference
from aleator.likelihood.problem import Problem
from aleator.results.values import Diagnostic
from aleator.status import Status
from aleator.types import Array, Flags


@dataclass(frozen=True)
class Accuracy:
    """How exact surfaces are to be at the measured outcomes; measured by `benchmarks folds`.

    `log_likelihood` is the error of a log-likelihood without noise above which surfaces have more
    runs near the outcomes, up to `rounds` times.
    `move` is the same of an estimate, in standard errors, and `unknown` the one that refuses the
    answer. A surface is taken to be off by up to `farther` times the largest error that was seen.
    """

    log_likelihood: float = 0.1
    rounds: int = 3
    move: float = 0.25
    unknown: float = 0.5
    farther: float = 3.0


ACCURACY = Accuracy()


@dataclass(frozen=True)
class Doubt:
    """What each surface's error near the outcome does at most: NaN where it is not known.

    `moves` (N,) are standard errors of an estimate, `changes` (N,) of the log-density without
    noise; infinite where the outcome may be beyond an extreme, zero with noise or without surfaces.
    """

    moves: Array
    changes: Array

    @property
    def error(self) -> float:
        """Of the log-likelihood: surfaces of different experiments err independently."""
        return float(np.linalg.norm(np.nan_to_num(self.changes, nan=0.0, posinf=np.inf)))

    @property
    def wanting(self) -> Flags:
        """Experiments (N,) whose surfaces are to be more exact near the measured outcomes."""
        found: Flags = self.moves > ACCURACY.move
        if self.error > ACCURACY.log_likelihood:
            found |= self.changes > ACCURACY.log_likelihood / np.sqrt(self.changes.size)
        return found


def doubt(problem: Problem, inference: Inference, alpha: Array, checked: Checked | None) -> Doubt:
    """How far the error of each surface near the outcome moves an estimate and a log-density.

    The error is the largest that the runs of the check saw there. An outcome that is off by it has
    another score, and H^-1 times the difference is the step of the estimates, to first order. An
    outcome that is then out of every law's reach tells nothing of them: it was measured. A move is
    not known where no run came near, or the estimates have no standard errors.
    """
    count = problem.condition.size
    moves, changes = np.full(count, np.nan), np.zeros(count)
    if problem.surface is None or checked is None:
        return Doubt(moves, changes)
    known = np.isfinite(checked.error)
    error = np.where(known, checked.largest, 0.0)
    here = problem.likelihood(alpha)
    if inference.positive:
        moves[known] = 0.0
        steps = inference.covariance / inference.standard_error[inference.free]
        for off in (error, -error):
            there = problem.given(problem.outcomes + off).likelihood(alpha)
            assert here.scores is not None
            assert there.scores is not None
            apart = (there.scores - here.scores)[:, inference.free]
            moved = np.abs(apart @ steps).max(axis=1, initial=0.0)
            reached = (there.status == Status.SOLVED) & np.isfinite(there.each)
            moves = np.maximum(moves, np.where(reached, moved, 0.0))
    if problem.levels is not None:
        for off in (ACCURACY.farther * error, -ACCURACY.farther * error):
            beyond = problem.levels.given(problem.outcomes + off).evaluate(alpha)
            reached = beyond.status == Status.SOLVED
            changes = np.maximum(
                changes, np.where(reached, np.abs(beyond.each - here.each), np.inf)
            )
        changes[~known] = np.nan
    return Doubt(moves, changes)


def doubt_refusals(doubted: Doubt, ids: Sequence[str]) -> list[Diagnostic]:
    """Experiments whose surfaces leave an estimate or a density unknown."""
    return [
        *_refused(
            doubted.moves > ACCURACY.unknown,
            "near the measured outcome the response surface misses the simulator by so much that "
            f"an estimate could move by {np.nanmax(doubted.moves, initial=0.0):.2g} standard "
            "errors",
            "see whether it is an outlier, or whether the simulator has a kink or a step there; ",
            ids,
        ),
        *_refused(
            np.isposinf(doubted.changes),
            "the measured outcome lies at an extreme of the response surface, nearer than the "
            "surface is exact, so that its density is not known",
            "add measurement noise ([noise] sd), check these rows; ",
            ids,
        ),
    ]


def _refused(rows: Flags, what: str, remedy: str, ids: Sequence[str]) -> list[Diagnostic]:
    where = np.flatnonzero(rows)
    if not where.size:
        return []
    remedy += "choose a tolerance, such as 0.005, or allow more runs (max_runs)"
    what = f"{named(where, ids)}: {what}"
    return [Diagnostic("response surface", what, remedy, chosen(where, ids))]
