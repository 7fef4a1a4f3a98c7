"""Hyperparameters, either fixed or free within limits, and their prior densities."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import Protocol

import numpy as np
from scipy import special

from aleator.core.types import Array, Indices
from aleator.errors import InputsError, disordered


class PriorLaw(Protocol):
    """The members of a law that a prior uses; every `Law` has them."""

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters of the prior's law, all of which must be known numbers."""

    @property
    def scatters(self) -> bool:
        """Whether the law scatters, as every law but a constant does."""

    def log_density(self, values: Array, x: Array) -> Array:
        """The log-density log f(x) at each x (J,), minus infinity outside the support."""

    def normal_score(self, values: Array, x: Array) -> Array:
        """The normal score Phi^-1(F(x)) at each x (J,)."""

    def quantile(self, values: Array, probability: Array) -> Array:
        """The quantile of the law at each probability."""


@dataclass(frozen=True)
class Free:
    """A hyperparameter to be identified between `lower` and `upper`, searched from `start`.

    A limit of None stands for the default of the law. A law has default limits only where the range
    of its parameter is finite. Both limits have the unit of the hyperparameter. `prior` is a law
    with known values: the prior distribution of the hyperparameter. Without a prior all values
    between the limits count alike. Raises InputsError for a lower limit that is not below the upper
    one.

    >>> Free(0.5, 1.5, start=1.0)
    Free(lower=0.5, upper=1.5, start=1.0, prior=None)
    >>> Free(10.0, 5.0)
    Traceback (most recent call last):
    aleator.errors.InputsError: Free(10, 5): the lower limit 10 is above the upper limit 5
      Remedy: write 5, 10
    """

    lower: float | None = None
    upper: float | None = None
    start: float | None = None
    prior: PriorLaw | None = None

    def __post_init__(self) -> None:
        low, high = self.lower, self.upper
        if isinstance(low, Real) and isinstance(high, Real) and low >= high:
            problem, remedy = disordered(float(low), float(high))
            raise InputsError(f"{type(self).__name__}({low:g}, {high:g}): {problem}", remedy)


@dataclass(frozen=True, init=False)
class By(Free):
    """A hyperparameter that is a formula of the experiments' covariates, with coefficients.

    Its value in experiment l is sum_j X_lj beta_j. The columns of X are made from `formula` by the
    package formulaic, for example ``By("1 + temperature + C(supplier)")``. `lower` and `upper` are
    limits of the value, such as the mean, in every experiment, not of a coefficient; where left out
    they are the defaults of the law. The limits of the coefficients are derived from them. `terms`
    gives numbers or limits to single coefficients, by the names that `Inputs.resolved` uses:
    ``{"temperature": Free(0.0, 1.0)}``.

    >>> By("1 + temperature", 0.0, 10.0).upper
    10.0
    """

    formula: str = ""
    terms: Mapping[str, float | Free] = field(default_factory=dict, hash=False)

    def __init__(
        self,
        formula: str,
        lower: float | None = None,
        upper: float | None = None,
        start: float | None = None,
        terms: Mapping[str, float | Free] | None = None,
    ) -> None:
        super().__init__(lower, upper, start)
        object.__setattr__(self, "formula", formula)
        object.__setattr__(self, "terms", dict(terms or {}))


@dataclass(frozen=True, init=False)
class Between(Free):
    """A hyperparameter that is only bounded: it lies between two numbers, and is not identified.

    No value between the bounds is more probable than another. An identification holds it at
    `start`, by default the middle; `Identification.p_box` moves it through its bounds.

    >>> Between(0.9, 1.1)
    Between(lower=0.9, upper=1.1, start=None, prior=None)
    """

    def __init__(self, lower: float, upper: float, start: float | None = None) -> None:
        super().__init__(lower, upper, start)


OPEN = Free()
"""A hyperparameter to be identified within the law's default limits."""

Specification = float | Free
"""A hyperparameter as the user states it: a number, `Free` (identified), `Between` (bounded)."""


@dataclass(frozen=True)
class LimitSettings:
    """Settings for limits of hyperparameters: how near to zero, and the default limits of an sd.

    The values are chosen by judgement and checked by tests/laws/test_images.py. zero: a lower limit
    of a scale that is below this share of the upper limit stands for zero. nearest: the default
    start of a scale that may be zero is found as if its lower limit were this share of its upper
    limit. sd: the default lower and upper limit of an sd, relative to the width of the limits of
    its mean.
    """

    zero: float = 1e-6
    nearest: float = 1e-3
    sd: tuple[float, float] = (1e-3, 0.5)


LIMITS = LimitSettings()


@dataclass(frozen=True)
class Beside:
    """A sum of a hyperparameter v and multiples of others, which a search uses in place of v.

    The sum is v + sum_j factor_j v_j. `terms` has the name and the factor of each of the other
    hyperparameters v_j; `lower` and `upper` are limits of the sum. Experiments determine the sum
    better than v alone. For example, an intercept v is the value at zero covariates, which may be
    far from all experiments; the sum is then the value at the mean of the covariates.
    """

    terms: tuple[tuple[str, float], ...]
    lower: float
    upper: float


@dataclass(frozen=True)
class Hyperparameter:
    """One hyperparameter with its limits, its start, and whether it is identified (`free`).

    One that is not free is a known number, with equal limits, or is only `bounded` by its limits.
    With `log` the search uses its logarithm, as for a standard deviation. `by` is the formula of
    covariates that gives its value, until a table replaces it by coefficients. `beside` names other
    hyperparameters whose multiples the search adds to this one (see `Beside`). `prior` is its prior
    density; None stands for a flat one.
    """

    name: str
    lower: float
    upper: float
    start: float
    free: bool
    log: bool = False
    by: By | None = None
    beside: Beside | None = None
    prior: Prior | None = None

    @property
    def is_number(self) -> bool:
        """Whether it is a number: neither identified nor only bounded."""
        return self.lower == self.upper

    @property
    def bounded(self) -> bool:
        """Whether it is only bounded by its limits, and not identified (see `Between`)."""
        return not (self.free or self.is_number)

    @property
    def reaches_zero(self) -> bool:
        """Whether the hyperparameter is a scale whose lower limit stands for zero."""
        return self.log and self.lower <= LIMITS.zero * self.upper

    @property
    def location(self) -> bool:
        """Whether it is the mean of a law, the value of a constant, or a coefficient of these.

        >>> resolve("v.mean", Free(0.0, 1.0), (None, None)).location
        True
        """
        return self.name.partition("[")[0].rpartition(".")[2] in ("mean", "value")

    def named(self, prefix: str) -> Hyperparameter:
        """This hyperparameter with the name ``prefix.name``."""
        return replace(self, name=f"{prefix}.{self.name}")


def _with_limits(specification: Free) -> str:
    """The text, for a message, that shows how limits are written in Python and in a study.toml."""
    if not isinstance(specification, By):
        return "{lower = ..., upper = ...} in study.toml, Free(lower, upper) in Python"
    formula = specification.formula
    return (
        f'{{formula = "{formula}", lower = ..., upper = ...}} in study.toml, '
        f'By("{formula}", lower, upper) in Python'
    )


def resolve(
    name: str,
    specification: Specification,
    default: tuple[float | None, float | None],
    *,
    positive: bool = False,
    least: float | None = None,
) -> Hyperparameter:
    """The hyperparameter that a specification states, with limits left out taken from `default`.

    `positive` says that only values above zero are admissible. The lower limit may still be stated
    as zero where `least` is given: it is then replaced by `least` times the upper limit, because
    there is no density at zero itself. Raises InputsError where a limit is missing, not finite, out
    of order, or not positive although it must be, where the start lies outside the limits, and for
    a prior that cannot be used.
    """
    if not isinstance(specification, Free):
        if not isinstance(specification, Real):
            raise InputsError(
                f"{name} = {specification!r} is neither a number nor Free(lower, upper)",
                f"write {name}=Free(lower, upper) to identify it, a number to fix it, or "
                f'{name}=By("1 + temperature") to let it follow covariates',
            )
        value = float(specification)
        _require(math.isfinite(value), f"{name} = {value} is not finite", "give a finite number")
        if positive:
            _require(value >= 0.0, f"{name} = {value} is negative", "give a number > 0")
            _require(value > 0.0, f"{name} = 0: no scatter", "use Constant instead")
        return Hyperparameter(name, value, value, value, free=False, log=positive)
    lower = default[0] if specification.lower is None else float(specification.lower)
    upper = default[1] if specification.upper is None else float(specification.upper)
    if lower is None or upper is None or not (math.isfinite(lower) and math.isfinite(upper)):
        raise InputsError(
            f"{name} is to be identified but has no finite lower and upper limit",
            f"give {name} a lower and an upper limit, {_with_limits(specification)}; a truncated "
            "normal or a beta law takes them from a finite box",
        )
    problem, remedy = disordered(lower, upper)
    _require(lower < upper, f"{name}: {problem}", remedy)
    if positive and least is not None and lower == 0.0:
        lower = least * upper
    if positive:
        _require(
            lower > 0.0,
            f"{name}: lower {lower} is not above zero",
            "give a small positive lower limit, such as a thousandth of the upper one",
        )
    nearest_zero = max(lower, LIMITS.nearest * upper) if lower <= LIMITS.zero * upper else lower
    free = not isinstance(specification, Between)
    middle = math.sqrt(nearest_zero * upper) if positive and free else 0.5 * (lower + upper)
    start = middle if specification.start is None else float(specification.start)
    _require(
        lower <= start <= upper,
        f"{name}: start {start} is outside its limits [{lower}, {upper}]",
        "move the start between the limits",
    )
    by = specification if isinstance(specification, By) else None
    law = specification.prior
    prior = None if law is None else Prior.of(law, name, lower, upper)
    return Hyperparameter(name, lower, upper, start, free, log=positive, by=by, prior=prior)


def location_and_scale(
    mean: Specification, sd: Specification, least: float = LIMITS.zero
) -> tuple[Hyperparameter, Hyperparameter]:
    """The hyperparameters `mean` and `sd` of a law whose parameter has no stated range.

    The mean, if free, needs stated limits. Default limits of the sd are 1/1000 and 1/2 of the width
    of the mean's limits. A lower limit of zero for the sd becomes `least` times its upper limit.
    """
    center = resolve("mean", mean, (None, None))
    width = center.upper - center.lower
    limits = (LIMITS.sd[0] * width, LIMITS.sd[1] * width) if width > 0.0 else (None, None)
    return center, resolve("sd", sd, limits, positive=True, least=least)


def require_above(
    end: float, pair: tuple[Hyperparameter, Hyperparameter]
) -> tuple[Hyperparameter, Hyperparameter]:
    """The given mean and sd; raises InputsError where the mean may reach the law's lower end."""
    _require(math.isfinite(end), f"lower = {end} is not finite", "give a finite lower end")
    _require(
        pair[0].lower > end,
        f"mean: {pair[0].lower} is not above the lower end {end} of the law"
        + ("" if pair[0].by is None else "; the limits of By(...) are those of the mean itself"),
        f"let the mean stay above it, or give the law another end: lower=..., now {end}",
    )
    return pair


def widest_above(
    end: float, pair: Sequence[Hyperparameter], largest_variation: float
) -> list[Array]:
    """Two pairs of values (mean, sd), one of which gives the law with the farthest upper tail.

    The laws compared have the lower end `end` and values within the limits. The sd is at its upper
    limit, but at most `largest_variation` times mean - end.
    """
    mean, sd = pair
    center = max(mean.lower, min(mean.upper, end + sd.upper / largest_variation))
    return [
        np.array([m, min(sd.upper, largest_variation * (m - end))]) for m in (center, mean.upper)
    ]


def filled(hyperparameters: Sequence[Hyperparameter], center: float, sd: float | None) -> Array:
    """The values (mean, sd) moved into their limits; the sd is at its start where `sd` is None."""
    spread = hyperparameters[1].start if sd is None else sd
    return within(hyperparameters, [center, spread])


def within(hyperparameters: Sequence[Hyperparameter], values: Sequence[float]) -> Array:
    """The values (k,), each moved into its limits; a fixed one keeps its value.

    >>> within([resolve("mean", Free(0.0, 1.0), (None, None))], [3.0]).tolist()
    [1.0]
    """
    return np.asarray(np.clip(np.asarray(values, dtype=float), *limits_of(hyperparameters)))


def limits_of(
    hyperparameters: Sequence[Hyperparameter], which: Indices | None = None
) -> tuple[Array, Array]:
    """The lower limits (k,) and the upper limits (k,) of all hyperparameters, or of those `which`.

    >>> limits_of([resolve("mean", Free(0.0, 1.0), (None, None))])
    (array([0.]), array([1.]))
    """
    chosen = hyperparameters if which is None else [hyperparameters[k] for k in which]
    return np.array([h.lower for h in chosen]), np.array([h.upper for h in chosen])


def _require(condition: bool, problem: str, remedy: str) -> None:
    if not condition:
        raise InputsError(problem, remedy)


@dataclass(frozen=True)
class PriorSteps:
    """Settings for priors, mostly for their numerical derivatives.

    The values are chosen by tests/laws/test_prior.py. step: the step of differences, relative to a
    quarter of the distance between the quartiles of the prior; near an end where the density
    vanishes or is infinite, relative to the distance to that end. wider: the step for the second
    derivative divided by the step for the first. share: the smallest probability that the prior may
    have between the limits of its hyperparameter.
    """

    step: float = 1e-3
    wider: float = 10.0
    share: float = 1e-3


STEPS = PriorSteps()
_CENTRAL = np.array([[-2.0, -1.0, 1.0, 2.0], [1 / 12, -2 / 3, 2 / 3, -1 / 12]])
_ONWARD = np.array([[0.0, 1.0, 2.0, 3.0, 4.0], [-25 / 12, 4.0, -3.0, 4 / 3, -1 / 4]])
"""Places and weights of one-sided differences of fourth order, for densities that end abruptly.

`_CENTRAL` has the places and weights of central differences.
"""


@dataclass(frozen=True)
class Prior:
    """The prior density p(v) of a hyperparameter v: the density of a law with known values.

    `step` is the step of its numerical derivatives. `soft` are the ends of the support (lower,
    upper) at which the log-density is not finite, `hard` the ends at which it is finite; an end
    that is not of this kind is infinite. The density is not normalized again on the limits of v,
    because a constant factor changes neither the maximum nor the posterior.

    >>> from aleator.laws import Normal
    >>> prior = Prior.of(Normal(1.0, 0.1), "x.mean", 0.5, 1.5)
    >>> prior.log_density(1.2), prior.slope(1.2)    # log N(1.2; 1, 0.1^2), -(1.2 - 1)/0.1^2
    (-0.6163534, -20.0)
    """

    law: PriorLaw
    step: float
    soft: tuple[float, float]
    hard: tuple[float, float]

    @classmethod
    def of(cls, law: PriorLaw, name: str, lower: float, upper: float) -> Prior:
        """The prior of the hyperparameter `name` with these limits.

        Raises InputsError where the law has free hyperparameters, is a constant, has no finite
        density at a limit, or has hardly any probability between the limits.
        """
        free = [h.name for h in law.hyperparameters if h.free]
        if free:
            raise InputsError(
                f"{name}: the prior leaves {', '.join(free)} to be identified",
                "a prior is known: give it numbers",
            )
        if not law.scatters:
            raise InputsError(
                f"{name}: a constant is no prior", f"fix {name} at that number instead"
            )
        values = _values_of(law)
        ends = law.log_density(values, np.array([lower, upper]))
        for end, at in zip(("lower", "upper"), ends.tolist(), strict=True):
            if not np.isfinite(at):
                limit = lower if end == "lower" else upper
                raise InputsError(
                    f"{name}: the prior has no finite density at the {end} limit {limit:g}",
                    f"move the {end} limit to where the prior has one",
                )
        held = _held(law, values, lower, upper)
        if held < STEPS.share:
            raise InputsError(
                f"{name}: the limits [{lower:g}, {upper:g}] hold {held:.2g} of the prior",
                "move the limits to where the prior is, or mend the prior",
            )
        low, first, third, high = law.quantile(values, np.array([0.0, 0.25, 0.75, 1.0])).tolist()
        with np.errstate(all="ignore"):
            stops = np.isfinite(law.log_density(values, np.array([low, high])))
        return cls(
            law,
            STEPS.step * 0.25 * (third - first),
            (-math.inf if stops[0] else low, math.inf if stops[1] else high),
            (low if stops[0] else -math.inf, high if stops[1] else math.inf),
        )

    def log_density(self, value: float) -> float:
        """The log-density log p(v) of the prior; minus infinity outside its support."""
        return float(self.law.log_density(_values_of(self.law), np.array([value]))[0])

    def slope(self, value: float) -> float:
        """The derivative d log p/dv by a difference of fourth order, with a relative error of 1e-8.

        Zero where v lies at or beyond an end at which the log-density is not finite.
        """
        step = min(
            self.step, STEPS.step * (value - self.soft[0]), STEPS.step * (self.soft[1] - value)
        )
        if not step > 0.0:
            return 0.0
        places, weights = _CENTRAL
        if value - self.hard[0] < 3.0 * step:
            places, weights = _ONWARD
        elif self.hard[1] - value < 3.0 * step:
            places, weights = -_ONWARD[0], -_ONWARD[1]
        found = self.law.log_density(_values_of(self.law), value + step * places)
        return float(found @ weights / step)

    def curvature(self, value: float) -> float:
        """The curvature -d2 log p/dv2 by a difference of slopes; a negative one counts as zero."""
        step = min(
            STEPS.wider * self.step, 0.5 * (value - self.soft[0]), 0.5 * (self.soft[1] - value)
        )
        if not step > 0.0:
            return 0.0
        bent = (self.slope(value - step) - self.slope(value + step)) / (2.0 * step)
        return max(bent, 0.0)


def curvatures(hyperparameters: Sequence[Hyperparameter], alpha: Array) -> Array:
    """The curvatures -d2 log p/dalpha_k2 (K,) of the priors; zero where there is no prior."""
    return _by_prior(hyperparameters, alpha, Prior.curvature)


def log_prior(hyperparameters: Sequence[Hyperparameter], alpha: Array) -> float:
    """The log prior density sum_k log p(alpha_k) over the hyperparameters with a prior, or 0."""
    return float(sum(_by_prior(hyperparameters, alpha, Prior.log_density)))


def prior_score(hyperparameters: Sequence[Hyperparameter], alpha: Array) -> Array | None:
    """The derivative (K,) of the log prior by alpha; None where there is no prior."""
    return _by_prior(hyperparameters, alpha, Prior.slope) if has_prior(hyperparameters) else None


def _by_prior(
    hyperparameters: Sequence[Hyperparameter], alpha: Array, of: Callable[[Prior, float], float]
) -> Array:
    pairs = zip(hyperparameters, alpha.tolist(), strict=True)
    return np.array([0.0 if h.prior is None else of(h.prior, value) for h, value in pairs])


def has_prior(hyperparameters: Sequence[Hyperparameter]) -> bool:
    """Whether any hyperparameter has a prior; a search then maximizes the posterior density."""
    return any(h.prior is not None for h in hyperparameters)


def _values_of(law: PriorLaw) -> Array:
    return np.array([h.start for h in law.hyperparameters])


def _held(law: PriorLaw, values: Array, lower: float, upper: float) -> float:
    """The probability that the prior law has between the two limits."""
    score = law.normal_score(values, np.array([lower, upper]))
    return float(special.ndtr(score[1]) - special.ndtr(score[0]))
