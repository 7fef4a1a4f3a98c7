"""How seconds and memory grow with the number of experiments, each study in a process of its own.

Whole identifications by default settings, of an exponential with one scattering parameter or two:
seconds of a processor and the most memory, beside what many experiments may take, and the stages
that took most of the time.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from aleator import Inputs, Noise, TruncatedNormal, identify
from aleator.core.types import Array

NOISE = 0.1
STAGES = 3
"""Stages that are told."""


@dataclass(frozen=True)
class Study:
    """So many experiments and scattering parameters, and what they may take; 0: nobody said."""

    count: int
    parameters: int
    noise: float
    seconds: float = 0.0
    memory: float = 0.0


STUDIES = tuple(
    study
    for noise in (0.0, NOISE)
    for study in (
        Study(2_000, 1, noise),
        Study(20_000, 1, noise, 60.0, 1024.0),
        Study(100_000, 1, noise, 300.0),
        Study(2_000, 2, noise),
        Study(5_000, 2, noise, 120.0, 1536.0),
    )
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
        "experiments", "parameters", "noise", "seconds", "may take", "MiB", "may take",
        "longest stages, seconds", title="growth",
    )  # fmt: skip
    for study in STUDIES:
        found = _alone(study)
        row = (
            f"{study.count:,}", str(study.parameters), f"{study.noise:g}",
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
    rng = np.random.default_rng(1)
    z = rng.uniform(0.5, 2.0, study.count)
    a = np.clip(0.5 + 0.1 * rng.standard_normal(study.count), 0.0, 1.0)
    c = 2.0 + 0.2 * (study.parameters - 1) * np.clip(rng.standard_normal(study.count), -5.0, 5.0)
    y = c * np.exp(a * z) + study.noise * rng.standard_normal(study.count)
    laws = {"a": TruncatedNormal(box=(0.0, 1.0)), "c": TruncatedNormal(box=(1.0, 3.0))}
    began = time.process_time()
    found = identify(
        _two if study.parameters == 2 else _one,
        pd.DataFrame({"z": z, "y": y}),
        Inputs({name: laws[name] for name in "ac"[: study.parameters]}),
        outcome="y",
        vectorized=True,
        noise=Noise(study.noise) if study.noise else None,
    )
    seconds = time.process_time() - began
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return Measured(seconds, peak, dict(found.seconds))


def _one(z: Array, a: Array) -> Array:
    return 2.0 * np.exp(a * z)


def _two(z: Array, a: Array, c: Array) -> Array:
    return c * np.exp(a * z)
