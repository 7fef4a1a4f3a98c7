"""The user's choice to run the simulator for every alpha, and the nodes where none is made."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from aleator.errors import InputsError
from aleator.laws.inputs import Inputs
from aleator.moments.expansion import Projection, Regression, SparseProjection
from aleator.moments.quadrature import Cubature, SobolPoints, TensorGauss

DEFAULT_NODES = {0: 1, 1: 20, 2: 20, 3: 12, 4: 8}
"""Nodes a dimension by the number of scattering parameters, where the user does not choose."""
SOBOL = 2048
"""Points where a tensor rule has too many nodes."""
Fit = Projection | SparseProjection | Regression


@dataclass(frozen=True)
class Collocation:
    """The user's choice to run the simulator at nodes of the law for every alpha.

    `nodes` is q, the nodes of Gauss rules a dimension (None: 20, 20, 12, 8 for 1 to 4 scattering
    parameters), or any cubature: `Smolyak(3)`, `SobolPoints(1024)`, `MonteCarloPoints(1000)`, the
    paper's `ProbabilityGrid(30)`. `moments` takes them by plain "quadrature" of the outcomes or
    from the polynomial chaos "expansion" of total degree `degree` (default q - 1), as the paper
    does with q = 5 and degree 4, in the laws' own polynomials. `fit`, instead, is an expansion in
    standard normal variates for many parameters: `Regression(TotalDegree(2))` or
    `SparseProjection(TotalDegree(2))`, whose moments are exact too.

    `difference_step` is the step of the central differences that give the derivative by the
    parameters, relative to the spread of the nodes; a gradient costs 2 n times the runs more.
    Raises InputsError for values out of range or choices that do not go together.

    >>> Collocation(nodes=5, moments="expansion", degree=4).degree
    4
    """

    nodes: int | Cubature | None = None
    moments: Literal["quadrature", "expansion"] = "quadrature"
    degree: int | None = None
    difference_step: float = 1e-4
    fit: Fit | None = None

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        check_nodes(self.nodes)
        if self.moments not in ("quadrature", "expansion"):
            raise InputsError(
                f"moments '{self.moments}' unknown", "use 'quadrature' or 'expansion'"
            )
        if self.moments == "expansion" and not isinstance(self.nodes, int | None):
            raise InputsError(
                "the paper's expansion is projected on a tensor rule",
                "give nodes as a number, or choose fit=Regression(...) without nodes",
            )
        most = self.nodes - 1 if isinstance(self.nodes, int) else None
        if self.degree is not None and not (
            self.degree >= 1 and (most is None or self.degree <= most)
        ):
            raise InputsError(
                f"degree {self.degree} is not between 1 and nodes - 1",
                "a rule of q nodes determines coefficients up to degree q - 1",
            )
        if not 0.0 < self.difference_step < 0.1:
            raise InputsError(
                f"difference_step {self.difference_step} is not between 0 and 0.1",
                "use about the cube root of the simulator's relative accuracy",
            )
        self._check_fit()

    def _check_fit(self) -> None:
        if self.fit is None:
            return
        if not isinstance(self.fit, Fit):
            raise InputsError(
                f"fit {type(self.fit).__name__} is not linear in the outcomes, so that a "
                "likelihood with it would jump",
                "use Regression, SparseProjection or Projection",
            )
        if self.nodes is not None or self.degree is not None:
            raise InputsError("fit brings nodes and degree of its own", "leave them out")
        if isinstance(self.fit, Regression) and self.fit.adaptive:
            # a degree that changes with alpha would make the likelihood jump
            object.__setattr__(self, "fit", replace(self.fit, adaptive=False))

    @property
    def name(self) -> str:
        """How the result names this choice."""
        if self.fit is not None:
            return f"collocation({type(self.fit).__name__.lower()})"
        return f"collocation({self.moments})"


def default_cubature(inputs: Inputs, *, runs: bool) -> Cubature:
    """The nodes where the user does not choose; `runs` says that each of them costs runs.

    Raises InputsError where each node costs runs and a tensor rule has too many of them.
    """
    dimensions = inputs.scattering
    if dimensions in DEFAULT_NODES:
        return TensorGauss(DEFAULT_NODES[dimensions])
    if runs:
        raise InputsError(
            f"{dimensions} scattering parameters make a tensor rule of too many nodes",
            "set nodes = SobolPoints(512) or fit = Regression(TotalDegree(2)), or take response "
            "surfaces",
        )
    return SobolPoints(SOBOL)


def as_cubature(nodes: int | Cubature) -> Cubature:
    """A number of nodes a dimension as a tensor rule; a cubature as it is.

    >>> as_cubature(5)
    TensorGauss(per_dimension=5)
    """
    return TensorGauss(nodes) if isinstance(nodes, int) else nodes


def finer(cubature: Cubature) -> Cubature | None:
    """A rule with more nodes, to see whether there are enough; None where that is not known.

    >>> finer(TensorGauss(8))
    TensorGauss(per_dimension=12)
    """
    if isinstance(cubature, TensorGauss):
        more = cubature.per_dimension + cubature.per_dimension // 2
        return TensorGauss(more) if more <= 100 else None
    if isinstance(cubature, SobolPoints) and cubature.points < 2**20:
        return SobolPoints(2 * cubature.points, cubature.seed)
    return None


def check_nodes(nodes: int | Cubature | None) -> None:
    """Raise InputsError unless nodes is None, a cubature, or between 2 and 100."""
    if isinstance(nodes, int) and not 2 <= nodes <= 100:
        raise InputsError(f"nodes {nodes} is not between 2 and 100", "5 to 20 serve most cases")
