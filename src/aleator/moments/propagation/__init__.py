"""alpha -> moments of every experiment: the seam that the likelihood sees.

The ways are one computation, averages of a response over the law; they differ in who answers for
the response: the simulator itself (collocation, the paper's way, runs for every alpha) or surfaces
built once on the box (no run at all); and in how the average is taken: at the nodes of a cubature,
or exactly from an expansion.
"""

from aleator.moments.propagation.choice import (
    Collocation,
    as_cubature,
    check_nodes,
    default_cubature,
    finer,
)
from aleator.moments.propagation.expanded import ExpandedPropagation
from aleator.moments.propagation.interface import NodePropagation, Propagation
from aleator.moments.propagation.projected import ProjectedPropagation
from aleator.moments.propagation.quadrature import QuadraturePropagation

__all__ = [
    "Collocation",
    "ExpandedPropagation",
    "NodePropagation",
    "ProjectedPropagation",
    "Propagation",
    "QuadraturePropagation",
    "as_cubature",
    "check_nodes",
    "default_cubature",
    "finer",
]
