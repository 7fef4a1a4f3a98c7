"""Polynomial chaos expansions of the outcomes of many experiments in many parameters.

design -> points to run the simulator at -> outcomes (N, J) -> `Expansion`. How both ends are made
is a choice: `Projection` (the paper), `SparseProjection`, `Regression`.
"""

from aleator.moments.expansion.basis import Basis
from aleator.moments.expansion.design import Design
from aleator.moments.expansion.expansion import Expanding, Expansion
from aleator.moments.expansion.projection import Projection
from aleator.moments.expansion.regression import Regression
from aleator.moments.expansion.sparse_projection import SparseProjection

__all__ = [
    "Basis",
    "Design",
    "Expanding",
    "Expansion",
    "Projection",
    "Regression",
    "SparseProjection",
]
