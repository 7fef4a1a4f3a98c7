"""The conversion of an `Answer` to a `Result`: plain data with every number of the report."""

from __future__ import annotations

import math
import platform
from collections.abc import Sequence
from dataclasses import replace
from importlib import metadata
from itertools import combinations
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from aleator.core.status import Status
from aleator.core.types import Array
from aleator.fit.flow import Answer
from aleator.fit.ledger import Ledger
from aleator.fit.question import varying_conditions
from aleator.fit.search import GUESSES, LeastSquares, by_tangent, least_squares
from aleator.fit.soundness import Reviewed
from aleator.fit.uncertainty import Inferred
from aleator.inference import diagnostics, surface_diagnostics
from aleator.inference.alpha_draws import Estimated, estimated
from aleator.inference.calibration import sequential_pit
from aleator.inference.check import Check, Checked
from aleator.inference.factors import factor_effects
from aleator.inference.information import Inference
from aleator.inference.law_ranges import law_ranges
from aleator.inference.likelihood_at import IndividualsAt, OutcomesAt
from aleator.inference.likelihood_draws import plausible_draws, plausible_laws
from aleator.inference.profile import Profile
from aleator.inference.surface_diagnostics import surface_report
from aleator.laws import Hyperparameter
from aleator.laws.hyperparameter import has_prior, log_prior
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import (
    IndividualLikelihood,
    IndividualParameters,
    individual_parameters,
)
from aleator.likelihood.level_sets.predicted import PointPredictor as PointPredictor
from aleator.likelihood.problem import Problem
from aleator.observations.experiments import Experiments, covariates
from aleator.results.result import Result
from aleator.results.values import (
    REPORTED,
    DensityDistance,
    Estimate,
    ExperimentReport,
    IndividualReport,
    LogLikelihoodReport,
    ObservationReport,
    ParameterCorrelation,
    PlausibleLaws,
)
from aleator.search import SearchResult
from aleator.search.interface import Hill, LogLikelihood

DIRECT = "direct"
"""The name of the propagation method in a result where the simulator itself was integrated over."""
LEAST = 5e-4
"""The smallest error that is reported: half of the last digit that is shown."""
CUT = {(True, True): "both", (True, False): "lower", (False, True): "upper", (False, False): None}
"""The word for the interval ends that are limits, by (lower end is a limit, upper end is one)."""


def result_of(answer: Answer, table: Experiments, check: Check, ledger: Ledger) -> Result:
    """The result of an identification from the experiments of a table, as plain data."""
    certain = answer.inferred
    end, inference, profile = certain.maximum, certain.inference, certain.profile
    likelihood, alpha, question = end.likelihood, end.alpha, certain.refined.question
    hyperparameters, surfaces = likelihood.hyperparameters, certain.refined.surfaces
    emulation = certain.refined.emulation
    with ledger.stage("baselines"):
        fit = least_squares(likelihood, question.measured)
        baselines = _baselines(fit, likelihood.inputs)
        # The linearized simulator has a density for exact outcomes only.
        if isinstance(likelihood, Problem) and likelihood.bounds is None:
            linear = by_tangent(likelihood, question.choices.search, question.seed)
            alpha_of_tangent = _named(linear.alpha, hyperparameters)
            baselines["circe"] = {
                "alpha": alpha_of_tangent, "log_likelihood": linear.log_likelihood
            }  # fmt: skip
    reviewed = Reviewed(answer, table)
    notes = []
    if answer.checked is None and surfaces is not None and check.active:
        notes.append(surface_diagnostics.UNCHECKED)
    if isinstance(likelihood, Problem):
        own = _of_outcomes(likelihood, reviewed)
    else:
        with ledger.stage("individual parameters"):
            own = _of_individuals(likelihood, reviewed)
    log_likelihood: LogLikelihoodReport = own.pop("log_likelihood")
    failing = surfaces or emulation or isinstance(likelihood, Problem)
    estimates = estimates_of(alpha, hyperparameters, inference, profile)
    names = tuple(hyperparameters[k].name for k in inference.free)
    correlation = tuple(tuple(row) for row in inference.correlation.tolist())
    known = estimated(estimates, names, correlation, hyperparameters)
    with ledger.stage("plausible laws"):
        plausible = _plausible(certain, known)
    drawn = plausible_draws(known, plausible)
    if not inference.positive:  # Where estimates have no intervals, nothing made of them has one.
        drawn = replace(drawn, fixed=np.flatnonzero([h.free for h in hyperparameters]))
    if not reviewed.emulator_refusal:
        notes += diagnostics.plausible_warnings(plausible)
    return Result(
        alpha=estimates,
        ranges=law_ranges(
            likelihood.inputs,
            hyperparameters,
            drawn,
            len(table.ids),
            covariates(table, likelihood.inputs.covariates),
            inference,
        ),
        log_likelihood=replace(
            log_likelihood,
            log_prior=log_prior(hyperparameters, alpha) if has_prior(hyperparameters) else None,
            restricted=reviewed.at.total if question.choices.restricted else None,
        ),
        propagation_reason=certain.refined.reason,
        array_fault="" if certain.refined.direct else question.runner.array_fault,
        levels=dict(question.inputs.levels),
        sound=reviewed.sound,
        undetermined=reviewed.undetermined,
        plausible=plausible,
        warnings=(*reviewed.warnings, *notes),
        failures=diagnostics.failure_report(question.runner) if failing else None,
        correlation_names=names,
        correlation=correlation,
        search=search_of(certain.search_result, reviewed.hills, inference, hyperparameters),
        baselines=baselines,
        runs=sum(ledger.runs.values()),
        runs_by_stage=ledger.runs,
        seconds={**ledger.seconds, "total": sum(ledger.seconds.values())},
        seed=question.seed,
        versions=versions(),
        transform=table.transform,
        parameter_correlations=parameter_correlations_of(
            likelihood.inputs, alpha, hyperparameters, inference
        ),
        factors=factor_effects(
            likelihood.inputs,
            alpha,
            inference,
            np.array([each.interval or (np.nan, np.nan) for each in estimates.values()]),
            covariates(table, likelihood.inputs.covariates),
        ),
        **own,
    )


def _plausible(certain: Inferred, known: Estimated) -> PlausibleLaws:
    """The laws that the experiments leave plausible, by the coarsest nodes that are accurate."""
    end, likelihood = certain.maximum, certain.maximum.likelihood
    if isinstance(likelihood, Problem):
        objective = OutcomesAt(likelihood, end.alpha).objective()
    else:
        assert end.coarse is not None
        objective = IndividualsAt(likelihood, end.alpha, end.coarse.rule).rough().objective()
    ends = certain.profile.points.reshape(-1, end.alpha.size)
    near = [*ends[np.all(np.isfinite(ends), axis=1)]]
    near += [rival.alpha for rival in certain.rivals if rival.as_high]
    return plausible_laws(known, objective, near)


def _of_outcomes(problem: Problem, reviewed: Reviewed) -> dict[str, Any]:
    """The fields of a result that are computed differently without measurement noise."""
    answer, table, at = reviewed.answer, reviewed.table, reviewed.at
    alpha, surface_error = answer.inferred.maximum.alpha, reviewed.surface_error
    where = "under the law" if problem.model.follows else "on the box"
    return {
        "log_likelihood": _verified(
            at, reviewed.exact or at, answer.checked,
            surface_diagnostics.cells_error(problem, reviewed.by_cells), answer.doubt,
            reviewed.emulated.log_likelihood,
        ),
        "density": problem.likelihood.name,
        "propagation": problem.name,
        **(
            {"experiments": experiment_reports(problem, alpha, at, table.ids, surface_error)}
            if table.simple
            else _of_several(problem, reviewed)
        ),
        "surface": emulator_report(answer.inferred)
        or surface_report(problem.surface, where),
        "density_distances": _distances(problem, alpha, reviewed.exact),
        "outcome": table.outcome_name,
    }  # fmt: skip


def _of_several(problem: Problem, reviewed: Reviewed) -> dict[str, Any]:
    """The fields of a result that several exact outcomes of an experiment have.

    The parameters of each experiment lie on its level set.
    """
    answer, table, at = reviewed.answer, reviewed.table, reviewed.at
    alpha, inputs = answer.inferred.maximum.alpha, problem.inputs
    under, fit = problem.predictor.under(alpha), OutcomesAt(problem, alpha)
    found, pit = fit.on_level_sets(), fit.probabilities(table.observations, None)
    columns = tuple(answer.inferred.refined.question.runner.cases.columns)
    shrinkage = zip(inputs.names, found.shrinkage.tolist(), strict=True)
    return {
        "shrinkage": {name: value for name, value in shrinkage if np.isfinite(value)},
        "experiments": _individuals(table, at.each, at.status, found, inputs.names),
        "observations": observation_reports(
            table, under.mean, under.sd, (under.mean, under.sd), columns, pit
        ),
        "responses": {r.name: str(r.transform) for r in table.observations.responses},
        "law_curves": law_curves(inputs, alpha, len(table.ids)),
    }


def _of_individuals(likelihood: IndividualLikelihood, reviewed: Reviewed) -> dict[str, Any]:
    """The fields of a result that are computed differently with measurement noise."""
    certain, checked = reviewed.answer.inferred, reviewed.answer.checked
    alpha, gap, surfaces = certain.maximum.alpha, certain.maximum.gap, certain.refined.surfaces
    emulation = certain.refined.emulation
    question, inputs, at = certain.refined.question, likelihood.inputs, reviewed.at
    table, names = question.table, likelihood.inputs.names
    found = individual_parameters(likelihood, alpha)
    pit = sequential_pit(likelihood, alpha, table.observations)
    columns = tuple(question.runner.cases.columns)
    each, status = at.each, at.status
    if inputs.grouping is not None:
        each, status = likelihood.conditional(alpha), status[inputs.grouping.cluster]
    shrinkage = zip(names, found.shrinkage, strict=True)
    every, of_errors = slice(0, len(table.observations)), alpha[inputs.size :]
    scale = likelihood.errors.scale(of_errors, found.predicted[:, None], every)
    scale = np.broadcast_to(scale, (len(table.observations), 1))[:, 0]
    conditional = likelihood.errors.conditional(of_errors, found.predicted[:, None], every)
    given = (conditional[0][:, 0], conditional[1][:, 0])
    return {
        "log_likelihood": _with_nodes(
            at.likelihood, gap, checked, reviewed.emulated.log_likelihood
        ),
        "density": likelihood.name,
        "propagation": "response_surface" if surfaces or emulation else DIRECT,
        "experiments": _individuals(table, each, status, found, names),
        "surface": emulator_report(certain)
        or surface_report(
            None if surfaces is None else surfaces.surface(), "under the law", "the noise"
        ),
        "outcome": ", ".join(response.name for response in table.observations.responses),
        "observations": observation_reports(table, found.predicted, scale, given, columns, pit),
        "shrinkage": {name: float(value) for name, value in shrinkage if np.isfinite(value)},
        "quadrature": {"nodes": likelihood.nodes.xi.shape[1], "gap": gap},
        "responses": {r.name: str(r.transform) for r in table.observations.responses},
        "law_curves": law_curves(inputs, alpha, len(table.ids)),
    }


def _verified(
    honest: LogLikelihood,
    exact: LogLikelihood,
    checked: Checked | None,
    cells: float,
    doubted: surface_diagnostics.Doubt,
    emulated: float,
) -> LogLikelihoodReport:
    """The log-likelihood without noise, its value verified by the check, and its error.

    `honest` is the reported log-likelihood, `exact` the one by level sets. The verified value is
    the exact one plus the change from the surfaces to the simulator. `cells` is the error of the
    level sets, `doubted` that of the surfaces, and `emulated` that of Gaussian processes.
    """
    found = honest.likelihood
    if checked is None:
        error = math.hypot(found - exact.likelihood, cells, emulated)
        return LogLikelihoodReport(found, None, None, error=error or None)
    verified, of_check = exact.likelihood + checked.total, max(checked.standard_error, LEAST)
    error = math.hypot(found - verified, of_check, doubted.error, cells)
    known = error if np.isfinite(error) else None
    return LogLikelihoodReport(found, verified, of_check, error=known)


def _with_nodes(
    total: float, gap: float, check: Checked | None, emulated: float
) -> LogLikelihoodReport:
    """The log-likelihood with noise and its error, from the check and from the quadrature.

    `gap` is the change of the log-likelihood by more quadrature nodes, and `emulated` its error by
    Gaussian processes in place of the simulator.
    """
    if check is None:
        error = math.hypot(gap, emulated) if emulated else None
        return LogLikelihoodReport(total, None, None, error=error)
    error = max(float(np.hypot(check.standard_error, gap)), LEAST)
    off = float(np.hypot(check.total, error))
    return LogLikelihoodReport(total, total + check.total, error, error=off)


def _distances(
    problem: Problem, alpha: Array, exact: LogLikelihood | None
) -> tuple[DensityDistance, ...]:
    """The distances of densities by moments from exact ones, if the user chose moments."""
    if exact is None or not np.isfinite(exact.total) or not np.all(exact.status == Status.SOLVED):
        return ()
    from aleator.moments.likelihood import Likelihood, density_distances

    assert isinstance(problem.likelihood, Likelihood)
    points = PointPredictor(
        problem.model.inputs, problem.response, problem.condition, problem.predictor.lower,
        problem.predictor.upper,
    )  # fmt: skip
    return density_distances(problem.likelihood, alpha, exact.total, points.under(alpha))


def emulator_report(certain: Inferred) -> dict[str, Any] | None:
    """What Gaussian processes in place of the simulator leave unknown; None without them."""
    emulation = certain.refined.emulation
    if emulation is None:
        return None
    error = emulation.error
    return {
        "experiments": len(emulation.processes.case),
        "runs": len(emulation.processes.x),
        "where": "under the law",
        "estimates_error": error.alpha,
        "log_likelihood_error": error.log_likelihood,
        "intervals_error": emulation.of_intervals(certain.maximum, certain.profile.points),
        "surprise": error.surprise,
        "stored": emulation.earlier,
        "slopes": emulation.processes.sloped_runs,
        "together": emulation.together,
        "rounds": [
            {
                "runs": one.runs,
                "estimates_error": one.alpha,
                "log_likelihood_error": one.log_likelihood,
            }
            for one in emulation.told
        ],
    }


def experiment_reports(
    problem: Problem,
    alpha: Array,
    honest: LogLikelihood,
    ids: Sequence[str],
    surface_error: Array,
) -> tuple[ExperimentReport, ...]:
    """The distribution of each outcome under the law alpha (K,), beside the measured value.

    The log-densities are those of the `honest` (reported) log-likelihood, and sum to its total.
    """
    under = problem.predictor.under(alpha)
    pit, quantiles = under.cdf(problem.outcomes), under.quantile(np.array(REPORTED.quantiles))
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
            quantiles={
                str(p): float(q) for p, q in zip(REPORTED.quantiles, quantiles[l], strict=True)
            },
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
        before = None if profile.unadjusted is None else profile.unadjusted[k]
        # A profile interval is measured from a maximum; without one it is not reported.
        sure = bool(np.isfinite(low) and np.isfinite(high)) and inference.positive
        estimates[h.name] = Estimate(
            estimate=float(alpha[k]),
            standard_error=float(inference.standard_error[k]) if known else None,
            sandwich_error=float(inference.sandwich_error[k]) if known else None,
            interval=(
                (float(low), float(high)) if sure else (h.lower, h.upper) if h.bounded else None
            ),
            at_bound=inference.at_bound[k],
            fixed=not h.free,
            cut=CUT[low == h.lower, high == h.upper] if sure else None,
            drops=(float(lower), float(upper)) if sure else None,
            unadjusted=None if before is None or not sure else (float(before[0]), float(before[1])),
        )
    return estimates


def parameter_correlations_of(
    inputs: Inputs, alpha: Array, hyperparameters: Sequence[Hyperparameter], inference: Inference
) -> tuple[ParameterCorrelation, ...]:
    """The correlations of two parameters, except those assumed zero, with standard errors."""
    matrix, slope = inputs.correlation_matrix(alpha), inputs.correlation_slope(alpha)
    uncertain = np.array([h.free for h in hyperparameters[: inputs.size]])
    # Column f of the covariance belongs to hyperparameter free[f]; those of the noise are left out.
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
    found: SearchResult,
    hills: Sequence[Hill],
    inference: Inference,
    hyperparameters: Sequence[Hyperparameter],
) -> dict[str, Any]:
    """The report of the search: its method, number of starts and evaluations, and optima.

    `stopped` are ends of ascents that had used up their evaluations before an optimum.
    """
    ends: dict[bool, list[dict[str, Any]]] = {True: [], False: []}
    for hill in hills:
        ends[hill.arrived].append(
            {
                "log_likelihood": hill.log_likelihood,
                "alpha": _named(hill.alpha, hyperparameters),
                "starts": hill.starts,
            }
        )
    return {
        "method": found.method,
        "starts": len(found.ascents),
        "evaluations": found.evaluations,
        "distinct_optima": len(ends[True]),
        "optima": ends[True],
        "stopped": ends[False],
        "edm": inference.edm,
        "converged": found.converged,
    }


def _individuals(
    table: Experiments,
    each: Array,
    status: NDArray[np.int64],
    found: IndividualParameters,
    names: tuple[str, ...],
) -> tuple[IndividualReport, ...]:
    ids, of = table.ids, table.observations.experiment
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


def _baselines(fit: LeastSquares, inputs: Inputs) -> dict[str, Any]:
    if fit.rmse > 1e-3 * GUESSES.huge:
        # At every point tried, at least one observation has no simulated value.
        return {}
    return {
        "least_squares": {
            "parameters": dict(zip(inputs.names, fit.x.tolist(), strict=True)),
            "rmse": fit.rmse,
            "log_likelihood": fit.log_likelihood,
        }
    }


def observation_reports(
    table: Experiments,
    predicted: Array,
    scale: Array,
    given: tuple[Array, Array],
    requested: Sequence[str],
    pit: Array,
) -> tuple[ObservationReport, ...]:
    """A report for each of M observations, with the conditions that vary within experiments.

    `predicted` (M,) are the predicted values and `scale` (M,) the scales of their errors; without
    noise they are the means and the standard deviations under the law. `given` are both given the
    earlier values of the experiment, with which errors may be correlated: residuals are relative to
    these. `pit` (M,) are the predicted
    probabilities of smaller values (see `sequential_pit`).
    """
    seen, (location, spread) = table.observations, given
    nearest = np.clip(location, seen.lower, seen.upper)
    with np.errstate(invalid="ignore"):
        # An infinite prediction satisfies every censoring bound below it.
        residual = np.where(nearest == location, 0.0, (nearest - location) / spread)
    names = varying_conditions(table, requested)
    columns = {name: table.conditions[name].to_numpy()[seen.row].tolist() for name in names}
    return tuple(
        ObservationReport(
            id=table.ids[seen.experiment[k]],
            row=int(seen.row[k]) + 1,
            response=seen.responses[seen.response[k]].name,
            lower=_finite(seen.lower[k]),
            upper=_finite(seen.upper[k]),
            predicted=float(predicted[k]),
            scale=float(scale[k]),
            residual=float(residual[k]),
            conditions={name: column[k] for name, column in columns.items()},
            pit=_finite(pit[k]),
        )
        for k in range(len(seen))
    )


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def law_curves(
    inputs: Inputs, alpha: Array, experiments: int, far: float = 3.3, points: int = 121
) -> dict[str, dict[str, list[float]]]:
    """The density curve of each scattering parameter's law, averaged over the experiments.

    p(x) = phi(theta)/(dx/dtheta) at x = T(theta), for standard normal variates theta from -`far` to
    `far`, which leaves out a thousandth of the law.
    """
    theta = np.linspace(-far, far, points)
    phi = np.exp(-0.5 * theta**2) / np.sqrt(2.0 * np.pi)
    values = inputs.values(alpha[: inputs.size], slice(0, experiments))
    found = {}
    for i in inputs.scattered:
        law, own = list(inputs.laws.values())[i], values[i]
        at = theta if own.ndim == 1 else np.broadcast_to(theta, (experiments, points))
        image = law.standard(own, at)
        with np.errstate(divide="ignore"):
            x, density = _mean_curve(np.atleast_2d(image.x), np.atleast_2d(phi / image.dtheta))
        if np.all(np.isfinite(density)):
            found[inputs.names[i]] = {"x": x.tolist(), "density": density.tolist()}
    return found


def _mean_curve(x: Array, density: Array) -> tuple[Array, Array]:
    if len(x) == 1:
        return x[0], density[0]
    at = np.linspace(x.min(), x.max(), 2 * x.shape[1])
    return at, np.mean(
        [np.interp(at, *pair, 0.0, 0.0) for pair in zip(x, density, strict=True)], axis=0
    )


def _named(alpha: Array, hyperparameters: Sequence[Hyperparameter]) -> dict[str, float]:
    return {h.name: float(value) for h, value in zip(hyperparameters, alpha, strict=True)}


def versions() -> dict[str, str]:
    """The versions of Python and of the packages with which the numbers were computed."""
    return {
        "aleator": metadata.version("aleator"),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
    }
