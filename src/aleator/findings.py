"""What a careful reader must be told before trusting an answer: warnings, statuses, refusals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.densities import Status
from aleator.errors import ExperimentsError
from aleator.identification import Warning
from aleator.inference import Inference, weak_directions
from aleator.laws import Hyperparameter
from aleator.likelihood import NOISE_REACH, Likelihood, LogLikelihood
from aleator.problem import Problem
from aleator.profile import Profile
from aleator.propagation import QuadraturePropagation, finer
from aleator.response import Surface
from aleator.search import SearchResult, wide_limits
from aleator.verification import Verification

Array = NDArray[np.float64]

LARGEST_EDM = 1e-3
"""Distance to the maximum, in log-likelihood, that still counts as arrived."""
LARGEST_QUADRATURE_GAP = 0.1
"""Change of the log-likelihood with more nodes that is worth a warning."""
FEW_SAMPLES = 10
"""Effective samples below which a density is not verified."""
LARGEST_SURFACE_ERROR = 0.1
"""Error of a surface under the identified law, over the outcome's sd, worth a warning."""


def unreachable(likelihood: Likelihood) -> NDArray[np.intp]:
    """Experiments whose outcome has likelihood zero for every admissible alpha."""
    low, high = _reach(likelihood)
    return np.flatnonzero((likelihood.outcomes < low) | (likelihood.outcomes > high))


def refuse_unreachable(likelihood: Likelihood, ids: Sequence[str]) -> None:
    """Raise ExperimentsError that names the experiments outside the reachable range."""
    outside, y = unreachable(likelihood), likelihood.outcomes
    if outside.size == 0:
        return
    low, high = _reach(likelihood)
    named = "; ".join(
        f"experiment {ids[l]}: outcome {y[l]:.6g}, reachable [{low[l]:.6g}, {high[l]:.6g}]"
        for l in outside[:5]
    )
    more = f"; and {outside.size - 5} more" if outside.size > 5 else ""
    remedy = "check these rows and the units, widen the box of the parameters, or "
    remedy += "allow more noise" if likelihood.noisy else "add measurement noise ([noise] sd)"
    raise ExperimentsError(
        f"{outside.size} outcome(s) lie outside the range that the simulator reaches on the box, "
        f"so that no law explains them: {named}{more}",
        remedy,
    )


def _reach(likelihood: Likelihood) -> tuple[Array, Array]:
    margin = NOISE_REACH * likelihood.hyperparameters[-1].upper if likelihood.noisy else 0.0
    return likelihood.lower - margin, likelihood.upper + margin


def statuses(codes: NDArray[np.int64], log_density: Array) -> list[str]:
    """One word for each experiment: solved, outside_support, or why the density failed."""
    outside = (codes == Status.SOLVED) & ~np.isfinite(log_density)
    combined = np.where(outside, int(Status.OUTSIDE_SUPPORT), codes)
    return [Status(int(code)).name.lower() for code in combined]


def score_steps(
    inference: Inference, alpha: Array, hyperparameters: Sequence[Hyperparameter]
) -> Array:
    """Steps (K,) at which the check differences the log-likelihood; zero where there is no error.

    A quarter of a standard error, within the limits.
    """
    room = [min(a - h.lower, h.upper - a) for a, h in zip(alpha, hyperparameters, strict=True)]
    step = 0.25 * np.nan_to_num(inference.standard_error)
    return np.asarray(np.clip(step, 0.0, np.maximum(room, 0.0)))


def surface_errors(problem: Problem, checked: Verification | None) -> Array:
    """Error of the surfaces under the identified law, over the outcome's sd, (N,); NaN if unknown.

    Compared with the verification's runs of the simulator, which no surface was fitted to.
    """
    surface, condition = problem.surface, problem.condition
    if surface is None or checked is None:
        return np.full(condition.size, np.nan)
    count, samples = checked.outcomes.shape
    index = np.repeat(condition, samples)
    x = checked.x.reshape(count * samples, -1)[:, problem.moving]
    guess = surface.at(index, x).reshape(count, samples)
    rms = np.sqrt(np.mean((guess - checked.outcomes) ** 2, axis=1))
    scatter = checked.outcomes.std(axis=1)
    return np.asarray(rms / np.where(scatter > 0.0, scatter, np.inf))


def surface_report(surface: Surface | None) -> dict[str, Any] | None:
    """How good the surfaces are over the box, relative to the outcome's scatter there."""
    if surface is None:
        return None
    relative = surface.error / np.where(surface.scatter > 0.0, surface.scatter, np.inf)
    return {
        "converged": int(surface.converged.sum()),
        "experiments": int(surface.converged.size),
        "median_error": float(np.median(relative)),
        "worst_error": float(np.max(relative)),
        "runs": int(surface.total_runs),
    }


def quadrature_gap(problem: Problem, alpha: Array) -> float:
    """Change of the log-likelihood when every parameter gets half as many nodes again.

    Zero for collocation, where nodes cost runs.
    """
    way = problem.likelihood.propagation
    if problem.surface is None or not isinstance(way, QuadraturePropagation):
        return 0.0
    more = finer(way.cubature)
    if more is None:
        return 0.0
    likelihood = replace(problem.likelihood, propagation=replace(way, cubature=more))
    return likelihood.evaluate(alpha).total - problem.likelihood.evaluate(alpha).total


def review(
    problem: Problem,
    found: SearchResult,
    inference: Inference,
    profile: Profile,
    honest: LogLikelihood,
    checked: Verification | None,
    surface_error: Array,
    ids: Sequence[str],
) -> tuple[tuple[Warning, ...], bool]:
    """All warnings, and whether the answer is accepted."""
    hyperparameters = problem.likelihood.hyperparameters
    refusals = [
        *_density_warnings(honest, ids),
        *_search_refusals(inference, hyperparameters),
        *_verification_refusals(honest, checked, ids),
    ]
    notes = [
        *_bound_warnings(hyperparameters, inference, profile),
        *(
            Warning("identifiability", sentence, "fix one of them, or vary the conditions more")
            for sentence in weak_directions(inference, found.alpha, hyperparameters)
        ),
        *_surface_warnings(problem.surface, problem.condition, surface_error, ids),
        *_quadrature_warnings(quadrature_gap(problem, found.alpha)),
        *_verification_notes(honest, checked, ids),
    ]
    return (*refusals, *notes), not refusals


def _quadrature_warnings(gap: float) -> list[Warning]:
    if abs(gap) < LARGEST_QUADRATURE_GAP:
        return []
    return [
        Warning(
            "quadrature",
            f"with half as many nodes again the log-likelihood changes by {gap:.2g}",
            "raise nodes in [propagation]",
        )
    ]


def _density_warnings(honest: LogLikelihood, ids: Sequence[str]) -> list[Warning]:
    words = np.array(statuses(honest.status, honest.each))
    warnings = []
    for status in (s for s in Status if s is not Status.SOLVED):
        bad = np.flatnonzero(words == status.name.lower())
        if bad.size:
            what, _, remedy = status.explanation.partition(": ")
            warnings.append(Warning("density", f"{_experiments(bad, ids)}: {what}", remedy))
    return warnings


def _search_refusals(
    inference: Inference, hyperparameters: Sequence[Hyperparameter]
) -> list[Warning]:
    warnings = []
    wide = wide_limits(hyperparameters)
    narrow = f"; narrow the limits of {', '.join(wide)}, many orders of magnitude wide"
    also = narrow if wide else ""
    if not inference.positive:
        warnings.append(
            Warning(
                "search",
                "the information matrix at the answer is not positive definite: it is no maximum, "
                "or a hyperparameter has no effect",
                f"fix a hyperparameter, or search from more starts{also}",
            )
        )
    elif not inference.edm < LARGEST_EDM:
        warnings.append(
            Warning(
                "search",
                f"the search stopped an estimated {inference.edm:.2g} in log-likelihood "
                "below the maximum",
                f"allow more evaluations a start, search from more starts, or polish{also}",
            )
        )
    return warnings


def _verification_refusals(
    honest: LogLikelihood, checked: Verification | None, ids: Sequence[str]
) -> list[Warning]:
    if checked is None:
        return []
    gap = honest.each - checked.each
    told = checked.effective >= FEW_SAMPLES
    bad = np.flatnonzero(told & ~(np.abs(gap) < np.maximum(1.0, 5.0 * checked.each_error)))
    if bad.size == 0:
        return []
    return [
        Warning(
            "verification",
            f"{_experiments(bad, ids)}: the log-density differs from Monte Carlo on the simulator "
            "by more than 1 and by more than five standard errors",
            "raise the order of the density, lower the tolerance of the surface, or take more "
            "samples",
        )
    ]


def _verification_notes(
    honest: LogLikelihood, checked: Verification | None, ids: Sequence[str]
) -> list[Warning]:
    """What the check could not see, and what it sees in the total only."""
    if checked is None:
        return []
    notes = []
    few = np.flatnonzero(checked.effective < FEW_SAMPLES)
    if few.size:
        notes.append(
            Warning(
                "verification",
                f"{_experiments(few, ids)}: so far out under the identified law that hardly a "
                "sample of the simulator falls there; their log-densities are not verified",
                "look at these experiments: outliers, or a law with too little scatter or noise",
            )
        )
    told = checked.effective >= FEW_SAMPLES
    gap = float(np.sum(honest.each[told] - checked.each[told]))
    allowed = max(0.1 + 0.002 * honest.each.size, 4.0 * checked.standard_error)
    if abs(gap) > allowed:
        notes.append(
            Warning(
                "verification",
                f"the log-likelihood differs from Monte Carlo on the simulator by {gap:.2g}: "
                "estimates and standard errors may be off by a share of a standard error",
                "compare with a higher order of the density, and with collocation",
            )
        )
    return notes


def _bound_warnings(
    hyperparameters: Sequence[Hyperparameter], inference: Inference, profile: Profile
) -> list[Warning]:
    warnings = [
        Warning(
            "bounds",
            f"{h.name} ends on its {side} limit {h.lower if side == 'lower' else h.upper:.6g}; "
            "it has no standard error, and the others are conditional on it",
            "widen the limit if it is not physical, or fix the hyperparameter",
        )
        for h, side in zip(hyperparameters, inference.at_bound, strict=True)
        if side is not None
    ]
    cut = [
        h.name
        for h, side, (low, high) in zip(
            hyperparameters, inference.at_bound, profile.intervals, strict=True
        )
        if side is None and (low == h.lower or high == h.upper)
    ]
    if cut:
        warnings.append(
            Warning(
                "bounds",
                f"the 95 % interval of {', '.join(cut)} ends on a limit: the experiments do not "
                "rule out values beyond it",
                "widen the limit if it is not physical",
            )
        )
    return warnings


def _surface_warnings(
    surface: Surface | None,
    condition: NDArray[np.intp],
    surface_error: Array,
    ids: Sequence[str],
) -> list[Warning]:
    if surface is None:
        return []
    warnings = []
    missed = np.flatnonzero(~surface.converged[condition])
    if missed.size:
        warnings.append(
            Warning(
                "response surface",
                f"{_experiments(missed, ids)}: estimated error above the tolerance when the runs "
                "were used up",
                "allow more runs an experiment (max_runs), or narrow the box",
            )
        )
    with np.errstate(invalid="ignore"):
        rough = np.flatnonzero(surface_error > LARGEST_SURFACE_ERROR)
    if rough.size:
        warnings.append(
            Warning(
                "response surface",
                f"{_experiments(rough, ids)}: surface error above "
                f"{LARGEST_SURFACE_ERROR:.0%} of the outcome's standard deviation under the "
                "identified law",
                "lower the tolerance of the surface, or narrow the box around the law",
            )
        )
    return warnings


def _experiments(which: NDArray[np.intp], ids: Sequence[str]) -> str:
    shown = ", ".join(ids[l] for l in which[:8])
    more = f" and {which.size - 8} more" if which.size > 8 else ""
    return f"experiment{'s' if which.size > 1 else ''} {shown}{more}"
