"""Whether the gap between a law and the best one is more than chance, by parametric bootstrap."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aleator.inference.ceiling.mixing import mixed
from aleator.inference.fit import Fit, climbed, stepped
from aleator.progress import Progress
from aleator.types import Array

Points = Callable[[Fit, np.random.Generator], Array]
"""The points x (J, n) that the best law of a fit is sought on."""
EXCEEDED = 10
"""Replicates above the gap after which no more are drawn."""
ARRIVED = 0.01
"""What may be left to climb in a replicate, in log-likelihood."""
COARSE = 1e-5
"""Of the gradient function, over its largest value in a replicate."""


@dataclass(frozen=True)
class Judged:
    """The share of data sets of the law itself whose gap is as large.

    `failed` replicates have no log-likelihood and count as larger.
    """

    p_value: float
    replicates: int
    exceeded: int
    failed: int


def gap(fit: Fit, points: Array) -> float:
    """Log-likelihood of the best law on points x (J, n) above that of the fit."""
    best = mixed(fit.likelihood.given(points), COARSE).log_likelihood
    return best - fit.scored().likelihood


def judged(fit: Fit, points: Points, most: int, seed: int, progress: Progress) -> Judged | None:
    """The p value of the gap of a fit: data are drawn from its law, and fitted by its family.

    The best law has no limit distribution to compare with, so that the gap is drawn (McLachlan,
    1987). It is that on points made by one rule for measured and for drawn data. It stops early:
    after ten larger gaps p is ten over the replicates until then (Besag and Clifford, 1991), else
    (g + 1)/(most + 1). None where the measured data have no gap. Cost: a climb and a product of
    matrices for each replicate.
    """
    seen = gap(fit, points(fit, np.random.default_rng([seed, 0])))
    if not np.isfinite(seen):
        return None
    exceeded = failed = count = 0
    while count < most and exceeded < EXCEEDED:
        count += 1
        progress.update(f"{count} of at most {most} data sets of the law", count, most)
        larger = _larger(fit, seen, points, np.random.default_rng([seed, count]))
        failed += larger is None
        exceeded += larger is not False
    p_value = exceeded / count if exceeded >= EXCEEDED else (exceeded + 1) / (count + 1)
    return Judged(p_value, count, exceeded, failed)


def _larger(fit: Fit, seen: float, points: Points, rng: np.random.Generator) -> bool | None:
    """Whether the gap of other data is as large; None where it is no number.

    One step comes near the maximum, from below: what is smaller after it is smaller in the end.
    """
    near = stepped(fit.drawn(rng))
    found = gap(near, points(near, rng))
    if found >= seen:
        end = climbed(near, arrived=ARRIVED)
        found = gap(end, points(end, rng))
    return bool(found >= seen) if np.isfinite(found) else None
