"""Diagnostics by the Monte Carlo check: what it could not judge, and where it disagrees."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from aleator.inference.diagnostics.naming import chosen, named
from aleator.inference.diagnostics.near_outcomes import Doubt
from aleator.inference.information import Inference
from aleator.inference.verification import FEW_SAMPLES, Movement, Verification, movement
from aleator.laws import Hyperparameter
from aleator.laws.prior import prior_score
from aleator.likelihood.policy import density_remedy
from aleator.likelihood.problem import Problem
from aleator.results.values import Diagnostic
from aleator.search.value import LogLikelihood
from aleator.types import Array

MOST = 0.5
"""Share of the experiments that a check must reach for an answer to count as sound."""
LARGEST_MOVE = 0.25
"""Standard errors by which an estimate may be off before a reader must know."""


def score_steps(
    inference: Inference, alpha: Array, hyperparameters: Sequence[Hyperparameter]
) -> Array:
    """Steps (K,) at which the check differences the log-likelihood; zero where there is no error.

    A quarter of the standard error that each estimate would have if all others were known, within
    the limits. Where estimates are correlated the standard error itself is many times that, and a
    difference over it is far from a derivative.
    """
    room = [min(a - h.lower, h.upper - a) for a, h in zip(alpha, hyperparameters, strict=True)]
    step = np.zeros(alpha.size)
    if inference.positive:
        inside = np.isin(inference.identified, inference.free)
        step[inference.free] = 0.25 / np.sqrt(np.diag(inference.information)[inside])
    return np.asarray(np.clip(step, 0.0, np.maximum(room, 0.0)))


def refusals(
    honest: LogLikelihood, checked: Verification | None, ids: Sequence[str]
) -> list[Diagnostic]:
    """Where the densities and the check disagree in a single experiment."""
    if checked is None:
        return []
    if np.mean(checked.reached) < MOST:
        return [
            Diagnostic(
                "verification",
                f"the check on the simulator could judge only {np.sum(checked.reached)} of "
                f"{len(ids)} experiments: for the others no outcome that was simulated under the "
                "identified law came near the measured one",
                "search from more starts, widen the limits of the law, or take more samples",
                chosen(np.flatnonzero(~checked.reached), ids),
            )
        ]
    lost = np.flatnonzero(checked.contradicted)
    if lost.size:
        return [
            Diagnostic(
                "verification",
                f"{named(lost, ids)}: where the response surfaces explain the measured outcome the "
                "simulator's own outcomes lie elsewhere, so that the check found no density",
                "choose a tolerance, such as 0.005, for surfaces that are exact on all of their "
                "region; or take more samples",
                chosen(lost, ids),
            )
        ]
    gap = honest.each - checked.each
    bad = np.flatnonzero(
        checked.reached & ~(np.abs(gap) < np.maximum(1.0, 5.0 * checked.each_error))
    )
    if bad.size == 0:
        return []
    return [
        Diagnostic(
            "verification",
            f"{named(bad, ids)}: the log-density that was computed and that of the check on the "
            "simulator differ by more than 1, and by more than five standard errors of the check",
            "raise the order of the density, lower the tolerance of the surface, or take more "
            "samples",
            chosen(bad, ids),
        )
    ]


def total_refusals(
    honest: LogLikelihood,
    checked: Verification | None,
    inference: Inference,
    problem: Problem,
    alpha: Array,
    doubted: Doubt,
) -> list[Diagnostic]:
    """A difference in the total that moves an estimate, where only the surfaces can have made it.

    The likelihood is exact but for them, where it is that of level sets. They have not made it
    where all that the runs saw of their errors near the outcomes, all to one side, moves no
    estimate (see `doubt`): the check's kernel smears what ends within its width.
    """
    if checked is None or problem.levels is None or np.sum(doubted.moves) < LARGEST_MOVE:
        return []
    return _total(honest, checked, _step(checked, inference, problem, alpha), problem)


def _step(
    checked: Verification, inference: Inference, problem: Problem, alpha: Array
) -> Movement | None:
    if checked.score is None:
        return None
    prior = prior_score(problem.model.hyperparameters, alpha)
    return movement(
        checked.score, inference.free, inference.standard_error, prior, inference.covariance
    )


def notes(
    honest: LogLikelihood,
    checked: Verification | None,
    inference: Inference,
    problem: Problem,
    alpha: Array,
    ids: Sequence[str],
    *,
    told: bool,
) -> list[Diagnostic]:
    """Experiments that it could not judge, a difference in the total, how far alpha would move.

    The last only if `told`: from an answer that is refused a step leads nowhere.
    """
    if checked is None:
        return []
    step = _step(checked, inference, problem, alpha) if told else None
    total = [] if problem.levels is not None else _total(honest, checked, step, problem)
    return [
        *_unseen(checked, inference, problem, alpha, ids),
        *total,
        *_moves(step, inference, problem),
    ]


def _unseen(
    checked: Verification, inference: Inference, problem: Problem, alpha: Array, ids: Sequence[str]
) -> list[Diagnostic]:
    """Experiments that are not verified, where alpha would be another without them."""
    few = np.flatnonzero(~checked.reached)
    if few.size == 0:
        return []
    moved = _without(few, inference, problem, alpha)
    if moved <= LARGEST_MOVE:
        return []
    return [
        Diagnostic(
            "verification",
            f"{named(few, ids)}: hardly any outcome that was simulated under the identified law "
            f"comes near the measured one (fewer than {FEW_SAMPLES} effective samples), so that "
            "the check cannot verify their part of the log-likelihood; without them an estimate "
            f"would move by {_size(moved)}",
            "see whether they are outliers, or whether the law has too little scatter or noise; or "
            "take more samples",
            chosen(few, ids),
        )
    ]


def _without(rows: NDArray[np.intp], inference: Inference, problem: Problem, alpha: Array) -> float:
    """Standard errors by which an estimate moves, at most, to first order without some experiments.

    H^-1 times the score of the others, which is minus that of these at the maximum: the
    infinitesimal jackknife (Giordano et al., 2019). Infinite where the information has no inverse.
    """
    scores = problem.objective(alpha).scores
    assert scores is not None
    free = inference.free
    if not inference.positive or not free.size:
        return float("inf")
    step = inference.covariance @ scores[rows][:, free].sum(axis=0)
    return float(np.max(np.abs(step) / inference.standard_error[free]))


def _total(
    honest: LogLikelihood, checked: Verification, step: Movement | None, problem: Problem
) -> list[Diagnostic]:
    gap = float(np.sum(honest.each[checked.reached])) - checked.total
    allowed = max(0.1 + 0.002 * honest.each.size, 4.0 * checked.standard_error)
    if abs(gap) <= allowed:
        return []
    meaning = "estimates and standard errors may be off by a share of a standard error"
    if step is not None:
        largest = float(np.max(np.abs(step.step)))
        if largest < LARGEST_MOVE:
            # a difference that is the same for all alpha, which decides nothing
            return []
        meaning = "with the density of the simulator itself an estimate would move by " + _size(
            largest
        )
    return [
        Diagnostic(
            "verification",
            f"the log-likelihood differs from Monte Carlo on the simulator by {gap:.2g}: {meaning}",
            density_remedy(problem.model),
        )
    ]


def _moves(step: Movement | None, inference: Inference, problem: Problem) -> list[Diagnostic]:
    """Hyperparameters that the exact density would move, beyond two errors of the step."""
    if step is None:
        return []
    names = [problem.model.hyperparameters[k].name for k in inference.free]
    rows = np.flatnonzero(np.abs(step.step) - 2.0 * step.error > LARGEST_MOVE)
    if rows.size == 0:
        return []
    rows = rows[np.argsort(-np.abs(step.step[rows]))]
    moves = ", ".join(
        f"{names[i]} would {'rise' if step.step[i] > 0 else 'fall'} by {_size(abs(step.step[i]))}"
        for i in rows
    )
    return [
        Diagnostic(
            "density",
            f"the density in use is an approximation: with the exact one {moves}",
            density_remedy(problem.model),
            tuple(names[i] for i in rows),
        )
    ]


def _size(step: float) -> str:
    return f"about {step:.2f} standard errors" if step < 1.0 else "a standard error or more"
