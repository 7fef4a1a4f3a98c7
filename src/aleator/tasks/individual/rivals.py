"""Other maxima of the likelihood, of which the highest need not be the physical one."""

from __future__ import annotations

import numpy as np

from aleator.inference.diagnostics.estimates import LARGEST_EDM
from aleator.inference.diagnostics.individual import Rival
from aleator.inference.information import Inference, infer
from aleator.search import SearchResult
from aleator.tasks.individual.settle import Settled, settled
from aleator.types import Array

TRIED = 2
"""Optima of the search that are looked at, besides the best."""
APART = 2.0
"""Standard errors that tell two maxima apart."""


def rivals(end: Settled, inference: Inference, found: SearchResult) -> tuple[Rival, ...]:
    """Other optima of the search that are maxima indeed: climbed from, inside, and bent down.

    Those that only a limit holds are none. Cost: some tens of evaluations for each.
    """
    if not inference.positive:
        return ()
    known: list[Array] = [end.alpha]
    kept = []
    for optimum in found.optima[1:]:
        if len(known) > TRIED:
            break
        if any(_near(optimum.alpha, other, inference) for other in known):
            continue
        other = settled(end.likelihood, optimum.alpha)
        if any(_near(other.alpha, one, inference) for one in known):
            continue
        known.append(other.alpha)
        rival = _judged(other, end, inference)
        if rival is not None:
            kept.append(rival)
    return tuple(sorted(kept, key=lambda rival: rival.drop))


def _judged(other: Settled, end: Settled, inference: Inference) -> Rival | None:
    hyperparameters = other.likelihood.hyperparameters
    about = infer(other.likelihood, other.alpha, hyperparameters)
    held = [a for a, b in zip(about.at_bound, inference.at_bound, strict=True) if a and a != b]
    drop = end.value - other.value
    if held or not about.positive or not about.edm < LARGEST_EDM or not np.isfinite(drop):
        return None
    sizes = np.abs(_errors(other.alpha, end.alpha, inference))
    moved = tuple(int(k) for k in np.flatnonzero(np.nan_to_num(sizes) > 1.0))
    return Rival(other.alpha, end.alpha, drop, moved)


def _near(alpha: Array, other: Array, inference: Inference) -> bool:
    sizes = np.abs(_errors(alpha, other, inference))
    return bool(np.nanmax(sizes, initial=0.0) < APART)


def _errors(alpha: Array, other: Array, inference: Inference) -> Array:
    """How far apart two alphas are in standard errors (K,); NaN where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((alpha - other) / inference.standard_error)
