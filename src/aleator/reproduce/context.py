"""What several figures share: computed when first asked for, once in a run."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

from aleator.progress import Progress, Silent
from aleator.reproduce.camelback import Camelback
from aleator.reproduce.clutch_study import ClutchStudy


@dataclass(frozen=True)
class Context:
    """The seed of everything random, who listens, and the shared expensive values.

    >>> Context(seed=1).camelback.limit
    6.0
    """

    seed: int = 0
    progress: Progress = field(default_factory=Silent)

    @cached_property
    def camelback(self) -> Camelback:
        """The illustrative outcome."""
        return Camelback()

    @cached_property
    def clutch(self) -> ClutchStudy:
        """The wet clutch and its synthetic measurements."""
        return ClutchStudy()
