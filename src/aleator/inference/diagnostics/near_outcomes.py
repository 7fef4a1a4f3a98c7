"""How far the estimates would move by what surfaces have wrong near the measured outcomes.

Surfaces are made exact where the law has its mass. An outcome far out is explained elsewhere, and
where the law is narrow an error there that is small beside the scatter decides on the estimates.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aleator.densities import Status
from aleator.inference.diagnostics.diagnostic import Diagnostic
from aleator.inference.diagnostics.naming import chosen, named
from aleator.inference.information import Inference
from aleator.inference.verification import Verification
from aleator.likelihood.problem import Problem
from aleator.types import Array

DOUBTFUL = 0.25
"""Standard errors by which a surface may move an estimate before it is made more exact there."""
UNKNOWN = 0.5
"""The same that refuses the answer."""


def doubt(
    problem: Problem, inference: Inference, alpha: Array, checked: Verification | None
) -> Array:
    """Standard errors (N,) that each surface's error near the outcome moves an estimate, at most.

    The error is the largest that the runs of the check saw there. An outcome that is off by it has
    another score, and H^-1 times the difference is the step of the estimates, to first order. An
    outcome that is then out of every law's reach tells nothing: it was measured. NaN where it is
    not known: no run came near, or the estimates have no standard errors.
    """
    found = np.full(problem.condition.size, np.nan)
    if problem.surface is None or checked is None or not inference.positive:
        return found
    known = np.isfinite(checked.near_error)
    found[known] = 0.0
    error = np.where(known, checked.near_error, 0.0)
    free = inference.free
    steps = inference.covariance / inference.standard_error[free]
    here = problem.likelihood(alpha)
    for off in (error, -error):
        there = problem.given(problem.outcomes + off).likelihood(alpha)
        assert here.scores is not None
        assert there.scores is not None
        moved = np.abs((there.scores - here.scores)[:, free] @ steps).max(axis=1, initial=0.0)
        reached = (there.status == Status.SOLVED) & np.isfinite(there.each)
        found = np.maximum(found, np.where(reached, moved, 0.0))
    return found


def doubt_refusals(moves: Array, ids: Sequence[str]) -> list[Diagnostic]:
    """Experiments whose surfaces leave an estimate unknown."""
    rows = np.flatnonzero(moves > UNKNOWN)
    if not rows.size:
        return []
    return [
        Diagnostic(
            "response surface",
            f"{named(rows, ids)}: near the measured outcome the response surface misses the "
            f"simulator by so much that an estimate could move by {moves[rows].max():.2g} standard "
            "errors",
            "see whether it is an outlier, or whether the simulator has a kink or a step there; "
            "choose a tolerance, such as 0.005, or allow more runs (max_runs)",
            chosen(rows, ids),
        )
    ]
