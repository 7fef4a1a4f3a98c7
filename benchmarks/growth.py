"""How seconds and memory grow with the number of experiments, each study in a process of its own.

Whole identifications by default settings, of synthetic data: an exponential with one scattering
parameter or two, whole curves, and weights of growing animals with three parameters. Told are the
seconds of a processor and the most memory, beside what many experiments may take, and the stages
that took most of the time. The animals are also identified with a function of single numbers.
The part `cost` draws the seconds from 100 to 100,000 experiments.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from aleator import Experiments, Free, Inputs, LogNormal, Noise, TruncatedNormal, identify
from aleator.core.types import Array
from benchmarks.kept import Entry, Key, kept

NOISE = 0.1
STAGES = 3
"""Stages that are told."""


@dataclass(frozen=True)
class Study:
    """So many experiments and scattering parameters, and what they may take; 0: nobody said.

    An experiment has so many `points`. `arrays` says whether the function is stated to be
    `vectorized`; None: it is tried.
    """

    count: int
    parameters: int
    noise: float
    seconds: float = 0.0
    memory: float = 0.0
    points: int = 1
    arrays: bool | None = True


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
    Study(560, 3, NOISE, 60.0, 1024.0, points=10, arrays=None),
)

COUNTS = (100, 1_000, 10_000, 100_000)
"""The numbers of experiments whose cost is drawn: one parameter, one value with noise each."""
ESTIMATES, VERDICTS = "estimates and intervals", "with both verdicts"
PICTURE = Path(__file__).parents[1] / "docs" / "images" / "growth.png"


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
            "yes" if study.arrays else "tried",
            f"{found.seconds:.1f}", f"{study.seconds:g}" if study.seconds else "",
            f"{found.memory:.0f}", f"{study.memory:g}" if study.memory else "", found.longest,
        )  # fmt: skip
        console.print("  ".join(part for part in row if part), soft_wrap=True)
        table.add_row(*row)
    console.print(table)


def print_cost(console: Console, path: Path, _: int) -> None:
    """The seconds from 100 to 100,000 experiments as a table, and drawn into the documentation."""
    keys: list[Key] = [(count, part) for count in COUNTS for part in (ESTIMATES, VERDICTS)]
    found = kept(path, keys, _cost)
    table = Table("experiments", "", "seconds", "ms an experiment", "MiB", title="cost")
    for count, part in keys:
        one = found[count, part]
        each = 1e3 * one["seconds"] / int(count)
        table.add_row(
            f"{count:,}", str(part), f"{one['seconds']:.1f}", f"{each:.2f}", f"{one['memory']:.0f}"
        )
    console.print(table)
    _drawn({part: [found[n, part]["seconds"] for n in COUNTS] for part in (ESTIMATES, VERDICTS)})


def _cost(count: int, part: str) -> Entry:
    found = _alone(Study(count, 1, NOISE), part == VERDICTS)
    return {"seconds": found.seconds, "memory": found.memory}


def _drawn(seconds: Mapping[str, list[float]]) -> None:
    figure = Figure(figsize=(6.0, 3.2), layout="constrained")
    axes = figure.subplots()
    for marker, (part, values) in zip("os", seconds.items(), strict=True):
        (line,) = axes.loglog(COUNTS, values, marker=marker, label=part)
        straight = [values[-1] * count / COUNTS[-1] for count in COUNTS[1:]]
        axes.loglog(COUNTS[1:], straight, "--", linewidth=0.8, color=line.get_color())
    axes.plot([], [], "k--", linewidth=0.8, label="proportional to the experiments")
    axes.set(xlabel="experiments", ylabel="seconds of a processor")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(PICTURE, dpi=100)


def _alone(study: Study, verdicts: bool = True) -> Measured:
    """In a process that has made no other."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        return process.submit(_measured, study, verdicts).result()


def _measured(study: Study, verdicts: bool) -> Measured:
    table, inputs, simulator = (_animals if study.parameters == 3 else _exponential)(study)
    began = time.process_time()
    found = identify(
        simulator,
        Experiments.from_frame(table, outcome="y", id="id"),
        inputs,
        vectorized=study.arrays,
        noise=Noise(study.noise) if study.noise else None,
        consistency=verdicts,
        best_law=verdicts,
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
