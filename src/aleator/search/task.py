"""The head that all searches share: what is to be searched, and whether anything is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from aleator.laws import Hyperparameter
from aleator.progress import Progress, Silent
from aleator.search.coordinates import Coordinates
from aleator.search.counted import CountedObjective
from aleator.search.interface import Objective, Scored, SearchResult
from aleator.search.optima import only_point
from aleator.types import Array


@dataclass(frozen=True, eq=False)
class Task:
    """What a search is given: the counted objective over F > 0 free hyperparameters.

    `guesses` are alphas (K,) worth a start; `seed` is that of everything random.
    """

    counted: CountedObjective
    coordinates: Coordinates
    hyperparameters: Sequence[Hyperparameter]
    guesses: Sequence[Array]
    seed: int
    progress: Progress


class TaskSearch(ABC):
    """A search that is asked only where a hyperparameter is free; it fills `name` and `_search`."""

    @property
    @abstractmethod
    def name(self) -> str:
        """How the result names this choice."""

    def maximize(
        self,
        objective: Objective | Scored,
        hyperparameters: Sequence[Hyperparameter],
        *,
        seed: int,
        guesses: Sequence[Array] = (),
        progress: Progress | None = None,
    ) -> SearchResult:
        """Search within the limits; where nothing is free, one evaluation is the result.

        Raises InputsError where the log-likelihood is nowhere a finite number.
        """
        coordinates, counted = Coordinates(hyperparameters), CountedObjective(objective, self.name)
        if coordinates.free.size == 0:
            return only_point(counted, coordinates, hyperparameters)
        told = progress or Silent()
        return self._search(Task(counted, coordinates, hyperparameters, guesses, seed, told))

    @abstractmethod
    def _search(self, task: Task) -> SearchResult:
        """The result over the free hyperparameters."""
