"""Quasi-Newton ascent on the exact score, from several starts."""

from __future__ import annotations

from dataclasses import dataclass, replace

from aleator.errors import InputsError
from aleator.search.climb import climb
from aleator.search.interface import Ascent, SearchResult
from aleator.search.joining import Reached
from aleator.search.optima import gathered, reached_once
from aleator.search.starts import starting_points
from aleator.search.task import Task, TaskSearch


@dataclass(frozen=True)
class GradientMultistart(TaskSearch):
    """Bounded quasi-Newton (L-BFGS-B) on the exact score from `starts` points or more.

    The starts are the hyperparameters' own start, the guesses of the baselines, and scrambled
    Sobol' points of the limits. Of several starts, more follow until a second one comes to the best
    log-likelihood, `most` in all (three times `starts` where left out): a maximum that one start
    found need not be the highest. Variables are scaled by the outer product of the scores at the
    start, which is the information matrix's estimate there. At most `evaluations` of the
    log-likelihood a start; a start that needs more ends as not converged. Raises InputsError for
    values below one, for `most` below `starts`, and where the log-likelihood is not finite at any
    start.

    >>> GradientMultistart(starts=5).name
    'gradient_multistart(5)'
    """

    starts: int = 10
    evaluations: int = 60
    most: int | None = None

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if self.starts < 1 or self.evaluations < 1:
            raise InputsError(
                f"search: starts {self.starts} and evaluations {self.evaluations}",
                "both must be at least 1; 10 starts find most second optima",
            )
        if self.most is not None and self.most < self.starts:
            raise InputsError(
                f"search: most {self.most}, and {self.starts} starts",
                "let most be as many starts as there may be in all, or leave it out",
            )

    @property
    def name(self) -> str:
        """How the result names this choice."""
        return f"gradient_multistart({self.starts})"

    def _search(self, task: Task) -> SearchResult:
        """Climb from every start and gather the distinct optima, best first."""
        ascents: list[Ascent] = []
        reached: list[Reached] = []
        most = self.most or (3 * self.starts if self.starts > 1 else 1)
        counted, free = task.counted, task.coordinates.free
        for start in starting_points(task.coordinates, task.guesses, most, task.seed):
            if len(ascents) >= self.starts and not reached_once(ascents, counted, free):
                break
            ascents.append(climb(task.counted, task.coordinates, start, self.evaluations, reached))
            count = self.starts if len(ascents) <= self.starts else most
            text = f"start {len(ascents)} of {count}, {task.counted.standing}"
            task.progress.update(text, len(ascents), count)
        found = gathered(ascents, task.counted, task.hyperparameters)
        return replace(found, once=most > 1 and reached_once(ascents, counted, free))
