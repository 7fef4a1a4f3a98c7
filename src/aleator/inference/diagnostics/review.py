"""All that a careful reader must be told before trusting an answer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aleator.densities import Status
from aleator.inference.diagnostics import check
from aleator.inference.diagnostics.centering import centering_warnings
from aleator.inference.diagnostics.diagnostic import Diagnostic
from aleator.inference.diagnostics.directions import weak_directions
from aleator.inference.diagnostics.naming import chosen, named
from aleator.inference.diagnostics.surfaces import surface_refusals, surface_warnings
from aleator.inference.information import Inference
from aleator.inference.profile import Profile
from aleator.inference.verification import Verification
from aleator.laws import Hyperparameter
from aleator.likelihood.policy import nodes_remedy, quadrature_gap
from aleator.likelihood.problem import Problem
from aleator.search import SearchResult, wide_limits
from aleator.search.value import LogLikelihood
from aleator.types import Array

LARGEST_EDM = 1e-3
"""Distance to the maximum, in log-likelihood, that still counts as arrived."""
MOMENTS_STAND_IN = Diagnostic(
    "density",
    "the exact density would need more nodes than are used, because the outcome bends too much or "
    "the noise is too small; a density with four moments of the outcome was taken in its place",
    'compare with kind = "maximum_entropy" of order 6, or with kind = "logspline"',
)
LARGEST_QUADRATURE_GAP = 0.1
"""Change of the log-likelihood with more nodes that is worth a warning."""
FEW_EXPERIMENTS = 5
"""Experiments for each free hyperparameter below which normal theory is not to be trusted."""


def statuses(codes: NDArray[np.int64], log_density: Array) -> list[str]:
    """One word for each experiment: solved, outside_support, or why the density failed."""
    outside = (codes == Status.SOLVED) & ~np.isfinite(log_density)
    combined = np.where(outside, int(Status.OUTSIDE_SUPPORT), codes)
    return [Status(int(code)).name.lower() for code in combined]


def review(
    problem: Problem,
    found: SearchResult,
    inference: Inference,
    profile: Profile,
    honest: LogLikelihood,
    checked: Verification | None,
    surface_error: Array,
    ids: Sequence[str],
    conditions: pd.DataFrame,
) -> tuple[tuple[Diagnostic, ...], bool]:
    """All warnings, and whether the answer is accepted; `conditions` has a row an experiment."""
    hyperparameters = problem.model.hyperparameters
    refusals = [
        *_density_warnings(honest, ids),
        *_search_refusals(inference, hyperparameters),
        *check.refusals(honest, checked, ids),
        *surface_refusals(problem, found.alpha, checked, surface_error, ids),
    ]
    notes = [
        *_count_warnings(len(ids), inference),
        *_bound_warnings(hyperparameters, inference, profile),
        *weak_directions(inference, found.alpha, hyperparameters),
        *centering_warnings(problem, found.alpha, inference, conditions),
        *surface_warnings(problem, surface_error, ids),
        *_quadrature_warnings(quadrature_gap(problem, found.alpha), problem),
        *check.notes(honest, checked, inference, problem, found.alpha, ids, told=not refusals),
    ]
    return (*refusals, *notes), not refusals


def _count_warnings(experiments: int, inference: Inference) -> list[Diagnostic]:
    free = inference.identified.size
    if experiments >= FEW_EXPERIMENTS * free:
        return []
    return [
        Diagnostic(
            "experiments",
            f"{experiments} experiments for {free} free hyperparameters: standard errors and "
            "intervals are right for many experiments only, and estimated standard deviations tend "
            "to be too small, by about the ratio of hyperparameters to experiments",
            f"fix some, or add experiments ({2 * FEW_EXPERIMENTS} for each is a start)",
        )
    ]


def _quadrature_warnings(gap: float, problem: Problem) -> list[Diagnostic]:
    # of an outcome without density there is no difference, and it is told as such
    if not np.isfinite(gap) or abs(gap) < LARGEST_QUADRATURE_GAP:
        return []
    return [
        Diagnostic(
            "quadrature",
            f"50 % more nodes change the log-likelihood by {gap:.2g}: there are too few",
            nodes_remedy(problem),
        )
    ]


def _density_warnings(honest: LogLikelihood, ids: Sequence[str]) -> list[Diagnostic]:
    words = np.array(statuses(honest.status, honest.each))
    warnings = []
    for status in (s for s in Status if s is not Status.SOLVED):
        bad = np.flatnonzero(words == status.name.lower())
        if bad.size:
            what, _, remedy = status.explanation.partition(": ")
            warnings.append(
                Diagnostic("density", f"{named(bad, ids)}: {what}", remedy, chosen(bad, ids))
            )
    return warnings


def _search_refusals(
    inference: Inference, hyperparameters: Sequence[Hyperparameter]
) -> list[Diagnostic]:
    warnings = []
    wide = wide_limits(hyperparameters)
    narrow = f"; narrow the limits of {', '.join(wide)}, many orders of magnitude wide"
    also = narrow if wide else ""
    if not inference.positive:
        warnings.append(
            Diagnostic(
                "search",
                "the information matrix at the answer is not positive definite: it is no maximum, "
                "or a hyperparameter has no effect",
                f"fix a hyperparameter, or search from more starts{also}",
            )
        )
    elif not inference.edm < LARGEST_EDM:
        warnings.append(
            Diagnostic(
                "search",
                "the search did not arrive: the maximum is an estimated "
                f"{inference.edm:.2g} higher in log-likelihood",
                f"allow more evaluations a start, search from more starts, or polish{also}",
            )
        )
    return warnings


def _bound_warnings(
    hyperparameters: Sequence[Hyperparameter], inference: Inference, profile: Profile
) -> list[Diagnostic]:
    warnings = [
        Diagnostic(
            "bounds",
            f"{h.name} ends on its {side} limit {h.lower if side == 'lower' else h.upper:.6g}; "
            "it has no standard error, and those of the others hold with it fixed there",
            "widen the limit if it is not physical, or fix the hyperparameter",
            (h.name,),
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
            Diagnostic(
                "bounds",
                f"the 95 % interval of {', '.join(cut)} ends on a limit: the experiments do not "
                "rule out values beyond it",
                "widen the limit if it is not physical",
                tuple(cut),
            )
        )
    return warnings
