"""The parts of a search on the wet clutch: one log-likelihood with its score, and whole searches.

All on the same surfaces of the whole box, four moments and maximum entropy.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from aleator.core.types import Array
from aleator.likelihood.problem import Problem, prepare
from aleator.moments.likelihood import Likelihood
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.search import GradientMultistart
from aleator.study import load_study
from aleator.surrogates import ResponseSurface
from benchmarks.identifications import CLUTCH
from benchmarks.row import Row, ms, seconds_row

TRUTH = {"c2_scale.mean": 0.91, "c2_scale.sd": 0.081, "zp_scale.mean": 0.55, "zp_scale.sd": 0.046}
TOLERANCE = 0.02
TARGET_SCORE = 25e-3
TARGET_SEARCH = {1: 1.5, 10: 10.0}
TARGET_EVALUATIONS = 60


def likelihood_rows() -> list[Row]:
    """One log-likelihood with its score, then searches from one start and from ten."""
    study = load_study(CLUTCH)
    surfaces, density = ResponseSurface(tolerance=TOLERANCE), MaximumEntropy(order=4)
    model = replace(study.model, propagation=surfaces, density=density)
    problem = prepare(study.runner(), study.experiments.outcomes, model, study.inputs.box)
    alpha = np.array([TRUTH[h.name] for h in model.hyperparameters])
    return [*score_rows(problem, alpha), *search_rows(problem)]


def score_rows(problem: Problem, alpha: Array) -> list[Row]:
    """One log-likelihood with its score, against the target and against differences of values."""
    likelihood = problem.likelihood
    assert isinstance(likelihood, Likelihood)
    exact = median_seconds(lambda: likelihood(alpha), 30)
    value = median_seconds(lambda: likelihood.evaluate(alpha), 30)
    differences = (2 * alpha.size + 1) * value
    return [
        Row("log-likelihood and score, M = 4", ms(exact), f"target {ms(TARGET_SCORE)}",
            exact / TARGET_SCORE),
        Row("exact score / central differences of the value", ms(exact),
            f"{2 * alpha.size + 1} values {ms(differences)}", exact / differences),
    ]  # fmt: skip


def search_rows(problem: Problem) -> list[Row]:
    """Searches from one start and from ten, against the targets."""
    free, rows, most = problem.likelihood.hyperparameters, [], 0
    for starts, target in TARGET_SEARCH.items():
        began = time.perf_counter()
        found = GradientMultistart(starts).maximize(problem.continued, free, seed=0)
        rows.append(seconds_row(f"search, {starts} starts", time.perf_counter() - began, target))
        most = max(ascent.evaluations for ascent in found.ascents)
    rows.append(Row("evaluations of the longest start", str(most), f"target {TARGET_EVALUATIONS}",
                    most / TARGET_EVALUATIONS))  # fmt: skip
    return rows


def median_seconds(work: Callable[[], object], repeats: int) -> float:
    """Median wall-clock seconds of a piece of work, after one call to warm up."""
    work()
    seconds = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - began)
    return float(np.median(seconds))
