"""The steps of an identification: maximize, compute uncertainty, check on the simulator.

The command `identify` takes these steps for measured experiments, `recover` for simulated ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.core.types import Array, Indices
from aleator.fit.budget import affordable
from aleator.fit.earlier_runs import with_earlier_runs
from aleator.fit.ledger import Ledger
from aleator.fit.question import Question, start_point
from aleator.fit.refine import EXACT, Refinement, refined
from aleator.fit.regions import REGIONS, draws, plausible_alphas
from aleator.fit.rounds import enlarged
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

    `checked` is None where no response surface is used, no run was left, or the user switched the
    check off. `doubt` is the effect of the surfaces' errors on the estimates.
    """

    inferred: Inferred
    checked: Checked | None
    doubt: Doubt


def identified(question: Question, check: Check, ledger: Ledger) -> Answer:
    """Identify the laws, and check the result on the simulator where it rests on surfaces.

    Surfaces are accurate where the law has its mass. Without noise, an outcome in the tail of its
    law has its parameters elsewhere, where a surface may be wrong. The check finds such an error.
    The surface then gets more runs near that outcome, and the laws are identified again. Gaussian
    processes begin with the runs that are in the store.
    """
    runner = question.runner
    question = with_earlier_runs(question, enlarged(runner, question.choices.surfaces))
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
                # Runs that lie very close together can make a surface worse.
                break
            answer = again
    return answer


def answered(question: Question, ledger: Ledger) -> Inferred:
    """The maximum likelihood with its uncertainty, not yet checked on the simulator."""
    return with_uncertainty(refined(question, ledger), ledger)


def _checked(found: Inferred, check: Check, ledger: Ledger) -> Answer:
    """Check an identification with new runs, at parameters drawn from each experiment's own law."""
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
        # The error near a step of the simulator is unknown, and more runs would not reduce it.
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
    """Identify again with more runs near outcomes whose surfaces have too large an error.

    None where no surface needs runs, or none are left.
    """
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
    """Parameter points (512, moving) with outcomes near the measured ones, by condition.

    `rows` are the experiments. From `times` as many draws of plausible laws, those whose outcomes
    by the surface are nearest to the measured ones are kept.
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
