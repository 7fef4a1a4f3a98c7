"""Additive measurement noise on one response."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

from aleator.errors import InputsError, require_filled
from aleator.laws import Hyperparameter, Specification, resolve
from aleator.observations.model import NormalError, ObservationModel, is_shaped


@dataclass(frozen=True)
class Noise:
    """Measured value = simulated value eta + error, independent per observation.

    p(y | eta, scale) is that of `kind`, by default e ~ Normal(0, scale^2), with

        scale^2 = sd^2 + (relative eta)^2

    `sd` carries the unit of the response: a number (known), `Free(lower, upper)` (identified, both
    limits needed), or the name of a column that holds a known sd for each row. `relative` is a
    share of eta, known or free. One of the two may be left out. Both are parts of the scale, which
    is the standard deviation of normal errors but not of every kind. With a "log" transform, eta
    and the sd are those of the logarithm.

    Raises InputsError where there is neither, one is zero, limits are missing or out of order, or
    `kind` lacks a member of `ObservationModel`.

    >>> Noise(0.002).hyperparameter.name
    'noise.sd'
    >>> from aleator.laws import Free
    >>> [h.name for h in Noise(Free(0.1, 1.0), relative=0.05).hyperparameters]
    ['noise.sd', 'noise.relative']
    """

    sd: Specification | str | None = None
    kind: ObservationModel = field(default_factory=NormalError)
    relative: Specification | None = None

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if self.sd is None and self.relative is None:
            raise InputsError("noise: neither sd nor relative is given", "give one of them")
        for name, value in (("sd", self.sd), ("relative", self.relative)):
            if value == 0:
                raise InputsError(f"noise: {name} = 0 is no noise", "leave the noise out")
        require_filled(self.kind, ObservationModel, "noise")
        _ = self.hyperparameters

    @property
    def normal(self) -> bool:
        """Whether the error is normal, so that it adds to moments and densities in closed form."""
        return isinstance(self.kind, NormalError)

    @property
    def simple(self) -> bool:
        """Whether one scale, known or free, is all that there is to the noise."""
        plain = self.sd is not None and not isinstance(self.sd, str)
        return plain and self.relative is None and not self.shapes

    @cached_property
    def shapes(self) -> tuple[Hyperparameter, ...]:
        """The free shapes of the kind, without a prefix."""
        return self.kind.shapes if is_shaped(self.kind) else ()

    @property
    def column(self) -> str | None:
        """The column of known sds, if the sd is one."""
        return self.sd if isinstance(self.sd, str) else None

    @property
    def hyperparameter(self) -> Hyperparameter:
        """The one hyperparameter of simple noise, `noise.sd`.

        Raises InputsError for every other noise, which has none or several.
        """
        if not self.simple:
            raise InputsError(
                "this noise is not one standard deviation, known or free, and more is known to the "
                "integral over individual parameters only",
                "give the noise by one sd: Noise(sd), without relative, a column or a free shape",
            )
        return self.hyperparameters[0]

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """`noise.sd` unless it is a column, `noise.relative`, then the free shapes of the kind."""
        found = []
        if self.sd is not None and not isinstance(self.sd, str):
            found.append(resolve("sd", self.sd, (None, None), positive=True))
        if self.relative is not None:
            found.append(resolve("relative", self.relative, (None, None), positive=True))
        return tuple(h.named("noise") for h in (*found, *self.shapes))
