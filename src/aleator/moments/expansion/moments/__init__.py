"""Exact moments of a polynomial chaos expansion: one file for each way.

`prepare(basis, indices, order)` is the offline step; its result gives the moments of any
coefficients. Both ways are exact to rounding: `ExactQuadrature` for few parameters, `Galerkin` for
many; the cheaper is taken unless one is given.
"""

from aleator.moments.expansion.moments.cheapest import cheapest
from aleator.moments.expansion.moments.exact import ExpansionMoments, Way, prepare
from aleator.moments.expansion.moments.exact_quadrature import ExactQuadrature
from aleator.moments.expansion.moments.galerkin import Galerkin

__all__ = ["ExactQuadrature", "ExpansionMoments", "Galerkin", "Way", "cheapest", "prepare"]
