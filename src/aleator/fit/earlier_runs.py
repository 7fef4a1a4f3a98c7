"""The stored runs with which the Gaussian processes of a question begin.

These are all runs that the store had when the question was first asked, under conditions of the
question and within its first region. Runs that are stored later, its own among them, are looked up
one by one when they are needed. So a study that was interrupted makes the same decisions when it
goes on, and a study with other laws begins with all that is there.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np

from aleator.core.types import Array, Indices
from aleator.fit.question import Question
from aleator.fit.regions import draws
from aleator.laws.hyperparameter import log_prior
from aleator.simulators.response_functions import moving_parameters
from aleator.surrogates.choice import by_process


def with_earlier_runs(question: Question, together: int) -> Question:
    """The question with the stored runs with which its processes may begin.

    `together` is the number of runs of a round if workers enlarge it, or zero. A new question is
    entered into the store, so that this comes before its first run.
    """
    runner, choices = question.runner, question.choices
    processes = choices.surfaces and by_process(choices.surfaces, choices.density is not None)
    if runner.cache is None or not processes:
        return question
    return replace(question, earlier=runner.cache.before(fingerprint(question, together)))


def earlier_runs(question: Question, region: Array) -> tuple[Indices, Array]:
    """The cases (R,) and the moving parameters (R, n) of earlier runs within a region (n, 2)."""
    moving, runs = moving_parameters(region), question.earlier
    if runs is None:
        return np.empty(0, dtype=np.intp), np.empty((0, moving.size))
    inside = np.all((runs.x >= region[:, 0]) & (runs.x <= region[:, 1]), axis=1)
    return runs.case[inside], runs.x[inside][:, moving]


def fingerprint(question: Question, together: int) -> str:
    """A hash of what decides where a question makes its runs.

    Laws and noise are recognized by what they give at the start of the search: draws of the
    parameters, and log-densities of the measured values, whose last digits may differ elsewhere.
    """
    choices, runner, inputs = question.choices, question.runner, question.inputs
    hyperparameters, seen = choices.hyperparameters, question.table.observations
    start = np.array([h.start for h in hyperparameters])
    known = [(h.name, h.lower, h.upper, h.start, h.free, h.log) for h in hyperparameters]
    cells = {
        name: [np.asarray(cell).tolist() for cell in column]
        for name, column in runner.cases.columns.items()
    }
    most = None if choices.surfaces is None else choices.surfaces.max_runs
    digest = hashlib.sha256(repr((known, cells, most, together, question.seed)).encode())
    laws = [draws(inputs, [start], len(question.ids)), log_prior(hyperparameters, start)]
    if not question.exact:
        values, every = start[inputs.size :], slice(0, len(seen))
        laws.append(choices.errors.terms(values, question.measured[:, None], every).value)
    with np.errstate(all="ignore"):
        rounded = [np.asarray(part, dtype=np.float32) for part in laws]
    observed = [
        runner.cases.condition[question.unit], question.column, seen.experiment, seen.lower,
        seen.upper,
    ]  # fmt: skip
    for part in (*observed, *rounded):
        digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()
