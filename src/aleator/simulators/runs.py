"""Runs of a simulator: what is asked for, and what came of it."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from aleator.simulators.failure import RunFailed, describe, readable
from aleator.types import Array, Flags, Indices

NOT_FINITE = "NotFinite"
"""The kind of a failure where the simulator returned a number that cannot be used."""


@dataclass(frozen=True)
class Failure:
    """Why a run has no outcome: a message, its log if any, what was raised, and how often."""

    message: str
    log: str | None = None
    kind: str = ""
    attempts: int = 1

    @classmethod
    def of(cls, error: BaseException) -> Failure:
        """What an exception says.

        >>> Failure.of(RunFailed("it ended with exit code 3", "too hot"))
        Failure(message='it ended with exit code 3', log='too hot', kind='RunFailed', attempts=1)
        """
        if isinstance(error, RunFailed):
            return cls(readable(error.message), readable(error.log) or None, "RunFailed")
        return cls(describe(error), None, type(error).__name__)


@dataclass(frozen=True, eq=False)
class Runs:
    """R runs: `case` (R,) of the conditions, `x` (R, n), and once they are made what came of them.

    `outcome` (R, W) are the values of each run in the simulator's units, all NaN where there are
    none or none yet. `failures` says by run why there are none. `seconds` (R,) is what each run
    took on `host`; `named` says whether the simulator named its responses. Where fewer runs were
    made than were asked for, `stopped` is what ended them (Ctrl-C, or the surroundings), or None if
    the time was up.

    >>> asked = Runs.asked(np.array([0, 2]), np.array([[0.5], [0.7]]))
    >>> len(asked), asked.outcome.tolist()
    (2, [[nan], [nan]])
    """

    case: Indices
    x: Array
    outcome: Array
    seconds: Array
    failures: Mapping[int, Failure] = field(default_factory=dict)
    host: str = field(default_factory=platform.node)
    stopped: BaseException | None = None
    named: bool = False

    def __len__(self) -> int:
        return len(self.case)

    @classmethod
    def asked(cls, case: Indices, x: Array, width: int = 1) -> Self:
        """Runs that are to be made, of `width` values each."""
        return cls(case, x, np.full((len(case), width), np.nan), np.zeros(len(case)))

    @classmethod
    def of_keys(cls, keys: Sequence[bytes], parameters: int, width: int = 1) -> Self:
        """Runs that are to be made, by their keys.

        >>> Runs.of_keys(Runs.asked(np.array([3]), np.array([[0.5]])).keys(), 1).case
        array([3])
        """
        rows = np.frombuffer(b"".join(keys)).reshape(-1, 1 + parameters)
        return cls.asked(rows[:, 0].astype(np.intp), rows[:, 1:], width)

    def keys(self) -> list[bytes]:
        """What tells one run from another: the case and every bit of the parameters, R texts."""
        rows = np.column_stack([self.case, self.x])
        whole, size = rows.tobytes(), rows.itemsize * rows.shape[1]
        return [whole[k : k + size] for k in range(0, len(whole), size)]

    def some(self, rows: slice | Indices | Flags) -> Self:
        """Some of the runs, to be made."""
        return type(self).asked(self.case[rows], self.x[rows], self.outcome.shape[1])

    def halves(self) -> list[Self]:
        """The first half and the second, to be made; one of a single run."""
        middle = (len(self) + 1) // 2
        parts = [self.some(slice(middle)), self.some(slice(middle, None))]
        return [part for part in parts if len(part)]

    @classmethod
    def joined(cls, parts: Sequence[Runs]) -> Self:
        """The runs of all parts (at least one) in their order."""
        starts = np.cumsum([0, *map(len, parts)]).tolist()
        return cls(
            np.concatenate([part.case for part in parts]),
            np.concatenate([part.x for part in parts]),
            np.concatenate([part.outcome for part in parts]),
            np.concatenate([part.seconds for part in parts]),
            {
                start + row: failure
                for start, part in zip(starts, parts, strict=False)
                for row, failure in part.failures.items()
            },
            stopped=parts[-1].stopped,
            named=any(part.named for part in parts),
        )

    @property
    def empty(self) -> Flags:
        """(R,) which runs have no value: those that failed, and those that are not made."""
        return np.all(np.isnan(self.outcome), axis=1)  # type: ignore[no-any-return]

    @property
    def region(self) -> Array:
        """The smallest box (n, 2) that holds the parameters of all runs; there must be one."""
        return np.stack([self.x.min(axis=0), self.x.max(axis=0)], axis=1)
