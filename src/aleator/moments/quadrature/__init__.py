"""Nodes and weights of the joint law, by which averages over it are computed.

Each choice turns a joint law at alpha into `Nodes`, whose derivatives by alpha are those of just
what is computed: a weighted sum over the nodes has an exact gradient however coarse the rule is.
Gauss rules are exact in polynomials of x where a law has its own, and in polynomials of the
standard normal variate for a law that goes through it (lognormal, and every correlated parameter).

| choice | nodes for d scattering parameters | error for a smooth outcome |
|---|---|---|
| `TensorGauss(q)` | q^d | geometric in q; exact to degree 2q - 1 in each parameter |
| `Smolyak(L)` | about (2d)^L / L! | exact to total degree 2L + 1; some weights are negative |
| `SobolPoints(J)` | J | about J^-1 and better, any d |
| `MonteCarloPoints(J)` | J | J^-1/2, any d |
| `ProbabilityGrid(m)` | m^d | m^-1 where the outcome is unbounded; the paper's |
"""

from aleator.moments.quadrature.interface import Cubature
from aleator.moments.quadrature.nodes import Nodes
from aleator.moments.quadrature.points import MonteCarloPoints, ProbabilityGrid, SobolPoints
from aleator.moments.quadrature.smolyak import Smolyak
from aleator.moments.quadrature.tensor import TensorGauss

__all__ = [
    "Cubature",
    "Nodes",
    "TensorGauss",
    "Smolyak",
    "SobolPoints",
    "MonteCarloPoints",
    "ProbabilityGrid",
]
