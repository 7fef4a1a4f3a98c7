"""What an identification of individual parameters was made with, held so that more can be asked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from aleator.errors import InputsError, nearest
from aleator.inference.decisions.alpha_draws import AlphaDraws
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import GaussHermite, IndividualLikelihood, Layout, Predictor
from aleator.observations.errors import MeasurementErrors, Noise, noise_hyperparameters
from aleator.observations.experiments import Conditions, Experiments, covariates
from aleator.observations.responses import Response, Transform
from aleator.progress import Progress
from aleator.results.law import JointLaw
from aleator.results.values import Estimate, in_order
from aleator.simulators import Runner
from aleator.surrogates import ResponseSurface
from aleator.tasks.decide.forecast import Draws
from aleator.tasks.decide.ground import Ground, Measured
from aleator.tasks.decide.predictors import about, direct
from aleator.tasks.decide.table import tabled
from aleator.tasks.individual.fit import IndividualFit
from aleator.tasks.individual.observed import varying_conditions
from aleator.tasks.individual.planned import planned
from aleator.tasks.session import given_values, kept, missing
from aleator.types import Array

NODES = 7
"""Gauss-Hermite nodes a variate where a likelihood is made again to look at single experiments."""

DIRECT = "direct"
"""How an answer calls its propagation where the simulator itself was integrated over."""

OWN = "id"
"""`of` the ids of the new rows themselves."""

Runners = Callable[[Experiments | Conditions], Runner]
"""What makes the runs for a table."""


@dataclass(frozen=True, eq=False)
class IndividualSession:
    """Laws, noise and responses, the table, how runs are made, and the fit.

    Laws that follow covariates are resolved by the table. None for a table, a simulator or a
    fit that is not at hand. `on_simulator` tells whether the
    simulator itself is asked, or surfaces of it as in `surfaces`.
    """

    inputs: Inputs
    noise: Noise | Mapping[str, Noise] | None
    responses: tuple[Response, ...]
    table: Experiments | None
    runner: Runners | None
    fit: IndividualFit | None
    on_simulator: bool
    surfaces: ResponseSurface

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All of alpha."""
        names = tuple(response.name for response in self.responses)
        return (*self.inputs.hyperparameters, *noise_hyperparameters(self.noise, names))

    def law(
        self,
        values: Mapping[str, float | Estimate],
        at: Mapping[str, object] | pd.Series | None = None,
    ) -> JointLaw:
        """The joint law at these values, of experiments `at` some covariates."""
        alpha = in_order(values, self.hyperparameters)[: self.inputs.size]
        if not self.inputs.regressed:
            return JointLaw(self.inputs, alpha)
        if at is None:
            raise InputsError(
                f"the law follows {', '.join(self.inputs.covariates)}: experiments have laws of "
                "their own",
                f"say of which: found.law_at({{'{self.inputs.covariates[0]}': ...}})",
            )
        row = pd.DataFrame([dict(at)], index=["asked"])
        one, own = self.inputs.resolved(row).of_experiment(alpha, 0)
        return JointLaw(one, own)

    def log_likelihood(
        self, alpha: Mapping[str, float] | ArrayLike, values: Mapping[str, float | Estimate]
    ) -> float:
        """The log-likelihood at alpha with nodes adapted there; what is not named is as it was.

        At the estimate nodes are those of the answer, which importance points would not be again.
        """
        fit = kept(self.fit)
        at, here = given_values(alpha, values, self.hyperparameters), fit.likelihood
        own = here if np.array_equal(at, fit.alpha) else here.adapted(at)
        return own.evaluate(at).likelihood

    def predict(
        self,
        conditions: Conditions | pd.DataFrame,
        plausible: AlphaDraws,
        transform: Transform,
        quantiles: tuple[float, ...],
        progress: Progress | None,
        of: str | None = None,
        noise: bool = True,
    ) -> pd.DataFrame:
        """A row for each row of the conditions and response; see `Identification.predict`."""
        ground = self.ground(conditions, plausible.estimate, transform, of, noise)
        if progress is not None:
            progress.stage("prediction")
        return tabled(ground, plausible, quantiles, progress)

    def ground(
        self,
        conditions: Conditions | pd.DataFrame,
        alpha: Array,
        transform: Transform,  # noqa: ARG002  one interface for all sessions
        of: str | None = None,
        noise: bool = True,
    ) -> Ground:
        """New experiments, or measured ones, and what makes their outcomes."""
        if self.runner is None:
            raise missing(
                "a prediction needs the simulator",
                "aleator.load(path, simulator=..., inputs=..., noise=...)",
            )
        if isinstance(conditions, pd.DataFrame):
            conditions = Conditions.from_frame(conditions, responses=self.responses)
        inputs, known = self.inputs, None if of is None else self._known(conditions, alpha, of)
        if inputs.regressed and known is None:
            inputs = inputs.resolved(covariates(conditions, inputs.covariates))
        return Ground(
            conditions,
            inputs,
            MeasurementErrors.of(self.noise, conditions) if noise and self.noise else None,
            self.runner(conditions),
            self.on_simulator,
            self.surfaces,
            known,
            self.table,
        )

    def exact_fit(self) -> IndividualFit | None:
        """By the simulator itself in place of surfaces, where these are."""
        if self.on_simulator or self.fit is None or self.runner is None or self.table is None:
            return None
        return self.fit.on(self.runner(self.table))

    def runner_on(self, conditions: Conditions) -> Runner:
        """Runs of the simulator, made here and kept in no store."""
        if self.runner is None:
            raise missing("this needs the simulator", "aleator.load(path, simulator=..., ...)")
        return self.runner(conditions)

    def fit_on(
        self, candidates: Conditions, alpha: Array, runner: Runner, progress: Progress
    ) -> IndividualFit:
        """On the simulator itself, or on surfaces of the candidates' own."""
        fit = kept(self.fit)
        assert self.noise is not None
        runner.progress = progress
        return planned(fit, self.inputs, self.noise, candidates, alpha, runner, self._predictor)

    def _predictor(self, runner: Runner, x: Array) -> Predictor:
        box = self.inputs.box
        if not self.on_simulator:
            return about(runner, box, x, self.surfaces)
        return direct(runner, box, np.stack([x.min(axis=0), x.max(axis=0)], axis=1))

    def _known(self, conditions: Conditions, alpha: Array, of: str) -> Measured:
        """The measured experiments that the new ones are said to be."""
        if self.table is None:
            raise missing(
                f"of '{of}': that needs the experiments that were measured",
                "aleator.load(path, ..., experiments=...)",
            )
        likelihood, ids = self._adapted(self.table, alpha), self.table.ids
        which = [ids.index(name) for name in _measured(self.table, conditions, of)]
        return Measured(likelihood, np.array(which, dtype=np.intp))

    def _adapted(self, table: Experiments, alpha: Array) -> IndividualLikelihood:
        """The likelihood of the measured experiments, made again where it was not kept."""
        if self.fit is not None:
            return self.fit.likelihood
        assert self.runner is not None
        assert self.noise is not None
        runner, seen = self.runner(table), table.observations
        x = Draws.new(self.inputs, alpha, len(table.ids)).x
        likelihood = IndividualLikelihood.of(
            self.inputs,
            MeasurementErrors.of(self.noise, table),
            self._predictor(runner, x.reshape(-1, x.shape[2])),
            Layout(len(table.ids), seen.experiment, runner.unit, runner.column),
            GaussHermite(NODES),
        )
        return likelihood.adapted(alpha)


def _measured(table: Experiments, conditions: Conditions, of: str) -> list[str]:
    """The measured experiment that each new one is: a column's, or one for all."""
    if of == OWN:
        ids = [*conditions.ids]
    elif of in conditions.table.columns:
        ids = [_text(cell) for cell in covariates(conditions, [of])[of]]
    else:
        ids = [of] * len(conditions.ids)
    for name in ids:
        if name not in table.ids:
            raise InputsError(
                f"of '{of}': there is no experiment '{name}'{nearest(name, table.ids)}",
                "name an experiment that was measured, or a column of the conditions with such",
            )
    return ids


def session_of(
    propagation: str,
    inputs: Inputs,
    noise: Noise | Mapping[str, Noise],
    responses: tuple[Response, ...],
    table: Experiments | None,
    surfaces: ResponseSurface,
    runner: Runners | None,
) -> IndividualSession:
    """The session of an answer that was read from a file; `propagation` is the answer's."""
    if table is not None and inputs.regressed and inputs.covariate_model is None:
        inputs = inputs.resolved(covariates(table, inputs.covariates))
    on_simulator = propagation == DIRECT
    return IndividualSession(inputs, noise, responses, table, runner, None, on_simulator, surfaces)


def runners(runner: Runner, table: Experiments) -> Runners:
    """Runs of the simulator of a runner, which gets arrays of what varies in the table."""
    varying = varying_conditions(table, tuple(runner.cases.columns))

    def of(asked: Experiments | Conditions) -> Runner:
        if asked is table:
            return runner
        return Runner(runner.simulator, asked, runner.parameters, varying=varying)

    return of


def _text(cell: object) -> str:
    """An id as a table of texts has it."""
    return str(int(cell)) if isinstance(cell, float) and cell.is_integer() else str(cell)
