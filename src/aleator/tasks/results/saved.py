"""Reading an identification from its document."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from aleator.densities import Density, NodeDensity, Status
from aleator.errors import AleatorError, InputsError
from aleator.inference.diagnostics.diagnostic import Diagnostic
from aleator.inference.diagnostics.failures import FailureReport
from aleator.laws.inputs import Inputs
from aleator.likelihood.comparison import DensityDistance
from aleator.likelihood.model import Model
from aleator.likelihood.propagation import Collocation
from aleator.observations.experiments import Experiments
from aleator.observations.noise import Noise
from aleator.observations.responses import Response
from aleator.observations.transform import Transform
from aleator.simulators import Runner, Simulator, as_simulator
from aleator.surrogates import ResponseSurface
from aleator.tasks.asked import DEFAULT_PROPAGATION
from aleator.tasks.individual.session import IndividualSession, Runners, runners, session_of
from aleator.tasks.results.identification import Identification
from aleator.tasks.results.schema import read_answer
from aleator.tasks.results.second import consistency_in
from aleator.tasks.results.session import OutcomeSession, Session
from aleator.tasks.results.values import (
    Estimate,
    ExperimentReport,
    IndividualReport,
    LogLikelihoodReport,
    ObservationReport,
    ParameterCorrelation,
    in_order,
)

Entry = Mapping[str, Any]

OUTSIDE = Status.OUTSIDE_SUPPORT.name.lower()


def load(
    path: str | Path,
    *,
    simulator: Callable[..., Any] | Simulator | None = None,
    inputs: Inputs | None = None,
    vectorized: bool = False,
    noise: Noise | Mapping[str, Noise] | None = None,
    experiments: Experiments | None = None,
    propagation: ResponseSurface | Collocation = DEFAULT_PROPAGATION,
    density: Density | NodeDensity | None = None,
) -> Identification:
    """Read an identification that `found.save` or the command `aleator identify` wrote.

    All values come back as they were. What is no value is given again, as `identify` takes it:
    `inputs` and `noise` for `found.law`, `simulator` as well for `found.predict`; the `experiments`
    too for predictions of one that was measured, and where a law follows covariates. Raises
    AleatorError that names the file and the key where it is no identification, InputsError where
    the inputs and the noise have other hyperparameters than those that were identified.

    >>> from tempfile import TemporaryDirectory
    >>> import pandas as pd
    >>> from aleator import Free, MonteCarlo, Normal, identify
    >>> table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.1, 1.8, 3.6, 3.7]})
    >>> law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))})
    >>> found = identify(lambda load, x: load * x, table, law, outcome="y",
    ...                  verification=MonteCarlo(0))
    >>> with TemporaryDirectory() as folder:
    ...     found.save(f"{folder}/found.json")
    ...     again = load(f"{folder}/found.json", inputs=law)
    >>> again == found, again.law.marginals["x"].mean
    (True, 1.031)
    """
    found = from_document(read_answer(path))
    if inputs is None:
        return found
    made = None if simulator is None else as_simulator(simulator, vectorized)
    session: Session
    if found.observations:
        session = _individual_session(found, path, made, inputs, noise, experiments, propagation)
    else:
        if noise is not None:
            raise InputsError(
                f"{path} was identified from exact outcomes, without noise", "leave the noise out"
            )
        session = OutcomeSession(Model.of(inputs, propagation, density), made, None, experiments)
    try:
        in_order(found.alpha, session.hyperparameters)
    except InputsError as error:
        raise InputsError(
            f"{path} was identified with other inputs or another noise: {error.problem}",
            "give those of the identification",
        ) from None
    return replace(found, session=session)


def _individual_session(
    found: Identification,
    path: str | Path,
    simulator: Simulator | None,
    inputs: Inputs,
    noise: Noise | Mapping[str, Noise] | None,
    experiments: Experiments | None,
    propagation: ResponseSurface | Collocation,
) -> IndividualSession:
    regressed = inputs.regressed and inputs.covariate_model is None
    if noise is None or (experiments is None and regressed):
        lacking = "noise" if noise is None else "experiments, whose covariates make the law,"
        raise AleatorError(
            f"what can be asked of {path} needs the {lacking} too",
            f"aleator.load(path, ..., {'noise' if noise is None else 'experiments'}=...)",
        )
    surfaces = propagation if isinstance(propagation, ResponseSurface) else ResponseSurface()
    seen = tuple(Response(name, Transform(each)) for name, each in found.responses.items())
    return session_of(
        found.propagation, inputs, noise, seen, experiments, surfaces,
        _runners(found, simulator, inputs, experiments),
    )  # fmt: skip


def _runners(
    found: Identification,
    simulator: Simulator | None,
    inputs: Inputs,
    experiments: Experiments | None,
) -> Runners | None:
    """What makes runs with the simulator, which gets arrays of what varied within experiments."""
    if simulator is None:
        return None
    if experiments is not None:
        return runners(Runner(simulator, experiments, inputs.names), experiments)
    varying = {name for entry in found.observations for name in entry.conditions}
    return lambda asked: Runner(simulator, asked, inputs.names, varying=varying)


def from_document(document: Entry) -> Identification:
    """The identification of a document that was read; what JSON cannot hold (null) is NaN again.

    A log-density that is null because the outcome lies outside the support is minus infinity.
    """
    experiments: Any = tuple(map(_any_experiment, document["experiments"]))
    correlation = document["correlation"]
    plain = ("density", "propagation", "sound", "search", "baselines", "runs", "runs_by_stage",
             "seconds", "seed")  # fmt: skip
    later = ("outcome", "units", "propagation_reason", "versions", "shrinkage", "responses",
             "law_curves", "pictures", "quadrature")  # fmt: skip
    return Identification(
        **{key: document[key] for key in plain},
        **{key: document[key] for key in later if key in document},
        surface=document.get("surface"),
        transform=Transform(document.get("transform", "none")),
        alpha={name: _estimate(row) for name, row in document["alpha"].items()},
        log_likelihood=_log_likelihood(document["log_likelihood"], experiments),
        consistency=consistency_in(document),
        warnings=tuple(map(_diagnostic, document["warnings"])),
        experiments=experiments,
        correlation_names=tuple(correlation["names"]),
        correlation=tuple(map(tuple, correlation["matrix"])),
        failures=_failures(document.get("failures")),
        parameter_correlations=tuple(
            ParameterCorrelation(**{**row, "between": tuple(row["between"])})
            for row in document.get("parameter_correlations", ())
        ),
        observations=tuple(map(_observation, document.get("observations", ()))),
        best_possible=_best_possible(document.get("best_possible")),
        density_distances=tuple(
            DensityDistance(**_numbers(row)) for row in document.get("density_distances", ())
        ),
    )


def _best_possible(row: Entry | None) -> dict[str, float] | None:
    names = ("log_likelihood", "gap", "p_value", "replicates")
    return None if row is None else {name: _number(row[name]) for name in names}


def _estimate(row: Entry) -> Estimate:
    pairs = {k: None if row.get(k) is None else tuple(row[k]) for k in ("interval", "drops")}
    return Estimate(**{**row, "estimate": float(row["estimate"]), **pairs})


def _numbers(row: Entry) -> dict[str, Any]:
    """An entry whose nulls are numbers that JSON cannot hold."""
    return {key: math.nan if value is None else value for key, value in row.items()}


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def _any_experiment(row: Entry) -> ExperimentReport | IndividualReport:
    return _individual(row) if "observations" in row else _experiment(row)


def _individual(row: Entry) -> IndividualReport:
    parts: dict[str, Any] = {key: _numbers(row[key]) for key in ("mode", "mean", "sd")}
    classes = row.get("components") or {}
    parts["components"] = {
        name: tuple(map(_number, each)) for name, each in classes.items()
    } or None
    return IndividualReport(**{**row, **parts, "log_density": _log_density(row)})


def _observation(row: Entry) -> ObservationReport:
    numbers = {key: _number(row[key]) for key in ("predicted", "scale", "residual")}
    if row["predicted"] is None:
        # only of a bound, and on its open side, can an infinite prediction have a likelihood
        numbers["predicted"] = math.inf if row["upper"] is None else -math.inf
    return ObservationReport(**{**row, **numbers, "conditions": dict(row["conditions"])})


def _experiment(row: Entry) -> ExperimentReport:
    maybe = {key: row.get(key) for key in ("surface_error", "verified")}
    whole = {**_numbers(row), **maybe, "quantiles": _numbers(row["quantiles"])}
    return ExperimentReport(**{**whole, "log_density": _log_density(row)})


def _log_density(row: Entry) -> float:
    if row["log_density"] is None and row["status"] == OUTSIDE:
        return -math.inf
    return _number(row["log_density"])


def _diagnostic(row: Entry) -> Diagnostic:
    return Diagnostic(**{**row, "concerns": tuple(row.get("concerns", ()))})


def _log_likelihood(
    row: Entry, experiments: Sequence[ExperimentReport | IndividualReport]
) -> LogLikelihoodReport:
    estimated = row["estimated"]
    if estimated is None:
        estimated = sum(experiment.log_density for experiment in experiments)
    part, keys = row.get("reached"), ("experiments", "estimated", "verified", "standard_error")
    reached = None if part is None else {key: part[key] for key in keys}
    return LogLikelihoodReport(**{**row, "estimated": estimated, "reached": reached})


def _failures(row: Entry | None) -> FailureReport | None:
    if row is None:
        return None
    region = {name: tuple(ends) for name, ends in row["region"].items()}
    points = {name: tuple(values) for name, values in row.get("points", {}).items()}
    experiments = tuple(row["experiments"])
    return FailureReport(**{**row, "experiments": experiments, "region": region, "points": points})
