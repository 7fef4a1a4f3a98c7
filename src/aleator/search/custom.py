"""A search by an optimizer that the user gives as a function."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.search.interface import SearchResult
from aleator.search.objective import Coordinates, Task, TaskSearch
from aleator.search.populations import finished

Value = Callable[[ArrayLike], float]
Optimizer = Callable[[Value, Array, Array, Array, np.random.Generator], ArrayLike]

ARGUMENTS = ("value", "lower", "upper", "start", "rng")
TAKES = (
    f"write def search({', '.join(ARGUMENTS)}), by position: value(alpha) is the log-likelihood to "
    "be maximized, lower, upper and start are arrays of the free hyperparameters, rng is a NumPy "
    "Generator; return the best alpha"
)


@dataclass(frozen=True)
class CustomSearch(TaskSearch):
    """A search by any optimizer, given as a function `(value, lower, upper, start, rng) -> alpha`.

    alpha (F,) holds only the free hyperparameters, in their own units. `value(alpha)` is the
    log-likelihood, to be maximized; it is always a finite number. `lower` and `upper` (F,) are the
    limits. `start` (F,) is the best of the start values and the guesses. `rng` is a seeded NumPy
    generator. The result is the best alpha that was evaluated, followed by a gradient ascent from
    there if `polish`. Errors that the function raises are not caught.

    Raises InputsError for a function that cannot be called with these five arguments, and where it
    returns anything but F numbers within the limits.

    >>> from scipy import optimize
    >>> from aleator.laws import Hyperparameter
    >>> from aleator.search.interface import LogLikelihood
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

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise InputsError(f"custom search: {self.function!r} is not a function", TAKES)
        try:
            signature = inspect.signature(self.function)
        except ValueError:
            # Some functions written in C have no signature.
            return
        try:
            signature.bind(*ARGUMENTS)
        except TypeError as error:
            raise InputsError(
                f"custom search: the function takes {signature}, but is called with the five "
                f"arguments ({', '.join(ARGUMENTS)}): {error}",
                TAKES,
            ) from error

    def _search(self, task: Task) -> SearchResult:
        """Call the user's function, then improve the best alpha by a gradient ascent if asked."""
        coordinates, counted = task.coordinates, task.counted

        def value(free: ArrayLike) -> float:
            alpha = coordinates.filled(np.asarray(free, dtype=np.float64).reshape(1, -1))
            result = float(counted.values(alpha)[0])
            task.progress.update(f"{counted.evaluations} evaluations, {counted.standing}")
            return result

        lower, upper = coordinates.lower, coordinates.upper
        known = np.stack([coordinates.start, *task.guesses])[:, coordinates.free]
        known = np.clip(known, lower, upper)
        start = known[int(np.argmax(counted.values(coordinates.filled(known))))]
        rng = np.random.default_rng(task.seed)
        end = self.function(value, lower.copy(), upper.copy(), start.copy(), rng)
        value(_within(end, coordinates))
        return finished(task, converged=True, polish=self.polish)


def _within(end: ArrayLike, coordinates: Coordinates, share: float = 1e-9) -> Array:
    """The returned alpha as an array; InputsError unless it is F numbers within the limits.

    It may lie beyond a limit by this `share` of the distance of the limits, because of rounding.
    """
    try:
        alpha = np.asarray(end, dtype=np.float64)
    except (TypeError, ValueError):
        alpha = np.full(0, np.nan)
    lower, upper = coordinates.lower, coordinates.upper
    slack = share * (upper - lower)
    if alpha.shape != lower.shape or not np.all(
        (alpha >= lower - slack) & (alpha <= upper + slack)
    ):
        raise InputsError(
            f"custom search: the function returned {end!r}, not {lower.size} numbers within "
            f"{lower.tolist()} and {upper.tolist()}",
            "return the best alpha, an array of the free hyperparameters within their limits",
        )
    return alpha
