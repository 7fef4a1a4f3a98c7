"""Whether a study can be identified at all, before any run is made."""

from __future__ import annotations

from collections.abc import Mapping

from aleator.densities import Density, NodeDensity
from aleator.laws.inputs import Inputs
from aleator.likelihood.model import Model
from aleator.likelihood.propagation import Collocation
from aleator.observations.experiments import Experiments
from aleator.observations.noise import Noise
from aleator.surrogates import ResponseSurface
from aleator.tasks.asked import DEFAULT_SEARCH, require_enough
from aleator.tasks.individual.identify import asked, wanted


def require_askable(
    table: Experiments,
    inputs: Inputs,
    noise: Noise | Mapping[str, Noise] | None,
    propagation: ResponseSurface | Collocation,
    density: Density | NodeDensity | None,
) -> None:
    """Raise the AleatorError that `identify` would before its first run.

    Nothing that scatters, several observations without noise, fewer values than hyperparameters.
    """
    if wanted(table, inputs, noise, propagation, density):
        question = asked(table, inputs, noise, propagation, DEFAULT_SEARCH)
        require_enough(table, question.hyperparameters)
        return
    assert noise is None or isinstance(noise, Noise)
    require_enough(table, Model.of(inputs, noise, propagation, density).hyperparameters)
