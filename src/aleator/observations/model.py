"""What a measured value says of the simulated one: the observation model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol, TypeGuard

from aleator.laws import Hyperparameter
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


class Bounded(ObservationModel, Protocol):
    """An observation model that also computes probabilities of bounds itself, exact in both tails.

    That of a model without it is the difference of its `cdf`, which loses the upper tail.
    """

    def log_probability(self, lower: Array, upper: Array, eta: Array, scale: Array) -> Observed:
        """log P(lower < y < upper | eta, scale), d/d eta and d/d scale; ends may be infinite."""


class Curved(ObservationModel, Protocol):
    """An observation model whose log density has a second derivative in closed form.

    That of a model without it is a difference.
    """

    def curvature(self, y: Array, eta: Array, scale: Array) -> Array:
        """-d2 log p(y | eta, scale)/d eta2, which may be negative."""


class Shaped(ObservationModel, Protocol):
    """An observation model with hyperparameters of its own beside the scale.

    Where none of them is free `shapes` is empty, and the model is used as it is.
    """

    @property
    def shapes(self) -> tuple[Hyperparameter, ...]:
        """The free shapes, named without a prefix."""

    def at(self, values: Sequence[float]) -> ObservationModel:
        """The model with these values of its `shapes`."""

    def by_shapes(
        self, values: Sequence[float], lower: Array, upper: Array, eta: Array, scale: Array
    ) -> tuple[Array, ...]:
        """The derivative by each of the `shapes` at these values.

        It is that of the log density where lower and upper are equal, and of the log probability
        between them where they are not.
        """


# A look at one name: checks of a whole protocol cost more than what is asked in a hot path.
def is_bounded(model: ObservationModel) -> TypeGuard[Bounded]:
    """Whether a model computes probabilities of bounds itself."""
    return hasattr(model, "log_probability")


def is_curved(model: ObservationModel) -> TypeGuard[Curved]:
    """Whether a model knows its second derivative."""
    return hasattr(model, "curvature")


def is_shaped(model: ObservationModel) -> TypeGuard[Shaped]:
    """Whether a model has shapes that are free."""
    return bool(getattr(model, "shapes", ()))
