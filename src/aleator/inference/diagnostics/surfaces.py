"""How good the response surfaces are, and what to say where they are not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from aleator.inference.check import Checked
from aleator.inference.diagnostics.naming import chosen, named
from aleator.likelihood.problem import Problem
from aleator.results.values import Diagnostic
from aleator.surrogates import Surface
from aleator.types import Array

LARGEST_SURFACE_ERROR = 0.1
"""Error of a surface under the identified law, over the outcome's sd, worth a warning."""
USELESS = 0.5
"""The same, at which an answer is not sound."""
WRONG, WORSE, SHARE = 0.03, 4.0, 0.03
"""So are surfaces with an error above the first, so many times the estimated one, in such a share
of the experiments. Right ones were at most 3.3 times as rough as estimated, and most a fifth.
"""


def surface_errors(problem: Problem, checked: Checked | None) -> Array:
    """Error of the surfaces under the identified law, over the outcome's sd, (N,); NaN if unknown.

    By the runs of the check, which no surface was fitted to: they lie near the measured outcomes.
    """
    if checked is None:
        return np.full(problem.condition.size, np.nan)
    return checked.relative


def surface_report(problem: Problem) -> dict[str, Any] | None:
    """How good the surfaces are, relative to the outcome's scatter under the law or on the box."""
    if problem.surface is None:
        return None
    return judged(problem.surface, "under the law" if problem.model.follows else "on the box")


def relative_errors(surface: Surface) -> Array:
    """The estimated error of each surface, over the scatter or the noise that it is judged by."""
    return np.asarray(surface.error / np.where(surface.scatter > 0.0, surface.scatter, np.inf))


def judged(
    surface: Surface, where: str = "under the law", against: str = "the outcome's scatter"
) -> dict[str, Any]:
    """How good surfaces are, relative to what they were judged against."""
    relative = relative_errors(surface)
    return {
        "converged": int(surface.converged.sum()),
        "experiments": int(surface.converged.size),
        "median_error": float(np.median(relative)),
        "worst_error": float(np.max(relative)),
        "where": where,
        "against": against,
        "runs": int(surface.total_runs),
    }


def surface_refusals(
    problem: Problem, checked: Checked | None, surface_error: Array, ids: Sequence[str]
) -> list[Diagnostic]:
    """Surfaces by which an answer that rests on them cannot be sound."""
    found = _useless(problem, checked, surface_error, ids)
    if found or problem.surface is None or checked is None:
        return found
    return worse_than_estimated(checked, problem.surface.error[problem.condition], ids)


def worse_than_estimated(
    checked: Checked, estimated: Array, ids: Sequence[str]
) -> list[Diagnostic]:
    """Surfaces whose estimated errors (M,) are far too small: what rests on them is not known.

    `ids` (M,) are the experiments of the observations.
    """
    relative = checked.relative
    with np.errstate(invalid="ignore"):
        worse = (relative > WRONG) & (checked.typical > WORSE * estimated)
    rows = np.flatnonzero(worse)
    if rows.size < max(2, SHARE * worse.size):
        return []
    return [
        Diagnostic(
            "response surface",
            f"{named(rows, ids)}: the response surface misses the simulator by more than "
            f"{WORSE:.0f} times its estimated error, and by up to {relative[rows].max():.1%} "
            "of the outcome's scatter under the identified law",
            "see whether the simulator answers the same for equal parameters; choose a tolerance, "
            "such as 0.005, for surfaces that are exact on all of their region",
            chosen(rows, ids),
        )
    ]


def _useless(
    problem: Problem, checked: Checked | None, surface_error: Array, ids: Sequence[str]
) -> list[Diagnostic]:
    """Surfaces that are rough under the law."""
    surface = problem.surface
    if surface is None:
        return []
    with np.errstate(invalid="ignore", divide="ignore"):
        if checked is not None:
            relative = surface_error
        elif problem.model.follows:
            relative = (surface.error / surface.scatter)[problem.condition]
        else:
            return []
        useless = np.flatnonzero(relative > USELESS)
    if not useless.size:
        return []
    return [
        Diagnostic(
            "response surface",
            f"{named(useless, ids)}: the response surface misses the simulator by more than "
            f"{USELESS:.0%} of the outcome's scatter under the identified law, so that the "
            "estimates cannot be trusted",
            "choose a tolerance, such as 0.005, for surfaces that are exact on all of their region "
            'whatever the answer; take transform = "log" where the outcome spans decades; or '
            "narrow the box",
            chosen(useless, ids),
        )
    ]


def surface_warnings(
    problem: Problem, surface_error: Array, ids: Sequence[str]
) -> list[Diagnostic]:
    """Surfaces that did not reach their tolerance, and surfaces too rough for the answer."""
    if problem.surface is None:
        return []
    unexact = _unexact if problem.model.follows else _unconverged
    warnings = unexact(problem, problem.surface, ids)
    with np.errstate(invalid="ignore"):
        rough = np.flatnonzero(surface_error > LARGEST_SURFACE_ERROR)
    if rough.size:
        warnings.append(
            Diagnostic(
                "response surface",
                f"{named(rough, ids)}: the error of the response surface is above "
                f"{LARGEST_SURFACE_ERROR:.0%} of the outcome's standard deviation under the "
                "identified law",
                "lower the tolerance of the surface, or narrow the box around the law",
                chosen(rough, ids),
            )
        )
    return warnings


def _unexact(problem: Problem, surface: Surface, ids: Sequence[str]) -> list[Diagnostic]:
    """Surfaces that are rough under the law: more runs did not help, or did not move the answer."""
    rough = surface.error > LARGEST_SURFACE_ERROR * surface.scatter
    rows = np.flatnonzero((rough & ~surface.converged)[problem.condition])
    if not rows.size:
        return []
    return [
        Diagnostic(
            "response surface",
            f"{named(rows, ids)}: the estimated error of the response surface is above "
            f"{LARGEST_SURFACE_ERROR:.0%} of the outcome's scatter under the law; more runs "
            "stopped making it smaller, or stopped changing the estimates",
            "see what the verification says of these experiments; choose a tolerance, such as "
            "0.005, or allow more runs (max_runs)",
            chosen(rows, ids),
        )
    ]


def _unconverged(problem: Problem, surface: Surface, ids: Sequence[str]) -> list[Diagnostic]:
    """Two reasons: the runs were used up, or more runs stopped helping."""
    choice = problem.model.surfaces
    assert choice is not None
    missed = ~surface.converged[problem.condition]
    spent = surface.runs[problem.condition] >= choice.max_runs
    warnings = []
    for which, what, remedy in (
        (
            missed & spent,
            f"the estimated error was still above the tolerance when all {choice.max_runs} runs "
            "were used",
            "allow more runs an experiment (max_runs), or narrow the box",
        ),
        (
            missed & ~spent,
            "the estimated error stays above the tolerance however many runs are made; usual "
            "causes are the simulator's own numerical error, or an outcome that jumps",
            "make the simulator's own tolerances finer, raise the tolerance of the surface, or use "
            "collocation",
        ),
    ):
        rows = np.flatnonzero(which)
        if rows.size:
            message = f"{named(rows, ids)}: {what}"
            warnings.append(Diagnostic("response surface", message, remedy, chosen(rows, ids)))
    return warnings
