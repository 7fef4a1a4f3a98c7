"""`python -m benchmarks.few_runs`: how many runs an answer costs, by each way, on the wet clutch.

Every way fits the same density, four moments and maximum entropy, and is held against one dense
reference: surfaces of up to a thousand runs an experiment where the law is. A row says how far its
alpha is from the reference's, in standard errors, and how far its log-likelihood is from what the
reference says at the same alpha. Surfaces make their runs before the search, which needs none then;
collocation (the paper's: 25 nodes, an expansion of degree 4) and Monte Carlo make theirs for every
alpha. Their rows follow one ascent from the linear-Gaussian answer, from which an identification
starts too; a score costs four times the runs of its value besides. The paper's own search would
make 1,250 runs an experiment for a generation of its population of fifty.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from aleator.core.types import Array
from aleator.errors import AleatorError
from aleator.fit.search import by_tangent
from aleator.inference.check import Check
from aleator.inference.information import infer
from aleator.laws.inputs import law_region
from aleator.laws.quadrature import MonteCarloPoints
from aleator.likelihood.problem import Problem, prepare
from aleator.moments.likelihood import Continued, Likelihood
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.moments.propagation import Collocation
from aleator.search import GradientMultistart
from aleator.search.interface import LogLikelihood
from aleator.simulators import Runner
from aleator.study import Study, load_study
from aleator.surrogates import ResponseSurface
from aleator.tasks.identify import identify
from benchmarks.identifications import CLUTCH

FIGURE = Path("out") / "few_runs.png"
DENSITY = MaximumEntropy(4)
DENSE = ResponseSurface(tolerance=0.001, max_runs=1000)
SURFACES = {
    "own surfaces, as the answer needs": [
        ResponseSurface(surfaces="own", max_runs=most) for most in (34, 40, 1000)
    ],
    "own surfaces, as exact everywhere": [ResponseSurface(tolerance=t) for t in (0.1, 0.05, 0.02)],
}
EVALUATIONS = 20
APART = 1.3
"""Rows of one ascent: as many times more runs than the row before."""
LOG_LIKELIHOOD, ERROR = 0.5, 0.1
"""The targets: difference of log-likelihoods, and of alpha in standard errors."""


@dataclass(frozen=True)
class Reference:
    """The dense likelihood, its maximum, and standard errors there (NaN on a limit)."""

    likelihood: Likelihood
    alpha: Array
    standard_error: Array
    runs: float


@dataclass(frozen=True)
class Point:
    """What a way says after so many runs an experiment."""

    way: str
    runs: float
    alpha: Array
    log_likelihood: float

    def error(self, reference: Reference) -> float:
        """The largest distance of alpha from the reference's, in standard errors."""
        return float(np.nanmax(np.abs(self.alpha - reference.alpha) / reference.standard_error))

    def gap(self, reference: Reference) -> float:
        """Its log-likelihood less the reference's at the same alpha."""
        return self.log_likelihood - float(reference.likelihood.evaluate(self.alpha).total)


def reference_of(study: Study) -> Reference:
    """Dense surfaces within five standard deviations and three standard errors of the answer."""
    model = replace(study.model, density=DENSITY, propagation=ResponseSurface(tolerance=0.02))
    region, alpha = study.inputs.box, np.array([h.start for h in model.hyperparameters])
    runner, search = study.runner(), GradientMultistart(1)
    for choice in (model.propagation, DENSE):
        problem = prepare(
            runner, study.experiments.outcomes, replace(model, propagation=choice), region
        )
        free = problem.likelihood.hyperparameters
        alpha = search.maximize(problem.continued, free, seed=0, guesses=[alpha]).alpha
        error = infer(problem.continued, alpha, free).standard_error
        moved = [
            np.clip(alpha + sign * 3.0 * np.nan_to_num(error) * one,
                    [h.lower for h in free], [h.upper for h in free])
            for one in np.eye(alpha.size) for sign in (-1.0, 1.0)
        ]  # fmt: skip
        region = law_region(study.inputs, [alpha, *moved])
    return Reference(by_moments(problem), alpha, error, runner.fresh / len(runner.ids))


def by_moments(problem: Problem) -> Likelihood:
    """The likelihood of a problem with a density of moments."""
    assert isinstance(problem.likelihood, Likelihood)
    return problem.likelihood


def by_surfaces(way: str, study: Study, choice: ResponseSurface) -> Point:
    """A whole identification on surfaces, without its check."""
    runner = study.runner()
    found = identify(
        runner, study.experiments, study.inputs, density=DENSITY, propagation=choice,
        search=GradientMultistart(3), verification=Check(0), seed=study.seed,
    )  # fmt: skip
    alpha = np.array([found.alpha[h.name].estimate for h in study.model.hyperparameters])
    return Point(way, runner.fresh / len(runner.ids), alpha, found.log_likelihood.estimated)


@dataclass(frozen=True)
class Followed:
    """An objective that runs the simulator, and the best that it said after so many runs."""

    way: str
    objective: Continued
    runner: Runner
    best: list[Point]

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The objective with its score, noted."""
        found = self.objective(alpha)
        if not self.best or found.total > self.best[-1].log_likelihood:
            runs = self.runner.fresh / len(self.runner.ids)
            self.best.append(Point(self.way, runs, alpha.copy(), float(found.total)))
        return found


def by_runs(way: str, study: Study, choice: Collocation) -> list[Point]:
    """One ascent on the simulator itself: the best so far, at improvements some runs apart."""
    runner = study.runner()
    model = replace(study.model, density=DENSITY, propagation=choice)
    problem = prepare(runner, study.experiments.outcomes, model, study.inputs.box)
    followed = Followed(way, by_moments(problem).continued, runner, [])
    free = model.hyperparameters
    search = GradientMultistart(1, EVALUATIONS)
    guess = by_tangent(problem, search, seed=0)
    begun = [replace(h, start=float(value)) for h, value in zip(free, guess.alpha, strict=True)]
    search.maximize(followed, begun, seed=0)
    rows: list[Point] = []
    for point in followed.best:
        if not rows or point.runs >= APART * rows[-1].runs:
            rows.append(point)
    return [*rows, followed.best[-1]] if rows[-1] is not followed.best[-1] else rows


def points(study: Study) -> Iterator[Point]:
    """Every way, from few runs to many."""
    for way, choices in SURFACES.items():
        yield from (by_surfaces(way, study, choice) for choice in choices)
    yield from by_runs(
        "collocation, 25 for every alpha", study,
        Collocation(nodes=5, moments="expansion", degree=4),
    )  # fmt: skip
    yield from by_runs(
        "Monte Carlo, 25 for every alpha", study,
        Collocation(nodes=MonteCarloPoints(25)),
    )  # fmt: skip


def curve_table(reference: Reference, found: list[Point]) -> Table:
    """A row a point."""
    table = Table(
        "way", "runs", "error of alpha", "log-likelihood",
        title=f"wet clutch: runs an experiment; error of alpha in standard errors (target {ERROR})"
        f"; log-likelihood less the dense one at the same alpha (target {LOG_LIKELIHOOD}); "
        f"the dense reference made {reference.runs:.0f} runs an experiment",
    )  # fmt: skip
    for point in found:
        table.add_row(
            point.way, f"{point.runs:.1f}", f"{point.error(reference):.3f}",
            f"{point.gap(reference):+.3f}",
        )  # fmt: skip
    return table


def draw(reference: Reference, found: list[Point], path: Path) -> None:
    """The two errors over the runs, a line a way; raises AleatorError without matplotlib."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise AleatorError(
            "a figure needs matplotlib, which is not installed", "pip install matplotlib"
        ) from None
    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    sides = figure.subplots(1, 2)
    measures = (
        ("error of alpha, standard errors", Point.error, ERROR),
        ("log-likelihood, difference from the dense one", Point.gap, LOG_LIKELIHOOD),
    )
    for axes, (label, measure, target) in zip(sides, measures, strict=True):
        for way in dict.fromkeys(point.way for point in found):
            mine = [point for point in found if point.way == way]
            errors = [abs(measure(point, reference)) for point in mine]
            axes.loglog([point.runs for point in mine], errors, "o-", label=way, markersize=3)
        axes.axhline(target, color="gray", linewidth=0.8, linestyle="--")
        axes.set(xlabel="runs an experiment", ylabel=label)
    sides[0].legend(fontsize="small")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)


def print_few_runs(console: Console) -> None:
    """Measure every way, print the table, and draw it where matplotlib is."""
    study, began = load_study(CLUTCH), time.perf_counter()
    reference = reference_of(study)
    found = list(points(study))
    console.print(curve_table(reference, found))
    try:
        draw(reference, found, FIGURE)
        console.print(f"{FIGURE}, in {time.perf_counter() - began:.0f} s")
    except AleatorError as error:
        console.print(f"no figure: {error}")


if __name__ == "__main__":
    print_few_runs(Console())
