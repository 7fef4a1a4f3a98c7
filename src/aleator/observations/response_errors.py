"""The measurement errors of one response."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aleator.observations.bounds import observed
from aleator.observations.model import ObservationModel, Shaped, shapes_of
from aleator.observations.noise import Noise
from aleator.types import Array, Indices

FARTHEST = 1e140
"""An eta beyond which nothing changes, and whose square exists."""
STEP = 1e-4
"""Step in scales of the difference that gives a curvature; its error is about 1e-8."""


class Scale(NamedTuple):
    """sqrt(sd^2 + (relative eta)^2), with its derivatives by eta, sd and relative.

    Without a relative part the derivatives are None: they are 0, 1 and none.
    """

    value: Array
    d_eta: Array | None = None
    d_sd: Array | None = None
    d_relative: Array | None = None


@dataclass(frozen=True, eq=False)
class ResponseErrors:
    """The m observations of one response, and their noise.

    `rows` (m,) are their positions among all observations, in order; `lower` and `upper` (m, 1)
    their ends; `known` (m, 1) the sds of a column. `values` are those of `noise.hyperparameters`
    everywhere here, and `own` a slice of the m observations whose simulated values eta are (k, J).
    """

    noise: Noise
    rows: Indices
    lower: Array
    upper: Array
    known: Array | None = None

    def scale(self, values: Sequence[float], eta: Array, own: slice) -> Scale:
        """The scale of the errors, () or (k, 1) or (k, J)."""
        sd = self._sd(values, own)
        if self.noise.relative is None:
            return Scale(sd)
        relative = values[self._scales - 1]
        eta = np.clip(eta, -FARTHEST, FARTHEST)
        scale = np.sqrt(sd**2 + (relative * eta) ** 2)
        return Scale(scale, relative**2 * eta / scale, sd / scale, relative * eta**2 / scale)

    def model(self, values: Sequence[float]) -> ObservationModel:
        """The kind of the noise with the values of its shapes."""
        kind = self.noise.kind
        return kind.at(values[self._scales :]) if isinstance(kind, Shaped) else kind

    def terms(self, values: Sequence[float], eta: Array, own: slice) -> list[Array]:
        """log p (k, J), its derivative by eta, then that by each of the values.

        Where p is zero or eta is no number, log p is minus infinity and derivatives are zero.
        """
        with np.errstate(all="ignore"):
            lower, upper, scale = self.lower[own], self.upper[own], self.scale(values, eta, own)
            seen = observed(self.model(values), lower, upper, eta, scale.value)
            by_scale = seen.d_scale
            found = [seen.value, seen.d_eta]
            if scale.d_eta is not None:
                found[1] = seen.d_eta + by_scale * scale.d_eta
            if self._free_sd:
                found.append(by_scale if scale.d_sd is None else by_scale * scale.d_sd)
            if scale.d_relative is not None:
                found.append(by_scale * scale.d_relative)
            kind = self.noise.kind
            if isinstance(kind, Shaped) and kind.shapes:
                shapes = values[self._scales :]
                found += kind.by_shapes(shapes, lower, upper, eta, scale.value)
            return _finite(found)

    def curvature(self, values: Sequence[float], eta: Array, own: slice) -> Array:
        """-d2 log p/d eta2 (k, J), floored at zero: 1/scale^2 of exact values with normal noise."""
        with np.errstate(all="ignore"):
            scale = self.scale(values, eta, own)
            plain = self.noise.normal and scale.d_eta is None
            if plain and np.all(self.lower[own] == self.upper[own]):
                return np.broadcast_to(1.0 / scale.value**2, eta.shape)
            step = STEP * scale.value
            above, below = (self.terms(values, eta + h, own)[1] for h in (step, -step))
            bent = (below - above) / (2.0 * step)
            return np.where(np.isfinite(bent), np.maximum(bent, 0.0), 0.0)

    @property
    def _free_sd(self) -> bool:
        """Whether the sd is a hyperparameter, and not a column or left out."""
        return self.noise.sd is not None and self.noise.column is None

    @property
    def _scales(self) -> int:
        """How many of the values are of the scale; the rest are shapes."""
        return len(self.noise.hyperparameters) - len(shapes_of(self.noise.kind))

    def _sd(self, values: Sequence[float], own: slice) -> Array:
        if self.known is not None:
            return self.known[own]
        return np.asarray(values[0] if self._free_sd else 0.0)


def _finite(found: list[Array]) -> list[Array]:
    # A sum is finite if all its terms are, and costs one pass. Of these two, because an infinite
    # derivative by the scale comes with an infinite log p.
    if all(np.isfinite(np.sum(part)) for part in found[:2]):
        return found
    fine = np.logical_and.reduce([np.isfinite(part) for part in found])
    return [np.where(fine, part, 0.0 if k else -np.inf) for k, part in enumerate(found)]
