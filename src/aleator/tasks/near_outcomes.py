"""Runs where surfaces miss the simulator near an outcome, and the answer that they lead to.

Surfaces are made exact where the law has its mass. An outcome far out is explained elsewhere, and
its log-density may rest on what a surface has wrong there: the check on the simulator sees it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aleator.inference.check import Checked
from aleator.inference.diagnostics import Doubt, doubt
from aleator.tasks.answer import Answer, Question, sharpened
from aleator.tasks.ledger import Ledger
from aleator.tasks.likely import DRAWS, likely_alphas, wide_draws
from aleator.types import Array, Flags, Indices

TRIED = 16
"""Draws of likely laws for each one that is taken: those with the nearest outcomes."""


def doubt_of(answer: Answer, checked: Checked | None) -> Doubt:
    """What each surface's error near the outcome does to the answer, at most.

    It is not known where the outcome has a step: that is said, and no run helps.
    """
    problem, surfaces = answer.problem, answer.surfaces
    found = doubt(problem, answer.inference, answer.found.alpha, checked)
    if surfaces is None:
        return found
    stepped = surfaces.stepped[problem.condition]
    moves, changes = (np.where(stepped, np.nan, each) for each in (found.moves, found.changes))
    return replace(found, moves=moves, changes=changes)


def nearer(question: Question, answer: Answer, doubtful: Flags, ledger: Ledger) -> Answer | None:
    """The answer with more runs near the outcomes of some experiments (N,); None without any."""
    surfaces, condition = answer.surfaces, answer.problem.condition
    if surfaces is None or not doubtful.any():
        return None
    members = np.isin(np.arange(surfaces.good.size), condition[doubtful])
    rows = np.flatnonzero(doubtful & surfaces.granted(members)[condition])
    return sharpened(question, answer, _near(answer, rows), ledger) if rows.size else None


def _near(answer: Answer, rows: Indices) -> dict[int, Array]:
    """Draws (512, moving) for the conditions of some experiments, near their outcomes."""
    problem, alpha = answer.problem, answer.found.alpha
    surface = problem.surface
    assert surface is not None
    likely = [*likely_alphas(alpha, answer.inference, problem.model.hyperparameters)]
    wide = wide_draws(problem.model.inputs, likely, problem.region, TRIED * DRAWS)
    found: dict[int, Array] = {}
    for condition in np.unique(problem.condition[rows]).tolist():
        outcomes = surface.take(np.array([condition])).evaluate(wide)[0]
        measured = problem.outcomes[rows[problem.condition[rows] == condition]]
        nearest = np.argsort(np.abs(outcomes - measured[:, None]), axis=1)[:, :DRAWS]
        found[condition] = wide[nearest.ravel()]
    return found
