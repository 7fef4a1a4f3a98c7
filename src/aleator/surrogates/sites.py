"""The distinct values of runs that surfaces are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.simulators import Runner
from aleator.surrogates.responses import Run, moving_parameters
from aleator.types import Array, Flags, Indices


@dataclass(frozen=True, eq=False)
class Sites:
    """The distinct values that surfaces are made of: `case` and `column` (U,) of each.

    `unit` (U,) is a unit of each case, and `of` (M,) the site of each observation.
    """

    unit: Indices
    column: Indices
    of: Indices

    @classmethod
    def seen(cls, runner: Runner, unit: Indices, column: Indices) -> Sites:
        """Those of observations that are values of these units (M,), in these columns (M,)."""
        case = runner.cases.condition[unit]
        pairs = np.stack([case, column], axis=1)
        distinct, of = np.unique(pairs, axis=0, return_inverse=True)
        return cls(runner.cases.first[distinct[:, 0]], distinct[:, 1], of.ravel())

    def __len__(self) -> int:
        return self.unit.size

    def run(self, runner: Runner, region: Array) -> Run:
        """`run(index (R,), x (R, moving)) -> (R,)` of the sites, NaN where a run fails."""
        moving, known = moving_parameters(region), region[:, 0]

        def run(index: Indices, x: Array) -> Array:
            full = np.tile(known, (len(x), 1))
            full[:, moving] = x
            return np.asarray(
                runner.values(self.unit[index], full)[np.arange(len(x)), self.column[index]]
            )

        return run

    def together(self, members: Flags) -> Flags:
        """With all sites of the units of some: the same runs give them their values."""
        return np.isin(self.unit, self.unit[members])
