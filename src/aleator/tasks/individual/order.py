"""Equal components of mixtures in one order: which of them is the first is arbitrary."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aleator.laws import mixture
from aleator.laws.inputs import Inputs
from aleator.search import Optimum, SearchResult
from aleator.types import Array

SAME = 1e-2
"""Relative difference of two optima that are one."""


def ordered(found: SearchResult, inputs: Inputs) -> SearchResult:
    """Optima that differ in the order of equal components only are one."""
    if not mixture.exchangeable(inputs):
        return found
    optima: list[Optimum] = []
    for optimum in found.optima:
        alpha = in_order(optimum.alpha, inputs)
        for k, known in enumerate(optima):
            if np.allclose(known.alpha, alpha, rtol=SAME):
                optima[k] = replace(known, starts=known.starts + optimum.starts)
                break
        else:
            optima.append(replace(optimum, alpha=alpha))
    ascents = tuple(replace(a, alpha=in_order(a.alpha, inputs)) for a in found.ascents)
    return replace(found, alpha=optima[0].alpha, ascents=ascents, optima=tuple(optima))


def in_order(alpha: Array, inputs: Inputs) -> Array:
    """The same alpha (K,) with equal components in the order of their first hyperparameters."""
    return np.concatenate([mixture.ordered(inputs, alpha[: inputs.size]), alpha[inputs.size :]])
