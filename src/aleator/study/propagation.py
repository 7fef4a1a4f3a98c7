"""`[propagation]` of study.toml: how the law of the parameters becomes one of the outcome."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from aleator.expansion import Projection, Regression, SparseProjection
from aleator.likelihood.propagation import Collocation
from aleator.polynomials.indices import Hyperbolic, IndexSet, TotalDegree
from aleator.quadrature import (
    Cubature,
    GermGrid,
    MonteCarloPoints,
    ProbabilityGrid,
    Smolyak,
    SobolPoints,
    TensorGauss,
)
from aleator.study.keys import Section, fault
from aleator.surrogates import ResponseSurface

_RULES: dict[str, tuple[type[Cubature], tuple[str, ...]]] = {
    "gauss": (TensorGauss, ("per_dimension",)),
    "smolyak": (Smolyak, ("level",)),
    "sobol": (SobolPoints, ("points", "seed")),
    "monte_carlo": (MonteCarloPoints, ("points", "seed")),
    "probability_grid": (ProbabilityGrid, ("per_dimension",)),
    "germ_grid": (GermGrid, ("per_dimension",)),
}
_FITS: dict[str, type[Projection] | type[SparseProjection] | type[Regression]] = {
    "projection": Projection,
    "sparse_grid": SparseProjection,
    "regression": Regression,
}
_TERMS: dict[str, type[IndexSet]] = {"total_degree": TotalDegree, "hyperbolic": Hyperbolic}


class RuleSection(Section):
    """`nodes = {rule = "sobol", points = 1024}`: other nodes than those of Gauss rules."""

    rule: Literal["gauss", "smolyak", "sobol", "monte_carlo", "probability_grid", "germ_grid"]
    per_dimension: int | None = None
    level: int | None = None
    points: int | None = None
    seed: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _keys_are_used(self) -> Self:
        own = _RULES[self.rule][1]
        for key in sorted(self.model_fields_set - {"rule", *own}):
            raise fault(f'{key} has no meaning for rule = "{self.rule}"', f"its keys are {own}")
        if own[0] not in self.model_fields_set:
            raise fault(f'rule = "{self.rule}" lacks {own[0]}', f"add {own[0]} = ...")
        return self

    def build(self) -> Cubature:
        """The library's choice."""
        return _RULES[self.rule][0](**self.given("rule"))


def _kind(value: Any) -> str:
    return "table" if isinstance(value, (Mapping, RuleSection)) else "number"


Nodes = Annotated[
    Annotated[int, Tag("number")] | Annotated[RuleSection, Tag("table")], Discriminator(_kind)
]


def _nodes(value: int | RuleSection | None) -> int | Cubature | None:
    return value.build() if isinstance(value, RuleSection) else value


class SurfaceSection(Section):
    """`method = "response_surface"`: one surface an experiment, in rounds or of one tolerance."""

    method: Literal["response_surface"] = "response_surface"
    tolerance: float | None = None
    max_runs: int = 1000
    nodes: Nodes | None = None
    shared: bool | Literal["automatic"] = False

    def build(self) -> ResponseSurface | Collocation:
        """The library's choice."""
        return ResponseSurface(
            **self.given("method", "nodes", "shared"),
            nodes=_nodes(self.nodes),
            shared=None if self.shared == "automatic" else self.shared,
        )


class CollocationSection(Section):
    """`method = "collocation"`: the simulator runs at the nodes of the law for every alpha."""

    method: Literal["collocation"]
    nodes: Nodes | None = None
    moments: Literal["quadrature", "expansion"] = "quadrature"
    degree: int | None = None
    fit: Literal["projection", "sparse_grid", "regression"] | None = None
    terms: Literal["total_degree", "hyperbolic"] = "total_degree"

    @model_validator(mode="after")
    def _fit_is_whole(self) -> Self:
        if self.fit is None and "terms" in self.model_fields_set:
            raise fault("terms has no meaning without fit", 'write fit = "regression"')
        if self.fit is not None and self.degree is None:
            raise fault(f'fit = "{self.fit}" lacks degree', "add degree = 2")
        return self

    def build(self) -> ResponseSurface | Collocation:
        """The library's choice."""
        if self.fit is None:
            return Collocation(**self.given("method", "nodes"), nodes=_nodes(self.nodes))
        terms = _TERMS[self.terms](self.degree)  # type: ignore[call-arg]  # a set's first field
        return Collocation(
            nodes=_nodes(self.nodes), moments=self.moments, fit=_FITS[self.fit](terms)
        )


def _method(value: Any) -> str:
    # Whatever is neither is refused by the section.
    chosen = value if isinstance(value, Mapping) else {"method": getattr(value, "method", None)}
    return str(chosen.get("method") or "response_surface")


PropagationSection = Annotated[
    Annotated[SurfaceSection, Tag("response_surface")]
    | Annotated[CollocationSection, Tag("collocation")],
    Discriminator(_method),
]
