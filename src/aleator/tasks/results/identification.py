"""The result of an identification: its values, and what can be asked of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from aleator.inference.consistency import Consistency
from aleator.inference.diagnostics.diagnostic import Diagnostic
from aleator.inference.diagnostics.failures import FailureReport
from aleator.inference.fit import Fit
from aleator.likelihood.comparison import DensityDistance
from aleator.observations.transform import Transform
from aleator.progress import Progress
from aleator.tasks.results import documents, printed, second
from aleator.tasks.results.decided import Decided
from aleator.tasks.results.law import JointLaw
from aleator.tasks.results.session import OutcomeSession, Session, kept
from aleator.tasks.results.values import (
    Estimate,
    ExperimentReport,
    IndividualReport,
    LogLikelihoodReport,
    ObservationReport,
    ParameterCorrelation,
)

NO_SESSION = OutcomeSession(None, None, None)
NOT_ASKED = Consistency.untested("it was not asked for")


class Report(Protocol):
    """A page to look at; `aleator.report.html.saved` makes it."""

    text: str

    def save(self, path: str | Path) -> Path:
        """Write the page to a file."""

    def _repr_html_(self) -> str:
        """The page in a notebook."""


@dataclass(frozen=True, repr=False)
class Identification(Decided):
    """An identified law: alpha with its uncertainty, its log-likelihood, and how it was found.

    `sound` is true only if the search converged, every density was solved with every outcome
    in its support, and the Monte Carlo check, where it was made, agrees. `consistent` says whether
    the experiments look as the identified model says, `consistency` what does not. `warnings` say
    what to mend or to know. It prints as a report in short. `session` holds what it was made with:
    model, simulator, surfaces. An identification that was read from a file has only what was given
    again.

    >>> from aleator import Free, Inputs, MonteCarlo, Normal, identify
    >>> table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.1, 1.8, 3.6, 3.7]})
    >>> law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))})
    >>> found = identify(lambda load, x: load * x, table, law, outcome="y",
    ...                  verification=MonteCarlo(0))
    >>> found
    2 hyperparameters identified from 4 experiments, ... runs of the simulator
    alpha   estimate  std. error   95 % interval  note
    x.mean     1.031       0.062  0.873 .. 1.189
    x.sd       0.124       0.044  0.071 .. 0.303  sandwich error 0.018
    log-likelihood -0.511
    ...
    Computed soundly: the search converged, every density was solved; not verified on
    the
    simulator.
    Not tested whether consistent with the experiments: there are only 4 observations.
    >>> float(found.values["x.mean"]), found.intervals.loc["x.mean"].round(3).tolist()
    (1.031, [0.873, 1.189])
    >>> found.predict(pd.DataFrame({"load": [10.0]}))["mean"].tolist()
    [10.31]
    """

    alpha: Mapping[str, Estimate]
    log_likelihood: LogLikelihoodReport
    density: str
    propagation: str
    sound: bool
    warnings: tuple[Diagnostic, ...]
    experiments: tuple[ExperimentReport, ...] | tuple[IndividualReport, ...]
    correlation_names: tuple[str, ...]
    correlation: tuple[tuple[float, ...], ...]
    search: Mapping[str, Any]
    surface: Mapping[str, Any] | None
    baselines: Mapping[str, Any]
    runs: int
    runs_by_stage: Mapping[str, int]
    seconds: Mapping[str, float]
    seed: int
    failures: FailureReport | None = None
    versions: Mapping[str, str] = field(default_factory=dict)
    parameter_correlations: tuple[ParameterCorrelation, ...] = ()
    density_distances: tuple[DensityDistance, ...] = ()
    observations: tuple[ObservationReport, ...] = ()
    shrinkage: Mapping[str, float] = field(default_factory=dict)
    quadrature: Mapping[str, float] | None = None
    responses: Mapping[str, str] = field(default_factory=dict)
    law_curves: Mapping[str, Mapping[str, list[float]]] = field(default_factory=dict)
    outcome: str = "outcome"
    transform: Transform = Transform.NONE
    units: Mapping[str, str] = field(default_factory=dict)
    consistency: Consistency = NOT_ASKED
    best_possible: Mapping[str, float] | None = None
    pictures: Mapping[str, Any] = field(default_factory=dict)
    propagation_reason: str = ""
    session: Session = field(default=NO_SESSION, compare=False)

    def __repr__(self) -> str:
        return printed.text(self.to_dict())

    def _repr_html_(self) -> str:
        """The report in a notebook."""
        return printed.html(self.to_dict())

    @property
    def consistent(self) -> bool | None:
        """Whether the model is consistent with the experiments; None where that was not tested."""
        return self.consistency.consistent

    @property
    def values(self) -> pd.Series[float]:
        """The estimates (K,) by the name of the hyperparameter, fixed ones included."""
        return pd.Series({name: e.estimate for name, e in self.alpha.items()}, dtype=float)

    @property
    def errors(self) -> pd.Series[float]:
        """The standard errors (K,) from the observed information; NaN where there is none.

        A hyperparameter that is fixed, on its bound or not determined by the data has none.
        """
        return pd.Series({name: e.standard_error for name, e in self.alpha.items()}, dtype=float)

    @property
    def intervals(self) -> pd.DataFrame:
        """95 % intervals by profile likelihood: columns lower, upper; NaN where there is none."""
        ends = {name: e.interval or (np.nan, np.nan) for name, e in self.alpha.items()}
        return pd.DataFrame.from_dict(ends, orient="index", columns=["lower", "upper"])

    @property
    def covariance(self) -> pd.DataFrame:
        """The covariance (F, F) of those estimates that have a standard error, by name."""
        names = [*self.correlation_names]
        errors = self.errors[names].to_numpy()
        matrix = np.reshape(self.correlation, (len(names), len(names))) * np.outer(errors, errors)
        return pd.DataFrame(matrix, index=names, columns=names)

    @property
    def law(self) -> JointLaw:
        """The identified joint law of the parameters: `sample`, `pdf`, `cdf`, `marginals`.

        Raises AleatorError where the identification was read from a file without the inputs.
        """
        return self.session.law(self.alpha)

    @property
    def fit(self) -> Fit:
        """The likelihood with its data at the estimates, for what builds on it; no runs.

        Raises AleatorError where the identification was read from a file: surfaces are not saved.
        """
        return kept(self.session.fit)

    def law_at(self, covariates: Mapping[str, object] | pd.Series) -> JointLaw:
        """The joint law of an experiment with these covariates, by name.

        The same as `law` where no law follows covariates. Raises InputsError for one that is
        missing, and for a level that no experiment had.
        """
        return self.session.law(self.alpha, covariates)

    @property
    def individuals(self) -> pd.DataFrame:
        """A row for each experiment with individual parameters, by its id.

        Columns ``observations``, ``log_density``, and ``x.mode``, ``x.mean``, ``x.sd`` of each
        parameter x given the observations of the experiment; ``x.1.probability`` and so on of the
        components of a mixture. Without columns for experiments of one outcome.
        """
        own = [e for e in self.experiments if isinstance(e, IndividualReport)]
        rows = [
            {"observations": e.observations, "log_density": e.log_density}
            | {
                f"{name}.{what}": getattr(e, what)[name]
                for name in e.mean
                for what in ("mode", "mean", "sd")
            }
            | {
                f"{name}.{c}.probability": one
                for name, each in (e.components or {}).items()
                for c, one in enumerate(each, start=1)
            }
            for e in own
        ]
        return pd.DataFrame(rows, index=pd.Index([e.id for e in own], name="id"))

    @property
    def residuals(self) -> pd.DataFrame:
        """A row for each observation: its experiment and place, its bounds and its prediction.

        See `ObservationReport` for the columns; of the conditions those that vary within
        experiments have one each. Without columns for experiments of one outcome.
        """
        rows = [{**vars(o), **o.conditions} for o in self.observations]
        return pd.DataFrame(rows).drop(columns="conditions", errors="ignore")

    def log_likelihood_at(self, alpha: Mapping[str, float] | ArrayLike) -> float:
        """log L(alpha) on the surfaces of the identification; minus infinity outside a support.

        `alpha` maps names to values, where hyperparameters that are not named keep their estimate,
        or is an array (K,) in the order of `values`. The surfaces are exact around the estimate
        and over its intervals; far beyond them the value is rough. Raises InputsError for a name
        that is unknown and a value beyond its limits, AleatorError where the identification was
        read from a file: surfaces are not saved. Cost: some milliseconds, no run.
        """
        return self.session.log_likelihood(alpha, self.alpha)

    def report(self, *, progress: Progress | None = None) -> Report:
        """A page of charts that needs no network: a notebook shows it, `.save(path)` writes it.

        What it draws beside the answer is computed where the fit is at hand, in seconds and without
        runs; of an identification that was read from a file it shows what that has. Raises
        AleatorError where Bokeh is not installed.
        """
        whole = self
        if not self.pictures and self.session.fit is not None:
            whole = _above("tasks.pictures").pictured(self, progress)
        made: Report = _above("report.html.saved").report_of(whole.to_dict())
        return made

    def save(self, path: str | Path) -> None:
        """Write all values as a JSON file, which `aleator.load` reads; the session is not saved.

        Raises AleatorError where the file cannot be written.
        """
        documents.write_json(self.to_dict(), path)

    def to_dict(self) -> dict[str, Any]:
        """The document identification.json as plain dictionaries, lists, numbers and texts."""
        return {
            "outcome": self.outcome,
            "transform": self.transform,
            "units": dict(self.units),
            "alpha": {name: _estimate(value) for name, value in self.alpha.items()},
            "correlation": {
                "names": list(self.correlation_names),
                "matrix": [list(row) for row in self.correlation],
            },
            "parameter_correlations": [
                {**vars(c), "between": list(c.between)} for c in self.parameter_correlations
            ],
            "log_likelihood": dict(vars(self.log_likelihood)),
            "sound": self.sound,
            "consistent": self.consistent,
            "consistency": second.entry_of(self.consistency),
            "best_possible": None if self.best_possible is None else dict(self.best_possible),
            "warnings": [dict(vars(warning)) for warning in self.warnings],
            "density": self.density,
            "density_distances": [dict(vars(row)) for row in self.density_distances],
            "propagation": self.propagation,
            "propagation_reason": self.propagation_reason,
            "runs": self.runs,
            "runs_by_stage": dict(self.runs_by_stage),
            "failures": None if self.failures is None else _failures(self.failures),
            "search": dict(self.search),
            "surface": None if self.surface is None else dict(self.surface),
            "baselines": dict(self.baselines),
            "experiments": [_experiment(e) for e in self.experiments],
            "observations": [_experiment(o) for o in self.observations],
            "shrinkage": dict(self.shrinkage),
            "quadrature": None if self.quadrature is None else dict(self.quadrature),
            "responses": dict(self.responses),
            "law_curves": {name: dict(curve) for name, curve in self.law_curves.items()},
            "pictures": dict(self.pictures),
            "seed": self.seed,
            "versions": dict(self.versions),
            "seconds": dict(self.seconds),
        }


def _above(name: str) -> Any:
    """A room above, asked by name where an answer is to be shown: imports run downward only."""
    return import_module(f"aleator.{name}")


def _estimate(value: Estimate) -> dict[str, Any]:
    pairs = {"interval": value.interval, "drops": value.drops}
    return {**vars(value), **{k: None if v is None else list(v) for k, v in pairs.items()}}


def _experiment(report: ExperimentReport | IndividualReport | ObservationReport) -> dict[str, Any]:
    return {k: dict(v) if isinstance(v, Mapping) else v for k, v in vars(report).items()}


def _failures(report: FailureReport) -> dict[str, Any]:
    region = {name: list(ends) for name, ends in report.region.items()}
    points = {name: list(values) for name, values in report.points.items()}
    experiments = list(report.experiments)
    return {**vars(report), "experiments": experiments, "region": region, "points": points}
