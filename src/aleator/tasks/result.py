"""The result of an identification: values only, and the document made of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from aleator.inference.diagnostics.diagnostic import Diagnostic
from aleator.inference.diagnostics.failures import FailureReport
from aleator.likelihood.comparison import DensityDistance

QUANTILES = (0.025, 0.25, 0.5, 0.75, 0.975)


@dataclass(frozen=True)
class Estimate:
    """One hyperparameter: estimate, standard errors, 95 % interval; None where undetermined.

    `standard_error` from the observed information, `sandwich_error` valid also for a wrong model;
    `at_bound` is "lower" or "upper" where the estimate lies on its limit; a fixed
    hyperparameter has neither error nor interval.
    """

    estimate: float
    standard_error: float | None
    sandwich_error: float | None
    interval: tuple[float, float] | None
    at_bound: str | None
    fixed: bool


@dataclass(frozen=True)
class ParameterCorrelation:
    """Correlation of two parameters under the identified law, whatever it was identified by.

    That of their normal germs, which is theirs where both laws are normal. `standard_error` by the
    delta method; None where the correlation is known, or rests on an estimate without one.
    """

    between: tuple[str, str]
    estimate: float
    standard_error: float | None


@dataclass(frozen=True)
class LogLikelihoodReport:
    """The maximum as `estimated` by the densities and as `verified` on the simulator itself.

    `verified` is None without a check, and where it did not reach every experiment: `reached` has
    then the number of `experiments` that it did, and their sum as `estimated`, `verified` and
    `standard_error`.
    """

    estimated: float
    verified: float | None
    verified_standard_error: float | None
    reached: Mapping[str, float] | None = None


@dataclass(frozen=True)
class ExperimentReport:
    """What the identified law says of one experiment; moments include measurement noise.

    `kurtosis` is not in excess (3 for a normal outcome); `pit` is the probability of an outcome
    below the measured one; `surface_error` the root-mean-square error of the response surface
    under the identified law, over the outcome's standard deviation, where it was verified.
    `verified` tells whether the Monte Carlo check reached the experiment; None without a check.
    """

    id: str
    outcome: float
    log_density: float
    mean: float
    standard_deviation: float
    skewness: float
    kurtosis: float
    quantiles: Mapping[str, float]
    pit: float
    status: str
    surface_error: float | None
    verified: bool | None = None


@dataclass(frozen=True)
class Identification:
    """An identified law: alpha with its uncertainty, its log-likelihood, and how it was found.

    `accepted` is true only if the search converged, every density was solved with every outcome
    in its support, and the Monte Carlo check, where it was made, agrees. `warnings` say what to
    mend or to know. `to_dict()` is the document identification.json.

    >>> import pandas as pd
    >>> from aleator import Free, Inputs, MonteCarlo, Normal, identify
    >>> table = pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0], "y": [1.1, 1.8, 3.6, 3.7]})
    >>> law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))})
    >>> found = identify(lambda load, x: load * x, table, law, outcome="y",
    ...                  verification=MonteCarlo(0))
    >>> found.alpha["x.mean"].estimate
    1.031
    """

    alpha: Mapping[str, Estimate]
    log_likelihood: LogLikelihoodReport
    density: str
    propagation: str
    accepted: bool
    warnings: tuple[Diagnostic, ...]
    experiments: tuple[ExperimentReport, ...]
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

    def to_dict(self) -> dict[str, Any]:
        """The document identification.json as plain dictionaries, lists, numbers and texts."""
        return {
            "alpha": {name: _estimate(value) for name, value in self.alpha.items()},
            "correlation": {
                "names": list(self.correlation_names),
                "matrix": [list(row) for row in self.correlation],
            },
            "parameter_correlations": [
                {**vars(c), "between": list(c.between)} for c in self.parameter_correlations
            ],
            "log_likelihood": dict(vars(self.log_likelihood)),
            "accepted": self.accepted,
            "warnings": [dict(vars(warning)) for warning in self.warnings],
            "density": self.density,
            "density_distances": [dict(vars(row)) for row in self.density_distances],
            "propagation": self.propagation,
            "runs": self.runs,
            "runs_by_stage": dict(self.runs_by_stage),
            "failures": None if self.failures is None else _failures(self.failures),
            "search": dict(self.search),
            "surface": None if self.surface is None else dict(self.surface),
            "baselines": dict(self.baselines),
            "experiments": [{**vars(e), "quantiles": dict(e.quantiles)} for e in self.experiments],
            "seed": self.seed,
            "versions": dict(self.versions),
            "seconds": dict(self.seconds),
        }


def _estimate(value: Estimate) -> dict[str, Any]:
    interval = None if value.interval is None else list(value.interval)
    return {**vars(value), "interval": interval}


def _failures(report: FailureReport) -> dict[str, Any]:
    region = {name: list(ends) for name, ends in report.region.items()}
    return {**vars(report), "experiments": list(report.experiments), "region": region}
