"""`python -m benchmarks.forecasts RECORD.jsonl`: runs that are forecast, and runs made.

Twenty unlike simulators, all synthetic: the ten of `benchmarks.simulators` and ten of
`benchmarks.random_studies`, each as one of which runs are dear. The first forecast is that of
`check`. The others are told during the identification, after the first runs and after each round.
With `--goal 0.1` the rounds go on until the error of the estimates is 0.1 standard errors; then
only the rounds are made.
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from rich.console import Console

from aleator import Check, Experiments, Inputs, identify
from aleator.core.progress import Silent
from aleator.fit.emulate import Emulation
from aleator.fit.ledger import Ledger
from aleator.fit.question import Choices
from aleator.fit.regions import first_region
from aleator.fit.rounds import EMULATION, RoundsAhead, admitted_change, usual
from aleator.simulators import Runner, as_runner
from aleator.simulators.function import FunctionSimulator
from aleator.tasks.first_look import expected_cost, planned_look
from benchmarks.emulators import BY_NAME, EMULATED
from benchmarks.kept import Entry, Key, kept
from benchmarks.random_studies import RANDOM_STUDIES
from benchmarks.simulators import Errors

OTHERS = (0, 3, 7, 9, 12, 19, 22, 25, 28, 34)
"""Random studies: mild, peak, oscillation, ten decades, reciprocal, cube, line, growth, peak of
two, saturation."""
NAMES = (*BY_NAME, *map(str, OTHERS))
SEED, FACTOR, NEARER = 3200, 2.0, 1.5
GOAL = EMULATION.enough


def study_of(name: str, seed: int) -> tuple[FunctionSimulator, Experiments, Inputs, Errors]:
    """Simulator, experiments, laws and errors of one of the twenty."""
    if name in BY_NAME:
        study = BY_NAME[name]
        return study.slow, study.table(seed), study.inputs, study.noise
    other = RANDOM_STUDIES[int(name)]
    table = Experiments.from_frame(other.table(seed), outcome="y")
    return FunctionSimulator(other.simulator, vectorized=True), table, other.inputs, other.errors


def forecast(name: str, seed: int, goal: float) -> Entry:
    """The forecast of one study, and the runs that its identification makes."""
    simulator, table, inputs, noise = study_of(name, seed)
    runner = as_runner(simulator, table, inputs.names, simulator.vectorized, None)
    plan = planned_look(runner, table, inputs)
    cost = expected_cost(runner, table, inputs, noise, EMULATED, None, Check(), plan)
    assert cost is not None
    entry = {"experiments": len(table.ids), "conditions": plan.count, "moving": len(plan.moving),
             "least": cost.least, "most": cost.most}  # fmt: skip
    began = time.process_time()
    try:
        entry |= _identified(simulator, table, inputs, noise) if goal == GOAL else _until(
            goal, runner, table, inputs, noise
        )  # fmt: skip
    except Exception as error:  # a study without an answer has no number of runs
        return {**entry, "error": f"{type(error).__name__}: {error}"[:200]}
    print(f"{name}: {cost.least} to {cost.most} forecast, {entry['runs']} made", flush=True)
    return {**entry, "seconds": time.process_time() - began}


def _identified(
    simulator: FunctionSimulator, table: Experiments, inputs: Inputs, noise: Errors
) -> Entry:
    found = identify(
        simulator, table, inputs, noise=noise, propagation=EMULATED, consistency=False,
        best_law=False,
    )  # fmt: skip
    assert found.surface is not None
    rounds = [[*one.values()] for one in found.surface["rounds"]]
    return {"runs": found.runs, "sound": found.sound, "rounds": rounds}


def _until(goal: float, runner: Runner, table: Experiments, inputs: Inputs, noise: Errors) -> Entry:
    choices = Choices.of(table, inputs, noise, EMULATED)
    question = choices.question(runner, table.observations, 0)
    region = first_region(choices.inputs, choices.hyperparameters, len(table.ids))
    settings = replace(EMULATION, enough=goal)
    made = Emulation(question, Ledger(runner, Silent()), region, "", settings)
    made.answer()
    rounds = [[one.runs, one.alpha, one.log_likelihood] for one in made.told]
    return {"runs": runner.runs, "sound": made.error.alpha <= goal, "rounds": rounds}


def expected(entry: Entry, goal: float) -> list[float]:
    """The numbers of all runs that were expected after the first runs and after each round."""
    experiments, calm, found = entry["experiments"], 0, []
    change = admitted_change(experiments)
    for place, (runs, *errors) in enumerate(entry["rounds"]):
        alpha, log_likelihood = (np.inf if error is None else error for error in errors)
        small = alpha <= goal and log_likelihood <= change
        calm = calm + 1 if small and place else 0
        ahead = RoundsAhead(usual(entry["conditions"]), EMULATION.rounds, change, calm)
        found.append(ahead.expected(runs, alpha, log_likelihood, goal))
    return found


def table_of(entries: dict[str, Entry], goal: float) -> pd.DataFrame:
    """A row for each study with a sound answer: what was forecast, and ratios to the runs made."""
    rows = []
    for name, one in entries.items():
        if not one.get("sound"):
            continue
        told = [runs / one["runs"] for runs in expected(one, goal)]
        middle = float(np.sqrt(one["least"] * one["most"]))
        rows.append({
            "study": f"{name} {RANDOM_STUDIES[int(name)].name}" if name.isdigit() else name,
            "conditions": one["conditions"], "parameters": one["moving"], "least": one["least"],
            "most": one["most"], "made": one["runs"],
            "made/middle": one["runs"] / middle,
            "within 2": 1.0 / FACTOR <= one["runs"] / middle <= FACTOR,
            "in range": one["least"] <= one["runs"] <= one["most"],
            "first runs": told[0], "first round": told[1], "rounds": len(told) - 1,
            "near": np.mean([1.0 / NEARER <= one <= NEARER for one in told[1:-1]]),
        })  # fmt: skip
    return pd.DataFrame(rows)


def main() -> None:
    """Make what the record lacks, and print the ratios."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.forecasts", description=__doc__)
    parser.add_argument("record", type=Path)
    parser.add_argument("--only", help=f"with commas between them: {', '.join(NAMES)}")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of the data")
    parser.add_argument("--goal", type=float, default=GOAL, help="error at which the rounds end")
    options = parser.parse_args()
    names = options.only.split(",") if options.only else [*NAMES]
    warnings.simplefilter("ignore")
    keys: list[Key] = [(name, options.seed, options.goal) for name in names]
    known = kept(options.record, keys, forecast)
    entries = {str(key[0]): known[key] for key in keys}
    table, console = table_of(entries, options.goal), Console(width=200)
    console.print(table.to_string(index=False, float_format="%.2f"), highlight=False)
    for name, one in entries.items():
        if not one.get("sound"):
            told = one.get("error", f"not sound after {one.get('runs')} runs")
            console.print(name, told, highlight=False, markup=False)
    if len(table):
        near = [table[c].between(1.0 / NEARER, NEARER).sum() for c in ("first runs", "first round")]
        console.print(
            f"of {len(names)}: {table['within 2'].sum()} within a factor of {FACTOR:g} of the "
            f"range's middle, {table['in range'].sum()} in the range; within a factor of "
            f"{NEARER:g} after the first runs {near[0]}, after the first round {near[1]}",
            highlight=False,
        )


if __name__ == "__main__":
    main()
