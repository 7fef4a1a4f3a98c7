"""Runs of a simulator: planned, made, remembered, and made again to check that they repeat."""

from __future__ import annotations

import math
import platform
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.simulators.protocol import RunFailed, describe, readable

NOT_FINITE = "NotFinite"
"""The kind of a failure in which the run returned a number that is not finite."""


@dataclass(frozen=True)
class Failure:
    """Why a run has no outcome: message, end of its output, type of exception, attempts."""

    message: str
    log: str | None = None
    kind: str = ""
    attempts: int = 1

    @classmethod
    def of(cls, error: BaseException) -> Failure:
        """The failure of a run that raised an exception.

        >>> Failure.of(RunFailed("it ended with exit code 3", "too hot"))
        Failure(message='it ended with exit code 3', log='too hot', kind='RunFailed', attempts=1)
        """
        if isinstance(error, RunFailed):
            return cls(readable(error.message), readable(error.log) or None, "RunFailed")
        return cls(describe(error), None, type(error).__name__)


def row_bytes(values: Array) -> list[bytes]:
    """The bytes of each row of values (R, n), in the form of a store.

    >>> row_bytes(np.array([[1.0], [-0.0]]))[1]
    b'\\x00\\x00\\x00\\x00\\x00\\x00\\x00\\x80'
    """
    whole = np.ascontiguousarray(values, dtype="<f8").tobytes()
    size = len(whole) // max(len(values), 1)
    return [whole[k * size : (k + 1) * size] for k in range(len(values))]


@dataclass(frozen=True, eq=False)
class Runs:
    """R runs: the `case` (R,) of their conditions, their parameters `x` (R, n), and their outcomes.

    `outcome` (R, W) has the values of each run in the simulator's units. They are all NaN for a run
    that failed or is not made yet; `failures` has the reason of each failed run, by its position.
    `seconds` (R,) is the duration of each run, and `host` the computer. `named` says whether the
    simulator named its responses. If fewer runs were made than planned, `stopped` is the exception
    that ended them (Ctrl-C or a fault of the machine); None means that the time limit was reached.

    >>> planned = Runs.planned(np.array([0, 2]), np.array([[0.5], [0.7]]))
    >>> len(planned), planned.outcome.tolist()
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
    def planned(cls, case: Indices, x: Array, width: int = 1) -> Self:
        """Runs that are to be made, with `width` values each, still NaN."""
        return cls(case, x, np.full((len(case), width), np.nan), np.zeros(len(case)))

    @classmethod
    def of_keys(cls, keys: Sequence[bytes], parameters: int, width: int = 1) -> Self:
        """Runs that are to be made, from the keys that `keys` returned.

        >>> Runs.of_keys(Runs.planned(np.array([3]), np.array([[0.5]])).keys(), 1).case
        array([3])
        """
        rows = np.frombuffer(b"".join(keys)).reshape(-1, 1 + parameters)
        return cls.planned(rows[:, 0].astype(np.intp), rows[:, 1:], width)

    def keys(self) -> list[bytes]:
        """R byte strings that identify the runs: the case and every bit of the parameters."""
        return row_bytes(np.column_stack([self.case, self.x]))

    def frequent_failure(self) -> Failure | None:
        """The failure that most of the failed runs have in common; None without failed runs.

        Two messages are alike if they differ only in words with digits or slashes, such as values
        and folders. The first of the most frequent ones is returned, by conditions and parameters.
        """
        order = np.lexsort((*self.x.T[::-1], self.case)).tolist()
        failures = [self.failures[row] for row in order if row in self.failures]
        kinds = [re.sub(r"\S*[\d/]\S*", "#", failure.message) for failure in failures]
        if not kinds:
            return None
        return failures[kinds.index(Counter(kinds).most_common(1)[0][0])]

    def some(self, rows: slice | Indices | Flags) -> Self:
        """Some of the runs, as runs that are to be made."""
        return type(self).planned(self.case[rows], self.x[rows], self.outcome.shape[1])

    def halves(self) -> list[Self]:
        """The first and the second half, as runs that are to be made; a single run is one half."""
        middle = (len(self) + 1) // 2
        parts = [self.some(slice(middle)), self.some(slice(middle, None))]
        return [part for part in parts if len(part)]

    @classmethod
    def joined(cls, parts: Sequence[Runs]) -> Self:
        """All runs of the parts (at least one part), in their order."""
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
        """Which runs have no value (R,): those that failed, and those that are not made yet."""
        return np.all(np.isnan(self.outcome), axis=1)  # type: ignore[no-any-return]

    @property
    def region(self) -> Array:
        """The smallest box (n, 2) around the parameters of all runs (at least one)."""
        return np.stack([self.x.min(axis=0), self.x.max(axis=0)], axis=1)


class Memory:
    """The runs of this process by their keys: W values of each success, and the failures.

    `parameters` is the number of columns of x. Cost: some 150 bytes a run and 8 a value.

    >>> memory = Memory(parameters=1, width=1)
    >>> made = Runs(np.array([0]), np.array([[0.5]]), np.array([[2.0]]), np.zeros(1))
    >>> memory.keep(made.keys(), made)
    >>> memory.values(made.keys() + [b"another"])
    array([[ 2.],
           [nan]])
    """

    def __init__(self, parameters: int, width: int) -> None:
        self._parameters = parameters
        self.places: dict[bytes, int] = {}
        self.failures: dict[bytes, Failure] = {}
        self._values = np.full((1, width), np.nan)

    def __len__(self) -> int:
        return len(self.places) + len(self.failures)

    def __contains__(self, key: bytes) -> bool:
        return key in self.places or key in self.failures

    def values(self, keys: Sequence[bytes]) -> Array:
        """Values (R, W) of the runs with these keys; NaN for a run without values."""
        places = np.array([self.places.get(key, -1) for key in keys], dtype=np.intp)
        values = self._values[places]
        values[places < 0] = np.nan
        return values

    def planned(self, keys: Sequence[bytes]) -> Runs:
        """The runs with these keys, as runs that are to be made."""
        return Runs.of_keys(keys, self._parameters, self._values.shape[1])

    def remembered(self, keys: Sequence[bytes]) -> Runs:
        """The runs with these keys, with outcomes and failures as far as they were made."""
        failures = {k: self.failures[key] for k, key in enumerate(keys) if key in self.failures}
        return replace(self.planned(keys), outcome=self.values(keys), failures=failures)

    def keep(self, keys: Sequence[bytes], runs: Runs) -> None:
        """Remember the runs that have values or a failure; the others are not made yet."""
        self.failures |= {keys[k]: failure for k, failure in runs.failures.items()}
        good = np.flatnonzero(~runs.empty).tolist()
        worked = keys if len(good) == len(keys) else [keys[k] for k in good]
        for key in worked:
            self.failures.pop(key, None)
            self.places.setdefault(key, len(self.places))
        size = len(self._values)
        if (lacking := len(self.places) - size) > 0:
            more = np.full((max(size, lacking), self._values.shape[1]), np.nan)
            self._values = np.concatenate([self._values, more])
        self._values[[self.places[key] for key in worked]] = runs.outcome[good]


@dataclass(frozen=True)
class Repeatability:
    """Settings of the check that a run that is made again has the same outcome."""

    relative: float = 1e-6
    """The difference of two outcomes that is tolerated, relative to the outcome or to the median of
    all outcomes. Chosen by judgement: far above rounding, far below any measurement error."""
    most: int = 24
    """The most runs that are made again. If one run in ten is random, 24 repeated runs discover
    that in 92 of 100 studies (1 - 0.9^24)."""


REPEATABILITY = Repeatability()


class Repeats:
    """Chooses runs that are made again: the square root of their number, at most 24.

    It counts the runs that are made after `begin`.

    >>> repeats = Repeats()
    >>> repeats.begin()
    >>> [repeats.chosen(new).tolist() for new in (1, 3, 5, 100_000)]
    [[0], [0], [0], [0, 4999, 9999, 14999, 19999, 24999, 29999, 34999, ...]]
    """

    def __init__(self, settings: Repeatability = REPEATABILITY) -> None:
        self._settings, self._begun = settings, False
        self._made = self._again = 0

    def begin(self) -> None:
        """From now on choose among the runs that are made."""
        self._begun = True

    def chosen(self, new: int) -> Indices:
        """Positions among `new` runs that were just made; far apart, to vary the conditions."""
        if not self._begun:
            return np.empty(0, np.intp)
        self._made += new
        due = min(self._settings.most, math.isqrt(self._made)) - self._again
        if due <= 0:
            return np.empty(0, np.intp)
        chosen = np.unique(np.linspace(0, new - 1, min(due, new)).astype(np.intp))
        self._again += len(chosen)
        return chosen


def differing(
    first: Array, again: Array, settings: Repeatability = REPEATABILITY
) -> tuple[int, int] | None:
    """The row and the column of the first outcome (R, W) that differs when the runs are made again.

    Differences up to `settings.relative` of the value, or of the median of all values, are
    tolerated. A run that failed either time is not compared. None if nothing differs.

    >>> differing(np.array([[1.0], [2.0]]), np.array([[1.0], [2.1]]))
    (1, 0)
    """
    size = np.abs(first[np.isfinite(first)])
    usual = settings.relative * float(np.median(size)) if size.size else 0.0
    same = np.isclose(first, again, rtol=settings.relative, atol=usual, equal_nan=True)
    same |= np.all(np.isnan(first), axis=1, keepdims=True)
    same |= np.all(np.isnan(again), axis=1, keepdims=True)
    found = np.argwhere(~same)
    return (int(found[0, 0]), int(found[0, 1])) if len(found) else None
