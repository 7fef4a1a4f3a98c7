"""How seconds and memory grow with the number of experiments, each study in a process of its own.

Whole identifications with the second verdict and the best possible law, of a line with one
scattering slope. A ratio is that of seconds, or of memory, over the ratio of the experiments.
"""

from __future__ import annotations

import resource
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pandas as pd

from aleator import Free, Inputs, MonteCarlo, Noise, Normal, identify
from aleator.types import Array
from benchmarks.row import Row

FEW, MANY = 1_000, 8_000
NOISE = {"with noise": 0.05, "without noise": 0.0}


def growth_rows() -> list[Row]:
    """Both ways to a likelihood, of few experiments and of eight times as many."""
    return [row for name, sd in NOISE.items() for row in _grown(name, sd)]


def _grown(name: str, sd: float) -> list[Row]:
    (before, small), (after, large) = (_alone(count, sd) for count in (FEW, MANY))
    times = MANY / FEW
    what = f"{MANY:,} experiments for {FEW:,}, {name}"
    return [
        Row(f"{what}: seconds", f"{after:.1f} s", f"{times:g} x {before:.1f} s",
            after / (times * before)),
        Row(f"{what}: memory", f"{large:.0f} MiB", f"{times:g} x {small:.0f} MiB",
            large / (times * small)),
    ]  # fmt: skip


def _alone(count: int, sd: float) -> tuple[float, float]:
    """Seconds and MiB of one study, in a process that has made no other."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        return process.submit(_measured, count, sd).result()


def _measured(count: int, sd: float) -> tuple[float, float]:
    rng = np.random.default_rng(1)
    z = rng.uniform(1.0, 2.0, count)
    y = z * (1.0 + 0.1 * rng.standard_normal(count)) + sd * rng.standard_normal(count)
    law = Inputs({"a": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))})
    began = time.perf_counter()
    identify(
        _line, pd.DataFrame({"z": z, "y": y}), law, outcome="y", vectorized=True,
        noise=Noise(sd) if sd else None, verification=MonteCarlo(0),
    )  # fmt: skip
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return time.perf_counter() - began, peak


def _line(z: Array, a: Array) -> Array:
    return z * a
