"""The parts of an identification: plain values, with their places in its document."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from aleator.errors import InputsError, nearest
from aleator.laws import Hyperparameter
from aleator.types import Array

QUANTILES = (0.025, 0.25, 0.5, 0.75, 0.975)
ROUNDING = 1e-9
"""Share of a limit by which a value may lie beyond it, as it may have been written down."""


@dataclass(frozen=True)
class Estimate:
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
class ParameterCorrelation:
    """Correlation of two parameters under the identified law, whatever it was identified by.

    That of their standard normal variates, theirs too where both laws are normal. `standard_error`
    by the delta method; None where the correlation is known, or rests on an estimate without one.
    """

    between: tuple[str, str]
    estimate: float
    standard_error: float | None


@dataclass(frozen=True)
class LogLikelihoodReport:
    """The log-likelihood as `estimated` by the densities and as `verified` on the simulator itself.

    `error` is that of `estimated`: its difference from what was verified and the standard error of
    that together, or without a check what finer nodes change; None where neither is known.
    `verified` is None without a check, and where it did not reach every experiment: `reached` has
    then the number of `experiments` that it did, and their sum as `estimated`, `verified` and
    `standard_error`. `log_prior` is that of the priors, where a hyperparameter has one: the sum of
    both is what was maximized.
    """

    estimated: float
    verified: float | None
    verified_standard_error: float | None
    reached: Mapping[str, float] | None = None
    log_prior: float | None = None
    error: float | None = None


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
class IndividualReport:
    """What is known of one experiment with several observations.

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


@dataclass(frozen=True)
class ObservationReport:
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

    @property
    def censored(self) -> bool:
        """Whether only bounds of the value are known."""
        return self.lower is None or self.lower != self.upper


def in_order(
    alpha: Mapping[str, float | Estimate], hyperparameters: Sequence[Hyperparameter]
) -> Array:
    """The values (K,) of named hyperparameters, in the order of the model.

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
        slack = ROUNDING * max(abs(h.lower), abs(h.upper))
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
