"""Experiments and a simulator in, the identified law out."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from concurrent.futures import Executor
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from aleator.errors import InputsError
from aleator.inference import diagnostics
from aleator.inference.check import Check, Checked, checked, smoothed, unsmoothed
from aleator.inference.diagnostics.individual import rival_warnings
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import Layout, OnSurfaces
from aleator.likelihood.model import Model
from aleator.observations.experiments import Experiments
from aleator.observations.noise import Noise
from aleator.progress import Progress, Silent
from aleator.results.units import checked_units
from aleator.search import Search
from aleator.simulators import Budget, Runner, Simulator, as_runner
from aleator.surrogates import ResponseSurface
from aleator.tasks import individual, summary
from aleator.tasks.answer import Answer, Question, answered
from aleator.tasks.asked import DEFAULT_PROPAGATION, DEFAULT_SEARCH, require_enough
from aleator.tasks.baselines import baselines_of, start_point
from aleator.tasks.budget import affordable, spend
from aleator.tasks.ceiling import best_possible
from aleator.tasks.consistency import consistency_of
from aleator.tasks.identification import Identification
from aleator.tasks.individual.rivals import as_good
from aleator.tasks.ledger import Ledger
from aleator.tasks.near_outcomes import doubt_of, nearer
from aleator.types import Flags

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation

DEFAULT_CHECK = Check()
UNLIMITED = Budget()


def identify(
    simulator: Callable[..., Any] | Simulator | Runner,
    experiments: Experiments | pd.DataFrame,
    inputs: Inputs,
    *,
    outcome: str | None = None,
    vectorized: bool = False,
    noise: Noise | Mapping[str, Noise] | None = None,
    propagation: ResponseSurface | Collocation = DEFAULT_PROPAGATION,
    density: Density | None = None,
    search: Search = DEFAULT_SEARCH,
    verification: Check = DEFAULT_CHECK,
    seed: int = 0,
    progress: Progress | None = None,
    executor: Executor | None = None,
    consistency: bool = True,
    best_law: bool = True,
    budget: Budget = UNLIMITED,
    units: Mapping[str, str] | None = None,
) -> Identification:
    """Identify the law of the inputs from experiments, by maximum likelihood.

    alpha* = arg max sum_l log f_Yl(y_l | alpha) (paper, eq. (MLE)).

    `simulator` takes conditions and parameters by keyword and returns the outcome: once a run with
    floats, or with arrays of R runs if `vectorized`. `experiments` is an `Experiments`, or a data
    frame whose column `outcome` is the measured outcome and whose other columns are conditions.
    With `noise` the likelihood is an integral over each experiment's own parameters, without it is
    one over the level sets of the response: both exact. A `density`, `Collocation` and `nodes` of
    the law ask for moments of an exact outcome instead. Runs are made by the workers of `executor`,
    or here; the result does not depend on it. With `consistency` False the second verdict is left
    out, with `best_law` False the best possible law; the estimates do not depend on them. A
    `budget` ends the runs of the surfaces with the best answer so far, and a warning says what more
    would buy: such an answer depends on what the store knows. `units` of outcomes, conditions and
    parameters by name are shown beside them, no more. Raises AleatorError for input that cannot be
    used; failures of numerics are statuses and warnings on the result. Cost: the runs of the
    surfaces and of the check, and some milliseconds for each of some hundred evaluations of the
    likelihood.

    >>> from aleator.laws import Free, Normal
    >>> table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.1, 1.8, 3.6, 3.7]})
    >>> def model(load, x):
    ...     return load * x
    >>> law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))})
    >>> result = identify(model, table, law, outcome="y", verification=Check(0))
    >>> round(result.alpha["x.mean"].estimate, 3)  # the mean of y/load: (1.1 + .9 + 1.2 + .925)/4
    1.031
    """
    table = _experiments(experiments, outcome)
    if not isinstance(inputs, Inputs):
        raise InputsError(
            f"the inputs are {type(inputs).__name__}, not Inputs", "write Inputs({name: law, ...})"
        )
    each = noise.values() if isinstance(noise, Mapping) else () if noise is None else (noise,)
    if not all(isinstance(one, Noise) for one in each):
        raise InputsError(f"the noise is {noise!r:.60}, not Noise", "write Noise(sd=...)")
    known = (*table.observations.names, *map(str, table.table.columns), *inputs.names)
    shown = checked_units(units, known)
    runner = as_runner(simulator, table, inputs.names, vectorized, executor)
    runner.repeat_some()
    spend(budget, runner, inputs, propagation)
    ledger = Ledger(runner, progress or Silent())
    taken = (*runner.asked, *inputs.covariates)
    if individual.wanted(table, inputs, noise):
        found = individual.identified(
            runner,
            table,
            inputs,
            noise,
            propagation,
            density,
            search,
            verification,
            seed,
            ledger,
        )
        return _judged(replace(found, units=shown), taken, consistency, best_law, ledger)
    model = Model.of(inputs, propagation, density)
    require_enough(table, model.hyperparameters)
    question = Question(runner, table.outcomes, table.ids, model, search, seed)
    with diagnostics.boxes_proposed(runner, inputs):
        with ledger.stage("repeated run"):
            runner.require_repeatable(np.clip(start_point(inputs), *inputs.box.T))
        found = _found(question, table, verification, ledger)
    return _judged(replace(found, units=shown), taken, consistency, best_law, ledger)


def _found(
    question: Question, table: Experiments, verification: Check, ledger: Ledger
) -> Identification:
    """The answer to a question, checked on the simulator where it rests on something else."""
    runner, seed = question.runner, question.seed
    answer = answered(question, ledger)
    check = _checked(answer, runner, verification, ledger)
    doubted = doubt_of(answer, check)
    for _ in range(diagnostics.ACCURACY.rounds):
        better = nearer(question, answer, _doubtful(answer, doubted), ledger)
        if better is None:
            break
        again = _checked(better, runner, verification, ledger)
        if again is None:
            break
        answer, check, doubted = better, again, doubt_of(better, again)
    with ledger.stage("baselines"):
        baselines = baselines_of(answer.problem, question.search, seed)
    with ledger.stage("inference"):
        rivals = as_good(answer.problem, answer.found, answer.inference)
    notes = [
        *rival_warnings(rivals, question.model.hyperparameters, answer.profile.intervals),
        *diagnostics.budget_warnings(runner.account, answer.surfaces),
    ]
    if check is None and answer.surfaces is not None and verification.wanted:
        notes.append(diagnostics.UNCHECKED)
    found = summary.assemble(
        table, answer.problem, answer.found, answer.inference, answer.profile, check,
        baselines, runner.simulator, doubted=doubted, seconds=ledger.seconds,
        runs_by_stage=ledger.runs, seed=seed, failures=diagnostics.failure_report(runner),
        notes=notes,
    )  # fmt: skip
    found = replace(found, propagation_reason=answer.reason)
    if found.sound and not (answer.surfaces and answer.surfaces.broken):
        return found
    jumps = diagnostics.step_warnings(answer.surfaces, question.model.inputs)
    return replace(found, warnings=(*found.warnings, *jumps))


def _doubtful(answer: Answer, doubted: diagnostics.Doubt) -> Flags:
    """Experiments (N,) whose surfaces are to be more exact near the measured outcomes.

    Without noise also those whose outcome lies at an extreme of the surface.
    """
    return doubted.wanting | answer.problem.unreached_at(answer.found.alpha)


def _judged(
    found: Identification,
    taken: Collection[str],
    consistency: bool,
    best_law: bool,
    ledger: Ledger,
) -> Identification:
    """The identification with its second verdict and the best possible law, where asked for.

    `taken` are the columns that the simulator or a law takes.
    """
    if consistency:
        with ledger.stage("consistency"):
            second = consistency_of(found.fit, found.sound, found.seed, ledger.progress, taken)
        found = replace(found, consistency=second)
    if best_law and found.sound:
        with ledger.stage("best possible law"):
            best = best_possible(found.fit, found.seed, ledger.progress)
        found = replace(found, best_possible=best)
    return replace(
        found,
        runs=sum(ledger.runs.values()),
        runs_by_stage=dict(ledger.runs),
        seconds={**ledger.seconds, "total": sum(ledger.seconds.values())},
    )


def _checked(answer: Answer, runner: Runner, choice: Check, ledger: Ledger) -> Checked | None:
    """The check on the simulator; None where nothing rests on surfaces, or no run is left."""
    surfaces, problem = answer.surfaces, answer.problem
    if surfaces is None or problem.surface is None or not choice.wanted:
        return None
    most = affordable(runner, choice.runs(surfaces))
    if most == 0:
        return None
    inputs, law = problem.model.inputs, answer.found.alpha[: problem.model.inputs.size]
    predictor = OnSurfaces(problem.surface, problem.region, problem.condition)
    layout = Layout(
        len(problem.outcomes), np.arange(len(problem.outcomes)), runner.unit, runner.column
    )
    with ledger.stage("verification"):
        likelihood = smoothed(inputs, law, predictor, layout, problem.outcomes, choice.smooth)
        runs = most or choice.runs(surfaces)
        found = checked(likelihood, law, runner, runs, choice, problem.outcomes)
        exact = problem.exactly
        return found if exact is None else unsmoothed(found, exact, law)


def _experiments(experiments: Experiments | pd.DataFrame, outcome: str | None) -> Experiments:
    if isinstance(experiments, Experiments):
        return experiments
    if not isinstance(experiments, pd.DataFrame):
        raise InputsError(
            f"the experiments are {type(experiments).__name__}, not a data frame or Experiments",
            "write pandas.DataFrame(...)",
        )
    if outcome is None:
        raise InputsError(
            "identify got a data frame but not the name of its outcome",
            'say which column holds the measured outcome: identify(..., outcome="...")',
        )
    return Experiments.from_frame(experiments, outcome=outcome)
