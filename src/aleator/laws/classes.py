"""Laws with mixtures, whose components are classes of experiments: order and starts."""

from __future__ import annotations

import numpy as np

from aleator.core.types import Array
from aleator.laws.inputs import Inputs
from aleator.laws.law import Law
from aleator.laws.marginals import Constant, Normal
from aleator.laws.mixture import Mixture


def exchangeable(inputs: Inputs) -> bool:
    """Whether a law has components that are equal but for their order, and none has covariates."""
    return inputs.covariate_model is None and any(
        isinstance(law, Mixture) and law.exchangeable for law in inputs.laws.values()
    )


def ordered(inputs: Inputs, alpha: Array) -> Array:
    """The alpha (K,) of the same law with such components in their order; the rest is kept."""
    found = alpha.copy()
    if exchangeable(inputs):
        for law, part in zip(inputs.laws.values(), inputs.parts, strict=True):
            if isinstance(law, Mixture):
                found[part] = law.ordered(alpha[part])
    return found


def apart(inputs: Inputs, alpha: Array, x: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """The alpha (K,) with the components of mixtures about groups of points x (N, n).

    And the points (N, n), in which those of a mixture are the centers of their groups.
    """
    found, centers = alpha.copy(), x.copy()
    for i, law in enumerate(inputs.laws.values()):
        if isinstance(law, Mixture):
            found[inputs.parts[i]], centers[:, i] = law.apart(x[:, i], rng)
    return found, centers


def undivided(inputs: Inputs) -> Inputs:
    """Independent parameters with a known normal law, a wide one, in place of each mixture."""
    laws: dict[str, Law] = dict(inputs.laws)
    for name, law in inputs.laws.items():
        if isinstance(law, Mixture):
            low, high = law.location
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            laws[name] = Normal(middle, half) if half > 0.0 else Constant(middle)
    return Inputs(laws)
