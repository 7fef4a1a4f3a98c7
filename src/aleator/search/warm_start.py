"""A short search that starts from the known maximum of a nearly equal likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from aleator.laws import Hyperparameter
from aleator.progress import Progress
from aleator.search.gradient import GradientMultistart
from aleator.search.interface import Objective, Scored, SearchResult
from aleator.types import Array


@dataclass(frozen=True)
class WarmStart:
    """Climb from `alpha` (K,), the hyperparameters' start and a guess: `GradientMultistart(3)`.

    For a likelihood that costs much, after a search of a cheaper one that is nearly the same. It
    finds no optimum that the other did not lead to, and how often that was reached, `once` or more,
    is what the other tells.

    >>> import numpy as np
    >>> WarmStart(np.array([1.0])).name
    'gradient_multistart(3)'
    """

    alpha: Array
    once: bool = False

    @property
    def name(self) -> str:
        """How the result names this choice."""
        return self._multistart.name

    def maximize(
        self,
        objective: Objective | Scored,
        hyperparameters: Sequence[Hyperparameter],
        *,
        seed: int,
        guesses: Sequence[Array] = (),
        progress: Progress | None = None,
    ) -> SearchResult:
        """The best of the three ends; errors as `GradientMultistart`."""
        known = [self.alpha, *guesses]
        found = self._multistart.maximize(
            objective, hyperparameters, seed=seed, guesses=known, progress=progress
        )
        return replace(found, once=self.once)

    @property
    def _multistart(self) -> GradientMultistart:
        return GradientMultistart(3, most=3)
