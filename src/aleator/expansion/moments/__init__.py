"""Exact moments of a polynomial chaos expansion: one interface, one file for each way.

`prepare(basis, order, way)` is the offline step; its result gives the moments of any coefficients.
The ways, all exact to rounding: `PushFork` (the paper's), `TensorGauss`, `Galerkin`, and
`Automatic`, which takes the cheaper of the last two.
"""

from aleator.expansion.moments.automatic import Automatic, cheapest
from aleator.expansion.moments.basis import Basis
from aleator.expansion.moments.exact import (
    ExpansionMoments,
    central_moments,
    prepare,
    raw_moments,
)
from aleator.expansion.moments.galerkin import Galerkin
from aleator.expansion.moments.interface import Powers, Way
from aleator.expansion.moments.nonzero import NonzeroSet, Origin
from aleator.expansion.moments.push_fork import PushFork, raw_moment
from aleator.expansion.moments.tensor_gauss import TensorGauss

__all__ = [
    "Basis",
    "ExpansionMoments",
    "prepare",
    "central_moments",
    "raw_moments",
    "Way",
    "Powers",
    "PushFork",
    "NonzeroSet",
    "Origin",
    "TensorGauss",
    "Galerkin",
    "Automatic",
    "cheapest",
    "raw_moment",
]
