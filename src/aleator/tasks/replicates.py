"""Virtual data sets of a study, drawn at a known law and identified: one file for both kinds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from aleator.fit.flow import answered
from aleator.fit.ledger import Ledger
from aleator.fit.question import Choices
from aleator.inference.information import Inference
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.observations.errors import Noise
from aleator.observations.experiments import Conditions, Experiments
from aleator.observations.responses import Observations, responses_of
from aleator.progress import Silent
from aleator.search import Search
from aleator.simulators import Runner
from aleator.surrogates import ResponseSurface
from aleator.tasks.asked import AnyTable
from aleator.tasks.individual.virtual import virtual_observations
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


@dataclass(frozen=True)
class Job:
    """A study whose virtual data sets are drawn, and identified as `identify` does it."""

    choices: Choices

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All of alpha."""
        return self.choices.hyperparameters

    @property
    def table(self) -> Experiments:
        """What another process makes runs for."""
        return self.choices.table

    def draw(
        self, runner: Runner, alpha: Array, replicates: int, rng: np.random.Generator
    ) -> Sequence[Observations]:
        """Observations for each replicate, at the conditions of the table and bounded as there."""
        choices = self.choices
        if not choices.exact:
            return [
                virtual_observations(
                    runner, choices.table, choices.inputs, choices.errors, alpha, rng
                )
                for _ in range(replicates)
            ]
        inputs, count = choices.inputs, len(runner.ids)
        uniform = rng.random((replicates * count, len(inputs.names)))
        x = inputs.sample(alpha[: inputs.size], uniform)
        y = runner(np.tile(np.arange(count), replicates), x).reshape(replicates, count)
        (response,) = choices.table.observations.responses
        return [Observations.exact(one, response.name, response.transform) for one in y]

    def identify(self, runner: Runner, data: Observations, seed: int) -> Replicate:
        """One data set identified."""
        answer = answered(self.choices.question(runner, data, seed), Ledger(runner, Silent()))
        return Replicate(
            answer.settled.alpha, answer.profile.intervals, _errors(answer.inference),
            answer.found.log_likelihood, answer.found.converged,
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
    """The study that this is. Raises InputsError for choices that do not go together."""
    if not isinstance(experiments, Experiments):
        experiments = _unmeasured(experiments, noise)
    return Job(Choices.of(experiments, inputs, noise, propagation, density, search))


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
