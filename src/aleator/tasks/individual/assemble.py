"""From arrays to the Identification, for experiments with several observations."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from aleator.densities import Status
from aleator.inference.diagnostics.individual import review_individual
from aleator.likelihood.individual import IndividualParameters, individual_parameters
from aleator.tasks.individual.answer import Answer, Question
from aleator.tasks.results.identification import Identification
from aleator.tasks.results.summary import (
    estimates_of,
    parameter_correlations_of,
    search_of,
    versions,
)
from aleator.tasks.results.values import (
    IndividualReport,
    LogLikelihoodReport,
    ObservationReport,
)
from aleator.types import Array


def assembled(
    question: Question,
    answer: Answer,
    *,
    seconds: Mapping[str, float],
    runs_by_stage: Mapping[str, int],
) -> Identification:
    """The Identification of an answer."""
    end, found, inference, profile = answer.settled, answer.found, answer.inference, answer.profile
    alpha, table, inputs = end.alpha, question.table, end.likelihood.inputs
    hyperparameters = end.likelihood.hyperparameters
    at = end.likelihood.evaluate(alpha)
    individual = individual_parameters(end.likelihood, alpha)
    warnings, accepted = review_individual(
        at, alpha, hyperparameters, inference, profile, end.gap, table.ids
    )
    names = inputs.names
    return Identification(
        alpha=estimates_of(alpha, hyperparameters, inference, profile),
        log_likelihood=_log_likelihood(at.total, answer),
        density="individual_integral",
        propagation="direct" if answer.surfaces is None else "response_surface",
        accepted=accepted,
        warnings=warnings,
        experiments=_individuals(question, at.each, at.status, individual, names),
        correlation_names=tuple(hyperparameters[k].name for k in inference.free),
        correlation=tuple(tuple(row) for row in inference.correlation.tolist()),
        search=search_of(found, inference, hyperparameters),
        surface=None,
        baselines=_baselines(answer, names),
        runs=sum(runs_by_stage.values()),
        runs_by_stage=runs_by_stage,
        seconds={**seconds, "total": sum(seconds.values())},
        seed=question.seed,
        versions=versions(),
        outcome=", ".join(response.name for response in table.observations.responses),
        observations=_observations(question, individual),
        shrinkage={
            name: float(value)
            for name, value in zip(names, individual.shrinkage, strict=True)
            if np.isfinite(value)
        },
        parameter_correlations=parameter_correlations_of(inputs, alpha, hyperparameters, inference),
    )


def _log_likelihood(total: float, answer: Answer) -> LogLikelihoodReport:
    """Without surfaces the estimate is on the simulator itself, and errs by its nodes only."""
    if answer.surfaces is not None:
        return LogLikelihoodReport(total, None, None)
    gap = answer.settled.gap
    return LogLikelihoodReport(total, total + gap, abs(gap))


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
        )
        for l in range(len(ids))
    )


def _observations(question: Question, found: IndividualParameters) -> tuple[ObservationReport, ...]:
    table, seen = question.table, question.table.observations
    return tuple(
        ObservationReport(
            id=table.ids[seen.experiment[k]],
            row=int(seen.row[k]) + 1,
            response=seen.responses[seen.response[k]].name,
            lower=float(seen.lower[k]) if np.isfinite(seen.lower[k]) else None,
            upper=float(seen.upper[k]) if np.isfinite(seen.upper[k]) else None,
            predicted=float(found.predicted[k]),
        )
        for k in range(seen.experiment.size)
    )


def _baselines(answer: Answer, names: tuple[str, ...]) -> dict[str, object]:
    fit = answer.fit
    return {
        "least_squares": {
            "parameters": dict(zip(names, fit.x.tolist(), strict=True)),
            "rmse": fit.rmse,
            "log_likelihood": fit.log_likelihood,
        }
    }
