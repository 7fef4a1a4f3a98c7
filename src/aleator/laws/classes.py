"""Laws of several components: their order, and where a search begins with them."""

from __future__ import annotations

from aleator.laws.inputs import Inputs
from aleator.laws.mixture import Mixture
from aleator.types import Array


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


def apart(inputs: Inputs, alpha: Array, x: Array) -> Array:
    """The alpha (K,) with the components of mixtures about groups of points x (N, n).

    Where laws follow covariates it is alpha itself.
    """
    found = alpha.copy()
    if inputs.covariate_model is None:
        for i, law in enumerate(inputs.laws.values()):
            if isinstance(law, Mixture):
                part = inputs.parts[i]
                found[part] = law.apart(x[:, i])
    return found
