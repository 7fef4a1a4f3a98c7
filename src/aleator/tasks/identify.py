"""Experiments and a simulator in, the identified law out."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from aleator.densities import Convolution, Density, MaximumEntropy, NodeDensity, Status
from aleator.errors import InputsError
from aleator.inference import diagnostics as findings
from aleator.inference.information import Inference, infer
from aleator.inference.profile import Profile, profile_intervals
from aleator.inference.verification import MonteCarlo, SurfaceEmulator, Verification, verify
from aleator.laws.inputs import Inputs
from aleator.likelihood.comparison import exact_movement
from aleator.likelihood.problem import Model, Problem, default_density, has_lattice
from aleator.likelihood.propagation import Collocation
from aleator.observations.experiments import Experiments
from aleator.observations.noise import Noise
from aleator.progress import Progress, Silent
from aleator.search import GradientMultistart, Near, Search, SearchResult, ascend
from aleator.simulators import Runner, Simulator, as_runner
from aleator.surrogates import ResponseSurface
from aleator.tasks import summary
from aleator.tasks.baselines import (
    LeastSquares,
    LinearGaussian,
    least_squares,
    linear_gaussian,
    start_point,
)
from aleator.tasks.concentration import Concentration
from aleator.tasks.predict import DEFAULT_PROPAGATION
from aleator.tasks.result import Identification
from aleator.tasks.uniform import Uniform
from aleator.types import Array

WIDER = 3
"""Times that the region may be widened so that it holds the intervals."""

COARSE = 0.1
"""Change of the log-likelihood with more nodes that says that they are too few."""

MOVES = 0.1
"""Standard errors by which the exact density has to move an estimate to be worth its time."""

DEFAULT_SEARCH = GradientMultistart()
DEFAULT_VERIFICATION = MonteCarlo()


def identify(
    simulator: Callable[..., Any] | Simulator | Runner,
    experiments: Experiments | pd.DataFrame,
    inputs: Inputs,
    *,
    outcome: str | None = None,
    vectorized: bool = False,
    noise: Noise | None = None,
    propagation: ResponseSurface | Collocation = DEFAULT_PROPAGATION,
    density: Density | NodeDensity | None = None,
    search: Search = DEFAULT_SEARCH,
    verification: MonteCarlo = DEFAULT_VERIFICATION,
    seed: int = 0,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> Identification:
    """Identify the law of the inputs from experiments, by maximum likelihood.

    alpha* = arg max sum_l log f_Yl(y_l | alpha) (paper, eq. (MLE)).

    `simulator` takes conditions and parameters by keyword and returns the outcome: once a run with
    floats, or with arrays of R runs if `vectorized`. `experiments` is an `Experiments`, or a data
    frame whose column `outcome` is the measured outcome and whose other columns are conditions.
    `density` None is the density of the outcome itself (`Convolution`) where there are response
    surfaces, and noise or up to three scattering parameters, unless the nodes turn out too few for
    it; else maximum entropy of four moments. Runs are made by the workers of `executor`, or here;
    the result does not depend on it. Raises AleatorError for input that cannot be used; failures of
    numerics are statuses and warnings on the result. Cost: the runs of the surfaces and of the
    verification, and some milliseconds for each of some hundred evaluations of the likelihood.

    >>> from aleator.laws import Free, Normal
    >>> table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.1, 1.8, 3.6, 3.7]})
    >>> def model(load, x):
    ...     return load * x
    >>> law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))})
    >>> result = identify(model, table, law, outcome="y", verification=MonteCarlo(0))
    >>> round(result.alpha["x.mean"].estimate, 3)  # the mean of y/load: (1.1 + .9 + 1.2 + .925)/4
    1.031
    """
    table = _experiments(experiments, outcome)
    runner = as_runner(simulator, table, inputs.names, vectorized, executor)
    chosen = density or default_density(inputs, noise, propagation)
    model = Model(inputs, noise, propagation, chosen)
    _check_count(table, model)
    ledger = Ledger(runner, progress or Silent())
    with findings.boxes_proposed(runner, inputs):
        with ledger.stage("repeated run"):
            runner.require_repeatable(np.clip(start_point(inputs), *inputs.box.T))
        answer = _answered(runner, table, model, search, seed, ledger, freely=density is None)
        checked = None
        if verification.samples:
            with ledger.stage("verification"):
                checked = _verify(answer, runner, verification, seed, ledger)
    return summary.assemble(
        table, answer.problem, answer.found, answer.inference, answer.profile, checked,
        answer.baselines, runner.simulator, seconds=ledger.seconds, runs_by_stage=ledger.runs,
        seed=seed, failures=findings.failure_report(runner),
        notes=[findings.MOMENTS_STAND_IN] if answer.stands_in else [],
    )  # fmt: skip


@dataclass(frozen=True)
class _Answer:
    """A maximum that was found, and how sure it is."""

    problem: Problem
    found: SearchResult
    inference: Inference
    profile: Profile
    baselines: tuple[LeastSquares, LinearGaussian]
    stands_in: bool = False
    """Whether four moments serve although the exact density was tried."""


def _answered(
    runner: Runner,
    table: Experiments,
    model: Model,
    search: Search,
    seed: int,
    ledger: Ledger,
    *,
    freely: bool,
) -> _Answer:
    """Search on surfaces that fit the answer, and widen them until they hold its intervals.

    A density that was `freely` chosen is changed where another does better at the answer.
    """
    searched = _Searched(search, seed, ledger)
    follows = isinstance(model.propagation, ResponseSurface) and model.propagation.tolerance is None
    way = (Concentration if follows else Uniform)(
        runner, table.outcomes, model, searched, ledger.stage, ledger.progress, table.ids
    )
    problem, found = way.search(seed)
    other = _other_density(problem, found.alpha) if freely else None
    if other is not None:
        runner.know(runner.completed)
        exact, changed = isinstance(other, Convolution), replace(model, density=other)
        again = Near(found.alpha) if exact else search
        answer = _answered(runner, table, changed, again, seed, ledger, freely=exact)
        return answer if exact else replace(answer, stands_in=True)
    with ledger.stage("inference"):
        found, inference, profile = infer_at(problem, found)
    for _ in range(WIDER):
        held = way.hold(problem, found, inference, profile.intervals)
        if held is None:
            break
        problem, found = held
        with ledger.stage("inference"):
            found, inference, profile = infer_at(problem, found)
    return _Answer(problem, found, inference, profile, searched.baselines)


def _other_density(problem: Problem, alpha: Array) -> Density | NodeDensity | None:
    """What does better than the default density: the exact one, or four moments in its place."""
    if isinstance(problem.model.density, Convolution):
        return MaximumEntropy(order=4) if _moments_serve(problem, alpha) else None
    return Convolution() if exact_movement(problem, alpha) > MOVES else None


def _moments_serve(problem: Problem, alpha: Array) -> bool:
    """Whether a density over nodes needs more of them, so that four moments do better.

    By its status, or because more nodes change it; without noise four moments have to be nearer to
    what more nodes give.
    """
    likelihood = problem.likelihood
    if np.any(likelihood.fit(alpha).status == Status.TOO_COARSE):
        return True
    gap = findings.quadrature_gap(problem, alpha)
    if abs(gap) <= max(COARSE, 1e-3 * likelihood.outcomes.size):
        return False
    if likelihood.noisy:
        return True
    of_moments = replace(likelihood, density=MaximumEntropy(order=4)).evaluate(alpha)
    return abs(of_moments.total - likelihood.evaluate(alpha).total - gap) < abs(gap)


class Ledger:
    """Seconds and simulator runs by stage."""

    def __init__(self, runner: Runner, progress: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self.runs: dict[str, int] = {}
        self.progress = progress
        self._runner = runner
        self._last = ""

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Announce a stage, and note what it takes; a stage may come again, or go on."""
        if name != self._last:
            self.progress.stage(name)
        self._last = name
        began, before = time.perf_counter(), self._runner.runs
        try:
            yield
        finally:
            seconds, runs = time.perf_counter() - began, self._runner.runs - before
            self.seconds[name] = self.seconds.get(name, 0.0) + seconds
            self.runs[name] = self.runs.get(name, 0) + runs


def infer_at(problem: Problem, found: SearchResult) -> tuple[SearchResult, Inference, Profile]:
    """Standard errors and profile intervals; climbs on if the profile meets a better maximum."""
    objective, hyperparameters = problem.likelihood, problem.likelihood.hyperparameters
    for _ in range(3):
        inference = infer(objective, found.alpha, hyperparameters)
        profile = profile_intervals(objective, found.alpha, hyperparameters, inference)
        if profile.better is None:
            break
        information = inference.information
        end, value = ascend(
            objective, profile.better, hyperparameters, inference.identified, information
        )
        found = found.improved(end, value)
    return found, inference, profile


class _Searched:
    """The user's search, with the baselines of the same surfaces among its guesses."""

    baselines: tuple[LeastSquares, LinearGaussian]

    def __init__(self, search: Search, seed: int, ledger: Ledger) -> None:
        self.search, self.seed, self.ledger = search, seed, ledger

    def __call__(self, problem: Problem, guess: list[Array]) -> SearchResult:
        with self.ledger.stage("baselines"):
            self.baselines = _baselines(problem, self.search, self.seed)
        fit, linear = self.baselines
        hyperparameters = problem.likelihood.hyperparameters
        around = np.array([h.start for h in hyperparameters])
        inputs = problem.model.inputs
        for law, part, value in zip(inputs.laws.values(), inputs.slices, fit.x, strict=True):
            around[part] = law.filling(value)
        with self.ledger.stage("search"):
            return self.search.maximize(
                problem.likelihood,
                hyperparameters,
                seed=self.seed,
                guesses=[*guess, around, linear.alpha],
                progress=self.ledger.progress,
            )


def _baselines(problem: Problem, search: Search, seed: int) -> tuple[LeastSquares, LinearGaussian]:
    inputs, outcomes = problem.model.inputs, problem.likelihood.outcomes
    start = np.clip(start_point(inputs), *problem.region.T)
    fit = least_squares(problem.response, problem.condition, outcomes, problem.region, start)
    linear = linear_gaussian(
        problem.response, inputs, start, problem.condition, outcomes,
        problem.likelihood.hyperparameters, search, noisy=bool(problem.model.noise), seed=seed,
    )  # fmt: skip
    return fit, linear


def _verify(
    answer: _Answer, runner: Runner, choice: MonteCarlo, seed: int, ledger: Ledger
) -> Verification:
    problem, alpha = answer.problem, answer.found.alpha
    model, likelihood, surface = problem.model, problem.likelihood, problem.surface
    emulator = surface and SurfaceEmulator(surface, problem.region, problem.condition)
    return verify(
        runner.attempt, model.inputs, alpha, model.noise_sd(alpha), likelihood.outcomes, choice,
        seed=seed, lower=likelihood.lower, upper=likelihood.upper, emulator=emulator,
        steps=findings.score_steps(answer.inference, alpha, likelihood.hyperparameters),
        progress=ledger.progress,
    )  # fmt: skip


def _experiments(experiments: Experiments | pd.DataFrame, outcome: str | None) -> Experiments:
    if isinstance(experiments, Experiments):
        return experiments
    if outcome is None:
        raise InputsError(
            "identify got a data frame but not the name of its outcome",
            'say which column holds the measured outcome: identify(..., outcome="...")',
        )
    return Experiments.from_frame(experiments, outcome=outcome)


def _check_count(table: Experiments, model: Model) -> None:
    free = sum(h.free for h in model.hyperparameters)
    if len(table.ids) < free:
        raise InputsError(
            f"{len(table.ids)} experiments cannot identify {free} hyperparameters",
            "fix some hyperparameters, or add experiments (ten for each is a start)",
        )
    lattice = has_lattice(model.inputs, model.propagation)
    if isinstance(model.density, Convolution) and model.noise is None and not lattice:
        raise InputsError(
            "without noise the convolution needs nodes on a lattice: response surfaces, up to "
            "three scattering parameters, and nodes that are left out or a number",
            "add noise ([noise] sd, or noise=Noise(...)), or take MaximumEntropy or LogSpline",
        )
    if model.inputs.scattering == 0 and model.noise is None:
        raise InputsError(
            "nothing scatters: every parameter is a constant and there is no measurement noise",
            "give a parameter a law, or add noise: [noise] sd, or noise=Noise(...)",
        )
