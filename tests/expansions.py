"""Bases and ways of expanding that several tests take, and the true error of an expansion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aleator.core.types import Array
from aleator.laws import (
    Constant,
    Law,
    Normal,
    TruncatedNormal,
    Uniform,
)
from aleator.moments.expansion import (
    Basis,
    Expanding,
    Expansion,
    ExpansionDesign,
    Hyperbolic,
    TotalDegree,
    induced,
)
from aleator.moments.projection import Projection, Regression


def basis_of(*laws: tuple[Law, tuple[float, ...]]) -> Basis:
    return Basis(tuple(law for law, _ in laws), tuple(np.array(values) for _, values in laws))


def box(lower: float, upper: float) -> tuple[Law, tuple[float, ...]]:
    law = Uniform.between(lower, upper)
    return law, tuple(h.start for h in law.hyperparameters)


NORMAL = (Normal(0.0, 1.0), (0.0, 1.0))
MIXED = basis_of(
    (Normal(1.0, 2.0), (1.0, 2.0)),
    (TruncatedNormal((0.0, 3.0), 0.5, 1.0), (0.5, 1.0)),
    (TruncatedNormal((-1.0, 1.0), 0.2, 0.7, "hermite"), (0.2, 0.7)),
    (Constant(4.0), (4.0,)),
)
EVERY_WAY = [
    Projection(TotalDegree(3)),
    Regression(TotalDegree(3)),
    Regression(TotalDegree(3), adaptive=False),
    Regression(Hyperbolic(4, 0.6)),
]


def fitted(way: Expanding, basis: Basis, *functions: Callable[[Array], Array]) -> Expansion:
    design = way.design(basis)
    return way.fit(basis, design, np.stack([function(design.x) for function in functions]))


def drawn(basis: Basis, runs: int, seed: int) -> ExpansionDesign:
    """Points of the law itself: those that the constant polynomial induces."""
    return induced(basis, np.zeros((1, len(basis.laws)), dtype=int), runs, seed)


def miss(expansion: Expansion, function: Callable[[Array], Array], runs: int = 4096) -> float:
    """The true share of variance that the expansion of the first experiment misses."""
    points = drawn(expansion.basis, runs, seed=99)
    truth = function(points.x)
    return float(np.mean((expansion.evaluate(points.t)[0] - truth) ** 2) / truth.var())
