"""Whether experiments share one surface: their first runs tell how exact it would be."""

from __future__ import annotations

import numpy as np

from aleator.errors import InputsError
from aleator.simulators import Runner
from aleator.surrogates import ResponseSurface, Shared, Sharpened
from aleator.surrogates.attempts import attempts
from aleator.surrogates.conditions import features
from aleator.surrogates.responses import moving_parameters
from aleator.types import Array

WORTH = 0.3
"""Estimated error of the first shared surface, over the outcome's scatter on the box, that nine
experiments of ten must meet; with more each has its own surface."""


def first_surfaces(
    runner: Runner, region: Array, choice: ResponseSurface, where: Array
) -> Shared | Sharpened:
    """First surfaces on the region (n, 2): shared ones if the user asks, or they promise enough.

    `where` (J, moving) are the points at which that is judged. The runs made for it serve the
    experiments' own surfaces too. Raises InputsError where the user asks for a shared surface and
    there is nothing to share by, or too much.
    """
    run, box = attempts(runner, region), region[moving_parameters(region)]
    count, conditions = len(runner.cases), features(runner.cases.columns)
    if choice.shared is False or conditions is None or not Shared.fits(count, len(box)):
        if choice.shared:
            raise _nothing_to_share(conditions, count)
        return Sharpened(run, box, count)
    shared = Shared(run, box, conditions)
    shared.judge(where)
    return shared if choice.shared or _promises(shared) else shared.own_surfaces()


def later_surfaces(state: Shared | Sharpened, choice: ResponseSurface) -> Shared | Sharpened:
    """The same surfaces, or the experiments' own where a shared one has all the runs it takes."""
    if isinstance(state, Shared) and state.full and not choice.shared:
        return state.own_surfaces()
    return state


def _promises(shared: Shared) -> bool:
    relative = shared.error / np.where(shared.scatter > 0.0, shared.scatter, np.inf)
    return float(np.quantile(relative, 0.9)) <= WORTH


def _nothing_to_share(conditions: Array | None, experiments: int) -> InputsError:
    remedy = "leave out shared = true: each experiment then has its own surface"
    if conditions is None:
        what = "none varies, or one is a text with many values"
        return InputsError(
            f"no surface can be shared: of the conditions that the simulator asks for {what}",
            remedy,
        )
    return InputsError(f"{experiments} experiments are too many to share a surface", remedy)
