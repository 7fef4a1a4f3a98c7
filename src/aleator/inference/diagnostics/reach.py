"""Outcomes that no law can explain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aleator.errors import ExperimentsError
from aleator.likelihood.likelihood import Likelihood
from aleator.types import Array, Indices


def shortfalls(likelihood: Likelihood) -> tuple[Array, Array]:
    """How far outcomes (N,) lie above what is reached, or below it (negative); zero inside.

    And the outcomes (N,) without noise that come nearest to explaining them.
    """
    y, (low, high) = likelihood.outcomes, _reach(likelihood)
    bare = likelihood.predictive.range(0.0)
    short = np.maximum(y - high, 0.0) + np.minimum(y - low, 0.0)
    return short, y - np.where(short > 0.0, high - bare[1], np.where(short, low - bare[0], 0.0))


def unreachable(likelihood: Likelihood, ids: Sequence[str]) -> ExperimentsError:
    """What names the experiments outside the reachable range."""
    rows = np.flatnonzero(shortfalls(likelihood)[0])
    noisy = likelihood.predictive.noise is not None
    return out_of_reach(rows, likelihood.outcomes, _reach(likelihood), ids, noisy=noisy)


def out_of_reach(
    outside: Indices, y: Array, reach: tuple[Array, Array], ids: Sequence[str], *, noisy: bool
) -> ExperimentsError:
    """What names the experiments `outside`, of outcomes y (N,), and the ends (N,) of the reach."""
    low, high = reach
    named = "; ".join(
        f"experiment {ids[l]}: outcome {y[l]:.6g}, reachable [{low[l]:.6g}, {high[l]:.6g}]"
        for l in outside[:5]
    )
    more = f"; and {outside.size - 5} more" if outside.size > 5 else ""
    remedy = "check these rows and the units, widen the box of the parameters, or "
    remedy += "allow more noise" if noisy else "add measurement noise ([noise] sd)"
    return ExperimentsError(
        f"{outside.size} outcome(s) lie outside the range that the simulator reaches, "
        f"so that no law explains them: {named}{more}",
        remedy,
    )


def _reach(likelihood: Likelihood) -> tuple[Array, Array]:
    noisy = likelihood.predictive.noise is not None
    return likelihood.predictive.range(likelihood.hyperparameters[-1].upper if noisy else 0.0)
