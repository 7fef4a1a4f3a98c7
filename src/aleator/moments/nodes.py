"""Which nodes of the law the outcomes are propagated at: as many as are of use, no more."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from aleator.laws.inputs import Inputs
from aleator.moments.expansion import Regression
from aleator.moments.expansion.indices import TotalDegree
from aleator.moments.propagation import (
    Collocation,
    ExpandedPropagation,
    ProjectedPropagation,
    Propagation,
    QuadraturePropagation,
    as_cubature,
    default_cubature,
)
from aleator.moments.quadrature import TensorGauss
from aleator.surrogates import ResponseSurface
from aleator.surrogates.responses import Response
from aleator.types import Array

ALIKE = 1e-3
"""Moments, in standard deviations, that agree to this (rms over experiments) are the same to a
likelihood."""

SHARES = (12.0, 24.0)
"""Width of the region over the standard deviation of the laws at which nodes are compared."""
DEGREES = (2, 3, 4)
"""Degrees of the expansions that are tried in many parameters, with one more to compare."""


def propagated(
    inputs: Inputs,
    choice: ResponseSurface | Collocation,
    order: int,
    response: Response,
    region: Array,
) -> Propagation:
    """The way from the law to `order` moments of the outcomes; `region` (n, 2) is known."""
    if isinstance(choice, Collocation):
        return _collocated(inputs, choice, order, response)
    if choice.nodes is not None:
        return QuadraturePropagation(inputs, response, as_cubature(choice.nodes))
    # nodes cost no run here: as many as are of use
    cubature = default_cubature(inputs, runs=False)
    way = QuadraturePropagation(inputs, response, cubature)
    if isinstance(cubature, TensorGauss):
        return _enough_nodes(way, cubature.per_dimension, region, order)
    return _enough_degrees(way, region, order)


def _collocated(inputs: Inputs, chosen: Collocation, order: int, response: Response) -> Propagation:
    if chosen.fit is not None:
        return ExpandedPropagation(inputs, response, chosen.fit, order)
    if chosen.nodes is None:
        cubature = default_cubature(inputs, runs=True)
    else:
        cubature = as_cubature(chosen.nodes)
    if chosen.moments == "quadrature":
        return QuadraturePropagation(inputs, response, cubature)
    assert isinstance(cubature, TensorGauss)
    degree = chosen.degree or cubature.per_dimension - 1
    return ProjectedPropagation(inputs, response, cubature.per_dimension, degree)


def _enough_nodes(
    best: QuadraturePropagation, most: int, region: Array, order: int
) -> QuadraturePropagation:
    """The fewest nodes a dimension whose moments to `order` agree with those of `most` to ALIKE.

    Compared at laws in the middle of the region (n, 2) that span a sixth and a
    twelfth of it with one standard deviation on either side: smooth surfaces need few nodes,
    fronts need many. Every node saved is saved in each of the search's evaluations.
    """
    alphas = [best.inputs.filling(region, share) for share in SHARES]
    wanted = [_compared(best, a, order) for a in alphas]
    for nodes in range(4, most):
        way = replace(best, cubature=TensorGauss(nodes))
        if _alike([_compared(way, a, order) for a in alphas], wanted):
            return way
    return best


def _enough_degrees(sampled: QuadraturePropagation, region: Array, order: int) -> Propagation:
    """The expansion of degree 2 or 3 where one more degree changes nothing, else the samples.

    In many parameters the moments of an expansion are exact where samples are not; a surface that
    bends more than its own degree tells is left to the samples.
    """
    inputs, response = sampled.inputs, sampled.response
    alphas = [inputs.filling(region, share) for share in SHARES]
    ways = [
        ExpandedPropagation(
            inputs, response, Regression(TotalDegree(degree), adaptive=False), order
        )
        for degree in DEGREES
    ]
    lower = [_compared(ways[0], a, order) for a in alphas]
    for way, other in pairwise(ways):
        higher = [_compared(other, a, order) for a in alphas]
        if _alike(lower, higher):
            return way
        lower = higher
    return sampled


def _alike(some: list[Array], others: list[Array]) -> bool:
    gaps = (one - other for one, other in zip(some, others, strict=True))
    return all(np.mean(np.max(np.abs(gap), axis=1) ** 2) < ALIKE**2 for gap in gaps)


def _compared(way: Propagation, alpha: Array, order: int) -> Array:
    """Moments on a common scale: mean and sd in sds, standardized moments damped if large."""
    m = way.moments(alpha, order + order % 2, gradient=False)
    sd = np.where(m.sd > 0.0, m.sd, 1.0)
    # an even moment bounds the odd one below it
    above = np.arange(3, order + 1) + np.arange(3, order + 1) % 2
    shape = m.standardized[:, 3 : order + 1] / (1.0 + np.abs(m.standardized[:, above]))
    return np.concatenate([(m.mean / sd)[:, None], np.log(sd)[:, None], shape], axis=1)
