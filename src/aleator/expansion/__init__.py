"""Polynomial chaos expansions of the outcomes of many experiments in many parameters.

design -> points to run the simulator at -> outcomes (N, J) -> `Expansion`. How both ends are made
is a choice: `Projection` (the paper), `SparseProjection`, `Regression`.
"""

from aleator.expansion.basis import Basis
from aleator.expansion.design import Design
from aleator.expansion.expansion import Expanding, Expansion
from aleator.expansion.projection import Projection
from aleator.expansion.regression import Regression
from aleator.expansion.sparse_projection import SparseProjection

__all__ = [
    "Basis",
    "Design",
    "Expanding",
    "Expansion",
    "Projection",
    "Regression",
    "SparseProjection",
]
