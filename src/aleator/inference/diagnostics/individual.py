"""What must be told of an answer from experiments with several observations each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

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
from aleator.observations.responses import Observations
from aleator.results.values import Diagnostic
from aleator.search.value import LogLikelihood
from aleator.types import Array, Flags, Indices

LARGEST_GAP = 0.1
"""Change of the log-likelihood with more nodes from where on an answer is refused."""
NOTED_GAP = 0.01
"""... from where on it is told."""
EQUAL = 0.1
"""Maxima whose log-likelihoods differ by less are as high as each other."""
NOTED_FAILING = 0.02
"""Share of a law at which runs fail that is told."""
MOSTLY = 0.5
"""Share of values of which only bounds are known that is told."""


def review_individual(
    at: LogLikelihood,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    profile: Profile,
    gap: float,
    ids: Sequence[str],
) -> tuple[tuple[Diagnostic, ...], bool]:
    """All warnings, and whether the answer was computed soundly."""
    refusals = [
        *_without_density(at, ids),
        *search_refusals(inference, hyperparameters),
        *_too_few_nodes(gap, LARGEST_GAP),
    ]
    notes = [
        *count_warnings(len(ids), inference),
        *bound_warnings(hyperparameters, inference, profile),
        *weak_directions(inference, hyperparameters),
        *([] if refusals else _too_few_nodes(gap, NOTED_GAP)),
    ]
    return (*refusals, *notes), not refusals


def held_warnings(held: Mapping[str, Indices], ids: Sequence[str]) -> list[Diagnostic]:
    """Experiments whose covariates would take a value of their law beyond its limits."""
    return [
        Diagnostic(
            "bounds",
            f"{named(which, ids)}: the formula of {name} leads beyond the limits of {name}, "
            "where it is held",
            f"widen the limits of {name} if they are not physical, or take another formula",
            chosen(which, ids),
        )
        for name, which in held.items()
    ]


def review_data(
    seen: Observations, left: Observations, failing: Array, ids: Sequence[str]
) -> list[Diagnostic]:
    """What is missing: experiments without observations, values without runs, bounds only.

    `seen` are the observations of the table, `left` those of them that runs give a value of, and
    `failing` (N,) is the share of each experiment's law at which runs fail.
    """
    return [
        *_unobserved(seen, ids),
        *_lost(seen, left, ids),
        *_failing(failing, ids),
        *_censored(left),
    ]


def without_surfaces(lost: Flags, of: Indices, ids: Sequence[str]) -> list[Diagnostic]:
    """A refusal where observations (M,) have no surface in the end; `of` (M,) whose they are."""
    if not np.any(lost):
        return []
    which = np.unique(of[lost])
    return [
        Diagnostic(
            "surface",
            f"{named(which, ids)}: too few runs work near the identified law for a surface",
            "mend the simulator there, or narrow the limits of the law",
            chosen(which, ids),
        )
    ]


def rival_warnings(
    rivals: Sequence[Rival], hyperparameters: Sequence[Hyperparameter], intervals: Array
) -> list[Diagnostic]:
    """That there is another maximum, and where: as high, or outside the intervals (K, 2)."""
    rivals = [
        rival
        for rival in rivals
        if rival.drop < EQUAL or any(not _within(rival.alpha[k], intervals[k]) for k in rival.moved)
    ]
    if not rivals:
        return []
    best = rivals[0]
    where = ", ".join(
        f"{hyperparameters[k].name} {best.alpha[k]:.4g} (here {best.here[k]:.4g})"
        for k in best.moved
    )
    lower = f"has a log-likelihood lower by {best.drop:.3g}"
    height = lower if best.drop > EQUAL else "is as high"
    more = f" (and {len(rivals) - 1} more)" if len(rivals) > 1 else ""
    return [
        Diagnostic(
            "search",
            f"there are two maxima: another one{more} {height}, at {where}. The higher one need "
            "not be the physical one",
            "judge by what the parameters may be; limits that leave out one of them give the other",
            tuple(hyperparameters[k].name for k in best.moved),
        )
    ]


def _within(value: float, ends: Array) -> bool:
    return bool(ends[0] <= value <= ends[1])


@dataclass(frozen=True, eq=False)
class Rival:
    """Another maximum alpha (K,), lower by `drop`, beside the one `here` (K,).

    `moved` are the hyperparameters that differ by more than a standard error.
    """

    alpha: Array
    here: Array
    drop: float
    moved: tuple[int, ...]


def _unobserved(seen: Observations, ids: Sequence[str]) -> list[Diagnostic]:
    none = np.flatnonzero(np.bincount(seen.experiment, minlength=len(ids)) == 0)
    if not none.size:
        return []
    return [
        Diagnostic(
            "experiments",
            f"{named(none, ids)}: nothing was observed. It says nothing of the law, and of its "
            "parameters only the law is known",
            "leave it out, or see whether cells are blank that should not be",
            chosen(none, ids),
        )
    ]


def _lost(seen: Observations, left: Observations, ids: Sequence[str]) -> list[Diagnostic]:
    count = [np.bincount(part.experiment, minlength=len(ids)) for part in (seen, left)]
    lost = count[0] - count[1]
    which = np.flatnonzero(lost)
    if not which.size:
        return []
    return [
        Diagnostic(
            "simulator",
            f"{named(which, ids)}: no run gives a value of {int(lost.sum()):,} of the "
            f"{len(seen):,} observations, wherever the parameters are. They are left out: the "
            "likelihood is that of the others, on condition that what is left out has nothing to "
            "do with the parameters",
            "mend the simulator there, or delete these rows of the table",
            chosen(which, ids),
        )
    ]


def _failing(failing: Array, ids: Sequence[str]) -> list[Diagnostic]:
    which = np.flatnonzero(failing > NOTED_FAILING)
    if not which.size:
        return []
    return [
        Diagnostic(
            "simulator",
            f"{named(which, ids)}: runs fail at up to {100 * failing.max():.2g} % of the "
            "identified law. These parameters count as impossible there: the likelihood is that of "
            "the observations and of a run that works",
            "mend the simulator, or give the law a box where it works (`aleator box STUDY.toml`)",
            chosen(which, ids),
        )
    ]


def _censored(left: Observations) -> list[Diagnostic]:
    share = float(np.mean(left.censored)) if len(left) else 0.0
    if share <= MOSTLY:
        return []
    return [
        Diagnostic(
            "observations",
            f"of {100 * share:.0f} % of the values only bounds are known: the answer rests on the "
            "form of the law beyond what was measured",
            "see whether another law gives the same answer",
        )
    ]


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
