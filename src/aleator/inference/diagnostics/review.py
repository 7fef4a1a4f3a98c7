"""All that a careful reader must be told before trusting an answer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aleator.inference.check import Checked
from aleator.inference.diagnostics.centering import centering_warnings
from aleator.inference.diagnostics.check import check_refusals, density_notes
from aleator.inference.diagnostics.directions import weak_directions
from aleator.inference.diagnostics.estimates import (
    bound_warnings,
    count_warnings,
    once_warnings,
    search_refusals,
)
from aleator.inference.diagnostics.levels import (
    level_refusals,
    level_warnings,
    unreached_refusals,
)
from aleator.inference.diagnostics.naming import chosen, named
from aleator.inference.diagnostics.near_outcomes import Doubt, doubt_refusals
from aleator.inference.diagnostics.surfaces import surface_refusals, surface_warnings
from aleator.inference.information import Inference
from aleator.inference.profile import Profile
from aleator.likelihood.problem import Problem
from aleator.results.values import Diagnostic
from aleator.search import SearchResult
from aleator.search.value import LogLikelihood
from aleator.status import Status
from aleator.types import Array

LARGEST_QUADRATURE_GAP = 0.1
"""Change of the log-likelihood with more nodes at which they are too few."""


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
    checked: Checked | None,
    exact: LogLikelihood | None,
    surface_error: Array,
    doubted: Doubt,
    ids: Sequence[str],
    conditions: pd.DataFrame,
    changed: Array,
) -> tuple[tuple[Diagnostic, ...], bool]:
    """All warnings, and whether the answer is sound.

    `exact` is the log-likelihood by level sets where a density of moments was chosen, `doubted`
    what surfaces have wrong near the outcomes, `conditions` has a row an experiment,
    and `changed` (2, N) is that of `by_finer_cells`.
    """
    hyperparameters = problem.model.hyperparameters
    refusals = [
        *_density_warnings(honest, ids),
        *search_refusals(inference, hyperparameters),
        *([] if checked is None else check_refusals(checked.total, checked.standard_error)),
        *surface_refusals(problem, checked, surface_error, ids),
        *doubt_refusals(doubted, ids),
        *level_refusals(changed, ids),
        *unreached_refusals(problem, found.alpha, ids),
        *_quadrature_refusals(problem.gap(found.alpha)),
    ]
    notes = [
        *count_warnings(len(ids), inference),
        *once_warnings(found),
        *bound_warnings(hyperparameters, inference, profile),
        *weak_directions(inference, hyperparameters),
        *centering_warnings(problem, found.alpha, inference, conditions),
        *surface_warnings(problem, surface_error, ids),
        *level_warnings(changed),
        *([] if refusals else density_notes(exact, inference, problem)),
    ]
    return (*refusals, *notes), not refusals


def _quadrature_refusals(gap: float) -> list[Diagnostic]:
    # of an outcome without density there is no difference, and it is told as such
    if not np.isfinite(gap) or abs(gap) < LARGEST_QUADRATURE_GAP:
        return []
    return [
        Diagnostic(
            "quadrature",
            f"50 % more nodes change the log-likelihood by {gap:.2g}: there are too few",
            "raise propagation.nodes, or leave [density] out: level sets have none",
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
