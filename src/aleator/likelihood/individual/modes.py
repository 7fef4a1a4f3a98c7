"""The most likely variates of each experiment, given its observations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from aleator.types import Array

ARRIVED = 1e-6
"""A Newton step that gains less than this in log-density is the last."""
NEAR = 1e-2
"""... where nodes only have to lie about the mode, within a seventh of its width."""
STEPS = 30
FEW_STEPS = 6
"""... of modes that only have to be near: where alpha is absurd, so are they."""
LEAST = 0.1
"""Damping below this, over the information, is none."""
FARTHEST = 8.0
"""Variates beyond this have no mass: no step goes farther."""


class Curved(Protocol):
    """The log-density of variates z (B, s) with gradient (B, s) and information (B, s, s)."""

    def __call__(self, z: Array) -> tuple[Array, Array, Array]:
        """Value, gradient, and a positive definite approximation of the negative Hessian."""


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes z (B, s), and the information (B, s, s) there."""

    z: Array
    information: Array


def modes(log_density: Curved, start: Array, arrived: float = ARRIVED) -> Modes:
    """Climb from start (B, s) by Gauss-Newton steps, all experiments in one batch.

    Levenberg's damping, raised where a step does not gain, lowered where it does. Ends, without an
    error, when no experiment gains.
    """
    z = start
    value, gradient, information = log_density(z)
    damping = np.zeros(len(z))
    unit = np.eye(z.shape[1])
    raised, lowered = 4.0, 0.25
    for _ in range(STEPS if arrived < NEAR else FEW_STEPS):
        damped = information * (1.0 + damping[:, None, None] * unit)
        step = np.linalg.solve(damped, gradient[..., None])[..., 0]
        gain = 0.5 * np.sum(gradient * step, axis=1)
        open_ = gain > arrived
        if not np.any(open_):
            break
        trial = np.clip(z + step * open_[:, None], -FARTHEST, FARTHEST)
        new_value, new_gradient, new_information = log_density(trial)
        better = open_ & (new_value > value)
        z = np.where(better[:, None], trial, z)
        value = np.where(better, new_value, value)
        gradient = np.where(better[:, None], new_gradient, gradient)
        information = np.where(better[:, None, None], new_information, information)
        harder = np.where(open_, np.maximum(raised * damping, 1.0), damping)
        damping = np.where(better, lowered * damping * (damping > LEAST), harder)
    return Modes(z, information)
