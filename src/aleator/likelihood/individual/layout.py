"""Which observations belong to which experiment, and which runs give their values."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from aleator.types import Array, Flags, Indices

BLOCK = 400_000
"""Simulated values that are held at once."""
GROUP = 10
"""Experiments next to each other that a sample of them takes together."""


@dataclass(frozen=True, eq=False)
class Block:
    """Some experiments one after the other: B of them, with m observations.

    `owner` (m,) is the experiment of each observation, counted from the first of the block, and
    `starts` (B,) where the observations of each begin. `units` (V,) are what has to be run for
    them, `unit_owner` (V,) whose they are, and `place`, `column` (m,) say which value of which of
    these units an observation is.
    """

    experiments: slice
    rows: slice
    owner: Indices
    starts: Indices
    units: Indices
    unit_owner: Indices
    place: Indices
    column: Indices

    def __len__(self) -> int:
        return self.starts.size

    @cached_property
    def seen(self) -> Flags:
        """Which experiments have an observation (B,)."""
        return np.bincount(self.owner, minlength=len(self)) > 0

    def summed(self, values: Array) -> Array:
        """Sums (B, ...) over the observations (m, ...) of each experiment; zero without any."""
        if np.all(self.seen):
            return np.add.reduceat(values, self.starts, axis=0)
        sums = np.zeros((len(self), *values.shape[1:]))
        if np.any(self.seen):
            sums[self.seen] = np.add.reduceat(values, self.starts[self.seen], axis=0)
        return sums


@dataclass(frozen=True, eq=False)
class Layout:
    """N experiments (`count`) and their M observations, sorted by experiment.

    An experiment may have none: its likelihood is one, whatever the law. `experiment` (M,) is that
    of each observation, `unit` (M,) what a run has to be made for to give its value, and `column`
    (M,) which of the values of that run it is. `chosen` are the only experiments that count, where
    there are any.
    """

    count: int
    experiment: Indices
    unit: Indices
    column: Indices
    chosen: tuple[slice, ...] = ()
    _blocks: dict[int, tuple[Block, ...]] = field(default_factory=dict, repr=False)

    @property
    def size(self) -> int:
        """M, the number of observations."""
        return self.experiment.size

    def blocks(self, nodes: int) -> tuple[Block, ...]:
        """The experiments in blocks that fit into memory at so many nodes; made once for each."""
        widest = int(np.bincount(self.experiment, minlength=self.count).max())
        step = min(max(1, BLOCK // (widest * nodes)), self.count)
        if step not in self._blocks:
            parts = self.chosen or (slice(0, self.count),)
            self._blocks[step] = tuple(
                self._block(first, min(first + step, part.stop))
                for part in parts
                for first in range(part.start, part.stop, step)
            )
        return self._blocks[step]

    def sampled(self, size: int) -> Layout:
        """Only about so many of the experiments, in groups that are spread evenly over all."""
        groups = max(1, size // GROUP)
        starts = np.linspace(0, self.count - GROUP, groups).astype(int).tolist()
        chosen = tuple(slice(first, first + GROUP) for first in dict.fromkeys(starts))
        return replace(self, chosen=chosen, _blocks={})

    def alone(self, experiment: int) -> Block:
        """One experiment by itself."""
        return self._block(experiment, experiment + 1)

    def _block(self, first: int, last: int) -> Block:
        begin, end = np.searchsorted(self.experiment, [first, last])
        rows = slice(int(begin), int(end))
        owner = self.experiment[rows] - first
        units, place = np.unique(self.unit[rows], return_inverse=True)
        unit_owner = np.empty(units.size, dtype=np.intp)
        unit_owner[place] = owner
        return Block(
            slice(first, last), rows, owner, np.searchsorted(owner, np.arange(last - first)),
            units, unit_owner, place, self.column[rows],
        )  # fmt: skip
