"""Quasi-Newton ascent on the exact score, from several starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aleator.errors import InputsError
from aleator.laws import Hyperparameter
from aleator.progress import Progress, Silent
from aleator.search.climb import climb
from aleator.search.coordinates import Coordinates
from aleator.search.interface import Ascent, Objective, Scored, SearchResult
from aleator.search.optima import gathered, only_point
from aleator.search.starts import starting_points
from aleator.search.watched import Watched

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GradientMultistart:
    """Bounded quasi-Newton (L-BFGS-B) on the exact score from `starts` points.

    The starts are the hyperparameters' own start, the guesses of the baselines, and scrambled
    Sobol' points of the limits. Variables are scaled by the outer product of the scores at the
    start, which is the information matrix's estimate there. At most `evaluations` of the
    log-likelihood a start; a start that needs more ends as not converged. Raises InputsError for
    values below one, and where the log-likelihood is not finite at any start.

    >>> GradientMultistart(starts=5).name
    'gradient_multistart(5)'
    """

    starts: int = 10
    evaluations: int = 60

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if self.starts < 1 or self.evaluations < 1:
            raise InputsError(
                f"search: starts {self.starts} and evaluations {self.evaluations}",
                "both must be at least 1; 10 starts find most second optima",
            )

    @property
    def name(self) -> str:
        """How the result names this choice."""
        return f"gradient_multistart({self.starts})"

    def maximize(
        self,
        objective: Objective | Scored,
        hyperparameters: Sequence[Hyperparameter],
        *,
        seed: int,
        guesses: Sequence[Array] = (),
        progress: Progress | None = None,
    ) -> SearchResult:
        """Climb from every start and gather the distinct optima, best first."""
        progress = progress or Silent()
        coordinates, watched = Coordinates(hyperparameters), Watched(objective, self.name)
        if coordinates.free.size == 0:
            return only_point(watched, coordinates, hyperparameters)
        ascents: list[Ascent] = []
        for start in starting_points(coordinates, guesses, self.starts, seed):
            ascents.append(climb(watched, coordinates, start, self.evaluations))
            text = f"start {len(ascents)} of {self.starts}, {watched.standing}"
            progress.update(text, len(ascents), self.starts)
        return gathered(ascents, watched, hyperparameters)
