"""Exact moments of a polynomial chaos expansion: one interface, one file for each way.

`prepare(basis, order, way)` is the offline step; its result gives the moments of any coefficients.
The ways, all exact to rounding: `TensorGauss`, `Galerkin`, and `Automatic`, which takes the
cheaper of both.
"""

from aleator.expansion.moments.automatic import Automatic, cheapest
from aleator.expansion.moments.basis import Basis
from aleator.expansion.moments.exact import (
    ExpansionMoments,
    prepare,
)
from aleator.expansion.moments.galerkin import Galerkin
from aleator.expansion.moments.interface import Powers, Way
from aleator.expansion.moments.tensor_gauss import TensorGauss

__all__ = [
    "Basis",
    "ExpansionMoments",
    "prepare",
    "Way",
    "Powers",
    "TensorGauss",
    "Galerkin",
    "Automatic",
    "cheapest",
]
