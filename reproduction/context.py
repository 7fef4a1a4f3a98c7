"""What several figures share: computed when first asked for, once in a run."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from aleator.core.progress import Progress, Silent
from aleator.moments.densities import Gaussian
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.tasks.identification import Identification
from reproduction.clutch.laws import (
    PAPER_ENTROPY,
    PAPER_GAUSSIAN,
    Judged,
    drawn,
    identified,
    judged,
    values,
)
from reproduction.clutch.sampling import SamplingErrors, sampling_errors
from reproduction.clutch.study import GIVEN, ClutchStudy
from reproduction.illustrative.outcome import Camelback


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

    @cached_property
    def gaussian(self) -> Identification:
        """The law identified with Gaussian densities."""
        return identified(self.clutch, Gaussian(), self.seed, self.progress)

    @cached_property
    def entropy(self) -> Identification:
        """The law identified with maximum-entropy densities of four moments."""
        return identified(self.clutch, MaximumEntropy(order=4), self.seed, self.progress)

    @cached_property
    def at_given(self) -> Judged:
        """The paper's alpha = (1, 1, 0.07, 0.02)."""
        return self._judged("given", GIVEN)

    @cached_property
    def at_gaussian(self) -> Judged:
        """Our answer with Gaussian densities."""
        return self._judged("Gaussian", values(self.gaussian))

    @cached_property
    def at_entropy(self) -> Judged:
        """Our answer with maximum-entropy densities."""
        return self._judged("maximum entropy", values(self.entropy))

    @cached_property
    def at_paper_gaussian(self) -> Judged:
        """The paper's answer with Gaussian densities, on our clutch."""
        return self._judged("paper's Gaussian", PAPER_GAUSSIAN)

    @cached_property
    def at_paper_entropy(self) -> Judged:
        """The paper's answer with maximum-entropy densities, on our clutch."""
        return self._judged("paper's maximum entropy", PAPER_ENTROPY)

    @cached_property
    def sampling(self) -> tuple[SamplingErrors, ...]:
        """Errors by sampling at both identified laws, and at a law that both parameters scatter in.

        That third law is the paper's second answer, with outcomes drawn from it.
        """
        name = "the paper's, outcomes drawn from it"
        third = drawn(self.clutch, self.at_paper_entropy, name, self.seed)
        laws = (self.at_gaussian, self.at_entropy, third)
        return tuple(sampling_errors(self.clutch, at, self.seed, self.progress) for at in laws)

    def _judged(self, name: str, alpha: NDArray[np.float64]) -> Judged:
        return judged(self.clutch, name, alpha, self.seed, self.progress)
