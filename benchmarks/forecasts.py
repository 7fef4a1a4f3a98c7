"""`python -m benchmarks.forecasts RECORD.jsonl`: runs that `check` forecasts, and runs made.

Twenty unlike simulators, all synthetic: the ten of `benchmarks.simulators` and ten of
`benchmarks.random_studies`, each as one of which runs are dear.
"""

from __future__ import annotations

import argparse
import time
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
from rich.console import Console

from aleator import Check, Experiments, Inputs, identify
from aleator.simulators import as_runner
from aleator.simulators.function import FunctionSimulator
from aleator.tasks.first_look import expected_cost, planned_look
from benchmarks.emulators import BY_NAME, EMULATED
from benchmarks.kept import Entry, kept
from benchmarks.random_studies import RANDOM_STUDIES
from benchmarks.simulators import Errors

OTHERS = (0, 3, 7, 9, 12, 19, 22, 25, 28, 34)
"""Random studies: mild, peak, oscillation, ten decades, reciprocal, cube, line, growth, peak of
two, saturation."""
NAMES = (*BY_NAME, *map(str, OTHERS))
SEED, FACTOR = 3200, 2.0


def study_of(name: str) -> tuple[FunctionSimulator, Experiments, Inputs, Errors]:
    """Simulator, experiments, laws and errors of one of the twenty."""
    if name in BY_NAME:
        study = BY_NAME[name]
        return study.slow, study.table(SEED), study.inputs, study.noise
    other = RANDOM_STUDIES[int(name)]
    table = Experiments.from_frame(other.table(SEED), outcome="y")
    return FunctionSimulator(other.simulator, vectorized=True), table, other.inputs, other.errors


def forecast(name: str) -> Entry:
    """The forecast of one study, and the runs that its identification makes."""
    simulator, table, inputs, noise = study_of(name)
    runner = as_runner(simulator, table, inputs.names, simulator.vectorized, None)
    plan = planned_look(runner, table, inputs)
    cost = expected_cost(runner, table, inputs, noise, EMULATED, None, Check(), plan)
    entry = {"experiments": len(table.ids), "units": runner.units, "conditions": plan.count,
             "moving": len(plan.moving), "look": plan.runs}  # fmt: skip
    assert cost is not None
    entry |= {"least": cost.least, "most": cost.most}
    began = time.process_time()
    try:
        found = identify(
            simulator, table, inputs, noise=noise, propagation=EMULATED, consistency=False,
            best_law=False,
        )  # fmt: skip
    except Exception as error:  # a study without an answer has no number of runs
        return {**entry, "error": f"{type(error).__name__}: {error}"[:200]}
    print(f"{name}: {cost.least} to {cost.most} forecast, {found.runs} made", flush=True)
    return {**entry, "runs": found.runs, "by_stage": dict(found.runs_by_stage),
            "seconds": time.process_time() - began}  # fmt: skip


def table_of(entries: dict[str, Entry]) -> pd.DataFrame:
    """A row for each study with an answer: what was forecast, and ratios of the runs made to it."""
    rows = []
    for name, one in entries.items():
        if "runs" not in one:
            continue
        middle = float(np.sqrt(one["least"] * one["most"]))
        rows.append({
            "study": f"{name} {RANDOM_STUDIES[int(name)].name}" if name.isdigit() else name,
            "conditions": one["conditions"], "parameters": one["moving"], "least": one["least"],
            "most": one["most"], "made": one["runs"],
            "check": one["by_stage"].get("verification", 0), "made/middle": one["runs"] / middle,
            "within 2": 1.0 / FACTOR <= one["runs"] / middle <= FACTOR,
            "in range": one["least"] <= one["runs"] <= one["most"],
            "most/least": one["most"] / one["least"],
        })  # fmt: skip
    return pd.DataFrame(rows)


def main() -> None:
    """Make what the record lacks, and print the ratios."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.forecasts", description=__doc__)
    parser.add_argument("record", type=Path)
    parser.add_argument("--only", help=f"with commas between them: {', '.join(NAMES)}")
    options = parser.parse_args()
    names = options.only.split(",") if options.only else [*NAMES]
    warnings.simplefilter("ignore")
    known = kept(options.record, [(name,) for name in names], forecast)
    table = table_of({name: known[name,] for name in names})
    console = Console(width=200)
    console.print(table.to_string(index=False, float_format="%.2f"), highlight=False)
    for name in names:
        if "error" in known[name,]:
            console.print(name, known[name,]["error"], highlight=False, markup=False)
    if len(table):
        console.print(
            f"{table['within 2'].sum()} of {len(names)} within a factor of {FACTOR:g} of the "
            f"range's middle, {table['in range'].sum()} in the range",
            highlight=False,
        )


if __name__ == "__main__":
    main()
