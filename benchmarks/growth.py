"""How seconds and memory grow with the number of experiments, each study in a process of its own.

Whole identifications by default settings, of synthetic data: an exponential with one scattering
parameter or two, whole curves, and weights of growing animals with three parameters. Told are the
seconds of a processor and the most memory, beside what many experiments may take, and the stages
that took most of the time. The animals are also identified with a function of single numbers.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from aleator import Experiments, Free, Inputs, LogNormal, Noise, TruncatedNormal, identify
from aleator.core.types import Array

NOISE = 0.1
STAGES = 3
"""Stages that are told."""


@dataclass(frozen=True)
class Study:
    """So many experiments and scattering parameters, and what they may take; 0: nobody said.

    An experiment has so many `points`. `arrays` says whether the function is declared `vectorized`.
    """

    count: int
    parameters: int
    noise: float
    seconds: float = 0.0
    memory: float = 0.0
    points: int = 1
    arrays: bool = True


STUDIES = (
    *(
        study
        for noise in (0.0, NOISE)
        for study in (
            Study(100, 1, noise),
            Study(500, 1, noise),
            Study(2_000, 1, noise),
            Study(20_000, 1, noise, 60.0, 1024.0),
            Study(100_000, 1, noise, 300.0),
            Study(2_000, 2, noise),
            Study(5_000, 2, noise, 120.0, 1536.0),
        )
    ),
    Study(500, 2, NOISE, 60.0, 1024.0, points=100),
    Study(560, 3, NOISE, 60.0, 1024.0, points=10),
    Study(560, 3, NOISE, 60.0, 1024.0, points=10, arrays=False),
)


@dataclass(frozen=True)
class Measured:
    """Seconds of a processor, MiB at most, and seconds by the clock of each stage."""

    seconds: float
    memory: float
    stages: Mapping[str, float]

    @property
    def longest(self) -> str:
        """The stages that took most; what is left is the report's."""
        own = {name: value for name, value in self.stages.items() if name != "total"}
        most = sorted(own, key=lambda name: -own[name])[:STAGES]
        return ", ".join(f"{name} {own[name]:.1f}" for name in most)


def print_growth(console: Console) -> None:
    """Each study as soon as it is measured, then all as a table."""
    table = Table(
        "experiments", "points", "parameters", "noise", "arrays", "seconds", "may take",
        "MiB", "may take", "longest stages, seconds", title="growth",
    )  # fmt: skip
    for study in STUDIES:
        found = _alone(study)
        row = (
            f"{study.count:,}", str(study.points), str(study.parameters), f"{study.noise:g}",
            "yes" if study.arrays else "no",
            f"{found.seconds:.1f}", f"{study.seconds:g}" if study.seconds else "",
            f"{found.memory:.0f}", f"{study.memory:g}" if study.memory else "", found.longest,
        )  # fmt: skip
        console.print("  ".join(part for part in row if part), soft_wrap=True)
        table.add_row(*row)
    console.print(table)


def _alone(study: Study) -> Measured:
    """In a process that has made no other."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        return process.submit(_measured, study).result()


def _measured(study: Study) -> Measured:
    table, inputs, simulator = (_animals if study.parameters == 3 else _exponential)(study)
    began = time.process_time()
    found = identify(
        simulator,
        Experiments.from_frame(table, outcome="y", id="id"),
        inputs,
        vectorized=study.arrays,
        noise=Noise(study.noise) if study.noise else None,
    )
    seconds = time.process_time() - began
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return Measured(seconds, peak, dict(found.seconds))


Synthetic = tuple[pd.DataFrame, Inputs, Callable[..., Array]]


def _exponential(study: Study) -> Synthetic:
    """y = c exp(a z) with noise; a is Normal(0.5, 0.1), and c is 2 or Normal(2, 0.2)."""
    rng, count = np.random.default_rng(1), study.count
    each = np.repeat(np.arange(count), study.points)
    z = rng.uniform(0.5, 2.0, each.size)
    a = np.clip(0.5 + 0.1 * rng.standard_normal(count), 0.0, 1.0)
    c = 2.0 + 0.2 * (study.parameters - 1) * np.clip(rng.standard_normal(count), -5.0, 5.0)
    y = c[each] * np.exp(a[each] * z) + study.noise * rng.standard_normal(each.size)
    laws = {"a": TruncatedNormal(box=(0.0, 1.0)), "c": TruncatedNormal(box=(1.0, 3.0))}
    inputs = Inputs({name: laws[name] for name in "ac"[: study.parameters]})
    return pd.DataFrame({"id": each, "z": z, "y": y}), inputs, (_one, _two)[study.parameters - 1]


def _animals(study: Study) -> Synthetic:
    """Weights a (1 - b exp(-k t)) at t in [0, 4] with lognormal a, b and k; b hardly scatters."""
    rng, count = np.random.default_rng(1), study.count
    each = np.repeat(np.arange(count), study.points)
    t = rng.uniform(0.0, 4.0, each.size)
    a, k = np.exp(0.11 * rng.standard_normal(count)), np.exp(0.16 * rng.standard_normal(count))
    y = a[each] * (1.0 - 0.94 * np.exp(-k[each] * t)) + study.noise * rng.standard_normal(each.size)
    inputs = Inputs(
        {
            "a": LogNormal(Free(0.5, 2.0), Free(0.01, 0.5)),
            "b": LogNormal(Free(0.5, 1.5), Free(1e-3, 0.3)),
            "k": LogNormal(Free(0.3, 3.0), Free(0.01, 0.8)),
        }
    )
    return pd.DataFrame({"id": each, "t": t, "y": y}), inputs, _grown


def _one(z: Array, a: Array) -> Array:
    return 2.0 * np.exp(a * z)


def _two(z: Array, a: Array, c: Array) -> Array:
    return c * np.exp(a * z)


def _grown(t: Array, a: Array, b: Array, k: Array) -> Array:
    return a * (1.0 - b * np.exp(-k * t))
