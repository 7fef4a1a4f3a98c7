"""`make bench`: what Aleator must reach, measured in one run, as a table of ratios.

Every row is one number of Aleator over one number of its peer or its target, both measured here and
now, so that the machine's speed cancels where there is a peer. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from aleator.clutch.reference import reference_shifting_time
from aleator.clutch.simulator import shifting_time
from aleator.likelihood.problem import Problem, prepare
from aleator.search import GradientMultistart
from aleator.simulators import Runner
from aleator.study import Study, load_study
from aleator.tasks.recover import recover
from benchmarks.densities import density_rows, failure_table
from benchmarks.expansions import expansion_rows
from benchmarks.few_runs import print_few_runs
from benchmarks.moments import moment_rows
from benchmarks.row import Row, ms
from benchmarks.runs import print_runs
from benchmarks.searches import print_searches

CLUTCH = Path(__file__).parent.parent / "examples" / "wet_clutch" / "study.toml"
TRUTH = {"c2_scale.mean": 0.91, "c2_scale.sd": 0.081, "zp_scale.mean": 0.55, "zp_scale.sd": 0.046}


def median_seconds(work: Callable[[], object], repeats: int) -> float:
    """Median wall-clock seconds of a piece of work, after one call to warm up."""
    work()
    seconds = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - began)
    return float(np.median(seconds))


def likelihood_rows(problem: Problem, alpha: np.ndarray) -> list[Row]:
    """One log-likelihood with its score, against the target and against differences of values."""
    likelihood = problem.likelihood
    exact = median_seconds(lambda: likelihood(alpha), 30)
    value = median_seconds(lambda: likelihood.evaluate(alpha), 30)
    differences = (2 * alpha.size + 1) * value
    target = 25e-3
    return [
        Row("log-likelihood and score, M = 4", ms(exact), f"target {ms(target)}", exact / target),
        Row(
            "exact score / central differences of the value",
            ms(exact),
            f"{2 * alpha.size + 1} values {ms(differences)}",
            exact / differences,
        ),
    ]


def search_rows(problem: Problem) -> list[Row]:
    """Searches from one start and from ten, against the targets."""
    likelihood, rows = problem.likelihood, []
    for starts, target in ((1, 1.5), (10, 10.0)):
        began = time.perf_counter()
        found = GradientMultistart(starts).maximize(likelihood, likelihood.hyperparameters, seed=0)
        seconds = time.perf_counter() - began
        rows.append(
            Row(f"search, {starts} starts", f"{seconds:.2f} s", f"target {target} s",
                seconds / target)
        )  # fmt: skip
    most = max(a.evaluations for a in found.ascents)
    rows.append(Row("evaluations of the longest start", str(most), "target 60", most / 60))
    return rows


def simulator_rows() -> list[Row]:
    """Runs a second of the clutch against solve_ivp at the same accuracy, on one core."""
    many, few = clutch_runs(5_000, 0), clutch_runs(60, 1)
    ours = 5_000 / median_seconds(lambda: shifting_time(**many), 3)
    exact = reference(few, "RK45", 1e-10, 2e-3)
    rows = [error_row(few, exact)]
    for method, tolerance in (("RK45", 1e-8), ("LSODA", 1e-7)):
        began = time.perf_counter()
        found = reference(few, method, tolerance, np.inf)
        theirs = exact.size / (time.perf_counter() - began)
        error = np.abs(found - exact).max()
        rows.append(
            Row(f"clutch, runs a second / solve_ivp {method} (error {error:.0e} s)",
                f"{ours:,.0f}", f"{theirs:.0f}", ours / theirs)
        )  # fmt: skip
    return rows


def error_row(runs: dict[str, np.ndarray], exact: np.ndarray) -> Row:
    """Largest error of the clutch against a tight reference, over the accuracy asked for."""
    error = float(np.abs(shifting_time(**runs) - exact).max())
    return Row("clutch, largest error", f"{error:.1e} s", "target 1e-06 s", error / 1e-6)


def clutch_runs(size: int, seed: int) -> dict[str, np.ndarray]:
    """Random experiments with parameters uniform in the box."""
    study, rng = load_study(CLUTCH), np.random.default_rng(seed)
    table = study.experiments.conditions
    rows = table.iloc[rng.integers(0, len(table), size)]
    low, high = study.inputs.box.T
    x = rng.uniform(low, high, (size, low.size))
    parameters = dict(zip(study.inputs.names, x.T, strict=True))
    return {name: rows[name].to_numpy(float) for name in table.columns} | parameters


def reference(
    runs: dict[str, np.ndarray], method: str, tolerance: float, step: float
) -> np.ndarray:
    """The same runs by scipy.integrate.solve_ivp, one after the other."""
    names = list(runs)
    return np.array(
        [
            reference_shifting_time(
                **dict(zip(names, row, strict=True)),
                method=method, tolerance=tolerance, max_step=step,
            )
            for row in zip(*(runs[name].tolist() for name in names), strict=True)
        ]
    )  # fmt: skip


def whole_rows(study: Study, problem: Problem, runner: Runner, seconds: float) -> list[Row]:
    """From nothing to the answer, verification not: seconds, runs, and the paper's runs."""
    surface = problem.surface
    assert surface is not None
    worst = float((surface.error / surface.scatter).max())
    paper = 50 * 25 * len(study.experiments)
    return [
        Row("whole identification", f"{seconds:.1f} s", "target 20 s", seconds / 20.0),
        Row("runs of the simulator", f"{runner.runs:,}", "target 12,000", runner.runs / 12_000),
        Row("worst estimated surface error", f"{worst:.2%}", "target 2 %", worst / 0.02),
        Row("runs / paper's collocation, one population of 50", f"{runner.runs:,}", f"{paper:,}",
            runner.runs / paper),
    ]  # fmt: skip


def print_table(console: Console, rows: Sequence[Row]) -> None:
    """Print the rows; a ratio below one is a target kept or a peer beaten in time."""
    table = Table("what", "Aleator", "against", "ratio")
    for row in rows:
        table.add_row(row.what, row.ours, row.theirs, f"{row.ratio:.3g}")
    console.print(table)


def recovery_table(console: Console, study: Study, replicates: int, workers: int) -> None:
    """Bias and coverage over virtual data sets from the model itself."""
    began = time.perf_counter()
    found = recover(
        study.runner(), study.model, study.search, TRUTH,
        replicates=replicates, seed=0, workers=workers,
    )  # fmt: skip
    seconds = time.perf_counter() - began
    console.print(f"recovery: {replicates} virtual data sets in {seconds:.0f} s")
    console.print(found.table().round(4).to_string())


def main() -> None:
    """Measure everything and print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--replicates", type=int, default=40)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    console = Console()
    study = load_study(CLUTCH)
    runner = study.runner()
    began = time.perf_counter()
    problem = prepare(runner, study.experiments.outcomes, study.model, study.inputs.box)
    built = time.perf_counter() - began
    searched = search_rows(problem)
    # the whole: surfaces and ten starts; the rows below it measure its parts again
    whole = time.perf_counter() - began
    alpha = np.array([TRUTH[h.name] for h in problem.likelihood.hyperparameters])
    rows = [
        *likelihood_rows(problem, alpha),
        *searched,
        *simulator_rows(),
        Row("response surfaces", f"{built:.1f} s", "target 20 s", built / 20.0),
        *whole_rows(study, problem, runner, whole),
        *moment_rows(),
        *density_rows(),
        *expansion_rows(),
    ]
    print_table(console, rows)
    failure_table(console)
    print_searches(console)
    print_few_runs(console)
    print_runs()
    if options.replicates:
        recovery_table(console, study, options.replicates, options.workers)


if __name__ == "__main__":
    main()
