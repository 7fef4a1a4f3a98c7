"""Whether the grids of level sets are fine enough, and outcomes that the simulator jumps over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aleator.inference.diagnostics.naming import chosen, named
from aleator.likelihood.problem import Problem
from aleator.results.values import Diagnostic
from aleator.types import Array


@dataclass(frozen=True)
class Cells:
    """What cells tell of a log-likelihood by level sets; measured by `benchmarks folds`.

    `jumped` is the loss of a log-density from coarse cells to those of half their size that says
    that the outcome is nowhere reached: it is log 2 where a set is only the cells that a jump
    crosses. `coarse` is the error of the log-likelihood that is worth a warning. `margin` is the
    error that is left, over what the last two halvings changed: 1.4 on random study 25. `rounding`
    is the least error of a log-density: of a slope over a cell that was halved eight times.
    """

    jumped: float = 0.5
    coarse: float = 0.1
    margin: float = 2.0
    rounding: float = 1e-8


CELLS = Cells()


def by_finer_cells(problem: Problem, alpha: Array) -> Array:
    """What cells of half the size changed in each log-density, the last time and before (2, N).

    Nothing without level sets. One halving alone may change nothing by chance: beside a kink the
    error of cells has either sign.
    """
    if problem.levels is None:
        return np.zeros((2, problem.outcomes.size))
    sizes = (problem.levels, problem.levels.coarse(), problem.levels.coarse(4))
    return np.asarray(-np.diff([levels.evaluate(alpha).each for levels in sizes], axis=0))


def cells_error(problem: Problem, changed: Array) -> float:
    """Of the log-likelihood by level sets, of what finer cells changed (2, N); zero without."""
    if problem.levels is None:
        return 0.0
    total, rounding = changed.sum(axis=1), CELLS.rounding * np.sqrt(changed.shape[1])
    return float(np.hypot(CELLS.margin * np.sqrt(total @ total + np.sum(changed**2)), rounding))


def level_refusals(changed: Array, ids: Sequence[str]) -> list[Diagnostic]:
    """Experiments whose outcome lies between the values on either side of a jump."""
    rows = np.flatnonzero(changed[0] < -CELLS.jumped)
    if not rows.size:
        return []
    return [
        Diagnostic(
            "jump",
            f"{named(rows, ids)}: the simulator jumps over the measured outcome, which it reaches "
            "for no parameters, so that no law explains it",
            "add measurement noise ([noise] sd), check these rows, or see why the simulator jumps",
            chosen(rows, ids),
        )
    ]


def unreached_refusals(problem: Problem, alpha: Array, ids: Sequence[str]) -> list[Diagnostic]:
    """Experiments whose outcome is not reached: it lies beyond an extreme of the response."""
    rows = np.flatnonzero(problem.unreached_at(alpha))
    if not rows.size:
        return []
    what = "the simulator" if problem.surface is None else "the response surface"
    return [
        Diagnostic(
            "extreme",
            f"{named(rows, ids)}: {what} does not go so far: the measured outcome lies at an "
            "extreme of it or beyond, where its density is not known",
            "add measurement noise ([noise] sd), check these rows, or choose a tolerance, such as "
            "0.005, for surfaces that are more exact there",
            chosen(rows, ids),
        )
    ]


def level_warnings(changed: Array) -> list[Diagnostic]:
    """Cells that are too coarse for the answer."""
    # what is left is as much at most, if the error is of first order
    error = float(np.sum(changed[0]))
    if abs(error) < CELLS.coarse:
        return []
    return [
        Diagnostic(
            "quadrature",
            f"the cells in which the simulator is looked at may change the log-likelihood by "
            f"{abs(error):.2g}: they are too coarse",
            "narrow the box of the parameters around the law",
        )
    ]
