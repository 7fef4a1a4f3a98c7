"""The task `identify`: from experiments and a simulator to the identified law."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from aleator.core.progress import Progress, Silent
from aleator.errors import short
from aleator.fit.budget import spend
from aleator.fit.flow import Answer, identified
from aleator.fit.ledger import Ledger
from aleator.fit.question import DEFAULT_PROPAGATION, DEFAULT_SEARCH, Choices
from aleator.fit.result import result_of
from aleator.fit.stored_fit import keep_surfaces
from aleator.inference.check import Check
from aleator.inference.consistency import consistency_of
from aleator.inference.fit import Fit
from aleator.inference.model_choice import Criteria
from aleator.inference.outcome_question import OutcomeQuestion
from aleator.likelihood.problem import Problem
from aleator.observations.experiments import Experiments
from aleator.results.units import checked_units
from aleator.search import Search
from aleator.simulators import Budget, Runner, Simulator, as_runner
from aleator.surrogates import ResponseSurface
from aleator.tasks.arguments import (
    AnyNoise,
    Columns,
    Laws,
    experiments_of,
    inputs_of,
    noise_of,
    require_kind,
)
from aleator.tasks.ceiling import best_possible
from aleator.tasks.identification import Identification
from aleator.tasks.outcome_questions import require_answerable, with_answers
from aleator.tasks.session import Session, runners_like

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation

DEFAULT_CHECK = Check()
UNLIMITED = Budget()


def identify(
    simulator: Callable[..., Any] | Simulator | Runner,
    experiments: Experiments | pd.DataFrame | Columns,
    inputs: Laws,
    *,
    outcome: str | list[str] | None = None,
    id: str | None = None,
    vectorized: bool | None = None,
    series: bool = False,
    noise: AnyNoise = None,
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
    jac: bool | Callable[..., Any] = False,
    restricted: bool = False,
    small_sample: bool = False,
    questions: Sequence[OutcomeQuestion] = (),
) -> Identification:
    """Identify the law of the inputs from experiments, by maximum likelihood.

    alpha* = arg max sum_l log f_Yl(y_l | alpha) (paper, eq. (MLE)).

    `simulator` takes conditions and parameters by keyword and returns the outcome. It is called
    with floats for each run, or with arrays of R runs if `vectorized`. None: one trial finds out
    whether arrays give the same values. With `series` it is called once for a whole experiment: the
    conditions that vary within it, such as times, are arrays (m,) of its m rows, and it returns an
    array (m,). With `jac=True` it returns a pair, the outcome and its derivatives by the
    parameters, or `jac` is a function that returns these (see `FunctionSimulator`); then fewer runs
    do. `experiments` is a data frame, or a mapping of columns, or `Experiments`. Its column
    `outcome` is the measured outcome, or several columns are; the column `id` (by default "id", if
    there is one) names the experiment
    of each row: rows of one experiment share one draw of the parameters. The other columns are
    conditions. `inputs` is an `Inputs`, or a mapping from the names of parameters to their laws.
    `noise` is the standard deviation of the measurement error, a number or `Free(lower, upper)`, or
    a `Noise`, or a mapping from outcomes to these. With `noise` the likelihood is an integral over
    each experiment's own parameters. Without noise it is an integral over level sets, the
    parameters at which the simulator gives the measured outcome, or the bands between them that
    agree with the bounds of a censored one. Both are exact up to numerical errors. If a `density`,
    `Collocation` or `nodes` of the law are chosen, the density of an exact outcome without noise is
    computed from its moments instead.

    Runs are made by the workers of `executor`, or in this process. The result is the same as long
    as twice the number of workers is no more than six, or than half of the distinct conditions;
    beyond that rounds of runs are larger (see `ResponseSurface`).
    `consistency` False leaves out the second verdict, and `best_law` False the best possible law;
    the estimates do not depend on them. A `budget` limits the runs of response surfaces. The result
    is then the best one within the budget, with a warning about what more runs would improve. With
    a store, Gaussian processes begin with the runs that it has when the study is identified first;
    later runs change nothing. `units` of outcomes, conditions and parameters are only
    displayed. `progress=aleator.ProgressLine()` prints how far the work is; by default nothing is
    printed. `restricted` maximizes the restricted likelihood (REML), for variances from few
    experiments. `small_sample` adjusts the intervals for few experiments by Skovgaard's modified
    signed root of the profile (see docs/statistics/intervals.md); the estimates stay. `questions`
    about outcomes of new experiments are answered at the end (`OutcomeQuestion`): `answers` of the
    result, which the report states in sentences. A question that cannot be answered says why, and
    the rest of the result is there.

    Raises AleatorError for input that cannot be used. Ctrl-C raises KeyboardInterrupt, whose note
    says what became of the runs: a `Runner` with a `Store` keeps all that completed. While
    questions are answered it raises nothing: the result is returned, and the answers that are
    missing have the status "interrupted". Numerical failures are statuses and warnings on the
    result. Cost: the runs of the surfaces and of the check, and some milliseconds for each of some
    hundred evaluations of the likelihood.

    >>> from aleator.laws import Free, Normal
    >>> table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.1, 1.8, 3.6, 3.7]})
    >>> def model(load, x):
    ...     return load * x
    >>> law = {"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))}
    >>> result = identify(model, table, law, outcome="y", verification=Check(0))
    >>> round(result.alpha["x.mean"].estimate, 3)  # the mean of y/load: (1.1 + .9 + 1.2 + .925)/4
    1.031
    """
    table = experiments_of(experiments, outcome, id)
    inputs, noise = inputs_of(inputs), noise_of(noise)
    _require_settings(propagation, search, verification, seed, progress, budget, questions)
    known = (*table.observations.names, *map(str, table.table.columns), *inputs.names)
    shown = checked_units(units, known)
    runner = as_runner(simulator, table, inputs.names, vectorized, executor, jac, series)
    responses, runners = table.observations.responses, runners_like(runner, table)
    require_answerable(questions, Session(inputs, noise, responses, table, runners), shown)
    runner.repeat_some()
    spend(budget, runner, inputs, propagation, density is not None)
    ledger = Ledger(runner, progress or Silent())
    choices = Choices.of(
        table, inputs, noise, propagation, density, search, restricted=restricted,
        small_sample=small_sample,
    )  # fmt: skip
    choices.require_enough()
    with _telling_how_to_go_on(runner):
        question = choices.question(runner, table.observations, seed)
        answer = identified(question, verification, ledger)
        result = result_of(answer, table, verification, ledger)
        found = Identification.of(replace(result, units=shown), _session(answer, table))
        if not restricted:
            found = replace(found, criteria=Criteria.of(found.fit).reported())
        keep_surfaces(found, found.fit, answer.inferred.refined.question.kept, runner)
        taken = (*runner.used_conditions, *inputs.columns)
        found = _judged(found, taken, consistency, best_law, ledger)
        if questions:
            found = with_answers(found, questions, runner, ledger)
    return replace(
        found,
        runs=sum(ledger.runs.values()),
        runs_by_stage=dict(ledger.runs),
        seconds={**ledger.seconds, "total": sum(ledger.seconds.values())},
    )


@contextmanager
def _telling_how_to_go_on(runner: Runner) -> Iterator[None]:
    """Add to the KeyboardInterrupt of Ctrl-C what became of the runs, below its traceback."""
    try:
        yield
    except KeyboardInterrupt as stopped:
        if runner.cache is not None:
            file = short(runner.cache.store.path)
            stopped.add_note(f"Completed runs are in {file}: the same call goes on from there.")
        elif runner.fresh:
            stopped.add_note(
                f"The {runner.fresh:,} runs are not kept. With Runner(simulator, experiments, "
                "parameters, store=Store('runs.sqlite')) in place of the simulator, the same call "
                "goes on from where it was stopped."
            )
        raise


def _judged(
    found: Identification,
    taken: Collection[str],
    consistency: bool,
    best_law: bool,
    ledger: Ledger,
) -> Identification:
    """The identification with the consistency tests and the best possible law, if requested.

    `taken` are the columns of the table that the simulator or a law uses.
    """
    if consistency:
        with ledger.stage("consistency"):
            second = consistency_of(found.fit, found.sound, found.seed, ledger.progress, taken)
        found = replace(found, consistency=second)
    if best_law and found.sound:
        with ledger.stage("best possible law"):
            best = best_possible(found.fit, found.seed, ledger.progress)
        found = replace(found, best_possible=best)
    return found


def _require_settings(
    propagation: object, search: object, verification: object, seed: object, progress: object,
    budget: object, questions: object,
) -> None:  # fmt: skip
    """Raise AleatorError for an argument of another kind, before anything is computed."""
    require_kind(propagation, "__dataclass_fields__", "propagation", "ResponseSurface()")
    require_kind(search, "maximize", "search", "CMAES(), or GradientMultistart(10)")
    require_kind(verification, Check, "verification", "Check(), or Check(0) for no check")
    require_kind(seed, (int, np.integer), "seed", "0")
    require_kind(budget, Budget, "budget", "Budget(runs=100)")
    require_kind(questions, Sequence, "questions", '[OutcomeQuestion(probability="y > 1")]')
    if progress is not None:
        require_kind(progress, "stage", "progress", "aleator.ProgressLine()")


def _session(answer: Answer, table: Experiments) -> Session:
    """The session of an identification: its model, runner and fit, kept for further tasks."""
    end, inferred = answer.inferred.maximum, answer.inferred
    question, responses = inferred.refined.question, table.observations.responses
    runner, noise = question.runner, question.choices.noise
    if isinstance(end.likelihood, Problem):
        model = end.likelihood.model
        fit = Fit.of_outcomes(end.likelihood, end.alpha, inferred.inference, table)
        # Predictions of one exact outcome use response surfaces.
        direct = inferred.refined.direct and not table.simple
        return Session(
            model.inputs, None, responses, table, runners_like(runner, table), fit, direct,
            model.surfaces or ResponseSurface(), model,
        )  # fmt: skip
    assert end.coarse is not None
    assert question.choices.surfaces is not None
    fit = Fit.of_individuals(
        end.likelihood, end.alpha, inferred.inference, question.table, end.coarse.rule
    )
    return Session(
        end.likelihood.inputs, noise, responses, table, runners_like(runner, table), fit,
        inferred.refined.direct, question.choices.surfaces,
    )  # fmt: skip
