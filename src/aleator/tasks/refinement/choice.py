"""The way to an answer that goes with the choice of the propagation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager

from aleator.likelihood.model import Model
from aleator.likelihood.problem import Forward, forward, told
from aleator.progress import Progress
from aleator.simulators import Runner
from aleator.surrogates import surfaces_of
from aleator.tasks.likely import law_draws, wide_draws
from aleator.tasks.refinement.collocated import Collocated
from aleator.tasks.refinement.interface import Refinement, Search
from aleator.tasks.refinement.on_region import OnRegion
from aleator.tasks.refinement.under_law import UnderLaw
from aleator.tasks.region import own_region
from aleator.types import Array


def refinement_of(
    runner: Runner,
    outcomes: Array,
    model: Model,
    full: Search,
    stage: Callable[[str], AbstractContextManager[None]],
    progress: Progress,
    ids: Sequence[str],
) -> Refinement:
    """The way that goes with the user's choice of the propagation."""
    if model.surfaces is None:
        return Collocated(runner, outcomes, model, full, stage, progress, ids)
    kind = UnderLaw if model.follows else OnRegion
    return kind(runner, outcomes, model, full, stage, progress, ids)


def under_law(
    runner: Runner, model: Model, alpha: Array, progress: Progress | None = None
) -> Forward:
    """The forward problem for a law alpha (K,) that is known: no search moves it.

    With a tolerance the surfaces are exact all over the region of the law. Without one they are as
    exact under the law as an identification makes them: half the error that it begins with.
    """
    region = own_region(model.inputs, alpha)
    if model.surfaces is None:
        return forward(runner, model, region, progress)
    surfaces = surfaces_of(runner, region, model.surfaces)
    if model.follows:
        surfaces.judge(law_draws(model.inputs, alpha, region))
        draws = wide_draws(model.inputs, [alpha], region)
        surfaces.refine(draws, 0.5 * surfaces.level, told(progress))
    else:
        surfaces.refine(None, surfaces.level, told(progress))
    return forward(runner, model, region, progress, surfaces.surface())
