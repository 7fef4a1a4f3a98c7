"""`python -m benchmarks.runs`: what runs cost beside the simulator, from a hundred to a million.

A cheap simulator, a function that is called once a run, goes through a store and two worker
processes, and through the store alone; a third way is the same as arrays. Fifty runs of each of as
many experiments as it takes. It is a process of its own, whose memory is then that of the runs.

Overhead is what a run takes besides the simulator: wall-clock time, less the seconds that the
simulator took where it ran, shared by the workers. "Again" is what another runner takes, which
finds every run in the store.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from aleator.observations.experiments import Conditions
from aleator.simulators import FunctionSimulator, Runner, Store
from aleator.simulators.pool import ProcessPool

WORKERS = 2
EACH = 50
SIZES = (100, 1_000, 10_000, 100_000, 1_000_000)
TARGET_SECONDS, TARGET_OVERHEAD, TARGET_MEMORY = 180.0, 100e-6, 2.0


def damped(load: float, stiffness: float, damping: float) -> float:
    """Travel of a damped spring after fifty steps of explicit Euler."""
    travel = speed = 0.0
    for _ in range(50):
        travel, speed = (
            travel + 0.02 * speed,
            speed + 0.02 * (load - damping * speed - stiffness * travel),
        )
    return travel


@dataclass(frozen=True)
class Cost:
    """What `runs` runs took in all, the simulator itself where it ran, and all of it again."""

    runs: int
    seconds: float
    simulator: float
    again: float
    megabytes: float

    def overhead(self, workers: int) -> float:
        """Seconds a run besides the simulator."""
        return (self.seconds - self.simulator / workers) / self.runs


def cost(runs: int, vectorized: bool, executor: Executor | None, folder: Path) -> Cost:
    """Runs of a new study through a new store, each experiment under conditions of its own."""
    experiments = max(runs // EACH, 1)
    table = Conditions(
        tuple(map(str, range(experiments))),
        pd.DataFrame({"load": np.linspace(1.0, 2.0, experiments)}),
    )
    rng = np.random.default_rng(runs)
    index = np.repeat(np.arange(experiments), runs // experiments)
    x = rng.uniform(0.5, 1.5, (runs, 2))
    path = folder / f"{runs}.sqlite"
    simulator, names = FunctionSimulator(damped, vectorized), ["stiffness", "damping"]
    seconds = []
    for _ in range(2):
        began = time.perf_counter()
        with Store(path) as store:
            run = Runner(simulator, table, names, store=store, executor=executor)
            run(index, x)
        seconds.append(time.perf_counter() - began)
    assert run.cache is not None
    assert run.fresh == 0
    stored = run.cache.at_start
    assert stored.runs == runs
    found = Cost(runs, seconds[0], stored.seconds, seconds[1], path.stat().st_size / 1e6)
    path.unlink()
    return found


def memory() -> float:
    """The most memory that this process had, and each worker as much as the largest, in GiB."""
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    largest = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return float((own + WORKERS * largest) / 2**20)


def growth_table(name: str, costs: list[Cost], workers: int) -> Table:
    """A row for each number of runs."""
    table = Table(
        "runs", "seconds", "a run", "simulator", "overhead", "again", "MB",
        title=f"{name}; microseconds",
    )  # fmt: skip
    for c in costs:
        table.add_row(
            f"{c.runs:,}", f"{c.seconds:.2f}", f"{1e6 * c.seconds / c.runs:.1f}",
            f"{1e6 * c.simulator / c.runs:.1f}", f"{1e6 * c.overhead(workers):.1f}",
            f"{1e6 * c.again / c.runs:.1f}", f"{c.megabytes:.1f}",
        )  # fmt: skip
    return table


def measure(console: Console) -> None:
    """Measure and print everything."""
    with TemporaryDirectory() as folder:
        with ProcessPool(WORKERS) as pool:
            cost(WORKERS * EACH, False, pool, Path(folder))  # the workers start, and import
            pooled = [cost(runs, False, pool, Path(folder)) for runs in SIZES]
        most = memory()
        ways = {
            f"runs through the store and {WORKERS} processes": (pooled, WORKERS),
            "runs through the store, one by one in this process": (
                [cost(runs, False, None, Path(folder)) for runs in SIZES[:-1]], 1),
            "runs through the store, as arrays in this process": (
                [cost(runs, True, None, Path(folder)) for runs in SIZES], 1),
        }  # fmt: skip
    for name, (costs, workers) in ways.items():
        console.print(growth_table(name, costs, workers))
    table = Table("what", "Aleator", "target", "ratio")
    for what, ours, target, unit in (
        ("20,000 experiments of 50 runs", pooled[-1].seconds, TARGET_SECONDS, "s"),
        ("overhead a run", 1e6 * pooled[-1].overhead(WORKERS), 1e6 * TARGET_OVERHEAD, "µs"),
        ("memory of all processes", most, TARGET_MEMORY, "GiB"),
    ):
        table.add_row(what, f"{ours:.3g} {unit}", f"{target:g} {unit}", f"{ours / target:.3g}")
    console.print(table)


def print_runs() -> None:
    """Measure and print in a new process, whose memory is its own."""
    subprocess.run([sys.executable, "-m", "benchmarks.runs"], check=True)


if __name__ == "__main__":
    measure(Console())
