"""The user's choices of law, response surfaces and density, which determine the likelihood."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from aleator.errors import NOISE, InputsError
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.surrogates import ResponseSurface

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation


@dataclass(frozen=True)
class Model:
    """The joint law, and the way in which the density of an exactly measured outcome is computed.

    Without a `density` the density of the outcome is computed by level sets. With one, a density of
    this kind is fitted to moments of the outcome. `direct` says that the simulator itself is run,
    without response surfaces.

    >>> from aleator.laws import Normal
    >>> from aleator.moments.propagation import Collocation
    >>> inputs = Inputs({"x": Normal(0.0, 1.0)})
    >>> Model.of(inputs).density, Model.of(inputs, Collocation()).density.name
    (None, 'maximum entropy, 4 moments')
    """

    inputs: Inputs
    propagation: ResponseSurface | Collocation
    density: Density | None = None
    direct: bool = False

    @classmethod
    def of(
        cls,
        inputs: Inputs,
        propagation: ResponseSurface | Collocation | None = None,
        density: Density | None = None,
    ) -> Model:
        """The model with defaults filled in; raises InputsError where no parameter scatters.

        Collocation, and response surfaces with chosen nodes of the law, need a density that is
        fitted to moments. Its default is the maximum-entropy density of four moments.
        """
        propagation = propagation or ResponseSurface()
        if inputs.scattering == 0:
            raise InputsError(
                "nothing scatters: every parameter is a constant and there is no measurement noise",
                f"give a parameter a law, or add {NOISE}",
            )
        own = isinstance(propagation, ResponseSurface) and propagation.nodes is None
        if density is None and not own:
            from aleator.moments.maximum_entropy import MaximumEntropy

            density = MaximumEntropy(order=4)
        return cls(inputs, propagation, density)

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters in the order of alpha, which are those of the inputs."""
        return self.inputs.hyperparameters

    @property
    def surfaces(self) -> ResponseSurface | None:
        """The user's choice of response surfaces; None if the simulator itself is run."""
        own = isinstance(self.propagation, ResponseSurface) and not self.direct
        return self.propagation if own else None  # type: ignore[return-value]

    @property
    def follows(self) -> bool:
        """Whether response surfaces are refined only where the law has its probability.

        Otherwise they are refined over their whole region.
        """
        return self.surfaces is not None and self.surfaces.tolerance is None

    @property
    def name(self) -> str:
        """The name of the propagation method in reports."""
        return "direct" if self.direct else self.propagation.name

    def directly(self) -> Model:
        """This model, but with the simulator itself in place of response surfaces."""
        return replace(self, direct=True)
