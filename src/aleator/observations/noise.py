"""Additive measurement noise on the outcome."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

from aleator.errors import InputsError, require_filled
from aleator.laws import Hyperparameter, Specification, resolve
from aleator.observations.model import ObservationModel
from aleator.observations.normal import NormalError


@dataclass(frozen=True)
class Noise:
    """Measured outcome = simulated outcome + error, independent per experiment.

    p(y | eta, sd) is that of `kind`, by default e ~ Normal(0, sd^2). `sd` is its scale, which is
    the standard deviation of normal errors but not of every kind, and carries the unit of the
    outcome: a number (known) or `Free(lower, upper)` (identified, both limits needed). Raises
    InputsError where it is zero, the limits are missing or out of order, or `kind` lacks a member
    of `ObservationModel`.

    >>> Noise(0.002).hyperparameter.name
    'noise.sd'
    """

    sd: Specification
    kind: ObservationModel = field(default_factory=NormalError)

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if self.sd == 0:
            raise InputsError("noise: sd = 0 is no noise", "leave the noise out")
        require_filled(self.kind, ObservationModel, "noise")
        _ = self.hyperparameter

    @property
    def normal(self) -> bool:
        """Whether the error is normal, so that it adds to moments and densities in closed form."""
        return isinstance(self.kind, NormalError)

    @cached_property
    def hyperparameter(self) -> Hyperparameter:
        """The one hyperparameter, `noise.sd`."""
        return resolve("sd", self.sd, (None, None), positive=True).named("noise")
