"""A search by an optimizer of the user's own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.errors import InputsError
from aleator.laws import Hyperparameter
from aleator.progress import Progress, Silent
from aleator.search.coordinates import Coordinates
from aleator.search.interface import Objective, Scored, SearchResult
from aleator.search.optima import only_point
from aleator.search.population import finished
from aleator.search.watched import Watched

Array = NDArray[np.float64]
Value = Callable[[ArrayLike], float]
Optimizer = Callable[[Value, Array, Array, Array, np.random.Generator], ArrayLike]


@dataclass(frozen=True)
class CustomSearch:
    """Any optimizer, as a function `(value, lower, upper, start, rng) -> alpha`.

    All are of the F free hyperparameters, in their own units: `value(alpha)` is the log-likelihood
    at alpha (F,), to be maximized, and never anything but a finite number; `lower`, `upper` and
    `start` are (F,), the start being the best of the hyperparameters' own and the guesses; `rng`
    is seeded. The result is the best alpha that was asked for, after a gradient ascent from there
    if `polish`. What the function raises is not caught.

    Raises InputsError where the function returns anything but F numbers within the limits.

    >>> from scipy import optimize
    >>> from aleator.likelihood import LogLikelihood
    >>> def simplex(value, lower, upper, start, rng):
    ...     limits = optimize.Bounds(lower, upper)
    ...     cost = lambda alpha: -value(alpha)
    ...     return optimize.minimize(cost, start, method="Nelder-Mead", bounds=limits).x
    >>> def parabola(alpha):  # log L = -(alpha - 2)^2, largest at 2
    ...     gap = alpha - 2.0
    ...     return LogLikelihood(-(gap**2), -2.0 * gap[None, :], np.zeros(1, dtype=int))
    >>> limits = [Hyperparameter("x.mean", 0.0, 10.0, 5.0, free=True)]
    >>> search = CustomSearch(simplex, polish=False)
    >>> search.maximize(parabola, limits, seed=0).alpha.round(3).tolist()
    [2.0]
    """

    function: Optimizer
    polish: bool = True
    name: str = "custom"

    def maximize(
        self,
        objective: Objective | Scored,
        hyperparameters: Sequence[Hyperparameter],
        *,
        seed: int,
        guesses: Sequence[Array] = (),
        progress: Progress | None = None,
    ) -> SearchResult:
        """Let the function search, and polish the best that it met."""
        progress = progress or Silent()
        coordinates, watched = Coordinates(hyperparameters), Watched(objective, self.name)
        if coordinates.free.size == 0:
            return only_point(watched, coordinates, hyperparameters)

        def value(free: ArrayLike) -> float:
            alpha = coordinates.filled(np.asarray(free, dtype=np.float64).reshape(1, -1))
            result = float(watched.values(alpha)[0])
            progress.update(f"{watched.evaluations} evaluations, {watched.standing}")
            return result

        lower, upper = coordinates.lower, coordinates.upper
        known = np.stack([coordinates.start, *guesses])[:, coordinates.free]
        known = np.clip(known, lower, upper)
        start = known[int(np.argmax(watched.values(coordinates.filled(known))))]
        rng = np.random.default_rng(seed)
        end = self.function(value, lower.copy(), upper.copy(), start.copy(), rng)
        value(_within(end, coordinates))
        return finished(watched, coordinates, hyperparameters, converged=True, polish=self.polish)


def _within(end: ArrayLike, coordinates: Coordinates) -> Array:
    try:
        alpha = np.asarray(end, dtype=np.float64)
    except (TypeError, ValueError):
        alpha = np.full(0, np.nan)
    lower, upper = coordinates.lower, coordinates.upper
    slack = 1e-9 * (upper - lower)
    if alpha.shape != lower.shape or not np.all(
        (alpha >= lower - slack) & (alpha <= upper + slack)
    ):
        raise InputsError(
            f"custom search: the function returned {end!r}, not {lower.size} numbers within "
            f"{lower.tolist()} and {upper.tolist()}",
            "return the best alpha, an array of the free hyperparameters within their limits",
        )
    return alpha
