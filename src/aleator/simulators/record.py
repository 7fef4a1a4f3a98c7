"""The record of completed runs in memory."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Runs:
    """R completed runs: `index` (R,) of the experiment, `x` (R, n), `outcome` (R,).

    The outcome is finite and in its original unit, before the transform of the experiments.

    >>> len(Runs.none(2))
    0
    """

    index: NDArray[np.intp]
    x: NDArray[np.float64]
    outcome: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.index)

    @classmethod
    def none(cls, parameters: int) -> Runs:
        """No runs of a simulator with so many parameters."""
        return cls.joined([], parameters)

    @classmethod
    def joined(cls, blocks: Sequence[Runs], parameters: int) -> Runs:
        """The runs of all blocks in their order."""
        return cls(
            np.concatenate([np.empty(0, np.intp), *(block.index for block in blocks)]),
            np.concatenate([np.empty((0, parameters)), *(block.x for block in blocks)]),
            np.concatenate([np.empty(0), *(block.outcome for block in blocks)]),
        )


@dataclass(frozen=True, eq=False)
class Failures:
    """F runs without an outcome: `index` (F,) of the experiment, `x` (F, n), `messages`.

    >>> Failures.of([(0, np.array([0.9]), "too hot"), (0, np.array([0.7]), "too hot")], 1).region
    array([[0.7, 0.9]])
    """

    index: NDArray[np.intp]
    x: NDArray[np.float64]
    messages: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.index)

    @classmethod
    def of(
        cls, failed: Collection[tuple[int, NDArray[np.float64], str]], parameters: int
    ) -> Failures:
        """The failures of runs with so many parameters."""
        return cls(
            np.array([at for at, _, _ in failed], dtype=np.intp),
            np.array([x for _, x, _ in failed], dtype=np.float64).reshape(-1, parameters),
            tuple(message for _, _, message in failed),
        )

    @property
    def region(self) -> NDArray[np.float64]:
        """The smallest box (n, 2) that holds all of them; there must be one."""
        return np.stack([self.x.min(axis=0), self.x.max(axis=0)], axis=1)
