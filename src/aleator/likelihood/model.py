"""The user's choices, and the one place that is asked what follows from them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from aleator.densities import Convolution, Density, MaximumEntropy, NodeDensity
from aleator.errors import InputsError
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.likelihood.level_sets import traceable
from aleator.likelihood.propagation import GRID, Collocation
from aleator.quadrature import GermGrid, SobolPoints
from aleator.surrogates import ResponseSurface

MOST_ON_LATTICE = 3
"""Scattering parameters up to which the nodes of a density over nodes are a lattice."""
STAND_IN = MaximumEntropy(order=4)
"""The density where that of the outcome itself is not to be had."""

ChosenDensity = Density | NodeDensity


@dataclass(frozen=True)
class Model:
    """Law, propagation and density. `open` says whether another density may take its place.

    >>> from aleator.laws import Normal
    >>> inputs = Inputs({"x": Normal(0.0, 1.0)})
    >>> Model.of(inputs).density.name, Model.of(inputs, propagation=Collocation()).density.name
    ('convolution', 'maximum entropy, 4 moments')
    """

    inputs: Inputs
    propagation: ResponseSurface | Collocation
    density: ChosenDensity
    open: bool = False

    @classmethod
    def of(
        cls,
        inputs: Inputs,
        propagation: ResponseSurface | Collocation | None = None,
        density: ChosenDensity | None = None,
    ) -> Model:
        """The model with a density of its own where the user chooses none.

        That of the outcome itself where one parameter scatters, nodes cost no run and are a
        lattice: it is exact. Else maximum entropy of four moments. Raises InputsError for choices
        that do not go together.
        """
        propagation = propagation or ResponseSurface()
        bare = cls(inputs, propagation, density or STAND_IN)
        if density is None:
            bare = replace(bare, density=bare._first_density, open=True)
        bare._check()
        return bare

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters in the order of alpha: the inputs'."""
        return self.inputs.hyperparameters

    @property
    def surfaces(self) -> ResponseSurface | None:
        """The choice of response surfaces; None where the simulator runs for every alpha."""
        return self.propagation if isinstance(self.propagation, ResponseSurface) else None

    @property
    def collocation(self) -> Collocation | None:
        """The choice of collocation; None where there are response surfaces."""
        return self.propagation if isinstance(self.propagation, Collocation) else None

    @property
    def follows(self) -> bool:
        """Whether surfaces are made exact where the law is, and not all over their region."""
        return self.surfaces is not None and self.surfaces.tolerance is None

    @property
    def exact(self) -> bool:
        """Whether the density is that of the outcome itself, exact but for the number of nodes."""
        return isinstance(self.density, Convolution)

    @property
    def at_nodes(self) -> bool:
        """Whether the density is fitted to the outcomes at the nodes, and not to their moments."""
        return isinstance(self.density, NodeDensity)

    @property
    def order(self) -> int:
        """Moments that are matched, and the four of a report."""
        return 4 if isinstance(self.density, NodeDensity) else max(self.density.order, 4)

    @property
    def lattice(self) -> bool:
        """Whether a density over nodes gets a lattice of them, which it needs.

        A number of nodes a dimension is one of such a lattice; other nodes carry none.
        """
        if not 1 <= self.inputs.scattering <= MOST_ON_LATTICE:
            return False
        if self.collocation is not None:
            return isinstance(self.collocation.nodes, GermGrid)
        nodes = self.propagation.nodes
        return nodes is None or isinstance(nodes, int | GermGrid)

    def exactly(self) -> Model:
        """The same with the density of the outcome itself, which may still give way to moments."""
        return replace(self, density=Convolution(), open=True)

    @property
    def traced(self) -> bool:
        """Whether the likelihood is that of level sets: nobody says how."""
        fast = self.collocation is not None and self.collocation.fast
        chosen = fast or (self.open and self.follows)
        return chosen and traceable(self.inputs)

    def directly(self) -> Model:
        """The same on the simulator itself, at the nodes of a lattice."""
        lattice = self.inputs.scattering <= MOST_ON_LATTICE
        nodes = GermGrid(GRID[self.inputs.scattering]) if lattice else SobolPoints(4096)
        return replace(
            self, propagation=Collocation(nodes, fast=True),
            density=Convolution() if lattice else STAND_IN, open=False,
        )  # fmt: skip

    def by_moments(self) -> Model:
        """The same with four moments, for good."""
        return replace(self, density=STAND_IN, open=False)

    @property
    def _first_density(self) -> ChosenDensity:
        sure = self.surfaces is not None and self.lattice
        return Convolution() if sure else STAND_IN

    def _check(self) -> None:
        if isinstance(self.density, Convolution) and not self.lattice:
            raise InputsError(
                'the density "convolution" takes at most three scattering '
                "parameters, and response surfaces with `nodes` left out or given as a number, or "
                "nodes that are a GermGrid",
                "take MaximumEntropy",
            )
        if self.inputs.scattering == 0:
            raise InputsError(
                "nothing scatters: every parameter is a constant and there is no measurement noise",
                "give a parameter a law, or add noise: [noise] sd, or noise=Noise(...)",
            )
