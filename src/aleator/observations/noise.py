"""The measurement error of a response, as the user states it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from aleator.errors import InputsError, naming, require_filled
from aleator.laws import Hyperparameter, Specification, resolve
from aleator.observations.correlated import ErrorCorrelation
from aleator.observations.model import NormalError, ObservationModel, is_shaped
from aleator.observations.variance import VarianceFunction


@dataclass(frozen=True)
class Noise:
    """The measurement error of a response: measured value = simulated value eta + error.

    Their density p(y | eta, scale) is given by `kind`, by default Normal(0, scale^2), with

        scale^2 = sd^2 + (relative eta)^2

    `sd`, in the unit of the response, is a number (known), `Free(lower, upper)` (to be identified,
    both limits needed), or the name of a column that holds a known sd for each row. `relative` is a
    share of eta, known or free. One of the two may be left out. The scale is the standard deviation
    if the errors are normal, but not for every kind. With a "log" transform, eta and the sd are
    those of the logarithm. With a `variance`, `PowerVariance` or `ExponentialVariance`, the scale
    is the sd times a function of eta or of a column.

    The errors of different observations are independent, unless a `correlation` is given: `AR1`,
    `CAR1`, `CompoundSymmetry` or `GaussianProcess`, for normal errors measured exactly. It ties the
    errors of the response within an experiment: `Noise(Free(0.1, 1.0), correlation=AR1())` where
    errors that follow each other in a series are alike.

    Raises InputsError where neither sd nor relative is given, where one is zero, where limits are
    missing or out of order, where `kind` lacks a member of `ObservationModel`, for a `variance`
    beside `relative` or without sd, and for a `correlation` of errors that are not normal.

    >>> Noise(0.002).hyperparameter.name
    'noise.sd'
    >>> from aleator.laws import Free
    >>> [h.name for h in Noise(Free(0.1, 1.0), relative=0.05).hyperparameters]
    ['noise.sd', 'noise.relative']
    >>> from aleator.observations.correlated import AR1
    >>> [h.name for h in Noise(Free(0.1, 1.0), correlation=AR1()).hyperparameters]
    ['noise.sd', 'noise.rho']
    """

    sd: Specification | str | None = None
    kind: ObservationModel = field(default_factory=NormalError)
    relative: Specification | None = None
    variance: VarianceFunction | None = None
    correlation: ErrorCorrelation | None = None

    def __post_init__(self) -> None:
        """Check all arguments; InputsError if they are not valid."""
        if self.sd is None and self.relative is None:
            raise InputsError("noise: neither sd nor relative is given", "give one of them")
        for name, value in (("sd", self.sd), ("relative", self.relative)):
            if value == 0:
                other = self.relative if name == "sd" else self.sd
                out = "leave the noise out" if other is None else f"leave {name} out"
                raise InputsError(f"noise: {name} = 0 is no noise", out)
        require_filled(self.kind, ObservationModel, "noise")
        if self.variance is not None:
            require_filled(self.variance, VarianceFunction, "noise: variance")
            if self.relative is not None or self.sd is None:
                raise InputsError(
                    "noise: a variance function scales the sd, and no relative part",
                    "give sd and variance, without relative",
                )
        if self.correlation is not None:
            require_filled(self.correlation, ErrorCorrelation, "noise: correlation")
            if not self.normal:
                raise InputsError(
                    f"noise: the correlation of errors of the kind {self.kind.name} is not known "
                    "in closed form",
                    "leave out the kind, or the correlation",
                )
        for h in self.hyperparameters:
            if h.by is not None:
                raise InputsError(
                    f"{h.name} = '{h.by.formula}': a formula is for laws of parameters",
                    "give a number or limits; a variance function follows a column",
                )

    @property
    def normal(self) -> bool:
        """Whether the error is normal; then moments and densities with it have a closed form."""
        return isinstance(self.kind, NormalError)

    @property
    def simple(self) -> bool:
        """Whether one standard deviation, known or free, describes the whole noise."""
        plain = self.sd is not None and not isinstance(self.sd, str)
        alone = self.variance is None and self.correlation is None
        return plain and alone and self.relative is None and not self.shapes

    @cached_property
    def shapes(self) -> tuple[Hyperparameter, ...]:
        """The free shape hyperparameters of the kind, named without the prefix `noise.`."""
        return self.kind.shapes if is_shaped(self.kind) else ()

    @property
    def column(self) -> str | None:
        """The name of the column of known sds, or None if the sd is not given by a column."""
        return self.sd if isinstance(self.sd, str) else None

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of the table that the scale follows: known sds, the variance's covariate."""
        of = None if self.variance is None else self.variance.of
        return tuple(name for name in (self.column, of) if name is not None)

    @property
    def hyperparameter(self) -> Hyperparameter:
        """The hyperparameter `noise.sd` of simple noise, which has no other.

        Raises InputsError for noise that is not `simple`.
        """
        if not self.simple:
            raise InputsError(
                "this noise is not one standard deviation, known or free, and more is known to the "
                "integral over individual parameters only",
                "give the noise by one sd: Noise(sd), without relative, a column, a free shape, "
                "variance and correlation",
            )
        return self.hyperparameters[0]

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters of the noise, known or free.

        They are `noise.sd` (unless it is a column), `noise.relative` or that of the variance
        function if given, then the free shapes of the kind, then those of the correlation.
        """
        found = []
        with naming("noise"):
            if self.sd is not None and not isinstance(self.sd, str):
                found.append(resolve("sd", self.sd, (None, None), positive=True))
            if self.relative is not None:
                found.append(resolve("relative", self.relative, (None, None), positive=True))
        if self.variance is not None:
            found.append(self.variance.hyperparameter)
        ties = () if self.correlation is None else self.correlation.hyperparameters
        return tuple(h.named("noise") for h in (*found, *self.shapes, *ties))


def noise_columns(noise: Noise | Mapping[str, Noise] | None) -> tuple[str, ...]:
    """The columns of the table that the scales of the noise of one or several outcomes follow.

    >>> noise_columns({"life": Noise("error"), "width": Noise(0.1)})
    ('error',)
    """
    each = noise.values() if isinstance(noise, Mapping) else () if noise is None else (noise,)
    return tuple(dict.fromkeys(name for one in each for name in one.columns))
