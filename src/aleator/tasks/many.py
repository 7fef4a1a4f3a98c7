"""The search of many experiments: on a sample of them, and its best ends climbed from with all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from aleator.likelihood.problem import Problem
from aleator.search import Ascent, Objective, Optimum, SearchResult, ascend
from aleator.search.interface import SAME_VALUE
from aleator.search.optima import SAME_PLACE
from aleator.types import Array

MANY, SAMPLE = 1000, 400
"""Experiments from which a sample of so many tells where optima are."""
BEST = 2
"""Optima of the sample that are climbed from."""


def of_many(problem: Problem, search: Callable[[Objective], SearchResult]) -> SearchResult:
    """What a search of all experiments would find; of up to MANY it is just that.

    An optimum of the sample lies within its standard errors of one of all, some sqrt(N/SAMPLE) of
    theirs, and a climb from there takes few evaluations. Starts that ended at none of the best
    optima of the sample are left out.
    """
    count = problem.outcomes.size
    if count <= MANY:
        return search(problem.objective)
    rows = np.linspace(0, count - 1, SAMPLE).astype(np.intp)
    found = search(problem.likelihood.take(rows).continued)
    optima, ascents = list[Optimum](), list[Ascent]()
    for of_sample in found.optima[:BEST]:
        alpha, value, information = _climbed(problem, of_sample.alpha)
        led = [a for a in found.ascents if _same(a.log_likelihood, of_sample.log_likelihood)]
        ascents += [replace(a, alpha=alpha, log_likelihood=value) for a in led]
        known = [o for o in optima if _same(o.log_likelihood, value)]
        steps = [alpha - o.alpha for o in known]
        if not any(step @ information @ step < SAME_PLACE**2 for step in steps):
            optima.append(Optimum(alpha, value, of_sample.starts))
    optima.sort(key=lambda optimum: -optimum.log_likelihood)
    best = optima[0]
    return replace(
        found, alpha=best.alpha, log_likelihood=best.log_likelihood, optima=tuple(optima),
        ascents=tuple(ascents),
    )  # fmt: skip


def _same(one: float, other: float) -> bool:
    return abs(one - other) < SAME_VALUE


def _climbed(problem: Problem, alpha: Array) -> tuple[Array, float, Array]:
    """The nearest maximum (K,), its value, and the outer product (K, K) of the scores below it."""
    objective, hyperparameters = problem.objective, problem.model.hyperparameters
    free = np.flatnonzero([h.free for h in hyperparameters])
    scores = objective(alpha).scores
    assert scores is not None
    information = scores.T @ scores
    own = information[np.ix_(free, free)]
    return (*ascend(objective, alpha, hyperparameters, free, own), information)
