"""Experiments with several observations and a simulator in, the identified law out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from aleator.errors import InputsError
from aleator.laws.inputs import Inputs
from aleator.observations.covariates import covariates
from aleator.observations.experiments import Experiments
from aleator.observations.noise import Noise
from aleator.search import Search
from aleator.simulators import Runner
from aleator.surrogates import ResponseSurface
from aleator.tasks.individual.answer import Question, answered
from aleator.tasks.individual.assemble import assembled
from aleator.tasks.ledger import Ledger
from aleator.tasks.results.identification import Identification

Noises = Noise | Mapping[str, Noise]
"""The noise of the only response, or of each by name."""


def wanted(table: Experiments, inputs: Inputs, noise: Noises | None) -> bool:
    """Whether a study needs the integral over individual parameters.

    It does where an experiment has several observations, or one that is censored, where the noise
    is not of one standard deviation, and where a law follows covariates.
    """
    simple = noise is None or (isinstance(noise, Noise) and noise.simple)
    return not (table.simple and simple) or inputs.regressed


def identified(
    runner: Runner,
    table: Experiments,
    inputs: Inputs,
    noise: Noises | None,
    surfaces: ResponseSurface,
    search: Search,
    seed: int,
    ledger: Ledger,
) -> Identification:
    """The law of the parameters from all observations of each experiment."""
    if noise is None:
        raise InputsError(
            "several observations an experiment, censored ones and covariates need measurement "
            "noise: without it no parameters explain all observations exactly",
            "add noise: [noise] sd, or noise=Noise(...)",
        )
    if inputs.regressed:
        inputs = inputs.resolved(covariates(table, inputs.covariates))
    kept = np.ones(len(table.observations), dtype=np.bool_)
    question = Question(runner, table, inputs, noise, surfaces, search, seed, kept)
    answer = answered(question, ledger)
    return assembled(question, answer, ledger)
