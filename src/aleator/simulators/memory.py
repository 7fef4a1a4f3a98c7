"""What a runner knows of its runs: their values, or why there are none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aleator.simulators.runs import Failure, Runs
from aleator.types import Array

_FIRST = 64


class Memory:
    """Runs by their keys: W values of each that has an outcome, a failure of each that has none.

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
        self._values = np.full((_FIRST, width), np.nan)

    def __len__(self) -> int:
        return len(self.places) + len(self.failures)

    def __contains__(self, key: bytes) -> bool:
        return key in self.places or key in self.failures

    def values(self, keys: Sequence[bytes]) -> Array:
        """Values (R, W), NaN where there are none."""
        places = np.array([self.places.get(key, -1) for key in keys], dtype=np.intp)
        values = self._values[places]
        values[places < 0] = np.nan
        return values

    def asked(self, keys: Sequence[bytes]) -> Runs:
        """Runs that are to be made."""
        return Runs.of_keys(keys, self._parameters, self._values.shape[1])

    def known(self, keys: Sequence[bytes]) -> Runs:
        """What is known of some runs."""
        failures = {k: self.failures[key] for k, key in enumerate(keys) if key in self.failures}
        return replace(self.asked(keys), outcome=self.values(keys), failures=failures)

    def keep(self, keys: Sequence[bytes], runs: Runs) -> None:
        """Remember runs that are made; those that have neither values nor a failure are not."""
        self.failures |= {keys[k]: failure for k, failure in runs.failures.items()}
        good = np.flatnonzero(~runs.empty).tolist()
        own = keys if len(good) == len(keys) else [keys[k] for k in good]
        for key in self.failures.keys() & own:
            del self.failures[key]
        for key in own:
            self.places.setdefault(key, len(self.places))
        self._grow()
        self._values[[self.places[key] for key in own]] = runs.outcome[good]

    def _grow(self) -> None:
        size = len(self._values)
        if len(self.places) > size:
            more = np.full((max(size, len(self.places) - size), self._values.shape[1]), np.nan)
            self._values = np.concatenate([self._values, more])
