"""Runs that cost less than remembering them: made here, neither remembered nor stored."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from aleator.blocks import blocks
from aleator.errors import AleatorError
from aleator.simulators.arrays import CHECKED, Together, elementwise
from aleator.simulators.bound import Bound
from aleator.simulators.function import FunctionSimulator
from aleator.simulators.protocol import ARRAY_BLOCK, RunStopped
from aleator.simulators.runs import NOT_FINITE, Failure, Runs
from aleator.simulators.workers.batch import make
from aleator.types import Array, Indices

Failures = Mapping[int, Failure]
# Kronecker's sequence by square roots of primes: points of a box that differ in every coordinate.
_PRIMES = np.array([2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0, 29.0])


TOLD = 1000
"""Runs without an outcome that are remembered, to be told."""


class Direct:
    """Runs of cases, as they are asked for: `count` is how many were made.

    `lost` counts those that lack a value which is measured; `failures` are the first of them.

    After `find_arrays` a function of numbers is called with arrays, if it may be.

    >>> inverse = FunctionSimulator(lambda x: 1.0 / x, vectorized=True)
    >>> from aleator.simulators.cases import Cases
    >>> direct = Direct(Bound(inverse, Cases.of({}, 1), ("x",)))
    >>> direct(np.array([0, 0]), np.array([[2.0], [0.0]])).tolist()
    [[0.5], [inf]]
    """

    def __init__(self, bound: Bound) -> None:
        self._bound, self._simulator, self._form = bound, bound.simulator, bound.form
        self._together: Together | None = None
        self.count = self.lost = 0
        self.failures = Runs.asked(np.empty(0, np.intp), np.empty((0, len(bound.parameters))))

    def __call__(self, case: Indices, x: Array) -> Array:
        """Values (R, W) of runs of `case` (R,) with parameters `x` (R, n), as they were returned.

        A run that raises is NaN; a number that is not finite stays as it is. Raises SimulatorError
        for a wrong shape or type, SurroundingsError for what the machine did to a run. Cost: some
        20 ns a run of a vectorized function beside its own.
        """
        self.count += len(case)
        values = np.empty((len(case), self._form.width))
        for rows in blocks(len(case), 1, self._size):
            values[rows], failures = self._block(case[rows], x[rows])
            self._note(case[rows], x[rows], values[rows], failures)
        return values

    def again(self, case: Indices, x: Array) -> Array:
        """Values (R, W) of runs that are made once more; none is counted."""
        parts = blocks(len(case), 1, self._size)
        return np.concatenate([self._block(case[rows], x[rows])[0] for rows in parts])

    @property
    def _size(self) -> int:
        together = max(ARRAY_BLOCK // self._form.width, 1)
        return together if self._together else self._simulator.block

    def find_arrays(self, region: Array) -> bool:
        """Whether the simulator takes arrays: it is vectorized, or a function found `elementwise`.

        It is tried at up to 16 points of the region (n, 2), under as many cases.
        """
        simulator = self._simulator
        if not isinstance(simulator, FunctionSimulator) or simulator.vectorized:
            return getattr(simulator, "vectorized", False) is True
        case = np.linspace(0, len(self._bound.cases) - 1, CHECKED).astype(np.intp)
        steps = np.sqrt(np.resize(_PRIMES, len(region)))
        share = np.outer(np.arange(1, CHECKED + 1), steps) % 1.0
        points = region[:, 0] + share * (region[:, 1] - region[:, 0])
        self.count += CHECKED
        found = elementwise(self._bound, case, points)
        self._together = Together(self._bound) if found else None
        return found

    def _note(self, case: Indices, x: Array, values: Array, failures: Failures) -> None:
        """Remember why runs have no outcome."""
        form = self._form.some(case)
        gone = np.isnan(values) if form.observed is None else np.isnan(values) & form.observed
        if not np.any(gone):
            return
        runs = np.unique(np.nonzero(gone)[0])
        self.lost += len(runs)
        told = runs[: TOLD - len(self.failures)]
        if len(told):
            columns = np.argmax(gone[told], axis=1)
            noted = {
                k: failures.get(run) or Failure(form.fault(run, column, np.nan), kind=NOT_FINITE)
                for k, (run, column) in enumerate(zip(told.tolist(), columns.tolist(), strict=True))
            }
            asked = replace(Runs.asked(case[told], x[told]), failures=noted)
            self.failures = Runs.joined([self.failures, asked])

    def _block(self, case: Indices, x: Array) -> tuple[Array, Failures]:
        try:
            if self._together is not None:
                return self._together(case, x), {}
            returned = self._simulator(*self._bound.columns(case, x))
            return self._form.some(case).shaped(self._simulator, returned, len(case)), {}
        except (AleatorError, KeyboardInterrupt):
            raise
        except BaseException as error:
            if isinstance(error.__cause__, KeyboardInterrupt) and isinstance(error, RunStopped):
                raise error.__cause__ from None
            return self._carefully(case, x)

    def _carefully(self, case: Indices, x: Array) -> tuple[Array, Failures]:
        """The same where a run raises: that one is NaN."""
        form, names = self._form.some(case), self._bound.parameters
        values = np.full((len(x), form.width), np.nan)
        anything = replace(form, observed=np.zeros(values.shape, dtype=np.bool_))
        done, failures = 0, dict[int, Failure]()
        while done < len(case):
            left = slice(done, None)
            asked = Runs.asked(case[left], x[left], form.width)
            conditions = self._bound.cases.at(case[left])
            made = make(self._simulator, conditions, names, anything.some(left), asked, np.inf)
            if made.stopped:
                raise made.stopped
            values[done : done + len(made)] = made.outcome
            failures |= {done + run: failure for run, failure in made.failures.items()}
            done += len(made)
        return values, failures
