"""The result of an identification as plain data, equal to what is read back from its file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, is_dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import pandas as pd

from aleator.observations.responses import Transform
from aleator.results import documents, printed
from aleator.results.answer import answer
from aleator.results.values import (
    Consistency,
    DensityDistance,
    Diagnostic,
    Estimate,
    ExperimentReport,
    FactorEffect,
    FailureReport,
    IndividualReport,
    InformationCriteria,
    LawRange,
    LogLikelihoodReport,
    ObservationReport,
    OutcomeAnswer,
    ParameterCorrelation,
    Plain,
    PlausibleLaws,
    plain_fields,
    typed,
)

Entry = Mapping[str, Any]
"""A JSON object in a document, as a mapping."""
NOT_TESTED = Consistency.untested("it was not asked for")


@dataclass(frozen=True, repr=False, eq=False)
class Result(Plain):
    """An identified law: alpha with its uncertainty, its log-likelihood, and how it was found.

    `sound` is true only if three things hold: the search converged; every density was solved, with
    the outcome in its support; and the verification on the simulator agrees, if it was made.
    `undetermined` names the hyperparameters whose values the experiments leave open: other values,
    far away or all between the limits, are as likely. `plausible` says how the laws that the
    experiments leave plausible are drawn for predictions; None in files of earlier versions.
    `consistency` says whether the experiments contradict the identified model. `density` names the
    likelihood method and `quadrature` its number of nodes. `correlation` (F, F) is the correlation
    of the estimates that have a standard error; `correlation_names` are their names. `ranges` has
    the 95 % range of each scattering parameter, by name (`LawRange`). `search`, `surface`,
    `baselines`, `best_possible` and `pictures` are dictionaries as in the JSON document, with None
    for a number that JSON cannot hold. `array_fault` says why a function that was tried with arrays
    is called once a run; it is "" if none was. `criteria` are AIC, AICc and BIC, None for a
    restricted likelihood. `answers` are those to the questions about outcomes of new experiments
    that `identify` was asked. `runs` are the different runs that were needed, stored ones included.
    About the square root of their number, at most 24, and the first one are made a second time, to
    check that outcomes repeat.

    Each field has the form in which it is read back from a document: Python's numbers, tuples,
    dictionaries. Two results are equal if their documents are equal.
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
    factors: tuple[FactorEffect, ...] = ()
    density_distances: tuple[DensityDistance, ...] = ()
    observations: tuple[ObservationReport, ...] = ()
    shrinkage: Mapping[str, float] = field(default_factory=dict)
    quadrature: Mapping[str, float] | None = None
    responses: Mapping[str, str] = field(default_factory=dict)
    law_curves: Mapping[str, Mapping[str, list[float]]] = field(default_factory=dict)
    ranges: Mapping[str, LawRange] = field(default_factory=dict)
    outcome: str = "outcome"
    transform: Transform = Transform.NONE
    units: Mapping[str, str] = field(default_factory=dict)
    consistency: Consistency = NOT_TESTED
    best_possible: Mapping[str, float] | None = None
    pictures: Mapping[str, Any] = field(default_factory=dict)
    propagation_reason: str = ""
    array_fault: str = ""
    criteria: InformationCriteria | None = None
    levels: Mapping[str, str] = field(default_factory=dict)
    undetermined: tuple[str, ...] = ()
    answers: tuple[OutcomeAnswer, ...] = ()
    plausible: PlausibleLaws | None = None

    def __post_init__(self) -> None:
        if self.observations:
            rows = typed(tuple[IndividualReport, ...], self.experiments)
            object.__setattr__(self, "experiments", rows)
        super().__post_init__()
        if math.isnan(self.log_likelihood.estimated):
            total = math.fsum(e.log_density for e in self.experiments)
            told = replace(self.log_likelihood, estimated=total)
            object.__setattr__(self, "log_likelihood", told)

    @classmethod
    def from_document(cls, document: Entry) -> Self:
        """The result that a document describes; a number that is null in JSON becomes NaN.

        A log-density that is null because the outcome lies outside the support becomes minus
        infinity.
        """
        known = {name: document[name] for name in plain_fields(Result) if name in document}
        correlation = document["correlation"]
        known |= {"correlation_names": correlation["names"], "correlation": correlation["matrix"]}
        if "consistency" in document:
            second = {**document["consistency"], "consistent": document["consistent"]}
            known["consistency"] = second
        return cls(**known)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Result):
            return NotImplemented
        return documents.to_json(self.to_dict()) == documents.to_json(other.to_dict())

    def __repr__(self) -> str:
        return printed.text(answer(self.to_dict()))

    def _repr_html_(self) -> str:
        """The short report as HTML for a notebook."""
        return printed.fragment(answer(self.to_dict()))

    @property
    def consistent(self) -> bool | None:
        """Whether the model is consistent with the experiments; None where that was not tested."""
        return self.consistency.consistent

    @property
    def aic(self) -> float:
        """Akaike's criterion, as `aleator.compare` has it; NaN for a restricted likelihood."""
        return math.nan if self.criteria is None else self.criteria.aic

    @property
    def bic(self) -> float:
        """The Bayesian criterion, as `aleator.compare` has it; NaN for a restricted likelihood."""
        return math.nan if self.criteria is None else self.criteria.bic

    @property
    def emulator_error(self) -> float | None:
        """The error of the estimates that an emulator in place of the simulator causes.

        It is in standard errors, in the worst direction, to first order. None without an emulator.
        """
        return None if self.surface is None else self.surface.get("estimates_error")

    @property
    def values(self) -> pd.Series[float]:
        """The estimates (K,) by the name of the hyperparameter, including fixed ones."""
        return pd.Series({name: e.estimate for name, e in self.alpha.items()}, dtype=float)

    @property
    def errors(self) -> pd.Series[float]:
        """The standard errors (K,) from the observed information; NaN where there is none.

        A hyperparameter that is fixed, on its bound or not determined by the data has none.
        """
        return pd.Series({name: e.standard_error for name, e in self.alpha.items()}, dtype=float)

    @property
    def intervals(self) -> pd.DataFrame:
        """95 % intervals by profile likelihood: columns lower, upper; NaN where there is none.

        Of a hyperparameter that is only bounded they are its bounds.
        """
        ends = {name: e.interval or (np.nan, np.nan) for name, e in self.alpha.items()}
        return pd.DataFrame.from_dict(ends, orient="index", columns=["lower", "upper"])

    @property
    def quantities(self) -> pd.DataFrame:
        """The quantities by which the laws are usually told, such as the median of a lognormal law.

        The columns are the estimate, its standard error, and the ends lower and upper of its 95 %
        interval over draws of alpha (see `LawQuantity`); NaN where these are not known. A row is
        named as in ``x.median``; of a law that follows a factor there is one for each level, as in
        ``x.median[oil=a]``.
        """
        rows = {
            f"{name}.{what}{at}": (
                one.estimate,
                one.standard_error,
                *(one.interval or (np.nan, np.nan)),
            )
            for name, entry in self.ranges.items()
            for at, law in [
                ("", entry),
                *((f"[{entry.factor}={level}]", own) for level, own in entry.by_level.items()),
            ]
            for what, one in law.quantities.items()
        }
        columns = ["estimate", "standard_error", "lower", "upper"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns)

    @property
    def covariance(self) -> pd.DataFrame:
        """The covariance matrix (F, F) of the estimates that have a standard error, by name."""
        names = [*self.correlation_names]
        errors = self.errors[names].to_numpy()
        matrix = np.reshape(self.correlation, (len(names), len(names))) * np.outer(errors, errors)
        return pd.DataFrame(matrix, index=names, columns=names)

    @property
    def individuals(self) -> pd.DataFrame:
        """A data frame with a row for each experiment with individual parameters, by its id.

        Its columns are ``observations``, ``log_density``, and for each parameter x ``x.mode``,
        ``x.mean`` and ``x.sd`` given the observations of the experiment, and ``x.lower`` and
        ``x.upper``, 95 % of a normal law with this mean and sd. The identified law is taken as
        known: sd and range leave out the error of its hyperparameters. For a mixture,
        ``x.1.probability`` and so on are the probabilities of its components. Empty if each
        experiment has one outcome.
        """
        own = [e for e in self.experiments if isinstance(e, IndividualReport)]
        rows = [
            {"observations": e.observations, "log_density": e.log_density}
            | {
                f"{name}.{what}": value
                for name in e.mean
                for what, value in zip(
                    ("mode", "mean", "sd", "lower", "upper"),
                    (e.mode[name], e.mean[name], e.sd[name], *e.interval(name)),
                    strict=True,
                )
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
        """A data frame with a row for each observation: its place, bounds and fitted value.

        ``id`` is the experiment, ``row`` the row of the table, counted from 1, and ``response`` the
        name of the outcome. ``lower`` and ``upper`` are the measured value, or its known bounds,
        and ``predicted`` is the fitted value, the mean of the simulated value given the
        observations of the experiment: in the unit of the outcome, or as logarithms with a "log"
        transform. ``scale`` is the standard deviation of the measurement error, in the same unit
        (of errors that are not normal, their scale). ``residual`` is measured minus predicted,
        divided by ``scale``: it has no unit. ``pit`` is the probability of a smaller value, given
        the earlier observations of the experiment; under a right model it is uniform on [0, 1].
        Then follow the conditions that vary within experiments. See `ObservationReport` for bounds,
        and for correlated errors docs/study.md. Empty if each experiment has one outcome.
        """
        rows = [{**vars(o), **o.conditions} for o in self.observations]
        return pd.DataFrame(rows).drop(columns="conditions", errors="ignore")

    def save(self, path: str | Path) -> None:
        """Write all values as a JSON file, which `aleator.load` reads.

        Raises AleatorError where the file cannot be written.
        """
        documents.write_json(self.to_dict(), path)

    def to_dict(self) -> dict[str, Any]:
        """The content of identification.json as plain dictionaries, lists, numbers and texts."""
        document: dict[str, Any] = {
            name: _in_document(getattr(self, name))
            for name in plain_fields(Result)
            if name != "correlation_names"
        }
        document["correlation"] = {
            "names": list(self.correlation_names),
            "matrix": document["correlation"],
        }
        document["consistent"] = document["consistency"].pop("consistent")
        return document


def _in_document(value: Any) -> Any:
    """A value as a JSON document has it: data classes become dictionaries, tuples become lists."""
    if is_dataclass(value):
        value = vars(value)
    if isinstance(value, Mapping):
        return {key: _in_document(part) for key, part in value.items()}
    return [_in_document(part) for part in value] if isinstance(value, tuple | list) else value
