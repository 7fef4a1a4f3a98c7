"""Outcomes that jump as a parameter changes, and where."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aleator.laws.inputs import Inputs
from aleator.results.values import Diagnostic
from aleator.surrogates import AdaptiveSurfaces
from aleator.surrogates.responses import moving_parameters
from aleator.types import Array


def step_warnings(surfaces: AdaptiveSurfaces | None, inputs: Inputs) -> list[Diagnostic]:
    """Outcomes with a step, which surfaces do not follow."""
    if surfaces is None:
        return []
    found = surfaces.steps(np.arange(surfaces.good.size))
    if not found:
        return []
    names = [inputs.names[i] for i in moving_parameters(inputs.box)]
    sharpest = min(found, key=lambda step: float(np.linalg.norm(step.there - step.here)))
    return [
        Diagnostic(
            "jump",
            f"the outcome jumps, or is as steep as a jump, in {len(found)} of "
            f"{surfaces.good.size} surfaces, which more runs hardly make exact: in one of them by "
            f"{sharpest.size:.3g} from {_place(names, sharpest.here)} to "
            f"{_place(names, sharpest.there)}",
            "narrow the box to one side of the jump; or let the simulator take arrays: it is then "
            "integrated over itself, without surfaces",
        )
    ]


def _place(names: Sequence[str], x: Array) -> str:
    return ", ".join(f"{name} = {value:.6g}" for name, value in zip(names, x, strict=True))
