"""Experiments with several observations and a simulator in, the identified law out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from aleator.errors import ExperimentsError, InputsError
from aleator.laws.inputs import Inputs
from aleator.observations.errors import MeasurementErrors
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
    errors = MeasurementErrors.of(noise, table)
    if inputs.regressed:
        inputs = inputs.resolved(_covariates(table, inputs.covariates))
    question = Question(runner, table, inputs, errors, surfaces, search, seed)
    answer = answered(question, ledger)
    return assembled(question, answer, seconds=ledger.seconds, runs_by_stage=ledger.runs)


def _covariates(table: Experiments, names: Sequence[str]) -> pd.DataFrame:
    """The columns that laws follow, a row an experiment.

    All columns that are alike in all rows of each experiment; raises ExperimentsError for a wanted
    one that is not.
    """
    first = np.unique(table.experiment, return_index=True)[1]
    of_experiments = table.table.iloc[first].set_axis([*table.ids], axis=0)
    spread = table.table.groupby(table.experiment, sort=True).nunique(dropna=False)
    for name in names:
        if name in spread and (spread[name] > 1).any():
            lost = int(np.flatnonzero(spread[name] > 1)[0])
            raise ExperimentsError(
                f"column '{name}' has several values in experiment '{table.ids[lost]}', and a law "
                "of its parameters follows it",
                "let laws follow only what is the same in all rows of an experiment; what varies "
                "is a condition of the simulator",
            )
    return of_experiments
