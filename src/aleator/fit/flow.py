"""The flow of an identification: question, refine, uncertainty, check.

`identify` asks for the experiments that were measured, `recover` for virtual ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.core.types import Array, Indices
from aleator.fit.ledger import Ledger, affordable
from aleator.fit.question import Question, start_point
from aleator.fit.refine import EXACT, Refinement, refined
from aleator.fit.regions import REGIONS, draws, plausible_alphas
from aleator.fit.uncertainty import Inferred, with_uncertainty
from aleator.inference import diagnostics, surface_diagnostics
from aleator.inference.check import Check, Checked, checked, smoothed, unsmoothed
from aleator.inference.surface_diagnostics import Doubt, doubt
from aleator.likelihood.individual import Layout, OnSurfaces
from aleator.likelihood.problem import Problem
from aleator.simulators.response_functions import moving_parameters


@dataclass(frozen=True, eq=False)
class Answer:
    """The maximum with its uncertainty, its check on the simulator, and the surfaces' errors.

    `checked` is None where nothing rests on surfaces, or no run was left or wanted.
    """

    inferred: Inferred
    checked: Checked | None
    doubt: Doubt


def identified(question: Question, check: Check, ledger: Ledger) -> Answer:
    """The answer to a question, checked on the simulator where it rests on surfaces.

    Surfaces are made exact where the law has its mass. An exact outcome far out is explained
    elsewhere, and its log-density may rest on what a surface has wrong there: the check sees it,
    and the surface has more runs near that outcome.
    """
    runner = question.runner
    start = np.clip(start_point(question.inputs), *question.inputs.box.T)
    with diagnostics.boxes_proposed(runner, question.inputs):
        with ledger.stage("repeated run"):
            runner.require_repeatable(start)
        answer = _checked(answered(question, ledger), check, ledger)
        for _ in range(surface_diagnostics.ACCURACY.rounds):
            better = _nearer(answer, ledger)
            if better is None:
                break
            again = _checked(better, check, ledger)
            if again.checked is None or again.doubt.size > answer.doubt.size:
                # runs beside each other may spoil a surface
                break
            answer = again
    return answer


def answered(question: Question, ledger: Ledger) -> Inferred:
    """The maximum that neither nodes nor runs move, with its uncertainty."""
    return with_uncertainty(refined(question, ledger), ledger)


def _checked(found: Inferred, check: Check, ledger: Ledger) -> Answer:
    """The answer with the check: a few fresh runs under the individual laws."""
    question, surfaces = found.refined.question, found.refined.surfaces
    likelihood, alpha, runner = found.maximum.likelihood, found.maximum.alpha, question.runner
    none = np.zeros(likelihood.count)
    result: Checked | None = None
    if surfaces is not None and check.active:
        runs = check.runs(surfaces)
        most = affordable(runner, runs)
        if most != 0:
            with ledger.stage("verification"):
                result = _against_simulator(found, check, most or runs)
    if not isinstance(likelihood, Problem):
        return Answer(found, result, Doubt(np.full(likelihood.count, np.nan), none))
    doubted = doubt(likelihood, found.inference, alpha, result)
    if surfaces is not None:
        # what a step does is not known: that is said, and no run helps
        doubted = doubted.but_for(surfaces.stepped[likelihood.condition])
    return Answer(found, result, doubted)


def _against_simulator(found: Inferred, check: Check, runs: int) -> Checked:
    runner, end = found.refined.question.runner, found.maximum
    likelihood, alpha = end.likelihood, end.alpha
    if not isinstance(likelihood, Problem):
        return checked(likelihood, alpha, runner, runs, check)
    y, law = likelihood.outcomes, alpha[: likelihood.inputs.size]
    assert likelihood.surface is not None
    predictor = OnSurfaces(likelihood.surface, likelihood.region, likelihood.condition)
    layout = Layout(y.size, np.arange(y.size), runner.unit, runner.column)
    smooth = smoothed(likelihood.inputs, law, predictor, layout, y, check.smooth)
    result, exact = checked(smooth, law, runner, runs, check, y), likelihood.exactly
    return result if exact is None else unsmoothed(result, exact, law)


def _nearer(answer: Answer, ledger: Ledger) -> Inferred | None:
    """The answer with more runs near outcomes whose surfaces are doubted; None without any."""
    found, likelihood = answer.inferred, answer.inferred.maximum.likelihood
    surfaces = found.refined.surfaces
    if surfaces is None or not isinstance(likelihood, Problem):
        return None
    doubtful = answer.doubt.wanting | likelihood.unreached_at(found.maximum.alpha)
    members = np.isin(np.arange(surfaces.good.size), likelihood.condition[doubtful])
    rows = np.flatnonzero(doubtful & surfaces.granted(members)[likelihood.condition])
    if not rows.size:
        return None
    refinement = Refinement(found.refined.question, ledger)
    near = _draws_near(likelihood, found, rows)
    return with_uncertainty(refinement.sharpened(found.refined, near), ledger)


def _draws_near(
    problem: Problem, found: Inferred, rows: Indices, times: int = 16
) -> dict[int, Array]:
    """Draws (512, moving) near the measured outcomes of some experiments, by condition.

    Of `times` as many draws of plausible laws, those whose outcomes are nearest are taken.
    """
    inputs, region = problem.inputs, problem.region
    likely = plausible_alphas(found.maximum.alpha, found.inference, problem.hyperparameters)
    wide = draws(inputs, [*likely], problem.count, EXACT.wide, times * REGIONS.draws)
    wide = np.clip(wide, *region.T)[:, moving_parameters(region)]
    surface = problem.surface
    assert surface is not None
    near: dict[int, Array] = {}
    for condition in np.unique(problem.condition[rows]).tolist():
        outcomes = surface.take(np.array([condition])).evaluate(wide)[0]
        measured = problem.outcomes[rows[problem.condition[rows] == condition]]
        nearest = np.argsort(np.abs(outcomes - measured[:, None]), axis=1)[:, : REGIONS.draws]
        near[condition] = wide[nearest.ravel()]
    return near
