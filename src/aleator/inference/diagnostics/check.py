"""What the check on the simulator says of an answer, and what a density of moments costs."""

from __future__ import annotations

import numpy as np

from aleator.inference.information import Inference
from aleator.likelihood.problem import Problem
from aleator.likelihood.scoring import scoring_step
from aleator.results.values import Diagnostic
from aleator.search.value import LogLikelihood
from aleator.types import Array

LARGEST_CHANGE = 0.5
"""Change of the log-likelihood by the simulator, beyond its error, that refuses an answer."""
LARGEST_MOVE = 0.25
"""Standard errors by which an estimate may be off before a reader must know."""


def check_refusals(change: float, error: float) -> list[Diagnostic]:
    """Whether the simulator itself gives another log-likelihood than its surfaces."""
    if not abs(change) > LARGEST_CHANGE + 3.0 * error:
        return []
    return [
        Diagnostic(
            "check",
            f"the simulator itself changes the log-likelihood by {change:+.2g} +- {error:.2g}: the "
            "surfaces are not exact enough",
            "lower the surfaces' tolerance (propagation.tolerance), or narrow the limits",
        )
    ]


def exact_density(problem: Problem, alpha: Array) -> LogLikelihood | None:
    """By the level sets of the same surfaces, where a density of moments was chosen; else None."""
    levels = problem.exactly
    return None if levels is None or problem.levels is not None else levels(alpha)


def density_notes(
    exact: LogLikelihood | None, inference: Inference, problem: Problem
) -> list[Diagnostic]:
    """How far the density of the outcome itself would move an estimate, by one step of scoring."""
    if exact is None or exact.scores is None or not inference.free.size:
        return []
    free = inference.free
    prior = None if exact.prior_score is None else exact.prior_score[free]
    found = scoring_step(exact.scores[:, free], prior)
    if found is None:
        return []
    steps = found.in_standard_errors
    names = [problem.model.hyperparameters[k].name for k in free]
    rows = np.flatnonzero(np.abs(steps) > LARGEST_MOVE)
    if not rows.size:
        return []
    rows = rows[np.argsort(-np.abs(steps[rows]))]
    moves = ", ".join(
        f"{names[i]} would {'rise' if steps[i] > 0 else 'fall'} by {_size(abs(steps[i]))}"
        for i in rows
    )
    return [
        Diagnostic(
            "density",
            f"the density in use is an approximation: with the exact one {moves}",
            "leave [density] out: level sets are exact; or take a higher order, and compare",
            tuple(names[i] for i in rows),
        )
    ]


def _size(step: float) -> str:
    return f"about {step:.2f} standard errors" if step < 1.0 else "a standard error or more"
