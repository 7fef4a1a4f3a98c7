"""Does the method find a law that is known? Virtual data sets from the model itself, identified."""

from __future__ import annotations

import multiprocessing
import pickle
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aleator.errors import InputsError
from aleator.laws import Hyperparameter
from aleator.likelihood.problem import Model, Problem, prepare
from aleator.progress import Progress, Silent
from aleator.search import Search
from aleator.simulators import Runner
from aleator.tasks.identify import infer_at
from aleator.tasks.region import known_region
from aleator.types import Array


@dataclass(frozen=True)
class Replicate:
    """One virtual data set identified: alpha (K,), intervals (K, 2), the maximum."""

    alpha: Array
    intervals: Array
    log_likelihood: float
    converged: bool


@dataclass(frozen=True)
class Recovery:
    """R replicates of a known law `truth` (K,) for the free hyperparameters `names`."""

    names: tuple[str, ...]
    truth: Array
    alpha: Array
    intervals: Array
    log_likelihood: Array
    converged: NDArray[np.bool_]

    def table(self) -> pd.DataFrame:
        """Truth, mean estimate, bias and its Monte Carlo error, scatter, and coverage, by name.

        `bias_error` is the standard deviation of the estimates over sqrt(R); `coverage` the
        share of 95 % intervals that hold the truth.
        """
        count = self.alpha.shape[0]
        scatter = self.alpha.std(axis=0, ddof=1)
        held = (self.intervals[:, :, 0] <= self.truth) & (self.truth <= self.intervals[:, :, 1])
        return pd.DataFrame(
            {
                "truth": self.truth,
                "mean": self.alpha.mean(axis=0),
                "bias": self.alpha.mean(axis=0) - self.truth,
                "bias_error": scatter / np.sqrt(count),
                "scatter": scatter,
                "coverage": held.mean(axis=0),
            },
            index=list(self.names),
        )


def recover(
    runner: Runner,
    model: Model,
    search: Search,
    truth: Mapping[str, float],
    *,
    replicates: int = 40,
    seed: int = 0,
    workers: int = 1,
    progress: Progress | None = None,
) -> Recovery:
    """Draw outcomes from the model at `truth`, identify each data set, and compare.

    The outcomes come from the simulator, one run an experiment and replicate, plus noise if the
    model has it; the response surfaces are built once and shared. `workers` processes identify in
    parallel; the answer does not depend on their number. Raises InputsError for fewer than two
    replicates, or a truth that lacks a hyperparameter or lies outside its limits.
    """
    progress = progress or Silent()
    alpha = _checked(truth, model.hyperparameters, replicates)
    progress.stage("response surface")
    count = runner.group.size
    region = model.inputs.box if model.inputs.bounded else known_region(model, alpha)
    problem = prepare(runner, np.zeros(count), model, region, progress)
    progress.stage("virtual experiments")
    data = _draw(runner, model, alpha, replicates, count, np.random.default_rng(seed))
    progress.stage("identification")
    found: dict[int, Replicate] = {}
    for number, replicate in _identified(problem, search, data, seed, workers):
        found[number] = replicate
        progress.update(f"{len(found)} of {replicates} data sets", len(found), replicates)
    results = [found[number] for number in range(replicates)]
    free = [k for k, h in enumerate(model.hyperparameters) if h.free]
    return Recovery(
        tuple(model.hyperparameters[k].name for k in free),
        alpha[free],
        np.stack([r.alpha[free] for r in results]),
        np.stack([r.intervals[free] for r in results]),
        np.array([r.log_likelihood for r in results]),
        np.array([r.converged for r in results]),
    )


def _draw(
    runner: Runner,
    model: Model,
    alpha: Array,
    replicates: int,
    count: int,
    rng: np.random.Generator,
) -> Array:
    """Outcomes (replicates, N) of independent parameters and noise."""
    inputs = model.inputs
    uniform = rng.random((replicates * count, len(inputs.names)))
    x = inputs.sample(alpha, uniform)
    outcomes = runner(np.tile(np.arange(count), replicates), x).reshape(replicates, count)
    return outcomes + model.noise_sd(alpha) * rng.standard_normal(outcomes.shape)


def _identified(
    problem: Problem, search: Search, data: Array, seed: int, workers: int
) -> Iterator[tuple[int, Replicate]]:
    if workers > 1 and _can_travel(problem, search):
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(workers, mp_context=context) as pool:
            jobs = {
                pool.submit(_one, problem, search, outcomes, seed + k): k
                for k, outcomes in enumerate(data)
            }
            try:
                for job in as_completed(jobs):
                    yield jobs[job], job.result()
            finally:
                pool.shutdown(wait=True, cancel_futures=True)
    else:
        for k, outcomes in enumerate(data):
            yield k, _one(problem, search, outcomes, seed + k)


def _can_travel(problem: Problem, search: Search) -> bool:
    """Whether both can be sent to another process; a function of a script cannot."""
    try:
        pickle.dumps((problem, search))
    except (pickle.PicklingError, AttributeError, TypeError):
        return False
    return True


def _one(problem: Problem, search: Search, outcomes: Array, seed: int) -> Replicate:
    likelihood = replace(problem.likelihood, outcomes=outcomes)
    problem = replace(problem, likelihood=likelihood)
    found = search.maximize(likelihood, likelihood.hyperparameters, seed=seed)
    found, _, profile = infer_at(problem, found)
    return Replicate(found.alpha, profile.intervals, found.log_likelihood, found.converged)


def _checked(
    truth: Mapping[str, float], hyperparameters: Sequence[Hyperparameter], replicates: int
) -> Array:
    if replicates < 2:
        raise InputsError(f"recover: {replicates} replicates", "use at least 2; 40 tell a lot")
    values = []
    for h in hyperparameters:
        value = truth.get(h.name, h.start if not h.free else None)
        if value is None:
            raise InputsError(f"recover: no true value of {h.name}", "give every hyperparameter")
        if not h.lower <= value <= h.upper:
            raise InputsError(
                f"recover: true {h.name} = {value} is outside its limits [{h.lower}, {h.upper}]",
                "widen the limits or choose another truth",
            )
        values.append(float(value))
    return np.array(values)
