"""`python -m benchmarks.searches`: what each search reaches on the two studies, and at what cost.

All searches maximize one likelihood, from one seed and without guesses; the best known
log-likelihood is the best that any of them reached. Budgets keep each search under half a minute on
one core: at most some 2,500 values. `plain` is a population without its final ascent.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from aleator.likelihood.problem import prepare
from aleator.search import (
    CMAES,
    DifferentialEvolution,
    GeneticAlgorithm,
    GradientMultistart,
    Search,
)
from aleator.study import load_study
from benchmarks.identifications import STUDIES
from reproduction.trials import Step, Trial, compare

SEARCHES: dict[str, Search] = {
    "gradient, 10 starts": GradientMultistart(10),
    "genetic, 50 (the paper's), plain": GeneticAlgorithm(50, 50, 50, polish=False),
    "genetic, 50": GeneticAlgorithm(50, 50),
    "differential evolution, 50, plain": DifferentialEvolution(50, 50, polish=False),
    "differential evolution, 50": DifferentialEvolution(50, 50),
    "CMA-ES, 3 runs, plain": CMAES(3, 800, polish=False),
    "CMA-ES, 3 runs": CMAES(3, 800),
}


def trials(study: Path) -> tuple[Trial, ...]:
    """Every search on the likelihood of one study, on surfaces of its whole box."""
    value = load_study(study)
    problem = prepare(value.runner(), value.experiments.outcomes, value.model, value.inputs.box)
    free = value.model.hyperparameters
    return compare(list(SEARCHES.values()), problem.continued, free, seed=1)


def search_table(name: str, found: Sequence[Trial]) -> Table:
    """What each trial reached, and after what it was within 0.1 and 0.01 of the best of them."""
    best = max(trial.log_likelihood for trial in found)
    table = Table(
        "search", "below the best", "evaluations (with score)", "seconds",
        "to within 0.1", "to within 0.01",
        title=f"searches, {name}: best log-likelihood {best:.3f}",
    )  # fmt: skip
    for label, trial in zip(SEARCHES, found, strict=True):
        table.add_row(
            label,
            f"{best - trial.log_likelihood:.4f}",
            f"{trial.evaluations:,} ({trial.scored:,})",
            f"{trial.seconds:.1f}",
            reached(trial.reached(best - 0.1)),
            reached(trial.reached(best - 0.01)),
        )
    return table


def reached(step: Step | None) -> str:
    """Evaluations and seconds of a step, or that there is none."""
    return "never" if step is None else f"{step.evaluations:,} in {step.seconds:.1f} s"


def print_searches(console: Console) -> None:
    """Search both studies with everything, and print a table for each."""
    for name, study in STUDIES.items():
        console.print(search_table(name, trials(study)))


if __name__ == "__main__":
    print_searches(Console())
