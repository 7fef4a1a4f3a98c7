"""`python -m benchmarks peers`: runs an experiment to 0.2 standard errors, by a plain design.

The peer is scikit-learn's Gaussian process (Matern 5/2, a length for each condition and parameter)
on a Sobol' design, one process of all experiments. Its mean takes the place of the simulator in
Aleator's own likelihood, and its alpha is judged like that of `benchmarks.emulators`. The design
fills the box in which the means are sought, and the search starts from the law of the data. All
data are synthetic.
"""

from __future__ import annotations

import importlib.util
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pandas as pd
from rich.console import Console
from scipy.interpolate import RectBivariateSpline
from scipy.stats import qmc

from aleator import identify
from aleator.core.types import Array
from benchmarks.emulators import BY_NAME, EMULATED, exact_answer, exact_value, exactly
from benchmarks.kept import Entry, Key, kept
from benchmarks.simulators import Studied

STUDIES = ("smooth", "clutch")
SIZES = (2, 4, 6, 8, 12, 16, 24, 32)
SETS, FIRST_SEED = 2, 4700
ENOUGH = 0.2
"""Error of alpha in the worst direction, in standard errors, that a design is to reach."""
LEARNED = 400
"""Runs by which the lengths of the process are chosen; all runs are in the process itself."""
TABULATED = 25
"""Values of each parameter at which the process is evaluated; a spline is between them."""
ALEATOR = "Aleator"


def box_of(study: Studied) -> Array:
    """The box (n, 2) of the peer's design: where the study seeks the means."""
    known = [marginal.known["mean"] for marginal in study.laws.values()]
    return np.array([(one.lower, one.upper) for one in known], dtype=float)


@dataclass(frozen=True, eq=False)
class Emulated:
    """A simulator of two parameters by a table for each condition, with splines between."""

    names: tuple[str, ...]
    conditions: Array
    splines: tuple[RectBivariateSpline, ...]
    box: Array

    def __call__(self, **values: Array) -> Array:
        """Outcomes (R,) under known conditions; beyond the box those of its edge."""
        known = self.conditions.shape[1]
        every = np.stack(np.broadcast_arrays(*(values[name] for name in self.names)), axis=1)
        of = np.argmin(np.abs(every[:, None, :known] - self.conditions[None]).sum(axis=2), axis=1)
        x, found = np.clip(every[:, known:], *self.box.T), np.empty(len(every))
        for k in np.unique(of).tolist():
            rows = of == k
            found[rows] = self.splines[k].ev(x[rows, 0], x[rows, 1])
        return found


def scikit(conditions: Array, x: Array, y: Array, box: Array) -> Callable[[Array, Array], Array]:
    """The mean of scikit-learn's Gaussian process at conditions (R, C) and parameters (R, n)."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    low, high = conditions.min(axis=0), conditions.max(axis=0)
    varied = high > low

    def scaled(c: Array, p: Array) -> Array:
        of_box = (p - box[:, 0]) / (box[:, 1] - box[:, 0])
        return np.hstack([(c - low)[:, varied] / (high - low)[varied], of_box])

    at = scaled(conditions, x)
    kernel = ConstantKernel(10.0, (1e-2, 1e5)) * Matern(
        np.ones(at.shape[1]), (0.05, 50.0), nu=2.5
    ) + WhiteKernel(1e-6, (1e-10, 1e-2))
    some = np.random.default_rng(0).permutation(len(at))[:LEARNED]
    learned = GaussianProcessRegressor(
        kernel, normalize_y=True, n_restarts_optimizer=1, random_state=0
    ).fit(at[some], y[some])
    whole = GaussianProcessRegressor(learned.kernel_, optimizer=None, normalize_y=True).fit(at, y)
    return lambda c, p: np.asarray(whole.predict(scaled(c, p)))


def emulated(study: Studied, table: pd.DataFrame, size: int) -> Emulated:
    """The peer of a study after `size` runs an experiment."""
    box, count = box_of(study), len(table)
    used = [str(name) for name in table]
    own = table.to_numpy(dtype=float)
    owner = np.repeat(np.arange(count), size)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of numbers of points that are no power of two
        share = qmc.Sobol(len(box), rng=1).random(count * size)
        x = box[:, 0] + share * (box[:, 1] - box[:, 0])
        names = (*used, *study.inputs.names)
        runs = dict(zip(names, np.hstack([own[owner], x]).T, strict=True))
        predicted = scikit(own[owner], x, np.asarray(study.simulator(**runs)), box)
    a, b = (np.linspace(low, high, TABULATED) for low, high in box.tolist())
    grid = np.stack([g.ravel() for g in np.meshgrid(a, b, indexing="ij")], axis=1)
    different = np.unique(own, axis=0)
    splines = tuple(
        RectBivariateSpline(
            a, b, predicted(np.tile(row, (len(grid), 1)), grid).reshape(a.size, b.size)
        )
        for row in different
    )
    return Emulated(names, different, splines, box)


exact = cache(exact_answer)
"""The exact answers, each computed once."""


def judged(name: str, seed: int, size: int | str) -> Entry:
    """The peer, or Aleator by default, on one data set: runs an experiment and error of alpha."""
    study, best = BY_NAME[name], exact(name, seed)
    table, began = study.table(seed), time.process_time()
    runs: float
    if isinstance(size, str):
        found = identify(
            study.slow, table, study.inputs, noise=study.noise, propagation=EMULATED,
            consistency=False, best_law=False,
        )  # fmt: skip
        alpha, runs = {k: e.estimate for k, e in found.alpha.items()}, found.runs / len(table.ids)
    else:
        other = replace(study, simulator=_named(emulated(study, table.conditions, size)))
        try:
            end = exactly(other, table, *study.from_truth())
        except Exception as error:  # outcomes that the peer's mean does not reach
            return {"runs": size, "error": f"{type(error).__name__}: {error}"[:200]}
        named = [h.name for h in end.likelihood.hyperparameters]
        alpha, runs = dict(zip(named, end.alpha.tolist(), strict=True)), float(size)
    loss = best["log_likelihood"] - exact_value(study, table, alpha)
    seconds = time.process_time() - began
    print(f"{name} {seed} {size}: error {np.sqrt(2 * max(loss, 0)):.3f}, {seconds:.0f} s")
    return {"runs": runs, "worst": float(np.sqrt(2.0 * max(loss, 0.0))), "seconds": seconds}


def _named(model: Emulated) -> Callable[..., Array]:
    """A function with the arguments of the model by name, as a simulator must have."""
    listed = ", ".join(model.names)
    passed = ", ".join(f"{name}={name}" for name in model.names)
    made: Callable[..., Array] = eval(f"lambda {listed}: model({passed})", {"model": model})
    return made


def measured(path: Path) -> Iterator[dict[str, object]]:
    """For each study: errors by size, and the runs from which on the median error is enough."""
    sizes: list[int] = [*SIZES] if importlib.util.find_spec("sklearn") else []
    for name in STUDIES:
        seeds = [FIRST_SEED + k for k in range(SETS)]
        keys: list[Key] = [(name, s, ALEATOR) for s in seeds]
        keys += [(name, s, size) for s in seeds for size in sizes]
        entries = kept(path, keys, judged)
        ours = [entries[name, seed, ALEATOR] for seed in seeds]
        yield {
            "study": name, "by": "Aleator, default", "runs": np.median([o["runs"] for o in ours]),
            "error": np.median([o["worst"] for o in ours]),
        }  # fmt: skip
        errors = {
            size: float(np.median([entries[name, s, size].get("worst", np.inf) for s in seeds]))
            for size in sizes
        }
        enough = [s for s in sizes if all(errors[t] <= ENOUGH for t in sizes if t >= s)]
        yield {
            "study": name, "by": "scikit-learn, Sobol'",
            "runs": enough[0] if enough else f"more than {max(sizes, default=0)}",
            "error": "; ".join(f"{size}: {error:.2f}" for size, error in errors.items()),
        }  # fmt: skip


def print_peers(console: Console, path: Path = Path("peers.jsonl")) -> None:
    """A row of each study for Aleator, and one for its peer."""
    rows = pd.DataFrame(partial(measured, path)())
    with pd.option_context("display.width", 200, "display.max_colwidth", 120):
        console.print(rows.to_string(index=False, float_format="%.2f"), highlight=False)
