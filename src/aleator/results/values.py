"""The parts of a result as data classes; their fields are the keys of its document."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
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
    """What a result reports and takes back; by judgement."""

    quantiles: tuple[float, ...] = (0.025, 0.25, 0.5, 0.75, 0.975)
    """Probabilities of the quantiles of predicted outcomes."""
    level: float = 0.05
    """The model is inconsistent where the probability of all tests together is below this."""
    rounding: float = 1e-9
    """Share of a limit by which a value may lie beyond it, as it may have been written down."""


REPORTED = ReportedSettings()
OUTSIDE = Status.OUTSIDE_SUPPORT.name.lower()


class Plain:
    """Base of data classes that are equal to what is read back from their JSON file.

    On creation NumPy's numbers become Python's, sequences become tuples, and numbers that JSON
    cannot hold become NaN, or None where the type of the field allows it.
    """

    def __post_init__(self) -> None:
        kind: Any = type(self)
        for name, hint in plain_fields(kind).items():
            object.__setattr__(self, name, typed(hint, getattr(self, name)))


@cache
def plain_fields(kind: Any) -> Mapping[str, Any]:
    """The fields of a data class with their types, except those that are left out of comparison."""
    known = hints_of(kind)
    return {f.name: known[f.name] for f in fields(kind) if f.compare}


def typed(hint: Any, value: Any) -> Any:
    """A value converted to the type of a field, from a program or from a document.

    >>> typed(tuple[float, ...], [1.0, None]), typed(float | None, np.inf), typed(Any, np.int64(3))
    ((1.0, nan), None, 3)
    """
    if isinstance(value, Plain):
        return value
    if hint is float:
        found = documents.plain(value)
        return math.nan if found is None else found
    if hint is Any:
        return documents.plain(value)
    if isinstance(hint, type) and is_dataclass(hint):
        known: dict[str, Any] = {name: value[name] for name in plain_fields(hint) if name in value}
        return hint(**known)
    parts, origin = get_args(hint), get_origin(hint)
    if origin in (Union, UnionType):
        return _one_of(parts, value)
    if origin is Mapping:
        return {str(key): typed(parts[1], part) for key, part in value.items()}
    if origin is list or Ellipsis in parts:
        return origin(typed(parts[0], part) for part in value)
    if origin is tuple:
        return tuple(typed(*pair) for pair in zip(parts, value, strict=True))
    return hint(value)


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

    `standard_error` from the observed information, `sandwich_error` valid also for a wrong model;
    `at_bound` is "lower" or "upper" where the estimate lies on its limit, and `cut` "lower",
    "upper" or "both" where the interval ends on a limit, at which the profile of the likelihood was
    evaluated and found within the interval. `drops` say how far the profile has dropped at its
    ends: 1.92, or less at a limit. A fixed hyperparameter has neither error nor interval.
    """

    estimate: float
    standard_error: float | None
    sandwich_error: float | None
    interval: tuple[float, float] | None
    at_bound: str | None
    fixed: bool
    cut: str | None = None
    drops: tuple[float, float] | None = None


@dataclass(frozen=True)
class ParameterCorrelation(Plain):
    """Correlation of two parameters under the identified law, whatever it was identified by.

    That of their standard normal variates, theirs too where both laws are normal. `standard_error`
    by the delta method; None where the correlation is known, or rests on an estimate without one.
    """

    between: tuple[str, str]
    estimate: float
    standard_error: float | None


@dataclass(frozen=True)
class LogLikelihoodReport(Plain):
    """The log-likelihood as `estimated`, and as `verified` by runs of the simulator itself.

    `error` is that of `estimated`: its difference from what was verified and the standard error of
    that together, or without a check what finer nodes change; None where neither is known.
    `verified` is None without a check. `log_prior` is that of the priors, where a hyperparameter
    has one: the sum of both is what was maximized.
    """

    estimated: float
    verified: float | None
    verified_standard_error: float | None
    log_prior: float | None = None
    error: float | None = None

    def __post_init__(self) -> None:
        impossible = self.estimated == -math.inf
        super().__post_init__()
        if impossible:
            object.__setattr__(self, "estimated", -math.inf)


@dataclass(frozen=True)
class ExperimentReport(Plain):
    """What the identified law says of one experiment; moments include measurement noise.

    `kurtosis` is not in excess (3 for a normal outcome); `pit` is the probability of an outcome
    below the measured one; `surface_error` the root mean square of what the response surface has
    wrong at the runs of the check, over the outcome's standard deviation; None without a check.
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


@dataclass(frozen=True)
class IndividualReport(Plain):
    """The individual law of one experiment with several observations.

    `log_density` is the logarithm of the density of all its observations together. `mode`, `mean`
    and `sd` are those of its parameters given its observations (the individual law), by name;
    `components` has the probability of each component of a mixture given them (latent classes).
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


def _log_density(value: float, status: str) -> float:
    """A log-density; minus infinity where the outcome lies outside the support."""
    return -math.inf if math.isnan(value) and status == OUTSIDE else value


@dataclass(frozen=True)
class ObservationReport(Plain):
    """One measured value, and what was predicted for it under its experiment's individual law.

    `lower` and `upper` are equal where it was measured exactly, else the bounds that are known;
    values are those that the likelihood sees. `row` counts the rows of the table from 1, and
    `conditions` are those that vary within experiments. `scale` is that of the measurement error,
    and `residual` the measured value minus the predicted one over it; of a censored value the
    distance to its nearer bound, zero between them. `pit` is the probability of a smaller value
    given the earlier observations of the same experiment: under the right law they are independent
    and uniform. A censored value has a random one between those of its bounds.
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
        # only of a bound, and on its open side, can an infinite prediction have a likelihood
        super().__post_init__()
        if math.isnan(self.predicted) and self.censored and None in (self.lower, self.upper):
            without_end = math.inf if self.upper is None else -math.inf
            object.__setattr__(self, "predicted", without_end)

    @property
    def censored(self) -> bool:
        """Whether only bounds of the value are known."""
        return self.lower is None or self.lower != self.upper


@dataclass(frozen=True)
class Diagnostic(Plain):
    """A warning: its subject, a message, and a remedy.

    `concerns` names the experiments, hyperparameters or parameters of the simulator concerned.
    """

    about: str
    message: str
    remedy: str
    concerns: tuple[str, ...] = ()


@dataclass(frozen=True)
class FailureReport(Plain):
    """Runs without an outcome: `runs` of the `needed`, in `experiments`, all within `region`.

    `region` is a box, [lowest, highest] of each parameter; `message` is what the first one said.
    `points` has the values of each parameter at which runs failed, of some hundreds at most.
    """

    runs: int
    needed: int
    experiments: tuple[str, ...]
    region: Mapping[str, tuple[float, float]]
    message: str
    points: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class DensityDistance(Plain):
    """A density fitted to moments against the exact one of the outcome, at the answer.

    `log_likelihood` is the difference of the log-likelihoods, `mean` and `worst` the earth mover's
    distance over the outcome's standard deviation, averaged over experiments and the largest;
    `failed` the number of experiments whose density could not be fitted.
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

    `kind` is its statistic and `of` what of the model it looks at: "outcomes", "scatter" or a
    hyperparameter. `column` and `where` say on what that may depend; None: on nothing, or along
    the whole column. `z` is the statistic in standard deviations of the replicates, `p` its
    probability, `corrected` the probability that any of the tests says as much.
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
    """An unexpected observation: its probability `p`, and `corrected` for the number of tests."""

    id: str
    row: int
    response: str
    p: float
    corrected: float


@dataclass(frozen=True)
class Relation(Plain):
    """The correlation of a parameter's individual means with a column, or with another parameter.

    `other` is the name of either, and `pair` tells whether it is a parameter's. Shrinkage makes
    such a correlation smaller or larger than that of the parameters themselves; `p` accounts for
    it: the probability that a right model, whose replicates shrink as much, has one as strong.
    """

    parameter: str
    other: str
    pair: bool
    correlation: float
    p: float


@dataclass(frozen=True)
class Consistency(Plain):
    """Whether the model is consistent with the experiments.

    `p` is the probability that a right model looks as bad in any of the `tests`. `consistent` is
    whether it is at least 0.05, and None where that could not be tested: `reason` says why.
    `discrepancies` are the strongest of those that contradict it, `outliers` the observations that
    one in twenty right models would not have. `replicates` under the fitted model say what is
    usual. `relations` are those of the individual parameters of experiments with several
    observations. `copies` are columns that the outcome determines: left out.
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

    def table(self) -> pd.DataFrame:
        """A row for each test, the one that says most first.

        >>> Consistency.untested("it was not asked for").table().empty
        True
        """
        frame = pd.DataFrame([vars(test) for test in self.tests])
        return frame if frame.empty else frame.sort_values("p", ignore_index=True)

    @classmethod
    def untested(cls, reason: str) -> Consistency:
        """A consistency without verdict, for a reason.

        >>> Consistency.untested("it was not asked for").consistent is None
        True
        """
        return cls(None, None, 0, reason=reason)


# ------------------------------------------------------------------------------------------- alpha


def in_order(
    alpha: Mapping[str, float | Estimate], hyperparameters: Sequence[Hyperparameter]
) -> Array:
    """The values (K,) of hyperparameters given by name, in the order of the model.

    Raises InputsError where one is missing or unknown, and for a value beyond its limits: surfaces
    and nodes are made for what lies between these.
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
