"""What every way to exact moments offers: an offline step and an online step."""

from __future__ import annotations

from typing import Protocol

from aleator.expansion.moments.basis import Basis
from aleator.types import Array


class Powers(Protocol):
    """Means of powers of Z = sum_i z_i psi_i, exact for any coefficients z (N, P).

    The coefficient of the constant is zero: Z has mean zero. All that does not depend on z was
    computed before.
    """

    def means(self, z: Array) -> Array:
        """E[Z^m] for m = 0..M, as (N, M+1)."""
        ...

    def projections(self, z: Array) -> Array:
        """E[Z^m psi_i] for m = 0..M-1, as (N, M, P): the derivative of E[Z^(m+1)]/(m+1) by z_i."""
        ...


class Way(Protocol):
    """A choice of how exact moments are computed."""

    def powers(self, basis: Basis, order: int) -> Powers:
        """The offline step: what moments to `order` need of the basis alone."""
        ...
