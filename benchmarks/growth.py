"""How seconds and memory grow with the number of experiments, each study in a process of its own.

Whole identifications by default settings, of an exponential with one scattering parameter or two. A
ratio is that of seconds, or of memory, over the ratio of the experiments. The last rows are those
of many experiments over what they may take.
"""

from __future__ import annotations

import resource
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
import pandas as pd

from aleator import Inputs, Noise, TruncatedNormal, identify
from aleator.types import Array
from benchmarks.row import Row

TIMES = 10
"""So many times as many experiments."""


@dataclass(frozen=True)
class Case:
    """Studies of `many` experiments and a tenth of them, and what the former may take."""

    name: str
    many: int
    parameters: int
    noise: float
    seconds: float
    memory: float


CASES = (
    Case("one parameter, with noise", 20_000, 1, 0.1, 60.0, 1024.0),
    Case("one parameter, without noise", 20_000, 1, 0.0, 60.0, 1024.0),
    Case("two parameters, with noise", 5_000, 2, 0.1, 120.0, 1536.0),
)


def growth_rows() -> list[Row]:
    """Both ways to a likelihood, of few experiments and of ten times as many."""
    return [row for case in CASES for row in _grown(case)]


def _grown(case: Case) -> list[Row]:
    few = case.many // TIMES
    (before, small), (after, large) = (_alone(case, count) for count in (few, case.many))
    what = f"{case.many:,} experiments for {few:,}, {case.name}"
    target = f"{case.many:,} experiments, {case.name}"
    return [
        Row(f"{what}: seconds", f"{after:.1f} s", f"{TIMES} x {before:.1f} s",
            after / (TIMES * before)),
        Row(f"{what}: memory", f"{large:.0f} MiB", f"{TIMES} x {small:.0f} MiB",
            large / (TIMES * small)),
        Row(f"{target}: seconds", f"{after:.1f} s", f"{case.seconds:g} s", after / case.seconds),
        Row(f"{target}: memory", f"{large:.0f} MiB", f"{case.memory:g} MiB", large / case.memory),
    ]  # fmt: skip


def _alone(case: Case, count: int) -> tuple[float, float]:
    """Seconds of a processor and MiB of one study, in a process that has made no other."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        return process.submit(_measured, case, count).result()


def _measured(case: Case, count: int) -> tuple[float, float]:
    rng = np.random.default_rng(1)
    z = rng.uniform(0.5, 2.0, count)
    a = np.clip(0.5 + 0.1 * rng.standard_normal(count), 0.0, 1.0)
    c = 2.0 + 0.2 * (case.parameters - 1) * np.clip(rng.standard_normal(count), -5.0, 5.0)
    y = c * np.exp(a * z) + case.noise * rng.standard_normal(count)
    laws = {"a": TruncatedNormal(box=(0.0, 1.0)), "c": TruncatedNormal(box=(1.0, 3.0))}
    began = time.process_time()
    identify(
        _two if case.parameters == 2 else _one,
        pd.DataFrame({"z": z, "y": y}),
        Inputs({name: laws[name] for name in "ac"[: case.parameters]}),
        outcome="y",
        vectorized=True,
        noise=Noise(case.noise) if case.noise else None,
    )
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return time.process_time() - began, peak


def _one(z: Array, a: Array) -> Array:
    return 2.0 * np.exp(a * z)


def _two(z: Array, a: Array, c: Array) -> Array:
    return c * np.exp(a * z)
