"""From arrays to the Identification: every number of the report is put in its place here."""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import metadata
from itertools import combinations
from typing import Any

import numpy as np
import scipy

from aleator.inference import diagnostics
from aleator.inference.check import Checked
from aleator.inference.fit import Fit
from aleator.inference.information import Inference
from aleator.inference.profile import Profile
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.laws.prior import has_prior
from aleator.likelihood.level_sets.predicted import Predictor as PointPredictor
from aleator.likelihood.problem import Problem
from aleator.observations.experiments import Experiments
from aleator.results.values import (
    QUANTILES,
    DensityDistance,
    Diagnostic,
    Estimate,
    ExperimentReport,
    FailureReport,
    LogLikelihoodReport,
    ParameterCorrelation,
)
from aleator.search import SearchResult
from aleator.search.value import LogLikelihood
from aleator.simulators import Simulator
from aleator.status import Status
from aleator.tasks.baselines import LeastSquares, LinearGaussian
from aleator.tasks.identification import Identification
from aleator.tasks.session import Session
from aleator.types import Array

LEAST = 5e-4
"""An error is told to be no less than this: half of the last digit that is shown."""
CUT = {(True, True): "both", (True, False): "lower", (False, True): "upper", (False, False): None}
"""Which ends of an interval are limits, by whether the lower one and the upper one is."""


def assemble(
    table: Experiments,
    problem: Problem,
    found: SearchResult,
    inference: Inference,
    profile: Profile,
    checked: Checked | None,
    baselines: tuple[LeastSquares, LinearGaussian],
    simulator: Simulator,
    *,
    doubted: diagnostics.Doubt,
    seconds: Mapping[str, float],
    runs_by_stage: Mapping[str, int],
    seed: int,
    failures: FailureReport | None = None,
    notes: Sequence[Diagnostic] = (),
) -> Identification:
    """The Identification of a finished search of a table's experiments."""
    ids = table.ids
    alpha, hyperparameters = found.alpha, problem.model.hyperparameters
    honest = problem.likelihood.evaluate(alpha)
    surface_error = diagnostics.surface_errors(problem, checked)
    changed = diagnostics.by_finer_cells(problem, alpha)
    exact = diagnostics.exact_density(problem, alpha)
    warnings, sound = diagnostics.review(
        problem,
        found,
        inference,
        profile,
        honest,
        checked,
        exact,
        surface_error,
        doubted,
        ids,
        table.conditions,
        changed,
    )
    return Identification(
        alpha=estimates_of(alpha, hyperparameters, inference, profile),
        log_likelihood=replace(
            _log_likelihood(
                honest, exact or honest, checked, diagnostics.cells_error(problem, changed), doubted
            ),
            log_prior=prior_of(honest, hyperparameters),
        ),
        density=problem.likelihood.name,
        propagation=problem.name,
        sound=sound,
        warnings=(*warnings, *diagnostics.failure_warnings(failures), *notes),
        experiments=experiment_reports(problem, alpha, honest, ids, surface_error),
        correlation_names=tuple(hyperparameters[k].name for k in inference.free),
        correlation=tuple(tuple(row) for row in inference.correlation.tolist()),
        search=search_of(found, inference, hyperparameters),
        surface=diagnostics.surface_report(problem),
        baselines=_baselines(*baselines, problem.model.inputs.names, hyperparameters),
        runs=sum(runs_by_stage.values()),
        runs_by_stage=runs_by_stage,
        failures=failures,
        seconds={**seconds, "total": sum(seconds.values())},
        seed=seed,
        versions=versions(),
        density_distances=_distances(problem, alpha, exact),
        outcome=table.outcome_name,
        transform=table.transform,
        session=Session.of_outcomes(
            problem.model, simulator, Fit.of_outcomes(problem, alpha, inference, table)
        ),
        parameter_correlations=parameter_correlations_of(
            problem.model.inputs, alpha, hyperparameters, inference
        ),
    )


def _log_likelihood(
    honest: LogLikelihood,
    exact: LogLikelihood,
    checked: Checked | None,
    cells: float,
    doubted: diagnostics.Doubt,
) -> LogLikelihoodReport:
    """With its error, of which `cells` is that of level sets.

    What was verified is the `exact` one on the surfaces and what the simulator changes of it.
    """
    found = honest.likelihood
    if checked is None:
        error = math.hypot(found - exact.likelihood, cells)
        return LogLikelihoodReport(found, None, None, error=error or None)
    verified, of_check = exact.likelihood + checked.total, max(checked.standard_error, LEAST)
    error = math.hypot(found - verified, of_check, doubted.error, cells)
    known = error if np.isfinite(error) else None
    return LogLikelihoodReport(found, verified, of_check, error=known)


def _distances(
    problem: Problem, alpha: Array, exact: LogLikelihood | None
) -> tuple[DensityDistance, ...]:
    """How far densities of moments are from the exact one, where one of them was chosen."""
    if exact is None or not np.isfinite(exact.total) or not np.all(exact.status == Status.SOLVED):
        return ()
    from aleator.moments.comparison import density_distances
    from aleator.moments.likelihood import Likelihood

    assert isinstance(problem.likelihood, Likelihood)
    points = PointPredictor(
        problem.model.inputs, problem.response, problem.condition, problem.predictor.lower,
        problem.predictor.upper,
    )  # fmt: skip
    return density_distances(problem.likelihood, alpha, exact.total, points.under(alpha))


def prior_of(at: LogLikelihood, hyperparameters: Sequence[Hyperparameter]) -> float | None:
    """The log prior of an answer; None where no hyperparameter has one."""
    return at.prior if has_prior(hyperparameters) else None


def experiment_reports(
    problem: Problem,
    alpha: Array,
    honest: LogLikelihood,
    ids: Sequence[str],
    surface_error: Array,
) -> tuple[ExperimentReport, ...]:
    """What the law alpha says of each experiment, beside its measured outcome.

    Log-densities are those of the `honest` log-likelihood: they sum to the total that is told.
    """
    under = problem.predictor.under(alpha)
    pit, quantiles = under.cdf(problem.outcomes), under.quantile(np.array(QUANTILES))
    status = diagnostics.statuses(honest.status, honest.each)
    return tuple(
        ExperimentReport(
            id=ids[l],
            outcome=float(problem.outcomes[l]),
            log_density=float(honest.each[l]),
            mean=float(under.mean[l]),
            standard_deviation=float(under.sd[l]),
            skewness=float(under.standardized[l, 3]),
            kurtosis=float(under.standardized[l, 4]),
            quantiles={str(p): float(q) for p, q in zip(QUANTILES, quantiles[l], strict=True)},
            pit=float(pit[l]),
            status=status[l],
            surface_error=float(surface_error[l]) if np.isfinite(surface_error[l]) else None,
        )
        for l in range(len(ids))
    )


def estimates_of(
    alpha: Array,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    profile: Profile,
) -> dict[str, Estimate]:
    """Every hyperparameter with its uncertainty, by name."""
    estimates = {}
    for k, h in enumerate(hyperparameters):
        known = bool(np.isfinite(inference.standard_error[k]))
        (low, high), (lower, upper) = profile.intervals[k], profile.drops[k]
        # without a maximum there is no drop from it to measure
        sure = bool(np.isfinite(low) and np.isfinite(high)) and inference.positive
        estimates[h.name] = Estimate(
            estimate=float(alpha[k]),
            standard_error=float(inference.standard_error[k]) if known else None,
            sandwich_error=float(inference.sandwich_error[k]) if known else None,
            interval=(float(low), float(high)) if sure else None,
            at_bound=inference.at_bound[k],
            fixed=not h.free,
            cut=CUT[low == h.lower, high == h.upper] if sure else None,
            drops=(float(lower), float(upper)) if sure else None,
        )
    return estimates


def parameter_correlations_of(
    inputs: Inputs, alpha: Array, hyperparameters: Sequence[Hyperparameter], inference: Inference
) -> tuple[ParameterCorrelation, ...]:
    """Every correlation of two parameters that is not zero by assumption."""
    matrix, slope = inputs.correlation_matrix(alpha), inputs.correlation_slope(alpha)
    uncertain = np.array([h.free for h in hyperparameters[: inputs.size]])
    # column f of the covariance is hyperparameter free[f]; the noise's is none of the inputs'
    estimated = inference.free < inputs.size
    free = inference.free[estimated]
    covariance = inference.covariance[np.ix_(estimated, estimated)]
    found = []
    for i, j in combinations(range(len(inputs.names)), 2):
        if matrix[i, j] == 0.0 and not np.any(slope[i, j]):
            continue
        needed = np.flatnonzero((slope[i, j] != 0.0) & uncertain)
        variance = slope[i, j, free] @ covariance @ slope[i, j, free]
        known = needed.size > 0 and np.all(np.isin(needed, free)) and variance > 0.0
        found.append(
            ParameterCorrelation(
                (inputs.names[i], inputs.names[j]),
                float(matrix[i, j]),
                float(np.sqrt(variance)) if known else None,
            )
        )
    return tuple(found)


def search_of(
    found: SearchResult, inference: Inference, hyperparameters: Sequence[Hyperparameter]
) -> dict[str, Any]:
    """What the search did, and the optima that it met."""
    return {
        "method": found.method,
        "starts": len(found.ascents),
        "evaluations": found.evaluations,
        "distinct_optima": len(found.optima),
        "optima": [
            {
                "log_likelihood": optimum.log_likelihood,
                "alpha": _named(optimum.alpha, hyperparameters),
                "starts": optimum.starts,
            }
            for optimum in found.optima
        ],
        "edm": inference.edm,
        "converged": found.converged,
    }


def _baselines(
    fit: LeastSquares,
    linear: LinearGaussian,
    names: Sequence[str],
    hyperparameters: Sequence[Hyperparameter],
) -> dict[str, Any]:
    return {
        "least_squares": {
            "parameters": dict(zip(names, fit.x.tolist(), strict=True)),
            "rmse": fit.rmse,
            "log_likelihood": fit.log_likelihood,
        },
        "circe": {
            "alpha": _named(linear.alpha, hyperparameters),
            "log_likelihood": linear.log_likelihood,
        },
    }


def _named(alpha: Array, hyperparameters: Sequence[Hyperparameter]) -> dict[str, float]:
    return {h.name: float(value) for h, value in zip(hyperparameters, alpha, strict=True)}


def versions() -> dict[str, str]:
    """What the numbers were computed with."""
    return {
        "aleator": metadata.version("aleator"),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
    }
