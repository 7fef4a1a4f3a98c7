"""The order of the components of mixture laws, and starting values for a search over them.

A component of a mixture stands for a class of experiments.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from aleator.core.types import Array
from aleator.laws.constant import Constant
from aleator.laws.inputs import Inputs
from aleator.laws.law import Law
from aleator.laws.marginals import Normal
from aleator.laws.mixture import Mixture


def exchangeable(inputs: Inputs) -> bool:
    """Whether some mixture has interchangeable components, and no law follows covariates."""
    return inputs.covariate_model is None and any(
        isinstance(law, Mixture) and law.exchangeable for law in inputs.laws.values()
    )


def ordered(inputs: Inputs, alpha: Array) -> Array:
    """The alpha (K,) of the same joint law with interchangeable components put in order.

    The components are ordered by their first hyperparameter. All other values are kept.
    """
    found = alpha.copy()
    if exchangeable(inputs):
        for law, part in zip(inputs.laws.values(), inputs.parts, strict=True):
            if isinstance(law, Mixture):
                found[part] = law.ordered(alpha[part])
    return found


def apart(inputs: Inputs, alpha: Array, x: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Starting values alpha (K,) that place the components of mixtures at groups of points.

    The points x (N, n) are grouped for each mixture by itself. Also returns the points (N, n) with
    each coordinate that has a mixture law replaced by the center of its group.
    """
    found, centers = alpha.copy(), x.copy()
    for i, law in enumerate(inputs.laws.values()):
        if isinstance(law, Mixture):
            found[inputs.parts[i]], centers[:, i] = law.apart(x[:, i], rng)
    return found, centers


def undivided(inputs: Inputs) -> Inputs:
    """Independent parameters, with a wide normal law of known values in place of each mixture."""
    laws: dict[str, Law] = dict(inputs.laws)
    for name, law in inputs.laws.items():
        if isinstance(law, Mixture):
            low, high = law.location
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            laws[name] = Normal(middle, half) if half > 0.0 else Constant(middle)
    return Inputs(laws)


def separated(inputs: Inputs, alpha: Array) -> list[tuple[Inputs, Array, float]]:
    """The joint law of each class, with its alpha and the logarithm of its probability.

    A class has one component of each mixture. Raises InputsError where laws follow covariates.

    >>> from aleator.laws import Free
    >>> two = Inputs({"x": Mixture((Normal(Free(0, 1), 0.1), Normal(Free(1, 2), 0.1)))})
    >>> parts = separated(two, np.array([0.2, 0.1, 1.5, 0.1, 0.25]))
    >>> [(own.tolist(), round(float(np.exp(log)), 6)) for _, own, log in parts]
    [([0.2, 0.1], 0.25), ([1.5, 0.1], 0.75)]
    """
    if len(inputs.classes) == 1:
        return [(inputs, alpha, 0.0)]
    found = []
    for c, components in enumerate(inputs.classes):
        own, log_weight = [], 0.0
        for law, part, component in zip(
            inputs.laws.values(), inputs.slices, components, strict=True
        ):
            values = alpha[part]
            if isinstance(law, Mixture):
                log_weight += float(law.log_weights(values)[0][component])
                values = values[law.parts[component]]
            own.append(values)
        joined = np.concatenate([*own, alpha[inputs.partials]])
        found.append((_of_class(inputs, c), joined, log_weight))
    return found


@lru_cache
def _of_class(inputs: Inputs, c: int) -> Inputs:
    """The joint law of class c: each mixture is replaced by one of its components."""
    laws = {
        name: law.components[component] if isinstance(law, Mixture) else law
        for (name, law), component in zip(inputs.laws.items(), inputs.classes[c], strict=True)
    }
    found = Inputs(laws)
    found.correlation = inputs.correlation
    # Without a correlation there were no correlated parameters.
    found.__dict__.pop("correlated", None)
    return found
