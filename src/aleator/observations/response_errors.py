"""The measurement errors of one response."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from aleator.observations.errors import Noise
from aleator.observations.model import ObservationModel, Observed, is_curved, is_shaped, observed
from aleator.types import Array, Flags, Indices

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
        return kind.at(values[self._scales :]) if is_shaped(kind) else kind

    def terms(self, values: Sequence[float], eta: Array, own: slice) -> list[Array]:
        """log p (k, J), its derivative by eta, then that by each of the values.

        Where p is zero or eta is no number, log p is minus infinity and derivatives are zero.
        """
        with np.errstate(all="ignore"):
            scale, seen = self._seen(values, eta, own)
            by_scale = seen.d_scale
            found = [seen.value, seen.d_eta]
            if self._free_sd:
                found.append(by_scale if scale.d_sd is None else by_scale * scale.d_sd)
            if scale.d_relative is not None:
                found.append(by_scale * scale.d_relative)
            kind = self.noise.kind
            if is_shaped(kind):
                shapes, ends = values[self._scales :], (self.lower[own], self.upper[own])
                found += kind.by_shapes(shapes, *ends, eta, scale.value)
            return _finite(found)

    def curvature(self, values: Sequence[float], eta: Array, own: slice) -> Array:
        """-d2 log p/d eta2 (k, J), floored at zero.

        In closed form where the scale does not depend on eta, for exact values and for normal
        errors: p solves the heat equation dp/d scale = scale d2p/d eta2, so that the curvature is
        (d log p/d eta)^2 - (d log p/d scale)/scale, for bounds too. Else a difference.
        """
        with np.errstate(all="ignore"):
            scale, model = self.scale(values, eta, own), self.model(values)
            if is_curved(model) and scale.d_eta is None and np.all(self._exact[own]):
                # The floor takes the place of what is no number, too.
                return np.fmax(model.curvature(self.upper[own], eta, scale.value), 0.0)
            if self.noise.normal and scale.d_eta is None:
                seen = self._seen(values, eta, own)[1]
                return np.fmax(seen.d_eta**2 - seen.d_scale / scale.value, 0.0)
            step = STEP * scale.value
            above, below = (self._seen(values, eta + h, own)[1].d_eta for h in (step, -step))
            bent = (below - above) / (2.0 * step)
            return np.where(np.isfinite(bent), np.maximum(bent, 0.0), 0.0)

    def _seen(self, values: Sequence[float], eta: Array, own: slice) -> tuple[Scale, Observed]:
        """The scale, and log p with the whole derivative by eta and that by the scale."""
        scale, lower, upper = self.scale(values, eta, own), self.lower[own], self.upper[own]
        seen = observed(self.model(values), lower, upper, eta, scale.value, self._exact[own])
        if scale.d_eta is not None:
            seen = seen._replace(d_eta=seen.d_eta + seen.d_scale * scale.d_eta)
        return scale, seen

    @cached_property
    def _exact(self) -> Flags:
        """Which observations are known exactly, bool (m,)."""
        return np.asarray((self.lower == self.upper)[:, 0])

    @cached_property
    def _free_sd(self) -> bool:
        """Whether the sd is a hyperparameter, and not a column or left out."""
        return self.noise.sd is not None and self.noise.column is None

    @cached_property
    def _scales(self) -> int:
        """How many of the values are of the scale; the rest are shapes."""
        return len(self.noise.hyperparameters) - len(self.noise.shapes)

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
