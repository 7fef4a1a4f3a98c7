"""The only way to a simulator: it checks, counts and keeps every run."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.errors import SimulatorError
from aleator.observations.experiments import Conditions, Experiments, transformed
from aleator.progress import Progress, Silent
from aleator.simulators.complaint import Complaint, Tried
from aleator.simulators.function import FunctionSimulator, Simulator
from aleator.simulators.kept import Kept
from aleator.simulators.record import Failures, Runs
from aleator.simulators.store import Store
from aleator.simulators.tally import Tally
from aleator.simulators.workers.crew import Crew, carried
from aleator.simulators.workers.work import Columns, Failure, Work, not_finite
from aleator.types import Array, Indices

REPEATABLE = 1e-6
"""Relative difference of two outcomes of the same run that is no cause for concern."""

MAX_FAILED = 0.2
"""Share of failed runs at which a study stops."""
FEW = 10
"""Failures of which no share is too large yet."""


def as_simulator(simulator: Simulator | Callable[..., Any], vectorized: bool = False) -> Simulator:
    """A plain function as a simulator, called once a run or `vectorized`; a simulator as it is.

    >>> as_simulator(lambda load, stiffness: load / stiffness).vectorized
    False
    """
    if isinstance(simulator, FunctionSimulator):
        return simulator
    if all(hasattr(simulator, member) for member in ("name", "block", "asks", "fingerprint")):
        return simulator  # type: ignore[return-value] # any class that fills the protocol
    return FunctionSimulator(simulator, vectorized)


def as_runner(
    simulator: Runner | Simulator | Callable[..., Any],
    experiments: Experiments | Conditions,
    parameters: Sequence[str],
    vectorized: bool = False,
    executor: Executor | None = None,
) -> Runner:
    """A runner as it is; a simulator or a function (see `as_simulator`) on the experiments.

    >>> import pandas as pd
    >>> table = Conditions(("a",), pd.DataFrame({"load": [1.0]}))
    >>> as_runner(lambda load, x: load * x, table, ["x"])([0], [[2.0]])
    array([2.])
    """
    if isinstance(simulator, Runner):
        return simulator
    simulator = as_simulator(simulator, vectorized)
    return Runner(simulator, experiments, parameters, executor=executor)


class Runner:
    """`run(index (R,), x (R, n)) -> outcome (R,)`: runs of a simulator on experiments.

    `parameters` names the n columns of x. The outcome is what the likelihood sees: after the
    transform of the experiments. Experiments under the same conditions share their runs. A run
    that is in `known` or in `store` is not repeated, and every new run is committed to the store
    as soon as it is known, one that failed with its message; numbers must be exactly equal.

    Runs are made here, one batch after the other, or by the workers of an `executor` (any
    concurrent.futures.Executor); outcomes do not depend on it. One that fails is tried again
    `retries` times. Where more than the share `max_failed` of the runs of this runner failed, and
    at least ten, `attempt` stops.

    `group` (N,) is, for each experiment, the first one under the same conditions.
    `runs` counts the runs that were needed, those that were known (`reused`) included, so that an
    identification resumed tells the same number as one that was not interrupted.

    Raises SimulatorError at once if the simulator does not take these conditions and parameters;
    in a run for an exception, an outcome that is not a finite number, or a wrong shape; StoreError
    if the store cannot be read or written. What completed before is kept in `completed`. A run
    that failed is tried again when a call needs it: whoever asks again has mended something.

    >>> import pandas as pd
    >>> table = Conditions(("a", "b"), pd.DataFrame({"load": [1.0, 2.0]}))
    >>> run = Runner(lambda load, stiffness: load / stiffness, table, ["stiffness"])
    >>> run([0, 1, 1], [[4.0], [4.0], [8.0]]).tolist(), run.runs
    ([0.25, 0.5, 0.25], 3)
    """

    def __init__(
        self,
        simulator: Simulator | Callable[..., Any],
        experiments: Experiments | Conditions,
        parameters: Sequence[str],
        known: Runs | None = None,
        progress: Progress | None = None,
        store: Store | None = None,
        *,
        executor: Executor | None = None,
        retries: int = 0,
        max_failed: float = MAX_FAILED,
    ) -> None:
        _check(retries, max_failed)
        self.simulator = as_simulator(simulator)
        self.ids = experiments.ids
        self.parameters = tuple(parameters)
        self.transform = experiments.transform
        self.progress = progress or Silent()
        self.executor, self.retries, self.max_failed = executor, retries, max_failed
        asked = self.simulator.asks([*map(str, experiments.conditions.columns)], self.parameters)
        self._conditions = {name: experiments.conditions[name].to_numpy() for name in asked}
        self.group = _groups([*self._conditions.values()], len(self.ids))
        self._known: dict[bytes, float] = {}
        self._failed: dict[bytes, tuple[int, Array, str]] = {}
        self._reused_runs: list[Runs] = []
        self._blocks: list[Runs] = []
        self.kept = (
            None
            if store is None
            else Kept(store, self.simulator, self._conditions, len(self.ids), self.parameters)
        )
        self._words = Complaint(
            self.simulator.name, bool(getattr(self.simulator, "vectorized", False)), self.ids,
            self.parameters, self._conditions,
        )  # fmt: skip
        self.runs = 0
        self.reused = 0
        if known is not None:
            self.know(known)

    def know(self, known: Runs) -> None:
        """Do not repeat the runs in `known`, for as long as this runner lives."""
        self._known.update(
            zip(self._keys(known.index, known.x), known.outcome.tolist(), strict=True)
        )
        self._reused_runs.append(known)

    @property
    def completed(self) -> Runs:
        """Every run that completed here, after those that were known."""
        return Runs.joined([*self._reused_runs, *self._blocks], len(self.parameters))

    @property
    def failures(self) -> Failures:
        """Every run that `attempt` needed and that has no outcome, once each."""
        return Failures.of(self._failed.values(), len(self.parameters))

    @property
    def fresh(self) -> int:
        """The number of runs that completed here."""
        return sum(map(len, self._blocks))

    def __call__(self, index: ArrayLike, x: ArrayLike) -> Array:
        """Run experiment `index` (R,) with parameters `x` (R, n): outcomes (R,), transformed."""
        at, points, keys, inverse = self._distinct(index, x)
        outcome, _ = self._recalled(at, points, keys)
        new = ~np.isfinite(transformed(outcome, self.transform))
        self.runs += len(keys)
        self.reused += len(keys) - int(np.sum(new))
        outcome[new], failures = self._done(at[new], points[new], int(np.sum(~new)), None)
        if failures:
            rows = np.flatnonzero(new)
            self._note(at, points, keys, {int(rows[k]): f for k, f in failures.items()})
            raise self._words.first(_tried(at[new], points[new], outcome[new], failures))
        return transformed(outcome[inverse], self.transform)

    @property
    def conditions(self) -> dict[str, NDArray[Any]]:
        """Columns (N,) of the conditions that the simulator asks for."""
        return dict(self._conditions)

    def attempt(self, index: ArrayLike, x: ArrayLike, most: float | None = None) -> Array:
        """Run as a call does, but a run that raises or is not finite is NaN and stops nothing.

        A run that is known, even as failed, is not repeated. Raises SimulatorError for a wrong
        shape, and NoOutcome where more than the share `most` (the runner's `max_failed`) failed.
        """
        at, points, keys, inverse = self._distinct(index, x)
        outcome, failed = self._recalled(at, points, keys)
        known = np.isfinite(outcome) | np.array([key in self._failed for key in keys], dtype=bool)
        known[[k for k, (_, attempts) in failed.items() if attempts > self.retries]] = True
        new = np.flatnonzero(~known)
        self.runs += len(keys)
        self.reused += int(np.sum(known))
        share = self.max_failed if most is None else most
        outcome[new], failures = self._done(at[new], points[new], int(np.sum(known)), share)
        seen = np.array(transformed(outcome, self.transform))
        seen[~np.isfinite(seen)] = np.nan
        lost = {k: Failure(k, message) for k, (message, _) in failed.items()}
        lost |= {int(new[k]): failure for k, failure in failures.items()}
        reasons = {
            k: lost.get(k, Failure(k, not_finite(outcome[k])))
            for k in np.flatnonzero(np.isnan(seen)).tolist()
            if keys[k] not in self._failed
        }
        if self._too_many(len(reasons), self.runs, share):
            raise self._complaint(_tried(at, points, outcome, reasons), self.runs)
        self._note(at, points, keys, reasons)
        return np.asarray(seen[inverse])

    def require_repeatable(self, x: ArrayLike) -> None:
        """Run the first experiment at x (n,) twice, and once only if that run is known.

        It is the one run that is ever repeated: it finds out, too, that a simulator no longer does
        what it did when its runs were stored. Where that run fails there is nothing to compare.

        Raises SimulatorError where the outcomes differ by more than a millionth: a simulator that
        draws random numbers has neither a response surface nor runs that can be reused.
        """
        point, at = np.atleast_2d(np.asarray(x, dtype=np.float64)), np.zeros(1, np.intp)
        first = float(self.attempt(at, point)[0])
        if np.isnan(first):
            return
        blocks = len(self._blocks)
        outcome, _ = self._done(at, point, 0, 1.0)
        del self._blocks[blocks:]  # it is known already
        again = float(transformed(outcome, self.transform)[0])
        self.runs += 1
        if abs(first - again) <= REPEATABLE * max(abs(first), abs(again)):
            return
        raise SimulatorError(
            f"simulator '{self.simulator.name}' returned {first:.8g} and then {again:.8g} for the "
            f"same run: experiment '{self.ids[0]}' with {self._words.at(point[0])}",
            "let it return the same outcome every time: fix the seed of its random numbers, keep "
            "no state from run to run, and leave measurement noise to [noise]",
        )

    def _distinct(
        self, index: ArrayLike, x: ArrayLike
    ) -> tuple[Indices, Array, list[bytes], list[int]]:
        """Distinct runs in the order of their first appearance, and which each run is."""
        at, points = np.asarray(index, dtype=np.intp), np.asarray(x, dtype=np.float64)
        place: dict[bytes, int] = {}
        inverse = [place.setdefault(key, len(place)) for key in self._keys(at, points)]
        if len(place) == len(at):
            return at, points, [*place], inverse
        _, first = np.unique(inverse, return_index=True)
        return at[first], points[first], [*place], inverse

    def _recalled(
        self, index: Indices, x: Array, keys: Sequence[bytes]
    ) -> tuple[Array, dict[int, tuple[str, int]]]:
        """Outcomes (R,), NaN where none is known, and of those that failed message and attempts."""
        outcome = np.array([self._known.get(key, np.nan) for key in keys], dtype=np.float64)
        rest = np.flatnonzero(np.isnan(outcome))
        if self.kept is None or not len(rest):
            return outcome, {}
        outcome[rest], failed = self.kept.find(self.group[index[rest]], x[rest])
        return outcome, {int(rest[k]): reason for k, reason in failed.items()}

    def _done(
        self, index: Indices, x: Array, known: int, most: float | None
    ) -> tuple[Array, dict[int, Failure]]:
        """Run, again where it failed and retries are left: raw outcomes (R,), NaN and why for some.

        `known` runs more of the same call need not be done. `most` is the share of failures that
        is too many, None where the first one is.
        """
        outcome = np.full(len(index), np.nan)
        failures: dict[int, Failure] = {}
        tally = Tally(self.progress, len(index), known)
        again = np.arange(len(index))
        for attempt in range(1 + self.retries):
            with closing(self._carried(index, x, again, tally)) as batches:
                for rows, done in batches:
                    outcome[rows] = done.outcome
                    if attempt:
                        for k in rows.tolist():
                            failures.pop(k, None)
                    for failure in self._received(index[rows], x[rows], done):
                        failures[int(rows[failure.position])] = failure
                    tally.count(len(rows), len(failures))
                    if failures and attempt == self.retries:
                        if most is None:
                            return outcome, failures
                        asked = self.runs - tally.left
                        if self._too_many(len(failures), asked, most):
                            tried = _tried(index, x, outcome, failures)
                            raise self._complaint(tried, asked)
            again = np.array(sorted(failures), dtype=np.intp)
            if not len(again):
                break
            tally.retry(len(again))
        return outcome, failures

    def _too_many(self, more: int, asked: int, most: float) -> bool:
        """Whether `more` failures than were noted are too large a share of all that was asked."""
        failed = len(self._failed) + more
        return more > 0 and failed >= FEW and failed > most * asked

    def _complaint(self, tried: Tried, asked: int) -> SimulatorError:
        return self._words.too_many(tried, len(self._failed) + len(tried.failures), asked)

    def _note(
        self, index: Indices, x: Array, keys: Sequence[bytes], failures: Mapping[int, Failure]
    ) -> None:
        """Remember failures by the rows of a call, for `failures` and so that none is repeated."""
        for k, failure in failures.items():
            self._failed[keys[k]] = int(index[k]), x[k], failure.message

    def _carried(
        self, index: Indices, x: Array, runs: Indices, tally: Tally
    ) -> Generator[tuple[Indices, Work], None, None]:
        """The runs as they are done; after Ctrl-C those that were at work are waited for."""

        def give(some: Indices) -> tuple[Columns, Columns]:
            conditions = {name: column[index[some]] for name, column in self._conditions.items()}
            return conditions, {name: x[some, k] for k, name in enumerate(self.parameters)}

        if self.executor is None:
            yield from carried(self.simulator, give, runs)
            return
        crew = Crew(self.simulator, self.executor)
        try:
            yield from crew.carry(give, runs, tally.stopping)
        except GeneratorExit:
            for some, done in crew.rest():
                self._received(index[some], x[some], done)
            raise

    def _received(self, index: Indices, x: Array, done: Work) -> tuple[Failure, ...]:
        """Keep what a worker brings; the failures, those included that are no finite number."""
        raised = {failure.position for failure in done.failures}
        good = np.isfinite(transformed(done.outcome, self.transform))
        bad = [
            Failure(k, not_finite(done.outcome[k]), None, "NotFinite")
            for k in np.flatnonzero(~good).tolist()
            if k not in raised
        ]
        if self.kept is not None:
            self.kept.add(self.group[index], x, done)
        if np.any(good):
            block = Runs(index[good], x[good].copy(), done.outcome[good].copy())
            self._blocks.append(block)
            keys = self._keys(block.index, block.x)
            self._known.update(zip(keys, block.outcome.tolist(), strict=True))
        return (*done.failures, *bad)

    def _keys(self, index: Indices, x: Array) -> list[bytes]:
        rows = np.column_stack([self.group[index], x])
        whole, size = rows.tobytes(), rows.itemsize * rows.shape[1]
        return [whole[k : k + size] for k in range(0, len(whole), size)]


def _tried(index: Indices, x: Array, outcome: Array, failures: dict[int, Failure]) -> Tried:
    """What was tried before it stopped: runs that have neither outcome nor failure were not."""
    rows = np.flatnonzero(~np.isnan(outcome) | np.isin(np.arange(len(index)), list(failures)))
    placed = {int(np.searchsorted(rows, k)): failure for k, failure in failures.items()}
    return Tried(index[rows], x[rows], outcome[rows], placed)


def _check(retries: int, max_failed: float) -> None:
    if retries < 0:
        raise SimulatorError(f"retries {retries}", "choose 0 or more")
    if not 0.0 <= max_failed <= 1.0:
        raise SimulatorError(f"max_failed {max_failed}", "choose a share in [0, 1], such as 0.2")


def _groups(columns: Sequence[NDArray[Any]], number: int) -> Indices:
    """For each experiment the first one with the same values in every column, (N,)."""
    first: dict[tuple[Any, ...], int] = {}
    rows = zip(*(column.tolist() for column in columns), strict=True) if columns else [()] * number
    return np.array([first.setdefault(row, k) for k, row in enumerate(rows)], dtype=np.intp)
