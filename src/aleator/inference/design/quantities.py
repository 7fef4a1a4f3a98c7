"""How a predicted quantile or probability moves with the hyperparameters."""

from __future__ import annotations

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicSpline

from aleator.inference.design.scores import Scores, simpson
from aleator.types import Array

NEWTON = 4
"""Steps that bring a quantile from between two nodes to where it is."""


def quantile_gradients(found: Scores, probability: float) -> tuple[Array, Array]:
    """Quantiles q (C,) of the outcomes, and dq/dalpha (C, K) = -(dF/dalpha)(q) / f(q).

    F is the distribution function and dF/dalpha = int_{-inf}^q s f dy, both from the nodes of the
    scores. Needs one observation an experiment.
    """
    y, below, slopes, density = _distribution(found)
    rising = np.maximum.accumulate(below, axis=0)
    q = np.array([np.interp(probability, F, nodes) for F, nodes in zip(rising.T, y.T, strict=True)])
    for _ in range(NEWTON):
        error = _at(y, below[..., None], q) - probability
        q = np.clip(q - (error / _at(y, density[..., None], q))[:, 0], y[0], y[-1])
    return q, -_at(y, slopes, q) / _at(y, density[..., None], q)


def probability_gradients(found: Scores, limit: float) -> tuple[Array, Array]:
    """P(outcome <= limit) (C,) and its derivatives (C, K) by alpha."""
    y, below, slopes, _ = _distribution(found)
    at = np.clip(limit, y[0], y[-1])
    return np.clip(_at(y, below[..., None], at)[:, 0], 0.0, 1.0), _at(y, slopes, at)


def _distribution(found: Scores) -> tuple[Array, Array, Array, Array]:
    """Nodes y (R, C), F (R, C), dF/dalpha (R, C, K) and f (R, C) at them, without limits."""
    assert found.outcomes is not None
    y = found.outcomes
    step = np.diff(y, axis=0).mean(axis=0)
    density = found.weights / (simpson(len(y))[:, None] * step)
    moved = density[..., None] * found.scores
    below = cumulative_simpson(density, dx=1.0, axis=0, initial=0.0) * step
    slopes = cumulative_simpson(moved, dx=1.0, axis=0, initial=0.0) * step[:, None]
    return y, below, slopes, density


def _at(nodes: Array, values: Array, y: Array) -> Array:
    """Values (R, C, K) interpolated at y (C,) from their nodes (R, C)."""
    each = [CubicSpline(nodes[:, c], values[:, c])(point) for c, point in enumerate(y)]
    return np.array(each).reshape(y.size, values.shape[2])
