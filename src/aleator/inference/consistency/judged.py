"""Replicates under the fitted model say which statistics of the experiments are unusual."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from aleator.inference.consistency.battery import SHARES, Battery
from aleator.inference.consistency.calibration import corrected, effective, probabilities
from aleator.inference.consistency.contrasts import Subject
from aleator.inference.consistency.residuals import residuals_of
from aleator.inference.fit import Fit, stepped
from aleator.results.values import Statistic
from aleator.types import Array

MANY = 200
"""Experiments from which one step to the maximum of a replicate does."""


@dataclass(frozen=True, eq=False)
class Judged:
    """Tests with their probabilities, that of all `together`, and how many replicates told them."""

    tests: tuple[Statistic, ...]
    together: float
    replicates: int


def judged(subjects: tuple[Subject, ...], observed: Array, replicates: Array) -> Judged:
    """What B replicates (B, T) of the statistics say of the observed ones (T,).

    First within each group of tests, the smallest p over its weight, then of the groups: each has
    its share of the false alarms, however many columns and hyperparameters there are.
    """
    skewed = np.array([s.skewed for s in subjects])
    one_sided = np.array([s.one_sided for s in subjects])
    least, weight = np.array([[s.least, s.weight] for s in subjects]).T
    p, own, z = probabilities(observed, replicates, skewed, one_sided, least)
    groups = np.array([s.group for s in subjects])
    found, smallest = np.ones(p.size), []
    for name in dict.fromkeys(groups.tolist()):
        inside = groups == name
        strongest = np.min(own[:, inside] / weight[inside], axis=1)
        tests = effective(strongest) / SHARES[name]
        found[inside] = corrected(p[inside] / weight[inside], tests)
        smallest.append(corrected(strongest, tests))
    found = corrected(found, effective(np.min(smallest, axis=0)))
    rows = zip(subjects, z.tolist(), p.tolist(), found.tolist(), strict=True)
    tests_found = tuple(Statistic(s.kind, s.of, s.column, s.where, *values) for s, *values in rows)
    return Judged(tests_found, float(found.min()), len(replicates))


def replicated(
    fit: Fit, battery: Battery, points: int, rng: np.random.Generator
) -> Iterator[Array]:
    """Statistics (T,) of other data under the fitted model, alpha fitted to them; without end.

    Of few experiments alpha takes a second step: after one, replicates miss their maximum by so
    much that the experiments, which do not, look odd (10 instead of 5 % false alarms at N = 15).
    """
    while True:
        other = stepped(fit.drawn(rng))
        fitted = stepped(other) if fit.count < MANY else other
        yield battery.values(residuals_of(fitted, points))
