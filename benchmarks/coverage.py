"""Bias and coverage of the wet clutch's intervals, over virtual data sets from the model itself."""

from __future__ import annotations

import time

from rich.console import Console

from aleator.study import load_study
from aleator.tasks.recover import recover
from benchmarks.identifications import CLUTCH
from benchmarks.likelihood import TRUTH


def print_coverage(console: Console, replicates: int, workers: int) -> None:
    """Identify `replicates` virtual data sets, in `workers` processes."""
    study, began = load_study(CLUTCH), time.perf_counter()
    found = recover(
        study.runner(), study.experiments, study.inputs, TRUTH,
        noise=study.noise, propagation=study.propagation, density=study.density,
        search=study.search,
        replicates=replicates, seed=0, workers=workers,
    )  # fmt: skip
    seconds = time.perf_counter() - began
    console.print(f"recovery: {replicates} virtual data sets in {seconds:.0f} s")
    console.print(found.table().round(4).to_string())
