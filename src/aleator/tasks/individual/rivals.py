"""Other maxima of the likelihood, of which the highest need not be the physical one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aleator.inference.diagnostics.estimates import LARGEST_EDM
from aleator.inference.diagnostics.individual import Rival
from aleator.inference.information import Inference, infer
from aleator.laws import Hyperparameter
from aleator.likelihood.individual import GaussHermite, IndividualLikelihood, PlanePanels
from aleator.likelihood.problem import Problem
from aleator.search import Objective, SearchResult, ascend
from aleator.search.interface import RULED_OUT
from aleator.tasks.individual.order import in_order
from aleator.tasks.individual.settle import Settled, climbed
from aleator.types import Array

NODES = 5
"""Gauss-Hermite nodes a variate that a second maximum is looked at with."""
TRIED = 2
"""Optima of the search that are looked at, besides the best."""
APART = 2.0
"""Standard errors that tell two maxima apart."""


def rivals(
    end: Settled, inference: Inference, found: SearchResult, others: Sequence[Array]
) -> tuple[Rival, ...]:
    """Other optima of the search that are maxima indeed: arrived at, inside, and bent down.

    Those that only a limit holds are none. With panels of two variates, where a climb costs most,
    only those `others` (K,) that were climbed to with them. Cost: some tens of evaluations for
    each, with no more nodes than a search takes.
    """
    if not inference.positive:
        return ()
    known: list[Array] = [end.alpha]
    kept = []
    likelihood, rule = end.likelihood, end.likelihood.rule
    if isinstance(rule, GaussHermite):
        likelihood = likelihood.by(GaussHermite(min(rule.first, NODES)), end.alpha)
    arrived = list(others)
    if not isinstance(rule, PlanePanels):
        arrived += [a.alpha for a in found.ascents if a.converged]
    for optimum in found.optima[1:]:
        if len(known) > TRIED:
            break
        if not _one_of(optimum.alpha, arrived):
            continue
        if any(near(optimum.alpha, other, inference) for other in known):
            continue
        held, alpha = climbed(likelihood, optimum.alpha)
        alpha = in_order(alpha, end.likelihood.inputs)
        if any(near(alpha, one, inference) for one in known):
            continue
        known.append(alpha)
        value = end.likelihood.adapted(alpha).evaluate(alpha).total
        rival = _of_nodes(held, alpha, value, end, inference)
        if rival is not None:
            kept.append(rival)
    return tuple(sorted(kept, key=lambda rival: rival.drop))


def as_good(problem: Problem, found: SearchResult, inference: Inference) -> tuple[Rival, ...]:
    """Other optima of a search that are maxima and that a drop of 1.92 does not rule out.

    They differ by more than a standard error, and not by the order of equal components only. Cost:
    a climb with its information for each of `found.rivals`.
    """
    if not inference.positive:
        return ()
    objective, hyperparameters = problem.objective, problem.model.hyperparameters
    kept: list[Rival] = []
    for other in found.rivals:
        alpha, value = ascend(
            objective, other, hyperparameters, inference.identified, inference.information
        )
        alpha = in_order(alpha, problem.model.inputs)
        if any(near(alpha, known.alpha, inference) for known in kept):
            continue
        drop = found.log_likelihood - value
        rival = _judged(objective, hyperparameters, alpha, drop, found.alpha, inference)
        if rival is not None and rival.moved and drop < RULED_OUT:
            kept.append(rival)
    return tuple(sorted(kept, key=lambda rival: rival.drop))


def elsewhere(
    found: SearchResult, inference: Inference, likelihood: IndividualLikelihood
) -> list[Array]:
    """Optima (K,) of a search on coarse surfaces that exact ones may prefer to its best.

    They lie apart, no mean is on a limit, and the noise that they need is at most e times larger.
    """
    limits = np.array(
        [(h.lower, h.upper) if h.free and not h.log else (-np.inf, np.inf)
         for h in likelihood.hyperparameters]
    )  # fmt: skip
    known, best = [found.alpha], found.log_likelihood
    for optimum in found.optima[1:]:
        alpha = optimum.alpha
        if (
            len(known) <= TRIED
            and np.all((limits[:, 0] < alpha) & (alpha < limits[:, 1]))
            and best - optimum.log_likelihood < likelihood.layout.experiment.size
            and not any(near(alpha, other, inference) for other in known)
        ):
            known.append(alpha)
    return known[1:]


def followed_rivals(
    others: Sequence[Settled], end: Settled, inference: Inference
) -> tuple[Rival, ...]:
    """Those of maxima that were followed to their own ends which are maxima indeed."""
    found = [
        _of_nodes(other.likelihood, other.alpha, other.value, end, inference)
        for other in others
        if not near(other.alpha, end.alpha, inference)
    ]
    return tuple(sorted((r for r in found if r is not None), key=lambda rival: rival.drop))


def _of_nodes(
    held: IndividualLikelihood, alpha: Array, value: float, end: Settled, inference: Inference
) -> Rival | None:
    objective, drop = held.followed, end.value - value
    return _judged(objective, held.hyperparameters, alpha, drop, end.alpha, inference)


def _judged(
    objective: Objective,
    hyperparameters: Sequence[Hyperparameter],
    alpha: Array,
    drop: float,
    here: Array,
    inference: Inference,
) -> Rival | None:
    """What lies lower than `here` (K,) by `drop`, if it is a maximum."""
    about = infer(objective, alpha, hyperparameters)
    stuck = [a for a, b in zip(about.at_bound, inference.at_bound, strict=True) if a and a != b]
    if stuck or not about.positive or not about.edm < LARGEST_EDM or not np.isfinite(drop):
        return None
    sizes = np.abs(_errors(alpha, here, inference))
    moved = tuple(int(k) for k in np.flatnonzero(np.nan_to_num(sizes) > 1.0))
    return Rival(alpha, here, drop, moved)


def _one_of(alpha: Array, known: Sequence[Array]) -> bool:
    return any(np.array_equal(alpha, other) for other in known)


def near(alpha: Array, other: Array, inference: Inference) -> bool:
    """Whether no hyperparameter differs by two standard errors, as far as they are known."""
    sizes = np.abs(_errors(alpha, other, inference))
    return bool(np.nanmax(sizes, initial=0.0) < APART)


def _errors(alpha: Array, other: Array, inference: Inference) -> Array:
    """How far apart two alphas are in standard errors (K,); NaN where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((alpha - other) / inference.standard_error)
