"""What must be told of an answer from experiments with several observations each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aleator.inference.diagnostics.diagnostic import Diagnostic
from aleator.inference.diagnostics.directions import weak_directions
from aleator.inference.diagnostics.estimates import (
    bound_warnings,
    count_warnings,
    search_refusals,
)
from aleator.inference.diagnostics.naming import chosen, named
from aleator.inference.information import Inference
from aleator.inference.profile import Profile
from aleator.laws import Hyperparameter
from aleator.search.value import LogLikelihood
from aleator.types import Array

LARGEST_GAP = 0.1
"""Change of the log-likelihood with more nodes from where on an answer is refused."""
NOTED_GAP = 0.01
"""... from where on it is told."""


def review_individual(
    at: LogLikelihood,
    alpha: Array,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    profile: Profile,
    gap: float,
    ids: Sequence[str],
) -> tuple[tuple[Diagnostic, ...], bool]:
    """All warnings, and whether the answer is accepted."""
    refusals = [
        *_without_density(at, ids),
        *search_refusals(inference, hyperparameters),
        *_too_few_nodes(gap, LARGEST_GAP),
    ]
    notes = [
        *count_warnings(len(ids), inference),
        *bound_warnings(hyperparameters, inference, profile),
        *weak_directions(inference, alpha, hyperparameters),
        *([] if refusals else _too_few_nodes(gap, NOTED_GAP)),
    ]
    return (*refusals, *notes), not refusals


def _without_density(at: LogLikelihood, ids: Sequence[str]) -> list[Diagnostic]:
    lost = np.flatnonzero(~np.isfinite(at.each))
    if not lost.size:
        return []
    return [
        Diagnostic(
            "density",
            f"{named(lost, ids)}: the observations are impossible under the law",
            "widen the limits, or look at the measured values and at the simulator there",
            chosen(lost, ids),
        )
    ]


def _too_few_nodes(gap: float, from_where: float) -> list[Diagnostic]:
    if abs(gap) <= from_where:
        return []
    return [
        Diagnostic(
            "quadrature",
            f"more nodes change the log-likelihood by {gap:.2g}: those that are used are too few "
            "for what the observations leave open of the parameters",
            "let fewer parameters scatter, or see whether the simulator jumps as they change",
        )
    ]
