"""What the paper's genetic algorithm reaches and costs, beside other searches."""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from aleator.core.progress import Progress
from aleator.likelihood.model import Model
from aleator.likelihood.problem import Problem, prepare
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.search import (
    CMAES,
    DifferentialEvolution,
    GeneticAlgorithm,
    GradientMultistart,
    Search,
)
from aleator.simulators import as_runner
from aleator.surrogates import ResponseSurface
from aleator.views.axes import BLUE, GREEN, ORANGE, VERMILION
from examples.wet_clutch.model import shifting_time
from reproduction.canvas import explain, powers_of_ten
from reproduction.clutch.laws import SEARCH_TOLERANCE
from reproduction.clutch.study import PARAMETERS, ClutchStudy
from reproduction.context import Context
from reproduction.figure import Claim, Reproduction, Verdict
from reproduction.trials import Trial, compare

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

NODES = 20
RUNS = 25  # of the paper for each experiment and alpha
FOUND = 0.5  # below the best log-likelihood: what counts as found
NEAR, CLOSE = 0.1, 0.01  # below it: how soon a search is that near
GRADIENT, GENETIC = "gradient, 5 starts", "genetic, 50 (the paper's)"
DIFFERENTIAL, CMA = "differential evolution, 50", "CMA-ES, 1 run"
HUES = {GRADIENT: BLUE, GENETIC: VERMILION, DIFFERENTIAL: ORANGE, CMA: GREEN}
EXTRA = {GENETIC: "pymoo", CMA: "cma"}


def searches(context: Context) -> Reproduction:
    """The best log-likelihood that each search knew after so many evaluations."""
    trials = _trials(context.clutch, context.seed, context.progress)
    best = max(trial.log_likelihood for trial in trials.values())
    rows = {name: _row(trial, best) for name, trial in trials.items()}
    table = pd.DataFrame([{"search": name} | row for name, row in rows.items()])
    steps = pd.DataFrame(
        [
            {
                "search": name,
                "evaluations": step.evaluations,
                "seconds": step.seconds,
                "below_best": best - step.log_likelihood,
            }
            for name, trial in trials.items()
            for step in trial.trace
        ]
    )

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        for name, trial in trials.items():
            own = steps[steps["search"] == name]
            ends = [*own["evaluations"], trial.evaluations]
            gaps = np.maximum([*own["below_best"], own["below_best"].iloc[-1]], 1e-5)
            axes.step(ends, gaps, where="post", color=HUES[name], lw=1.6, label=name)
        axes.set(xscale="log", yscale="log", xlabel="evaluations of the log-likelihood")
        axes.set_ylabel("below the best log-likelihood")
        powers_of_ten(axes.xaxis)
        powers_of_ten(axes.yaxis)
        explain(canvas, axes, 4)

    return Reproduction({"": table, "steps": steps}, draw, _claims(rows))


def problem_of(study: ClutchStudy, progress: Progress) -> Problem:
    """The clutch's problem with maximum entropy of four moments, on surfaces of its box."""
    surfaces = ResponseSurface(tolerance=SEARCH_TOLERANCE, nodes=NODES)
    model = Model.of(study.law(), propagation=surfaces, density=MaximumEntropy(order=4))
    runner = as_runner(shifting_time, study.experiments, PARAMETERS, vectorized=True)
    return prepare(runner, study.outcomes, model, study.box, progress)


def _choices() -> dict[str, Search]:
    """The searches whose packages are there; none but the gradient's ascents polishes its end."""
    found: dict[str, Search] = {
        GRADIENT: GradientMultistart(5),
        DIFFERENTIAL: DifferentialEvolution(50, 30, polish=False),
    }
    if _installed(GENETIC):
        found[GENETIC] = GeneticAlgorithm(50, 40, 40, polish=False)
    if _installed(CMA):
        found[CMA] = CMAES(1, 800, polish=False)
    return {name: found[name] for name in HUES if name in found}


def _installed(name: str) -> bool:
    return importlib.util.find_spec(EXTRA[name]) is not None


def _trials(study: ClutchStudy, seed: int, progress: Progress) -> dict[str, Trial]:
    problem, found = problem_of(study, progress), {}
    free = problem.likelihood.hyperparameters
    for name, search in _choices().items():
        progress.update(name)
        (found[name],) = compare([search], problem.continued, free, seed=seed)
    return found


def _row(trial: Trial, best: float) -> dict[str, float]:
    row = {
        "log_likelihood": trial.log_likelihood,
        "below_best": best - trial.log_likelihood,
        "evaluations": trial.evaluations,
        "with_score": trial.scored,
        "seconds": trial.seconds,
    }
    for gap in (NEAR, CLOSE):
        step = trial.reached(best - gap)
        row[f"evaluations_to_{gap:g}"] = np.nan if step is None else step.evaluations
    return row


def _claims(rows: dict[str, dict[str, float]]) -> tuple[Claim, ...]:
    missing = [name for name in EXTRA if name not in rows]
    unjudged = f"not run, for want of pymoo or cma: {', '.join(missing)}"
    reached = {name: row[f"evaluations_to_{NEAR:g}"] for name, row in rows.items()}
    told = "; ".join(f"{name}: {_count(reached[name], row)}" for name, row in rows.items())
    ends = "; ".join(f"{name}: {row['below_best']:.3f}" for name, row in rows.items())
    judged = GENETIC in rows
    found, cheaper, note = False, False, unjudged
    if judged:
        genetic, gradient = rows[GENETIC], rows[GRADIENT]
        found = genetic["below_best"] < FOUND
        cheaper = not reached[GENETIC] > reached[GRADIENT] and not np.isnan(reached[GENETIC])
        score = _seconds(gradient) / _seconds(genetic)
        note = (
            f"propagated as in the paper, {RUNS} runs an experiment, the genetic algorithm's "
            f"{genetic['evaluations']:,.0f} evaluations are {genetic['evaluations'] * RUNS:,.0f} "
            f"runs of each experiment; here all share one set of surfaces. An evaluation with its "
            f"score counts as one and takes {score:.1f} times as long"
        )
    return (
        Claim(
            "A genetic algorithm with a population of 50 finds the maximum.",
            "used for both answers",
            f"below the best log-likelihood at the end: {ends}",
            Verdict.of(found) if judged else Verdict.NOT_COMPARABLE,
            f"judged at {FOUND:g}; one seed, no final ascent after the populations"
            if judged
            else unjudged,
        ),
        Claim(
            "It is the search to take.",
            "implied; no other is compared",
            f"evaluations to within {NEAR:g} of the best: {told}",
            Verdict.of(cheaper) if judged else Verdict.NOT_COMPARABLE,
            note,
        ),
    )


def _seconds(row: dict[str, float]) -> float:
    """Seconds of an evaluation."""
    return row["seconds"] / row["evaluations"]


def _count(value: float, row: dict[str, float]) -> str:
    return f"never in {row['evaluations']:,.0f}" if np.isnan(value) else f"{value:,.0f}"
