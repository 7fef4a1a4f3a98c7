"""Experiments with several observations and a simulator in, the identified law out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from aleator.errors import InputsError
from aleator.inference import diagnostics
from aleator.inference.check import Check, checked
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.observations.errors import MeasurementErrors, Noise
from aleator.observations.experiments import Conditions, Experiments, covariates
from aleator.observations.responses import Observations
from aleator.search import Search
from aleator.simulators import Runner
from aleator.surrogates import ResponseSurface
from aleator.tasks.asked import require_enough, surfaces_alone
from aleator.tasks.baselines import start_point
from aleator.tasks.budget import affordable
from aleator.tasks.identification import Identification
from aleator.tasks.individual.answer import Question, answered
from aleator.tasks.individual.assemble import assembled
from aleator.tasks.ledger import Ledger

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation

Noises = Noise | Mapping[str, Noise]
"""The noise of the only response, or of each by name."""


def wanted(table: Experiments | Conditions, inputs: Inputs, noise: Noises | None) -> bool:
    """Whether a study goes by the integral over individual parameters: the one choice of the way.

    Every study does but those of one exact outcome an experiment, without noise, under one law for
    all experiments that is no mixture: these have a density of the outcome.
    """
    exact = noise is None and table.simple
    return not exact or inputs.regressed or len(inputs.classes) > 1


def identified(
    runner: Runner,
    table: Experiments,
    inputs: Inputs,
    noise: Noises | None,
    surfaces: ResponseSurface | Collocation,
    density: Density | None,
    search: Search,
    choice: Check,
    seed: int,
    ledger: Ledger,
) -> Identification:
    """The law of the parameters from all observations of each experiment."""
    asked_for = asked(table, inputs, noise, surfaces, density, search)
    require_enough(table, asked_for.hyperparameters)
    question = asked_for.question(runner, table.observations, seed)
    with diagnostics.boxes_proposed(runner, inputs):
        with ledger.stage("repeated run"):
            runner.require_repeatable(np.clip(start_point(question.inputs), *inputs.box.T))
        answer = answered(question, ledger)
        check, notes = (
            None,
            diagnostics.budget_warnings(runner.account, answer.surfaces, "the noise"),
        )
        if choice.wanted and answer.surfaces is not None:
            runs = choice.runs(answer.surfaces)
            most = affordable(runner, runs)
            if most == 0:
                notes.append(diagnostics.UNCHECKED)
            else:
                with ledger.stage("verification"):
                    check = checked(
                        answer.settled.likelihood,
                        answer.settled.alpha,
                        runner,
                        most or runs,
                        choice,
                    )
    found = assembled(question, answer, check, ledger, notes)
    if found.sound:
        return found
    jumps = diagnostics.step_warnings(answer.surfaces, inputs)
    return replace(found, warnings=(*found.warnings, *jumps))


@dataclass(frozen=True, eq=False)
class Asked:
    """The choices of a study with its table: all of a question but its runs and its data."""

    table: Experiments
    inputs: Inputs
    noise: Noises
    surfaces: ResponseSurface
    search: Search

    @property
    def errors(self) -> MeasurementErrors:
        """The measurement errors of the table's observations."""
        return MeasurementErrors.of(self.noise, self.table)

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """Those of the laws, then those of the errors."""
        return (*self.inputs.hyperparameters, *self.errors.hyperparameters)

    def question(self, runner: Runner, seen: Observations, seed: int) -> Question:
        """What to answer where this was observed, at the places of the table; NaN is nothing."""
        kept = ~np.isnan(seen.lower)
        return Question(
            runner, self.table.with_observations(seen.only(kept)), self.inputs, self.noise,
            self.surfaces, self.search, seed, kept,
        )  # fmt: skip


def asked(
    table: Experiments,
    inputs: Inputs,
    noise: Noises | None,
    surfaces: ResponseSurface | Collocation,
    density: Density | None,
    search: Search,
) -> Asked:
    """The choices checked, and laws that follow covariates resolved by the table.

    Raises InputsError as `surfaces_alone`, and without noise.
    """
    surfaces = surfaces_alone(surfaces, density)
    if noise is None and table.simple and not inputs.regressed:
        raise InputsError(
            "the likelihood of a mixture is known with measurement noise only",
            "add noise: [noise] sd, or noise=Noise(...), which may be small",
        )
    if noise is None:
        raise InputsError(
            "several observations an experiment, censored ones and covariates need measurement "
            "noise: without it no parameters explain all observations exactly",
            "add noise: [noise] sd, or noise=Noise(...)",
        )
    if inputs.regressed:
        inputs = inputs.resolved(covariates(table, inputs.covariates))
    return Asked(table, inputs, noise, surfaces, search)
