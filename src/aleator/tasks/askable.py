"""Whether a study can be identified at all, before any run is made."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from aleator.laws.inputs import Inputs
from aleator.observations.experiments import Experiments
from aleator.observations.noise import Noise
from aleator.surrogates import ResponseSurface
from aleator.tasks.asked import DEFAULT_SEARCH, require_enough
from aleator.tasks.recover import job_of

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation


def require_askable(
    table: Experiments,
    inputs: Inputs,
    noise: Noise | Mapping[str, Noise] | None,
    propagation: ResponseSurface | Collocation,
    density: Density | None,
) -> None:
    """Raise the AleatorError that `identify` would before its first run.

    Nothing that scatters, several observations without noise, fewer values than hyperparameters.
    """
    job = job_of(table, inputs, noise, propagation, density, DEFAULT_SEARCH)
    require_enough(table, job.hyperparameters)
