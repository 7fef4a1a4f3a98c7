"""Where the chosen law lacks mass: the gradient function over each parameter, and as a map."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.stats import qmc

from aleator.inference.ceiling.best import gradient
from aleator.tasks.ceiling.sought import Sought
from aleator.tasks.individual.curves import law_curves
from aleator.types import Array

LINE, SIDE, ACROSS = 121, 61, 64
"""Half the points of a curve; those of a map's side; draws of the other parameters for a curve."""


def gradient_curves(sought: Sought) -> dict[str, pd.DataFrame]:
    """`gradient` over each parameter `x`, with the `density` of its law, by its name.

    D(x_i) is the mean of D over the other parameters, drawn from the chosen law: a law that moves
    a share h of mass to x_i, the others as they were, gains N h D(x_i) in log-likelihood.
    """
    found = {}
    drawn = _draws(sought)
    densities = law_curves(sought.fit.inputs, sought.fit.alpha, 1)
    for s, name in enumerate(sought.names):
        at = _places(sought, s)
        points = np.tile(drawn, (len(at), 1, 1))
        points[:, :, s] = at[:, None]
        d = _gradient(sought, points.reshape(-1, drawn.shape[1])).reshape(len(at), -1).mean(axis=1)
        low, high = sought.region[s]
        x = low + (high - low) * at
        curve = densities.get(name, {"x": [low], "density": [np.nan]})
        density = np.interp(x, curve["x"], curve["density"], 0.0, 0.0)
        found[name] = pd.DataFrame({"x": x, "gradient": d, "density": density})
    return found


def gradient_map(sought: Sought) -> pd.DataFrame | None:
    """D at a grid of two parameters, a row for each of the second; None for any other number."""
    if len(sought.names) != 2:
        return None
    side = np.linspace(0.0, 1.0, SIDE)
    z = np.stack(np.meshgrid(side, side, indexing="xy"), axis=-1).reshape(-1, 2)
    first, second = (low + (high - low) * side for low, high in sought.region)
    return pd.DataFrame(_gradient(sought, z).reshape(SIDE, SIDE), index=second, columns=first)


def _places(sought: Sought, s: int) -> Array:
    """Places of the unit interval for a curve: half of them even, half by the law's quantiles."""
    inputs, alpha = sought.fit.inputs, sought.fit.alpha
    level = (np.arange(LINE) + 0.5) / LINE
    probability = np.tile(level[:, None], (1, len(inputs.names)))
    of_law = sought.z(inputs.marginal(alpha[: inputs.size], probability))[:, s]
    return np.unique(np.concatenate([np.linspace(0.0, 1.0, LINE), of_law]))


def _draws(sought: Sought) -> Array:
    """Points (64, s) of the chosen law; one where nothing else scatters."""
    inputs, alpha = sought.fit.inputs, sought.fit.alpha
    count = ACROSS if len(sought.names) > 1 else 1
    uniform = qmc.Sobol(len(inputs.names), rng=11).random(count)
    return sought.z(inputs.sample(alpha[: inputs.size], uniform))


def _gradient(sought: Sought, points: Array) -> Array:
    """D (J,) under the chosen law, in parts that fit into memory."""
    each = sought.fit.scored().each
    parts = np.array_split(points, -(-len(points) // sought.count))
    return np.concatenate([gradient(sought.log_density, each, part) for part in parts])
