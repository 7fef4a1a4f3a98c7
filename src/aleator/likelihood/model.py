"""The user's choices of law, surfaces and density, which say what likelihood is computed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from aleator.errors import InputsError
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.surrogates import ResponseSurface

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation


@dataclass(frozen=True)
class Model:
    """Law, and how the density of one exact outcome is computed.

    Without a `density` it is that of the outcome itself, by level sets; with one it is fitted to
    moments of the outcome. `direct` says that the simulator itself is run, without surfaces.

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
        """The model; nodes of the law and collocation ask for moments, of maximum entropy.

        Raises InputsError where nothing scatters.
        """
        propagation = propagation or ResponseSurface()
        if inputs.scattering == 0:
            raise InputsError(
                "nothing scatters: every parameter is a constant and there is no measurement noise",
                "give a parameter a law, or add noise: [noise] sd, or noise=Noise(...)",
            )
        own = isinstance(propagation, ResponseSurface) and propagation.nodes is None
        if density is None and not own:
            from aleator.moments.maximum_entropy import MaximumEntropy

            density = MaximumEntropy(order=4)
        return cls(inputs, propagation, density)

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters in the order of alpha: those of the inputs."""
        return self.inputs.hyperparameters

    @property
    def surfaces(self) -> ResponseSurface | None:
        """The choice of response surfaces; None where the simulator runs for every alpha."""
        own = isinstance(self.propagation, ResponseSurface) and not self.direct
        return self.propagation if own else None  # type: ignore[return-value]

    @property
    def follows(self) -> bool:
        """Whether surfaces are made exact where the law is, and not all over their region."""
        return self.surfaces is not None and self.surfaces.tolerance is None

    @property
    def name(self) -> str:
        """How reports name the propagation."""
        return "direct" if self.direct else self.propagation.name

    def directly(self) -> Model:
        """The same on the simulator itself."""
        return replace(self, direct=True)
