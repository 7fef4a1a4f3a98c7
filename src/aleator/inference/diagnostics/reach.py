"""Outcomes that no law can explain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aleator.errors import ExperimentsError
from aleator.likelihood.problem import Problem
from aleator.types import Array, Indices


def shortfalls(problem: Problem) -> Array:
    """How far outcomes (N,) lie above what is reached, or below it (negative); zero inside."""
    y, reach = problem.outcomes, problem.predictor
    return np.asarray(np.maximum(y - reach.upper, 0.0) + np.minimum(y - reach.lower, 0.0))


def unreachable(problem: Problem, ids: Sequence[str]) -> ExperimentsError:
    """What names the experiments outside the reachable range."""
    rows, reach = np.flatnonzero(shortfalls(problem)), problem.predictor
    return out_of_reach(rows, problem.outcomes, (reach.lower, reach.upper), ids)


def out_of_reach(
    outside: Indices, y: Array, reach: tuple[Array, Array], ids: Sequence[str]
) -> ExperimentsError:
    """What names the experiments `outside`, of outcomes y (N,), and the ends (N,) of the reach."""
    low, high = reach
    named = "; ".join(
        f"experiment {ids[l]}: outcome {y[l]:.6g}, reachable [{low[l]:.6g}, {high[l]:.6g}]"
        for l in outside[:5]
    )
    more = f"; and {outside.size - 5} more" if outside.size > 5 else ""
    return ExperimentsError(
        f"{outside.size} outcome(s) lie outside the range that the simulator reaches, "
        f"so that no law explains them: {named}{more}",
        "check these rows and the units, widen the box of the parameters, or add measurement noise "
        "([noise] sd)",
    )
