"""From arrays to the Identification, for experiments with several observations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from aleator.inference.calibration import sequential_pit
from aleator.inference.check import Checked
from aleator.inference.diagnostics.centering import centering_advice
from aleator.inference.diagnostics.check import check_refusals
from aleator.inference.diagnostics.estimates import once_warnings
from aleator.inference.diagnostics.failures import failure_report, failure_warnings
from aleator.inference.diagnostics.individual import (
    held_warnings,
    review_data,
    review_individual,
    rival_warnings,
    without_surfaces,
)
from aleator.inference.diagnostics.surfaces import judged, worse_than_estimated
from aleator.inference.fit import Fit
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import (
    IndividualLikelihood,
    IndividualParameters,
    OnSurfaces,
    individual_parameters,
)
from aleator.observations.experiments import Experiments
from aleator.results.values import Diagnostic, IndividualReport, LogLikelihoodReport
from aleator.status import Status
from aleator.tasks.identification import Identification
from aleator.tasks.individual.answer import Answer, Question
from aleator.tasks.individual.failed import failing_share
from aleator.tasks.individual.guess import HUGE
from aleator.tasks.individual.observed import observation_reports
from aleator.tasks.ledger import Ledger
from aleator.tasks.pictures import law_curves
from aleator.tasks.session import DIRECT, Session
from aleator.tasks.summary import (
    LEAST,
    estimates_of,
    parameter_correlations_of,
    prior_of,
    search_of,
    versions,
)
from aleator.types import Array, Flags, Indices


def assembled(
    question: Question,
    answer: Answer,
    check: Checked | None,
    ledger: Ledger,
    notes: Sequence[Diagnostic] = (),
) -> Identification:
    """The Identification of an answer, with its check on the simulator where it was made."""
    end, found, inference, profile = answer.settled, answer.found, answer.inference, answer.profile
    alpha, table, inputs = end.alpha, answer.question.table, end.likelihood.inputs
    hyperparameters = end.likelihood.hyperparameters
    at = end.likelihood.evaluate(alpha)
    with ledger.stage("individual parameters"):
        individual = individual_parameters(end.likelihood, alpha)
        pit = sequential_pit(end.likelihood, alpha, table.observations)
        failing = failing_share(end.likelihood, alpha)
    lost = without_surfaces(_lost(end.likelihood), table.observations.experiment, table.ids)
    differing = [] if check is None else _differing(end.likelihood, check, table)
    warnings, sound = review_individual(at, hyperparameters, inference, profile, end.gap, table.ids)
    failures = failure_report(question.runner) if answer.surfaces is not None else None
    names = inputs.names
    return Identification(
        alpha=estimates_of(alpha, hyperparameters, inference, profile),
        log_likelihood=replace(
            _log_likelihood(at.likelihood, end.gap, check), log_prior=prior_of(at, hyperparameters)
        ),
        density=end.likelihood.name,
        propagation=DIRECT if answer.surfaces is None else "response_surface",
        propagation_reason=answer.reason,
        sound=sound and not lost and not differing,
        warnings=(
            *lost,
            *differing,
            *warnings,
            *once_warnings(found),
            *_centering(answer),
            *held_warnings(_held(inputs, alpha), table.ids),
            *rival_warnings(answer.rivals, hyperparameters, profile.intervals),
            *review_data(question.table.observations, table.observations, failing, table.ids),
            *failure_warnings(failures),
            *notes,
        ),
        failures=failures,
        experiments=_individuals(answer.question, at.each, at.status, individual, names),
        correlation_names=tuple(hyperparameters[k].name for k in inference.free),
        correlation=tuple(tuple(row) for row in inference.correlation.tolist()),
        search=search_of(found, inference, hyperparameters),
        surface=None
        if answer.surfaces is None
        else judged(answer.surfaces.surface(), against="the noise"),
        baselines=_baselines(answer, names),
        runs=sum(ledger.runs.values()),
        runs_by_stage=ledger.runs,
        seconds={**ledger.seconds, "total": sum(ledger.seconds.values())},
        seed=question.seed,
        versions=versions(),
        outcome=", ".join(response.name for response in table.observations.responses),
        transform=table.transform,
        observations=observation_reports(
            table,
            end.likelihood,
            alpha,
            individual,
            tuple(question.runner.cases.columns),
            pit,
        ),
        shrinkage={
            name: float(value)
            for name, value in zip(names, individual.shrinkage, strict=True)
            if np.isfinite(value)
        },
        quadrature={"nodes": end.likelihood.nodes.xi.shape[1], "gap": end.gap},
        responses={r.name: str(r.transform) for r in table.observations.responses},
        law_curves=law_curves(inputs, alpha, len(table.ids)),
        session=Session.of_individuals(
            inputs,
            question.noise,
            question.table,
            question.runner,
            Fit.of_individuals(end.likelihood, alpha, inference, table, end.coarse.rule),
            answer.surfaces is None,
            question.surfaces,
        ),
        parameter_correlations=parameter_correlations_of(inputs, alpha, hyperparameters, inference),
    )


def _differing(
    likelihood: IndividualLikelihood, check: Checked, table: Experiments
) -> list[Diagnostic]:
    """Surfaces that the check contradicts."""
    predictor, of = likelihood.predictor, table.observations.experiment
    assert isinstance(predictor, OnSurfaces)
    estimated = predictor.surface.error[predictor.of]
    return [
        *check_refusals(check.total, check.standard_error),
        *worse_than_estimated(check, estimated, [table.ids[l] for l in of]),
    ]


def _centering(answer: Answer) -> list[Diagnostic]:
    """Advice to count conditions from their middle, by the slopes at the middle of the laws."""
    likelihood, table = answer.settled.likelihood, answer.question.table
    inputs, seen = likelihood.inputs, table.observations
    if len(inputs.classes) > 1:
        return []
    slopes = np.empty((len(seen), len(inputs.names)))
    for block in likelihood.blocks:
        middle = np.zeros((len(block), 1, inputs.scattering))
        found = likelihood.at(answer.settled.alpha, block, middle)
        slopes[block.rows] = found.slopes[:, :, 0].T
    conditions = table.conditions.iloc[seen.row]
    return centering_advice(
        slopes, inputs, likelihood.hyperparameters, answer.inference, conditions
    )


def _lost(likelihood: IndividualLikelihood) -> Flags:
    """Which observations (M,) have no surface: too few runs worked."""
    predictor = likelihood.predictor
    if not isinstance(predictor, OnSurfaces):
        return np.zeros(likelihood.layout.experiment.size, dtype=np.bool_)
    return np.asarray(np.isinf(predictor.surface.error[predictor.of]))


def _held(inputs: Inputs, alpha: Array) -> Mapping[str, Indices]:
    """The experiments whose covariates lead beyond the limits of a law's value, by its name."""
    model = inputs.covariate_model
    return {} if model is None else model.held(alpha)


def _log_likelihood(total: float, gap: float, check: Checked | None) -> LogLikelihoodReport:
    """Its error is that of the check and what more nodes change, which the check does not see."""
    if check is None:
        return LogLikelihoodReport(total, None, None)
    error = max(float(np.hypot(check.standard_error, gap)), LEAST)
    off = float(np.hypot(check.total, error))
    return LogLikelihoodReport(total, total + check.total, error, error=off)


def _individuals(
    question: Question,
    each: Array,
    status: NDArray[np.int64],
    found: IndividualParameters,
    names: tuple[str, ...],
) -> tuple[IndividualReport, ...]:
    ids, of = question.table.ids, question.table.observations.experiment
    observations = np.bincount(of, minlength=len(ids))
    return tuple(
        IndividualReport(
            id=ids[l],
            observations=int(observations[l]),
            log_density=float(each[l]),
            mode=dict(zip(names, found.mode[l].tolist(), strict=True)),
            mean=dict(zip(names, found.mean[l].tolist(), strict=True)),
            sd=dict(zip(names, found.sd[l].tolist(), strict=True)),
            status=Status(int(status[l])).name.lower(),
            components={name: tuple(p[l].tolist()) for name, p in found.components.items()} or None,
        )
        for l in range(len(ids))
    )


def _baselines(answer: Answer, names: tuple[str, ...]) -> dict[str, object]:
    fit = answer.fit
    if fit.rmse > 1e-3 * HUGE:
        # at every point that was tried some observation has no simulated value
        return {}
    return {
        "least_squares": {
            "parameters": dict(zip(names, fit.x.tolist(), strict=True)),
            "rmse": fit.rmse,
            "log_likelihood": fit.log_likelihood,
        }
    }
