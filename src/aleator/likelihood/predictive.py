"""The distribution of the outcomes under a law: law and response, but no data.

Two ways lead to it. `FromMoments` fits a density to the moments of the outcome (the paper).
`FromNodes` sums over the outcomes at the nodes of the law. Both carry the derivatives by alpha, so
that a likelihood made of them has its exact score.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from aleator.blocks import blocks
from aleator.densities import Density, FittedDensity, NodeDensity
from aleator.densities.interface import NearbyDensity
from aleator.densities.moments import Moments, joined
from aleator.densities.outcomes import Outcomes
from aleator.laws import Hyperparameter
from aleator.likelihood.located import Located, OfMoments, OfNodes
from aleator.likelihood.parts import FittedInParts, InParts
from aleator.likelihood.propagation import NodePropagation, Propagation, QuadraturePropagation
from aleator.quadrature.nodes import Nodes
from aleator.types import Array, Indices

LARGEST = 64_000
"""Outcomes at nodes that are summed at once: some of the arrays of them fit a core's cache."""


@dataclass(frozen=True)
class Predictive(ABC):
    """The distributions of N outcomes as functions of alpha (K,).

    `propagation` gives the moments, or the outcomes at the nodes, of U distinct conditions, and
    `condition` (N,) says which of them each experiment is made under: repetitions are propagated
    once. `lower` and `upper` (N,) are the range of the outcome, possibly infinite.
    `hyperparameters` (K) are those of the inputs.
    """

    propagation: Propagation
    density: Density | NodeDensity
    condition: Indices
    lower: Array
    upper: Array
    hyperparameters: tuple[Hyperparameter, ...]

    @abstractmethod
    def fitted(self, alpha: Array) -> FittedDensity:
        """The N densities of the outcomes at alpha."""

    @abstractmethod
    def at(self, alpha: Array, known: Located | None = None) -> Located:
        """These with their derivatives by alpha, from those that are `known` nearby or here."""

    @abstractmethod
    def continued(self, alphas: Array, y: Array) -> Array:
        """Sums (A,) of the continuation at y (N,), for alphas (A, K)."""

    @property
    def name(self) -> str:
        """What the densities are made of, for reports."""
        return self.density.name

    @property
    @abstractmethod
    def order(self) -> int:
        """Moments that are needed: those that are matched, and the four of a report."""

    def moments(self, alpha: Array, *, gradient: bool = False) -> Moments:
        """Moments of the outcomes."""
        moments = self.propagation.moments(alpha, self.order, gradient=gradient)
        return moments.take(self.condition)

    def take(self, rows: Indices) -> Predictive:
        """The distributions of some of the experiments, without a thought of the others."""
        propagation, condition = self.propagation, self.condition[rows]
        if isinstance(propagation, QuadraturePropagation) and propagation.divisible:
            asked, condition = np.unique(condition, return_inverse=True)
            propagation = propagation.take(asked)
        return replace(
            self,
            propagation=propagation,
            condition=condition,
            lower=self.lower[rows],
            upper=self.upper[rows],
        )

    def by(
        self, density: Density | NodeDensity, propagation: Propagation | None = None
    ) -> Predictive:
        """The same outcomes in another density, or by other nodes."""
        return predictive(
            propagation or self.propagation, density, self.condition, self.lower, self.upper,
            self.hyperparameters,
        )  # fmt: skip


@dataclass(frozen=True)
class FromMoments(Predictive):
    """Densities fitted to the moments of the outcomes."""

    density: Density

    @property
    def order(self) -> int:
        """The moments that the density matches, at least four."""
        return max(self.density.order, 4)

    def fitted(self, alpha: Array) -> FittedDensity:
        """The N densities with these moments on the range of the outcome."""
        return self.density.fit(self.moments(alpha), self.lower, self.upper)

    def at(self, alpha: Array, known: Located | None = None) -> Located:
        """Sooner where the densities of an alpha nearby are known."""
        if known is not None and np.array_equal(known.alpha, alpha):
            return known
        moments, ends = self.moments(alpha, gradient=True), (self.lower, self.upper)
        if isinstance(self.density, NearbyDensity) and isinstance(known, OfMoments):
            fitted = self.density.fit_near(moments, *ends, known.fitted)
        else:
            fitted = self.density.fit(moments, *ends)
        return OfMoments(alpha.copy(), fitted, moments)

    def continued(self, alphas: Array, y: Array) -> Array:
        """One batch of A N densities."""
        every = joined([self.moments(alpha) for alpha in alphas])
        lower, upper = (np.tile(end, len(alphas)) for end in (self.lower, self.upper))
        fitted = self.density.fit(every, lower, upper)
        value = fitted.sensitivity(np.tile(y, len(alphas))).value
        return np.asarray(value.reshape(-1, y.size).sum(axis=1))


@dataclass(frozen=True)
class FromNodes(Predictive):
    """Densities of the outcomes at the nodes of the law themselves."""

    propagation: NodePropagation
    density: NodeDensity

    @property
    def name(self) -> str:
        """With the number of nodes, which is the same for all alpha."""
        start = np.array([h.start for h in self.hyperparameters])
        return f"{self.density.name}, {len(self.propagation.at(start)):,} nodes"

    @property
    def order(self) -> int:
        """The four moments of a report."""
        return 4

    def fitted(self, alpha: Array) -> FittedDensity:
        """The N densities around the nodes' outcomes."""
        if self._rows:
            return self._in_parts(alpha).fitted
        return self._at(alpha, gradient=False).fitted

    def at(self, alpha: Array, known: Located | None = None) -> Located:
        """What is known nearby is of no use."""
        if known is not None and np.array_equal(known.alpha, alpha):
            return known
        return self._in_parts(alpha) if self._rows else self._at(alpha, gradient=True)

    def continued(self, alphas: Array, y: Array) -> Array:
        """One alpha after the other: their nodes are many."""
        return np.array([self.at(alpha).scored(y).each.sum() for alpha in alphas])

    @cached_property
    def _rows(self) -> tuple[slice, ...]:
        """Experiments whose outcomes at the nodes are summed at once; none where all are."""
        count, way = self.condition.size, self.propagation
        if not isinstance(way, QuadraturePropagation) or not way.divisible:
            return ()
        start = np.array([h.start for h in self.hyperparameters])
        rows = blocks(count, way.nodes(start).weights.size, LARGEST)
        return tuple(rows) if len(rows) > 1 else ()

    @cached_property
    def _parts(self) -> tuple[FromNodes, ...]:
        parts = (self.take(np.arange(rows.start, rows.stop)) for rows in self._rows)
        return tuple(part for part in parts if isinstance(part, FromNodes))

    def _in_parts(self, alpha: Array) -> InParts:
        """The nodes are found once for all parts."""
        assert isinstance(self.propagation, QuadraturePropagation)
        nodes = self.propagation.nodes(alpha)
        located = tuple(partial(part._of, alpha, nodes, gradient=True) for part in self._parts)
        fitted = tuple(partial(part._fitted_of, alpha, nodes) for part in self._parts)
        return InParts(alpha.copy(), self._rows, located, FittedInParts(self._rows, fitted))

    def _fitted_of(self, alpha: Array, nodes: Nodes) -> FittedDensity:
        return self._of(alpha, nodes, gradient=False).fitted

    def _of(self, alpha: Array, nodes: Nodes, *, gradient: bool) -> OfNodes:
        assert isinstance(self.propagation, QuadraturePropagation)
        return self._around(alpha, self.propagation.outcomes_at(nodes, gradient=gradient))

    def _at(self, alpha: Array, *, gradient: bool) -> OfNodes:
        return self._around(alpha, self.propagation.outcomes(alpha, gradient=gradient))

    def _around(self, alpha: Array, outcomes: Outcomes) -> OfNodes:
        outcomes = outcomes.take(self.condition)
        fitted = self.density.fit_nodes(outcomes, self.lower, self.upper)
        return OfNodes(alpha.copy(), fitted, outcomes)


def predictive(
    propagation: Propagation,
    density: Density | NodeDensity,
    condition: Indices,
    lower: Array,
    upper: Array,
    hyperparameters: tuple[Hyperparameter, ...],
) -> Predictive:
    """The predictive distribution by the way that the density asks for."""
    rest = (condition, lower, upper, hyperparameters)
    if isinstance(density, NodeDensity):
        assert isinstance(propagation, NodePropagation)
        return FromNodes(propagation, density, *rest)
    return FromMoments(propagation, density, *rest)
