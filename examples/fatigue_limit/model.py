"""The random fatigue-limit model: how many cycles one specimen endures."""

import numpy as np

from aleator.core.types import Array


def kilocycles(ratio: Array, v: Array, b0: Array, b1: Array) -> Array:
    """Thousands of cycles to failure: exp(b0 + b1 ln(ratio - exp(v))).

    `ratio` is the applied stress over the static strength. exp(v) is the fatigue limit of the
    specimen on the same scale: a smaller stress would never break it, and a stress just above it
    takes very long. The life is NaN where the stress does not exceed the limit.
    """
    return np.exp(b0 + b1 * np.log(ratio - np.exp(v)))
