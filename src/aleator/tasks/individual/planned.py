"""The fit of experiments that were not made: what they would tell is asked of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import IndividualLikelihood, Layout, Predictor
from aleator.likelihood.individual.gauss_hermite import GaussHermite
from aleator.observations.errors import MeasurementErrors, Noise
from aleator.observations.experiments import Conditions, covariates, unmeasured
from aleator.observations.responses import with_limits_of_test
from aleator.simulators import Runner
from aleator.tasks.individual.fit import IndividualFit
from aleator.tasks.individual.population import draws
from aleator.tasks.likely import likely_alphas
from aleator.types import Array


def planned(
    fit: IndividualFit,
    inputs: Inputs,
    noise: Noise | Mapping[str, Noise],
    candidates: Conditions,
    alpha: Array,
    runner: Runner,
    predictor: Callable[[Runner, Array], Predictor],
) -> IndividualFit:
    """That of candidates at alpha, with the limits of the measured experiments.

    `predictor` makes what answers for the simulator, exact where points (D, n) of the laws lie.
    """
    if inputs.regressed:
        inputs = inputs.resolved(covariates(candidates, inputs.covariates))
    count, asked = len(candidates.ids), candidates.observations
    table = unmeasured(candidates)
    table = table.with_observations(with_limits_of_test(asked, fit.table.observations))
    likely = likely_alphas(fit.alpha, fit.inference, fit.hyperparameters)
    likelihood = IndividualLikelihood.of(
        inputs,
        MeasurementErrors.of(noise, table),
        predictor(runner, draws(inputs, [alpha, *likely], count)),
        Layout(count, asked.experiment, runner.unit, runner.column),
        GaussHermite(1),
    )
    # as many nodes as the answer needed
    likelihood = replace(likelihood, rule=fit.likelihood.rule)
    return IndividualFit(likelihood, alpha, fit.inference, table, fit.few)
