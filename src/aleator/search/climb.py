"""One quasi-Newton ascent (L-BFGS-B) on the exact score within the limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from aleator.likelihood import LogLikelihood
from aleator.search.coordinates import Coordinates
from aleator.search.interface import Ascent
from aleator.search.watched import FLOOR, Watched

Array = NDArray[np.float64]


def climb(objective: Watched, coordinates: Coordinates, start: Array, evaluations: int) -> Ascent:
    """Climb from the alpha `start` (K,) with at most so many evaluations.

    The variables are steps from the start in units of the standard errors there, as the outer
    product of the scores estimates them. Where the log-likelihood is no number the line search
    sees a value below all it has met, and comes back.
    """
    first = objective(start)
    if first.total <= FLOOR:
        return Ascent(start, start, -np.inf, 1, converged=False)
    scale = _scale(coordinates, first, start)
    count, best = 1, (start, first.total)
    least = first.total

    def negative(v: Array) -> tuple[float, Array]:
        nonlocal count, best, least
        alpha = coordinates.moved(start, v * scale) if np.any(v) else start
        if np.array_equal(alpha, start):
            result = first
        elif count < evaluations:
            count += 1
            result = objective(alpha)
        else:
            # the method's own limit is not looked at within a line search
            raise _SpentError
        if result.total <= FLOOR:
            return 1.0 - least + (best[1] - least), np.zeros_like(v)
        least = min(least, result.total)
        if result.total > best[1]:
            best = (alpha, result.total)
        return -result.total, -coordinates.gradient(alpha, result.score) * scale

    unit = coordinates.to_unit(start)
    try:
        end = optimize.minimize(
            negative,
            np.zeros_like(unit),
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(-unit / scale, (1.0 - unit) / scale, strict=True)),
            options={"ftol": 1e-11, "gtol": 1e-4, "maxcor": 20},
        )
    except _SpentError:
        return Ascent(start, *best, count, converged=False)
    return Ascent(start, *best, count, converged=bool(end.success))


def _scale(coordinates: Coordinates, first: LogLikelihood, start: Array) -> Array:
    """Standard errors (F,) in u, by the outer product of the scores at the start."""
    assert first.scores is not None
    with np.errstate(over="ignore"):
        each = coordinates.gradient(start, first.scores)
        information = np.sum(each**2, axis=0)
    # no variable is scaled to more than its whole range, nor to nothing
    return np.asarray(1.0 / np.clip(np.sqrt(information), 1.0, 1e6))


class _SpentError(Exception):
    """All evaluations of a start are used up."""
