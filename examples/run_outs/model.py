"""The random fatigue-limit model: how many cycles one specimen endures, for ever included."""

import numpy as np

from aleator.core.types import Array


def kilocycles(ratio: Array, v: Array, b0: Array, b1: Array) -> Array:
    """Thousands of cycles to failure: exp(b0 + b1 ln(ratio - exp(v))).

    `ratio` is the applied stress over the static strength. exp(v) is the fatigue limit of the
    specimen on the same scale: a stress that does not exceed it never breaks the specimen, and the
    life is then infinite.
    """
    above = np.maximum(ratio - np.exp(v), 0.0)
    with np.errstate(divide="ignore"):
        return np.exp(b0 + b1 * np.log(above))
