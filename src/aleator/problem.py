"""A likelihood ready to be searched, built from experiments, a simulator and the user's choices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aleator.densities import Density
from aleator.inputs import Inputs
from aleator.laws import Hyperparameter
from aleator.likelihood import Likelihood
from aleator.noise import Noise
from aleator.progress import Progress
from aleator.propagation import Collocation, DirectResponse, QuadraturePropagation, default_nodes
from aleator.response import ResponseSurface, Surface, build_surface
from aleator.simulate import Runner

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Model:
    """The user's choices that make a likelihood of a simulator and a table."""

    inputs: Inputs
    noise: Noise | None
    propagation: ResponseSurface | Collocation
    density: Density

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters in the order of alpha: the inputs', then the noise's."""
        noise = (self.noise.hyperparameter,) if self.noise else ()
        return self.inputs.hyperparameters + noise

    def noise_sd(self, alpha: Array) -> float:
        """The noise's standard deviation in alpha (K,); zero without noise."""
        return float(alpha[-1]) if self.noise else 0.0


@dataclass(frozen=True)
class Problem:
    """Response, likelihood, and which of the U distinct conditions each experiment has, (N,)."""

    model: Model
    likelihood: Likelihood
    response: Surface | DirectResponse
    condition: Indices
    name: str

    @property
    def surface(self) -> Surface | None:
        """The response surfaces, if that is how the problem is propagated."""
        return self.response if isinstance(self.response, Surface) else None


def prepare(
    runner: Runner, outcomes: Array, model: Model, progress: Progress | None = None
) -> Problem:
    """Build the likelihood of outcomes (N,); response surfaces first, if that is the choice.

    Experiments under equal conditions are one to the simulator: U surfaces for N experiments.
    """
    first, condition = np.unique(runner.group, return_inverse=True)
    count, inputs = first.size, model.inputs

    def run(index: Indices, x: Array) -> Array:
        return runner(first[index], x)

    chosen = model.propagation
    nodes = default_nodes(inputs, chosen.nodes)
    if isinstance(chosen, ResponseSurface):
        surface = build_surface(run, inputs.box, count, chosen, _told(progress))
        response: Surface | DirectResponse = surface
        # the surface's own error must not shut an outcome out of the reachable range
        margin = 3.0 * surface.error
        lower, upper = surface.lower - margin, surface.upper + margin
        degree, name = None, "response_surface"
    else:
        response = DirectResponse(run, count, inputs.box, chosen.difference_step)
        lower, upper = np.full(count, -np.inf), np.full(count, np.inf)
        expand = chosen.moments == "expansion"
        degree, name = (chosen.degree or nodes - 1) if expand else None, chosen.name
    likelihood = Likelihood(
        QuadraturePropagation(inputs, response, nodes, degree),
        model.density,
        outcomes,
        condition,
        lower[condition],
        upper[condition],
        model.hyperparameters,
        bool(model.noise),
    )
    return Problem(model, likelihood, response, condition, name)


def _told(progress: Progress | None) -> Callable[[int, int, int], None] | None:
    if progress is None:
        return None
    listener = progress

    def tell(runs: int, converged: int, total: int) -> None:
        text = f"{runs} runs, {converged} of {total} surfaces converged"
        listener.update(text, converged, total)

    return tell
