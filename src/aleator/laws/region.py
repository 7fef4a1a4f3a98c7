"""The region of the parameters in which a law has its mass."""

from __future__ import annotations

import numpy as np

from aleator.laws.inputs import Inputs
from aleator.types import Array

TAIL = 1e-7
"""Probability left out at either end of a law's region: 5.2 standard deviations of a normal."""


def law_region(inputs: Inputs, alphas: list[Array], tail: float = TAIL) -> Array:
    """The smallest region (n, 2) that holds each parameter's law but for its tails, for all alphas.

    >>> from aleator.laws import Constant, Normal
    >>> inputs = Inputs({"v": Normal(0.0, 1.0), "b": Constant(2.0)})
    >>> law_region(inputs, [np.array([0.0, 1.0, 2.0])]).round(2).tolist()
    [[-5.2, 5.2], [2.0, 2.0]]
    """
    ends = np.array([[tail] * len(inputs.names), [1.0 - tail] * len(inputs.names)])
    x = np.concatenate([inputs.marginal(alpha, ends) for alpha in alphas])
    return np.stack([x.min(axis=0), x.max(axis=0)], axis=1)
