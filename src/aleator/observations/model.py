"""What a measured value says of the simulated one: the observation model."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from aleator.types import Array


class Observed(NamedTuple):
    """log p(y | eta, scale) with its derivatives by eta and by the scale, elementwise."""

    value: Array
    d_eta: Array
    d_scale: Array


class ObservationModel(Protocol):
    """The distribution of a measured value y, given the simulated value eta and a scale.

    Everything is elementwise: y, eta and the scale broadcast against each other, in the unit of the
    outcome. The scale is positive. A new kind of measurement error fills this protocol in a file of
    its own; nothing else in the package knows which kinds there are.
    """

    @property
    def name(self) -> str:
        """Name for reports and for `[noise] kind` in a study."""

    @property
    def reach(self) -> float:
        """Scales beyond which a measured value cannot lie from the simulated one; may be infinite.

        Mass below 1e-15 counts as none.
        """

    def log_density(self, y: Array, eta: Array, scale: Array) -> Observed:
        """log p(y | eta, scale), d/d eta and d/d scale; minus infinity where y cannot be."""

    def cdf(self, y: Array, eta: Array, scale: Array) -> Array:
        """Probability of a measured value not above y."""

    def quantile(self, probability: Array, eta: Array, scale: Array) -> Array:
        """The measured value that is not exceeded with a probability."""

    def moments(self, order: int) -> Array:
        """E[((y - eta)/scale)^m] for m from 0 to `order`, (order + 1,); NaN where there is none."""
