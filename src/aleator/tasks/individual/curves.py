"""The densities of the identified laws, as curves to draw."""

from __future__ import annotations

import numpy as np

from aleator.laws.inputs import Inputs
from aleator.types import Array

FARTHEST = 3.3
"""Standard normal variates where a curve ends: all but a thousandth of the law."""
POINTS = 121


def law_curves(inputs: Inputs, alpha: Array, experiments: int) -> dict[str, dict[str, list[float]]]:
    """`x` and `density` of each scattering parameter's law; with covariates the experiments' mean.

    p(x) = phi(theta)/(dx/dtheta) at x = T(theta).
    """
    theta = np.linspace(-FARTHEST, FARTHEST, POINTS)
    phi = np.exp(-0.5 * theta**2) / np.sqrt(2.0 * np.pi)
    values = inputs.values(alpha[: inputs.size], slice(0, experiments))
    found = {}
    for i in inputs.scattered:
        law, own = list(inputs.laws.values())[i], values[i]
        at = theta if own.ndim == 1 else np.broadcast_to(theta, (experiments, POINTS))
        image = law.standard(own, at)
        with np.errstate(divide="ignore"):
            x, density = _one(np.atleast_2d(image.x), np.atleast_2d(phi / image.dtheta))
        if np.all(np.isfinite(density)):
            found[inputs.names[i]] = {"x": x.tolist(), "density": density.tolist()}
    return found


def _one(x: Array, density: Array) -> tuple[Array, Array]:
    """The mean of the curves (B, J) of several experiments."""
    if len(x) == 1:
        return x[0], density[0]
    at = np.linspace(x.min(), x.max(), 2 * POINTS)
    return at, np.mean(
        [np.interp(at, *pair, 0.0, 0.0) for pair in zip(x, density, strict=True)], axis=0
    )
