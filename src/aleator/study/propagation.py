"""`[propagation]` of study.toml: how the law of the parameters becomes one of the outcome."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, PlainValidator, Tag

from aleator.errors import StudyError
from aleator.study.kinds import ChosenKind, Kinds
from aleator.surrogates import ResponseSurface
from aleator.surrogates.choice import Surfaces

RULES: Kinds[Any] = Kinds(
    "aleator.cubatures",
    "rule",
    {
        "gauss": "aleator.moments.quadrature:TensorGauss",
        "smolyak": "aleator.moments.quadrature:Smolyak",
        "sobol": "aleator.moments.quadrature:SobolPoints",
        "monte_carlo": "aleator.moments.quadrature:MonteCarloPoints",
        "probability_grid": "aleator.moments.quadrature:ProbabilityGrid",
    },
)
"""`nodes = {rule = "sobol", points = 1024}`: other nodes than those of Gauss rules."""


def _kind(value: Any) -> str:
    return "table" if isinstance(value, Mapping) else "number"


Nodes = Annotated[
    Annotated[int, Tag("number")]
    | Annotated[ChosenKind[Any], PlainValidator(RULES.read), Tag("table")],
    Discriminator(_kind),
]


def response_surface(
    folder: Path,
    tolerance: float | None = None,
    max_runs: int = 1000,
    nodes: Nodes | None = None,
    surfaces: Surfaces | None = None,
) -> ResponseSurface:
    """One surface an experiment, in rounds or of one tolerance."""
    return ResponseSurface(
        tolerance=tolerance, max_runs=max_runs, nodes=_nodes(nodes, folder), surfaces=surfaces
    )


def collocation(
    folder: Path,
    nodes: Nodes | None = None,
    moments: Literal["quadrature", "expansion"] = "quadrature",
    degree: int | None = None,
    fit: Literal["projection", "regression"] | None = None,
    terms: Literal["total_degree", "hyperbolic"] | None = None,
) -> Any:
    """The simulator runs at the nodes of the law for every alpha."""
    from aleator.moments.expansion import Hyperbolic, IndexSet, TotalDegree
    from aleator.moments.projection import Projection, Regression
    from aleator.moments.propagation import Collocation

    if fit is None:
        if terms is not None:
            raise StudyError("terms has no meaning without fit", 'write fit = "regression"')
        return Collocation(nodes=_nodes(nodes, folder), moments=moments, degree=degree)
    if degree is None:
        raise StudyError(f'fit = "{fit}" lacks degree', "add degree = 2")
    kept: IndexSet = Hyperbolic(degree) if terms == "hyperbolic" else TotalDegree(degree)
    fits: dict[str, type[Projection] | type[Regression]] = {
        "projection": Projection,
        "regression": Regression,
    }
    return Collocation(nodes=_nodes(nodes, folder), moments=moments, fit=fits[fit](kept))


def _nodes(value: int | ChosenKind[Any] | None, folder: Path) -> Any:
    return value.build(folder) if isinstance(value, ChosenKind) else value


PROPAGATIONS: Kinds[Any] = Kinds(
    "aleator.propagations",
    "method",
    {"response_surface": response_surface, "collocation": collocation},
    "response_surface",
)
"""`[propagation] method = "..."`."""
