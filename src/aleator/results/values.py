"""The parts of a result as data classes. The fields of a class are the keys of a result file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache
from types import UnionType
from typing import Any, Union, get_args, get_origin
from typing import get_type_hints as hints_of

import numpy as np
import pandas as pd

from aleator.core.status import Status
from aleator.core.types import Array
from aleator.errors import InputsError, nearest
from aleator.laws import Hyperparameter
from aleator.results import documents


@dataclass(frozen=True)
class ReportedSettings:
    """Settings of what a result reports and accepts. The values are chosen by judgement."""

    quantiles: tuple[float, ...] = (0.025, 0.25, 0.5, 0.75, 0.975)
    """Probabilities of the quantiles of predicted outcomes."""
    level: float = 0.05
    """The model is called inconsistent if the probability of all tests together is below this."""
    rounding: float = 1e-9
    """A value may exceed a limit by this share of it, because written numbers are rounded."""


REPORTED = ReportedSettings()
OUTSIDE = Status.OUTSIDE_SUPPORT.name.lower()


class Plain:
    """Base of data classes whose instances equal what is read back from their JSON file.

    On creation NumPy's numbers become Python's, and sequences become tuples. Numbers that JSON
    cannot hold become NaN, or None where the type of the field allows None.
    """

    def __post_init__(self) -> None:
        kind: Any = type(self)
        for name, hint in plain_fields(kind).items():
            object.__setattr__(self, name, typed(hint, getattr(self, name)))


@cache
def plain_fields(kind: Any) -> Mapping[str, Any]:
    """The fields of a data class with their types, except those that == does not compare."""
    known = hints_of(kind)
    return {f.name: known[f.name] for f in fields(kind) if f.compare}


def typed(hint: Any, value: Any) -> Any:
    """A value converted to the type of a field; the value comes from a program or from a document.

    >>> typed(tuple[float, ...], [1.0, None]), typed(float | None, np.inf), typed(Any, np.int64(3))
    ((1.0, nan), None, 3)
    """
    if isinstance(value, Plain):
        return value
    if hint is float:
        if type(value) is float and math.isfinite(value):
            return value
        found = documents.plain(value)
        return math.nan if found is None else found
    if hint is Any:
        return documents.plain(value)
    if type(value) is hint and hint in (str, int, bool):
        return value
    if isinstance(hint, type) and is_dataclass(hint):
        known: dict[str, Any] = {name: value[name] for name in plain_fields(hint) if name in value}
        return hint(**known)
    parts, origin = _parts(hint)
    if origin in (Union, UnionType):
        return _one_of(parts, value)
    if origin is Mapping:
        return {str(key): typed(parts[1], part) for key, part in value.items()}
    if origin is list or Ellipsis in parts:
        return origin(typed(parts[0], part) for part in value)
    if origin is tuple:
        return tuple(typed(*pair) for pair in zip(parts, value, strict=True))
    return hint(value)


@cache
def _parts(hint: Any) -> tuple[tuple[Any, ...], Any]:
    """The arguments and the origin of a type."""
    return get_args(hint), get_origin(hint)


def _one_of(parts: tuple[Any, ...], value: Any) -> Any:
    if str in parts:
        return documents.plain(value)
    if value is None:
        return None
    found = typed(parts[0], value)
    return None if isinstance(found, float) and math.isnan(found) else found


@dataclass(frozen=True)
class Estimate(Plain):
    """One hyperparameter: estimate, standard errors, 95 % interval; None where undetermined.

    `standard_error` is computed from the observed information; `sandwich_error` is valid also for a
    wrong model. `at_bound` is "lower" or "upper" if the estimate lies on that limit. `cut` is
    "lower", "upper" or "both" if the interval ends at that limit of the hyperparameter, because the
    profile likelihood has not dropped far enough there. `drops` are the drops of the profile
    log-likelihood at the two ends: 1.92 at an inner end, less at a limit. `unadjusted` is the
    interval with these drops if `interval` is adjusted for few experiments, which has other drops.
    A fixed hyperparameter has neither errors nor interval; if it is only bounded, `interval` has
    its bounds.
    """

    estimate: float
    standard_error: float | None
    sandwich_error: float | None
    interval: tuple[float, float] | None
    at_bound: str | None
    fixed: bool
    cut: str | None = None
    drops: tuple[float, float] | None = None
    unadjusted: tuple[float, float] | None = None


@dataclass(frozen=True)
class MeasuredThere(Plain):
    """How many of the `values` measured under the conditions of a question are as it asks.

    `inside` are in the event, or within the limits. `open` are known by a bound only, which leaves
    that open.
    """

    values: int
    inside: int
    open: int


@dataclass(frozen=True)
class OutcomeAnswer(Plain):
    """The answer to a question about one outcome of a new experiment (`OutcomeQuestion`).

    It is the row of `Identification.probability` for the `event`, or of `Identification.tolerance`
    for the limits of a `content`, a `confidence` and a `side`. `at` are the conditions, and `noise`
    says whether the measured or the true value is meant. `lower` and `upper` are the 95 % interval
    of the `probability`, or the limits. `error` is the standard error of the computation. `beyond`
    says how far the conditions lie outside those of the experiments, in words. `measured` is what
    the experiments under exactly these conditions show; None where there are none, and where the
    question is about the true value or a parameter, which is not measured. Without an answer the
    `status` is "failed" or "interrupted", and `reason` says why.
    """

    outcome: str
    at: Mapping[str, Any]
    noise: bool
    event: str | None = None
    content: float | None = None
    confidence: float | None = None
    side: str = "both"
    probability: float | None = None
    lower: float | None = None
    upper: float | None = None
    error: float | None = None
    beyond: str = ""
    measured: MeasuredThere | None = None
    status: str = "solved"
    reason: str = ""


@dataclass(frozen=True)
class PlausibleLaws(Plain):
    """How the laws that the experiments leave plausible are drawn, and how well that is possible.

    `status` is "normal" if draws of alpha from its intervals and correlations agree with the
    likelihood, "by_likelihood" if draws weighted by the likelihood take their place, and "poor" if
    neither represents it: predictions with uncertainty may then be wrong. `agreement` is that of
    the normal draws, between zero and one (see `inference.likelihood_draws.agreement`); None where
    there are none. `effective` is the effective number of draws by the likelihood (Kish,
    1965), `alpha` (A, K) and `weights` (A,) are these draws, in the order of the alpha of a result.
    """

    status: str
    agreement: float | None = None
    effective: float | None = None
    alpha: tuple[tuple[float, ...], ...] = ()
    weights: tuple[float, ...] = ()

    def reordered(self, order: Sequence[int]) -> PlausibleLaws:
        """The same laws with the columns of their draws in another order.

        >>> drawn = PlausibleLaws("by_likelihood", alpha=((1.0, 2.0),), weights=(1.0,))
        >>> drawn.reordered([1, 0]).alpha
        ((2.0, 1.0),)
        """
        return replace(self, alpha=tuple(tuple(row[k] for k in order) for row in self.alpha))

    @property
    def summary(self) -> dict[str, Any]:
        """The status with its numbers, without the draws."""
        names = ("status", "agreement", "effective")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class LawQuantity(Plain):
    """A quantity by which a law is usually told, such as the median of a lognormal law.

    `estimate` is that of the law at the estimate of alpha. `interval` holds 95 % of the quantity
    over draws of alpha, and `standard_error` follows from those of the hyperparameters (delta
    method); they are None where the uncertainty of a hyperparameter of the law is unknown.
    """

    estimate: float
    interval: tuple[float, float] | None
    standard_error: float | None = None


@dataclass(frozen=True)
class LawEnds(Plain):
    """The two ends of the range that holds 95 % of a law, and how sure they are.

    `lower` and `upper` are the quantiles of 2.5 % and 97.5 % of the law at the estimate of alpha.
    `lower_interval` and `upper_interval` hold 95 % of these quantiles over draws of alpha (see
    `found.draws`); they are None where the uncertainty of a hyperparameter of the law is unknown.
    `quantities` are those by which the law is usually told beside its hyperparameters, by name
    (see `Law.customary`); a law without a free hyperparameter has none.
    """

    lower: float
    upper: float
    lower_interval: tuple[float, float] | None
    upper_interval: tuple[float, float] | None
    quantities: Mapping[str, LawQuantity] = field(default_factory=dict)


@dataclass(frozen=True)
class LawRange(LawEnds):
    """The range of a scattering parameter that holds 95 % of its identified law.

    `level` is the column whose groups share one value; it is None if each experiment has its own.
    If a law `follows` covariates, the range holds 95 % of the mean of the experiments' laws, which
    has no `quantities`. If it follows a `factor` of two to four levels, `by_level` has the range of
    each level, where the other covariates of the law have the values `at`.
    """

    level: str | None = None
    follows: bool = False
    factor: str | None = None
    at: Mapping[str, Any] = field(default_factory=dict)
    by_level: Mapping[str, LawEnds] = field(default_factory=dict)


@dataclass(frozen=True)
class InformationCriteria(Plain):
    """AIC, AICc and BIC of the maximum with its number of `free` hyperparameters.

    `aicc` is None where it is infinite: for no more than `free` + 1 experiments. The equations are
    in docs/statistics/compare.md.
    """

    free: int
    aic: float
    aicc: float | None
    bic: float


@dataclass(frozen=True)
class FactorEffect(Plain):
    """How much a hyperparameter differs between the levels of a factor, a column of names.

    The two levels `between` have the largest `difference`, that of the first minus that of the
    second, with its `standard_error`. Its 95 % `interval` holds for the differences of all `pairs`
    of levels together (Bonferroni); with one pair, and where the difference is a coefficient, it is
    the interval of that coefficient. `wald` is the statistic of the test that all levels are equal,
    with `df` degrees of freedom and the p value `p`. Where the formula has products with the
    factor, each level has its mean over the experiments.
    """

    hyperparameter: str
    factor: str
    between: tuple[str, str]
    difference: float
    standard_error: float
    interval: tuple[float, float]
    pairs: int
    wald: float
    df: int
    p: float


@dataclass(frozen=True)
class ParameterCorrelation(Plain):
    """The correlation of two parameters under the identified law.

    It is the correlation of the standard normal variates of the parameters. If both laws are normal
    it is also the correlation of the parameters themselves. `standard_error` is computed by the
    delta method. It is None if the correlation is fixed, or depends on an estimate without a
    standard error.
    """

    between: tuple[str, str]
    estimate: float
    standard_error: float | None


@dataclass(frozen=True)
class LogLikelihoodReport(Plain):
    """The log-likelihood as `estimated`, and as `verified` by runs of the simulator itself.

    `verified` is None if no such runs were made. `error` is the numerical error of `estimated`.
    With a verification it combines the difference of the two values with the standard error of that
    difference; without one it is the change by a finer quadrature; None if neither is known.
    `log_prior` is the log prior density, if a hyperparameter has a prior: then the sum of
    log-likelihood and log prior was maximized. `restricted` is the restricted log-likelihood, if
    this was maximized.
    """

    estimated: float
    verified: float | None
    verified_standard_error: float | None
    log_prior: float | None = None
    error: float | None = None
    restricted: float | None = None

    def __post_init__(self) -> None:
        impossible = self.estimated == -math.inf
        super().__post_init__()
        if impossible:
            object.__setattr__(self, "estimated", -math.inf)


@dataclass(frozen=True)
class ExperimentReport(Plain):
    """The outcome that the identified law predicts for one experiment, beside the measured outcome.

    Moments include the measurement noise. `kurtosis` is 3 for a normal outcome. `pit` is the
    predicted probability of an outcome below the measured one. `surface_error` is the
    root-mean-square error of the response surface at the verification runs, divided by the standard
    deviation of the outcome; None without a verification.
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

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "log_density", _log_density(self.log_density, self.status))


REACH = 1.96
"""Half of the width of an interval that has 95 % of a normal law, in standard deviations."""


@dataclass(frozen=True)
class IndividualReport(Plain):
    """The individual law of one experiment with several observations.

    The individual law is the law of the experiment's parameters given its observations. `mode`,
    `mean` and `sd` describe it, by the name of the parameter. `log_density` is the logarithm of the
    joint density of all observations; with levels it is that given all other experiments that share
    parameters with this one, and the sum is not the log-likelihood. If a parameter has a mixture
    law, `components` has the probability of each component given the observations (latent classes).
    """

    id: str
    observations: int
    log_density: float
    mode: Mapping[str, float]
    mean: Mapping[str, float]
    sd: Mapping[str, float]
    status: str
    components: Mapping[str, tuple[float, ...]] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "log_density", _log_density(self.log_density, self.status))

    def interval(self, name: str) -> tuple[float, float]:
        """95 % of a normal law with the mean and sd of this parameter."""
        reach = REACH * self.sd[name]
        return self.mean[name] - reach, self.mean[name] + reach


def _log_density(value: float, status: str) -> float:
    """The log-density; minus infinity where NaN stands for an outcome outside the support."""
    return -math.inf if math.isnan(value) and status == OUTSIDE else value


@dataclass(frozen=True)
class ObservationReport(Plain):
    """One measured value, and its fitted value: the mean under its experiment's individual law.

    Values are on the scale of the likelihood (after a transform). `lower` and `upper` are equal for
    an exact measurement; otherwise the value is censored, and they are its known bounds. `row`
    counts the rows of the table from 1. `conditions` are those that vary within experiments.
    `scale` is the scale of the measurement error: its standard deviation, where the error is
    normal. `predicted` is the fitted value (without noise the mean under the law). `residual` is
    the measured minus this value, divided by `scale`; for a censored value it is the distance to
    the nearer bound, zero between the bounds. `pit` is the predicted probability of a smaller
    value, given the earlier observations of the same experiment. If the model is right these
    probabilities are independent and uniform on [0, 1]. For a censored value `pit` is drawn at
    random between the probabilities of its bounds.
    """

    id: str
    row: int
    response: str
    lower: float | None
    upper: float | None
    predicted: float
    scale: float
    residual: float
    conditions: Mapping[str, float | str]
    pit: float | None = None

    def __post_init__(self) -> None:
        # An infinite prediction has a likelihood only for a censored value without that bound.
        super().__post_init__()
        if math.isnan(self.predicted) and self.censored and None in (self.lower, self.upper):
            without_end = math.inf if self.upper is None else -math.inf
            object.__setattr__(self, "predicted", without_end)

    @property
    def censored(self) -> bool:
        """Whether the value is censored: only bounds of it are known."""
        return self.lower is None or self.lower != self.upper


@dataclass(frozen=True)
class Diagnostic(Plain):
    """A warning about a result: its subject, a message, and a remedy.

    `concerns` names the experiments, hyperparameters or parameters that it is about.
    """

    about: str
    message: str
    remedy: str
    concerns: tuple[str, ...] = ()


@dataclass(frozen=True)
class FailureReport(Plain):
    """The failed runs: `runs` of the `needed` ones failed, in `experiments`, all within `region`.

    `region` has the lowest and the highest value of each parameter among the failed runs. `message`
    is their most frequent error. `points` has the parameter values of failed runs, a few hundred
    at most.
    """

    runs: int
    needed: int
    experiments: tuple[str, ...]
    region: Mapping[str, tuple[float, float]]
    message: str
    points: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class DensityDistance(Plain):
    """How far a density fitted to moments is from the exact density, at the estimates.

    `log_likelihood` is the difference of the log-likelihoods. `mean` and `worst` are the average
    and the largest earth mover's distance over the experiments, in standard deviations of the
    outcome. `failed` is the number of experiments whose density could not be fitted.
    """

    density: str
    log_likelihood: float
    mean: float
    worst: float
    failed: int


# ------------------------------------------------------------------------------------- consistency


@dataclass(frozen=True)
class Statistic(Plain):
    """One test of consistency, with its probability under the model.

    `kind` names the test statistic. `of` is the part of the model that is tested: "outcomes",
    "scatter" or a hyperparameter. `column` is the quantity on which the tested part may depend
    (None: no quantity), and `where` the part of that column that is looked at (None: all of it).
    `z` is the statistic in standard deviations over simulated replicates, and `p` its probability
    if the model is right. `corrected` is the probability that at least one of all tests has so
    small a `p` (correction for multiple tests).
    """

    kind: str
    of: str
    column: str | None
    where: str | None
    z: float
    p: float
    corrected: float


@dataclass(frozen=True)
class Discrepancy(Plain):
    """A test that contradicts the model, with its interpretation and a remedy."""

    test: Statistic
    message: str
    remedy: str


@dataclass(frozen=True)
class Outlier(Plain):
    """An observation that is improbable under the model, with its probability `p`.

    `corrected` is the probability after correction for the number of observations tested.
    """

    id: str
    row: int
    response: str
    p: float
    corrected: float


@dataclass(frozen=True)
class Relation(Plain):
    """A correlation of a parameter's individual means with a column or with another parameter.

    `other` is the name of that column or parameter; `pair` says whether it is a parameter.
    Individual means are shrunk towards the population mean, so their correlation differs from the
    correlation of the parameters themselves. `p` allows for that: it is the probability that a
    right model, whose replicates are shrunk alike, has a correlation as strong.
    """

    parameter: str
    other: str
    pair: bool
    correlation: float
    p: float


@dataclass(frozen=True)
class Consistency(Plain):
    """Whether the model is consistent with the experiments.

    `p` is the probability that a right model looks as bad in any of the `tests`. `consistent` says
    whether `p` is at least 0.05; it is None if that could not be tested, and `reason` says why.
    `discrepancies` are the tests that contradict the model most strongly. `outliers` are
    observations so improbable that only one in twenty right models would have any. `replicates` is
    the number of data sets simulated under the fitted model, with which the tests compare.
    `relations` are correlations of individual parameters. `copies` are columns that are determined
    by the outcome, and are therefore not used in tests. `covariate` is the strongest relation of a
    parameter, or of the outcome, to a column, where chance among these relations alone does not
    explain it; the `corrected` of its test allows for these only. It is a hint, and no part of the
    verdict: one right model in twenty has it. None where there is none, or where `discrepancies`
    have its column.
    """

    consistent: bool | None
    p: float | None
    replicates: int
    discrepancies: tuple[Discrepancy, ...] = ()
    outliers: tuple[Outlier, ...] = ()
    tests: tuple[Statistic, ...] = ()
    reason: str = ""
    relations: tuple[Relation, ...] = ()
    copies: tuple[str, ...] = ()
    covariate: Discrepancy | None = None

    def table(self) -> pd.DataFrame:
        """A data frame with a row for each test, the smallest probability first.

        >>> Consistency.untested("it was not asked for").table().empty
        True
        """
        frame = pd.DataFrame([vars(test) for test in self.tests])
        return frame if frame.empty else frame.sort_values("p", ignore_index=True)

    @classmethod
    def untested(cls, reason: str) -> Consistency:
        """A consistency without a verdict; `reason` says why nothing was tested.

        >>> Consistency.untested("it was not asked for").consistent is None
        True
        """
        return cls(None, None, 0, reason=reason)


# ------------------------------------------------------------------------------------------- alpha


def in_order(
    alpha: Mapping[str, float | Estimate], hyperparameters: Sequence[Hyperparameter]
) -> Array:
    """The values (K,) of hyperparameters given by name, in the order of the model.

    Raises InputsError for a missing or unknown name, and for a value beyond its limits, because
    response surfaces and quadrature nodes are made for values within the limits.
    """
    names = [h.name for h in hyperparameters]
    for name in alpha:
        if name not in names:
            raise InputsError(
                f"alpha has '{name}', which the model does not know{nearest(name, names)}",
                f"the model's hyperparameters are {', '.join(names)}",
            )
    missing = [name for name in names if name not in alpha]
    if missing:
        raise InputsError(f"alpha lacks {', '.join(missing)}", "give every hyperparameter a value")
    values = [alpha[name] for name in names]
    at = np.array([v.estimate if isinstance(v, Estimate) else float(v) for v in values])
    for value, h in zip(at.tolist(), hyperparameters, strict=True):
        slack = REPORTED.rounding * max(abs(h.lower), abs(h.upper))
        if not h.lower - slack <= value <= h.upper + slack:
            raise InputsError(
                f"{h.name} = {value:g} is outside its limits [{h.lower:g}, {h.upper:g}]"
                if h.free
                else f"{h.name} = {value:g}, and the law says {h.lower:g}",
                "choose a value between them, or widen them"
                if h.free
                else "give it limits, or that value",
            )
    return at
