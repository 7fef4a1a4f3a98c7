"""The record of completed runs in memory."""

from __future__ import annotations

from collections.abc import Sequence
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
