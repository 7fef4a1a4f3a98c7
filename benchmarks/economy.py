"""`python -m benchmarks economy`: what an answer by default costs in runs, and how far off it is.

Each study is held against an answer with all the runs it likes: with noise by the simulator itself,
without by surfaces that are exact all over their region. Studies with noise may make as many runs
as they like, which makes theirs on surfaces, as a slow simulator's are.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from aleator import (
    Free,
    Identification,
    Inputs,
    LogNormal,
    Noise,
    Normal,
    ResponseSurface,
    TruncatedNormal,
    identify,
)
from aleator.cli.running import identified
from aleator.core.progress import Silent
from aleator.core.types import Array
from aleator.simulators import Budget
from aleator.study import load_study
from benchmarks.identifications import CHECK, CLUTCH

COUNT, NOISE = 40, 0.1
"""Experiments of a study, and the noise over the scatter of its outcomes."""
UNLIMITED = Budget(runs=10**9)
DENSE = ResponseSurface(tolerance=0.001)
OWN, PROCESSES = (ResponseSurface(surfaces=kind) for kind in ("own", "process"))


@dataclass(frozen=True)
class Case:
    """A simulator of a condition c and standard normal variates (n, N), by its laws' quantiles."""

    name: str
    simulator: Callable[..., Array]
    inputs: Inputs
    parameters: Callable[[Array], dict[str, Array]]

    def table(self, noise: bool) -> tuple[pd.DataFrame, Noise | None]:
        """The experiments with what their errors are said to be."""
        rng = np.random.default_rng(3)
        c = rng.uniform(0.2, 1.8, COUNT)
        x = self.parameters(rng.standard_normal((len(self.inputs.names), COUNT)))
        y = self.simulator(c=c, **x)
        sd = NOISE * float(np.std(y))
        error = sd * rng.standard_normal(COUNT)
        if not noise:
            return pd.DataFrame({"c": c, "y": y}), None
        return pd.DataFrame({"c": c, "y": y + error}), Noise(Free(0.1 * sd, 10.0 * sd))


def line(c: Array, a: Array) -> Array:
    """Through zero."""
    return 3.0 * a * c


def plane(c: Array, a: Array, b: Array) -> Array:
    """Level and slope."""
    return a + b * c


def exponential(c: Array, a: Array, b: Array) -> Array:
    """Over its box it spans twelve decades at the ends of c."""
    return np.asarray(np.exp(c * a + b))


def ratio(c: Array, a: Array, b: Array) -> Array:
    """Saturation."""
    return a / (b + 0.5 * c)


WIDE = {
    "a": TruncatedNormal(box=(-3.0, 4.0)),
    "b": TruncatedNormal(box=(-3.0, 3.0)),
}
OPEN = {
    "a": Normal(Free(-2.0, 3.0), Free(0.01, 2.0)),
    "b": Normal(Free(-2.0, 2.0), Free(0.01, 2.0)),
}
POSITIVE = {name: LogNormal(Free(0.3, 4.0), Free(0.02, 1.5)) for name in ("a", "b")}
ONE = {"a": TruncatedNormal(box=(-3.0, 4.0))}


def near_half(z: Array) -> dict[str, Array]:
    """Normal about a half, and about zero."""
    return {"a": 0.5 + 0.3 * z[0], "b": 0.3 * z[1]}


CASES = (
    Case("linear, one parameter", line, Inputs(ONE), lambda z: {"a": 0.5 + 0.3 * z[0]}),
    Case("linear, two parameters", plane, Inputs(WIDE), near_half),
    Case("exp(c a + b), box 7 x 6", exponential, Inputs(WIDE), near_half),
    Case("exp(c a + b), without box", exponential, Inputs(OPEN), near_half),
    Case("a / (b + c/2), without box", ratio, Inputs(POSITIVE),
         lambda z: {"a": 1.5 * np.exp(0.2 * z[0]), "b": np.exp(0.25 * z[1])}),
)  # fmt: skip


@dataclass(frozen=True)
class Cost:
    """What an answer cost: runs an experiment, and how far off it is, in standard errors."""

    name: str
    runs: float
    checks: float
    off: float
    sound: bool
    seconds: float


def cost(name: str, found: Identification, dense: Identification, seconds: float) -> Cost:
    """Of an answer, held against a dense one."""
    count, checks = len(found.experiments), found.runs_by_stage.get(CHECK, 0)
    off = [
        abs(one.estimate - dense.alpha[name].estimate) / error
        for name, one in found.alpha.items()
        if (error := dense.alpha[name].standard_error) is not None
    ]
    return Cost(
        name, (found.runs - checks) / count, checks / count, max(off, default=np.nan),
        found.sound, seconds,
    )  # fmt: skip


def of_case(case: Case, noise: bool) -> Cost:
    """One of the studies by default, with measurement noise or without."""
    table, error = case.table(noise)
    answer = partial(
        identify, case.simulator, table, case.inputs, outcome="y", noise=error, vectorized=True,
        consistency=False, best_law=False,
    )  # fmt: skip
    dense = answer() if noise else answer(propagation=DENSE)
    began = time.process_time()
    found = answer(budget=UNLIMITED) if noise else answer()
    name = f"{case.name}, {'noise' if noise else 'exact'}"
    return cost(name, found, dense, time.process_time() - began)


def of_clutch() -> Iterator[Cost]:
    """The wet clutch on polynomials of each experiment, and on Gaussian processes."""
    study = load_study(CLUTCH)

    def answer(surfaces: ResponseSurface) -> Identification:
        chosen = replace(study, propagation=surfaces)
        return identified(chosen, chosen.runner(), Silent(), consistency=False)

    dense = answer(DENSE)
    for name, surfaces in (("own surfaces", OWN), ("Gaussian processes", PROCESSES)):
        began = time.process_time()
        found = answer(surfaces)
        yield cost(f"wet clutch, {name}", found, dense, time.process_time() - began)


def costs() -> Iterator[Cost]:
    """All of it."""
    for case in CASES:
        for noise in (False, True):
            yield of_case(case, noise)
    yield from of_clutch()


def print_economy(console: Console) -> None:
    """A row for each study."""
    table = Table(
        "study", "runs", "check", "error of alpha", "sound", "CPU s",
        title="runs an experiment by default; error in standard errors",
    )  # fmt: skip
    for one in costs():
        table.add_row(
            one.name, f"{one.runs:.1f}", f"{one.checks:.1f}", f"{one.off:.3f}",
            "yes" if one.sound else "NO", f"{one.seconds:.1f}",
        )  # fmt: skip
    console.print(table)
