"""Where the parameters of all experiments lie: draws of their laws, and a region of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.tasks.region import padded, within
from aleator.types import Array

DRAWS = 512
FAR = 5.2
"""Standard normal variates beyond which a law has no mass that counts: 1e-7 at either end."""
LIKELY = 3.1
"""The same of laws that are only possible: 1e-3."""
PAD = 0.05
"""Share of its width by which a region is widened on either side."""
LEAST = 1e-3
"""Width of a region over that of the box, at least."""


def draws(inputs: Inputs, alphas: Sequence[Array], experiments: int, wide: float = 1.0) -> Array:
    """Some 512 parameters (D, n) of the experiments' laws, of all alphas alike.

    Variates are `wide` times as far out as the laws say.
    """
    each = max(1, DRAWS // (experiments * len(alphas)))
    power = int(np.ceil(np.log2(each * experiments)))
    u = qmc.Sobol(max(inputs.scattering, 1), rng=0).random_base2(power)[: each * experiments]
    xi = wide * special.ndtri(np.clip(u[:, : inputs.scattering], 1e-9, 1.0 - 1e-9))
    xi = np.tile(xi.reshape(experiments, each, inputs.scattering), (1, len(inputs.classes), 1))
    everyone = slice(0, experiments)
    x = [inputs.individual(a[: inputs.size], xi, everyone).x for a in alphas]
    whole = np.concatenate([part.reshape(-1, len(inputs.names)) for part in x])
    return whole[:: max(1, len(whole) // DRAWS)]


def held_region(inputs: Inputs, alphas: Sequence[Array], experiments: int, far: float) -> Array:
    """The smallest region (n, 2) that holds the variates within `far` of all experiments."""
    n, s = len(inputs.names), inputs.scattering
    low, high = np.full(n, np.inf), np.full(n, -np.inf)
    for alpha in alphas:
        own = alpha[: inputs.size]
        nothing = np.zeros((experiments, len(inputs.classes), s))
        mixing = inputs.individual(own, nothing, slice(0, experiments)).mixing
        # a row of L has length one: this is where its theta is as far out as it may be
        xi = far * np.concatenate([np.zeros((1, s)), mixing, -mixing])
        all_of = np.tile(xi, (experiments, len(inputs.classes), 1))
        x = inputs.individual(own, all_of, slice(0, experiments)).x
        low, high = np.minimum(low, x.min(axis=(0, 1))), np.maximum(high, x.max(axis=(0, 1)))
    return np.stack([low, high], axis=1)


def first_region(
    inputs: Inputs, hyperparameters: Sequence[Hyperparameter], experiments: int
) -> Array:
    """The box where every law states one; else what the limits of locations and constants span.

    With the standard deviations at their starts.
    """
    if inputs.bounded:
        return inputs.box
    lower = np.array([h.start if h.log else h.lower for h in hyperparameters])
    upper = np.array([h.start if h.log else h.upper for h in hyperparameters])
    return within(inputs.box, held_region(inputs, [lower, upper], experiments, LIKELY))


def around(region: Array, box: Array) -> Array:
    """The region somewhat wider on either side, within the box; what is known stays known."""
    return padded(region, box, PAD, LEAST)
