"""Virtual data sets of a study, drawn at a known law and identified: one file for both kinds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import pandas as pd

from aleator.inference.information import Inference
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.likelihood.model import Model
from aleator.observations.errors import Noise
from aleator.observations.experiments import Conditions, Experiments
from aleator.observations.responses import Observations, responses_of
from aleator.progress import Silent
from aleator.search import Search
from aleator.simulators import Runner
from aleator.surrogates import ResponseSurface
from aleator.tasks import individual
from aleator.tasks.answer import Question, answered
from aleator.tasks.asked import AnyTable
from aleator.tasks.ledger import Ledger
from aleator.types import Array

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation


@dataclass(frozen=True)
class Replicate:
    """One virtual data set identified: alpha (K,), intervals (K, 2), errors (K, 2), the maximum.

    Errors are the standard errors by the observed information, and the sandwich errors.
    """

    alpha: Array
    intervals: Array
    errors: Array
    log_likelihood: float
    converged: bool


class Job(Protocol):
    """One kind of study: how its virtual data sets are drawn, and identified."""

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All of alpha."""

    @property
    def table(self) -> Experiments | Conditions | None:
        """What another process makes runs for; None: the conditions of the runner."""

    def draw(
        self, runner: Runner, alpha: Array, replicates: int, rng: np.random.Generator
    ) -> Sequence[Any]:
        """A data set for each replicate."""

    def identify(self, runner: Runner, data: Any, seed: int) -> Replicate:
        """One data set identified, as `identify` does it."""


@dataclass(frozen=True)
class IndividualJob:
    """Experiments with several observations each."""

    asked: individual.Asked

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """Those of the laws, then those of the errors."""
        return self.asked.hyperparameters

    @property
    def table(self) -> Experiments:
        """The table of the study."""
        return self.asked.table

    def draw(
        self, runner: Runner, alpha: Array, replicates: int, rng: np.random.Generator
    ) -> Sequence[Observations]:
        """Observations at the conditions of the table, with bounds like its own."""
        asked = self.asked
        return [
            individual.virtual_observations(
                runner, asked.table, asked.inputs, asked.errors, alpha, rng
            )
            for _ in range(replicates)
        ]

    def identify(self, runner: Runner, data: Observations, seed: int) -> Replicate:
        """By the integral over individual parameters."""
        question = self.asked.question(runner, data, seed)
        answer = individual.answered(question, Ledger(runner, Silent()))
        found = answer.found
        return Replicate(
            answer.settled.alpha, answer.profile.intervals, _errors(answer.inference),
            found.log_likelihood, found.converged,
        )  # fmt: skip


@dataclass(frozen=True)
class OutcomesJob:
    """Experiments with one outcome each."""

    model: Model
    search: Search
    table: None = None

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """Those of the model."""
        return self.model.hyperparameters

    def draw(
        self, runner: Runner, alpha: Array, replicates: int, rng: np.random.Generator
    ) -> Sequence[Array]:
        """Outcomes (replicates, N) of independent parameters."""
        inputs, count = self.model.inputs, len(runner.ids)
        uniform = rng.random((replicates * count, len(inputs.names)))
        x = inputs.sample(alpha[: inputs.size], uniform)
        return [*runner(np.tile(np.arange(count), replicates), x).reshape(replicates, count)]

    def identify(self, runner: Runner, data: Array, seed: int) -> Replicate:
        """By the density of the outcomes."""
        question = Question(runner, data, runner.ids, self.model, self.search, seed)
        answer = answered(question, Ledger(runner, Silent()))
        found = answer.found
        return Replicate(
            found.alpha, answer.profile.intervals, _errors(answer.inference),
            found.log_likelihood, found.converged,
        )  # fmt: skip


def _errors(inference: Inference) -> Array:
    return np.stack([inference.standard_error, inference.sandwich_error], axis=1)


def job_of(
    experiments: AnyTable,
    inputs: Inputs,
    noise: Noise | Mapping[str, Noise] | None,
    propagation: ResponseSurface | Collocation,
    density: Density | None,
    search: Search,
) -> Job:
    """The kind of study that this is. Raises InputsError for choices that do not go together."""
    if not isinstance(experiments, Experiments):
        experiments = _unmeasured(experiments, noise)
    if individual.wanted(experiments, inputs, noise):
        return IndividualJob(
            individual.asked(experiments, inputs, noise, propagation, density, search)
        )
    return OutcomesJob(Model.of(inputs, propagation, density), search)


def _unmeasured(
    asked: Conditions | pd.DataFrame, noise: Noise | Mapping[str, Noise] | None
) -> Experiments:
    """Experiments of which nothing was measured; a data frame has the responses of the noise."""
    if isinstance(asked, pd.DataFrame):
        named = responses_of([*noise]) if isinstance(noise, Mapping) else ()
        asked = Conditions.from_frame(asked, responses=named)
    return Experiments(
        asked.ids, asked.conditions, asked.observations,
        table=asked.table, experiment=asked.experiment, places=asked.places,
    )  # fmt: skip
