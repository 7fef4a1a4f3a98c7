"""Outcomes that no law can explain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from aleator.errors import ExperimentsError
from aleator.likelihood.likelihood import Likelihood
from aleator.types import Array


def unreachable(likelihood: Likelihood) -> NDArray[np.intp]:
    """Experiments whose outcome has likelihood zero for every admissible alpha."""
    low, high = _reach(likelihood)
    return np.flatnonzero((likelihood.outcomes < low) | (likelihood.outcomes > high))


def refuse_unreachable(likelihood: Likelihood, ids: Sequence[str]) -> None:
    """Raise ExperimentsError that names the experiments outside the reachable range."""
    outside, y = unreachable(likelihood), likelihood.outcomes
    if outside.size == 0:
        return
    low, high = _reach(likelihood)
    named = "; ".join(
        f"experiment {ids[l]}: outcome {y[l]:.6g}, reachable [{low[l]:.6g}, {high[l]:.6g}]"
        for l in outside[:5]
    )
    more = f"; and {outside.size - 5} more" if outside.size > 5 else ""
    remedy = "check these rows and the units, widen the box of the parameters, or "
    remedy += (
        "allow more noise" if likelihood.predictive.noise else "add measurement noise ([noise] sd)"
    )
    raise ExperimentsError(
        f"{outside.size} outcome(s) lie outside the range that the simulator reaches on the box, "
        f"so that no law explains them: {named}{more}",
        remedy,
    )


def _reach(likelihood: Likelihood) -> tuple[Array, Array]:
    noisy = likelihood.predictive.noise is not None
    return likelihood.predictive.range(likelihood.hyperparameters[-1].upper if noisy else 0.0)
