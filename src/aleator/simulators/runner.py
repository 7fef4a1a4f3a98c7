"""The only way to a simulator: it checks, counts and remembers every run."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from aleator.errors import SimulatorError
from aleator.progress import Progress, Silent
from aleator.simulators.cases import Cases
from aleator.simulators.function import as_simulator
from aleator.simulators.messages import Messages
from aleator.simulators.protocol import Simulator
from aleator.simulators.run_progress import RunProgress
from aleator.simulators.runs import NOT_FINITE, Failure, Runs
from aleator.simulators.store import RunCache, Store
from aleator.simulators.workers.dispatcher import Dispatcher, made_here
from aleator.types import Array

if TYPE_CHECKING:
    from aleator.observations.experiments import Conditions, Experiments

REPEATABLE = 1e-6
"""Relative difference of two outcomes of the same run that is no cause for concern."""

MAX_FAILED = 0.2
"""Share of failed runs at which a study stops."""
FEW = 10
"""Failures of which no share is too large yet."""


def as_runner(
    simulator: Runner | Simulator | Callable[..., Any],
    experiments: Experiments | Conditions,
    parameters: Sequence[str],
    vectorized: bool = False,
    executor: Executor | None = None,
) -> Runner:
    """A runner as it is; a simulator or a function (see `as_simulator`) on the experiments.

    >>> import pandas as pd
    >>> from aleator.observations.experiments import Conditions
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
    transform of the experiments. A run is a case (see `cases`: experiments under equal conditions
    are one) and an x, every bit of it; the runner remembers it, and makes none twice. With a
    `store` it takes runs from there, and commits every new one as soon as it is known, one that
    failed with its message.

    Runs are made here, one batch after the other, or by the workers of an `executor` (any
    concurrent.futures.Executor); outcomes do not depend on it. One that fails is tried again
    `retries` times. Where more than the share `max_failed` of the runs of this runner failed, and
    at least ten, `attempt` stops.

    `runs` counts the different runs that were needed, those of the store included, so that an
    identification resumed tells the same number as one that was not interrupted. `fresh` counts
    those that were made here and have an outcome. `completed` are all runs with an outcome,
    `failures` those without. Memory: some 150 bytes a run.

    Raises SimulatorError at once if the simulator does not take these conditions and parameters;
    in a run for an exception, an outcome that is not a finite number, or a wrong shape; StoreError
    if the store cannot be read or written. A run that failed is tried again when a call needs it:
    whoever asks again has mended something.

    >>> import pandas as pd
    >>> from aleator.observations.experiments import Conditions
    >>> table = Conditions(("a", "b"), pd.DataFrame({"load": [1.0, 2.0]}))
    >>> run = Runner(lambda load, stiffness: load / stiffness, table, ["stiffness"])
    >>> run([0, 1, 1, 0], [[4.0], [4.0], [8.0], [4.0]]).tolist(), run.runs
    ([0.25, 0.5, 0.25, 0.25], 3)
    """

    def __init__(
        self,
        simulator: Simulator | Callable[..., Any],
        experiments: Experiments | Conditions,
        parameters: Sequence[str],
        *,
        progress: Progress | None = None,
        store: Store | None = None,
        executor: Executor | None = None,
        retries: int = 0,
        max_failed: float = MAX_FAILED,
    ) -> None:
        _check(retries, max_failed)
        self.simulator = as_simulator(simulator)
        self.ids, self.parameters = experiments.ids, tuple(parameters)
        self.transform = experiments.transform
        self.progress = progress or Silent()
        self.executor, self.retries, self.max_failed = executor, retries, max_failed
        table = experiments.conditions
        asked = self.simulator.asks([*map(str, table.columns)], self.parameters)
        self.cases = Cases.of({name: table[name].to_numpy() for name in asked}, len(self.ids))
        self.cache = (
            None if store is None else RunCache(store, self.simulator, self.cases, self.parameters)
        )
        self.fresh = 0
        self._outcomes: dict[bytes, float] = {}
        self._failures: dict[bytes, Failure] = {}
        self._messages = Messages(self.simulator, self.ids, self.parameters, self.cases)

    @property
    def runs(self) -> int:
        """The number of different runs that were needed so far."""
        return len(self._outcomes) + len(self._failures)

    @property
    def completed(self) -> Runs:
        """Every run that has an outcome, in the order in which they became known."""
        return self._known([*self._outcomes])

    @property
    def failures(self) -> Runs:
        """Every run that was needed and has no outcome."""
        return self._known([*self._failures])

    def __call__(self, index: ArrayLike, x: ArrayLike) -> Array:
        """Run experiment `index` (R,) with parameters `x` (R, n): outcomes (R,), transformed."""
        keys, distinct = self._keys(index, x)
        self._recall(distinct, failures=False)
        missing = [key for key in distinct if key not in self._outcomes]
        with closing(self._make(missing, len(distinct) - len(missing))) as batches:
            for made in batches:
                if made.failures:
                    break
        tried = self._known([key for key in missing if self._knows(key)])
        if tried.failures:
            raise self._messages.first(tried)
        return self.transform([self._outcomes[key] for key in keys])

    def attempt(self, index: ArrayLike, x: ArrayLike, most: float | None = None) -> Array:
        """Run as a call does, but a run that raises or is not finite is NaN and stops nothing.

        A run that is known, even as failed, is not repeated. Raises SimulatorError for a wrong
        shape, and NoOutcome where more than the share `most` (the runner's `max_failed`) failed.
        """
        keys, distinct = self._keys(index, x)
        before, share = len(self._failures), self.max_failed if most is None else most
        self._recall(distinct, failures=True)
        missing = [key for key in distinct if not self._knows(key)]
        with closing(self._make(missing, len(distinct) - len(missing))) as batches:
            for _ in batches:
                if self._too_many(before, share):
                    break
        if self._too_many(before, share):
            tried = self._known([key for key in distinct if self._knows(key)])
            raise self._messages.too_many(tried, len(self._failures), self.runs)
        return self.transform([self._outcomes.get(key, np.nan) for key in keys])

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
        for _ in range(1 + self.retries):
            (made,) = self._made(Runs.asked(self.cases.condition[at], point))
            again = float(self.transform(made.outcome)[0])
            if abs(first - again) <= REPEATABLE * max(abs(first), abs(again)):
                return
        raise self._messages.not_repeatable(point[0], first, again)

    def _keys(self, index: ArrayLike, x: ArrayLike) -> tuple[list[bytes], list[bytes]]:
        """The key of each run, and the distinct ones in the order of their first appearance."""
        case = self.cases.condition[np.asarray(index, dtype=np.intp)]
        keys = Runs.asked(case, np.asarray(x, dtype=np.float64)).keys()
        return keys, [*dict.fromkeys(keys)]

    def _asked(self, keys: Sequence[bytes]) -> Runs:
        return Runs.of_keys(keys, len(self.parameters))

    def _knows(self, key: bytes) -> bool:
        return key in self._outcomes or key in self._failures

    def _known(self, keys: Sequence[bytes]) -> Runs:
        """What is known of some runs."""
        outcome = np.array([self._outcomes.get(key, np.nan) for key in keys], dtype=np.float64)
        failures = {k: self._failures[key] for k, key in enumerate(keys) if key in self._failures}
        return replace(self._asked(keys), outcome=outcome, failures=failures)

    def _recall(self, keys: Sequence[bytes], failures: bool) -> None:
        """Remember what the store knows of some runs; `failures` too, unless retries are left."""
        if self.cache is None:
            return
        known = self._knows if failures else self._outcomes.__contains__
        unknown = [key for key in keys if not known(key)]
        found = self._judged(self.cache.find(self._asked(unknown)))
        settled = {
            k: failure
            for k, failure in found.failures.items()
            if failures and (failure.attempts > self.retries or failure.kind == NOT_FINITE)
        }
        self._remember(unknown, replace(found, failures=settled))

    def _make(self, keys: Sequence[bytes], known: int) -> Generator[Runs, None, None]:
        """Make runs and remember them; those that are not tried again are yielded.

        `known` runs more of the same call need not be made.
        """
        progress = RunProgress(self.progress, len(keys), known)
        for left in reversed(range(1 + self.retries)):
            with closing(self._made(self._asked(keys), progress)) as batches:
                for made in batches:
                    received = self._received(made)
                    progress.count(len(received), len(received.failures))
                    if not left:
                        yield received
            keys = [key for key in keys if key in self._failures]
            if not keys:
                return
            progress.retry(len(keys))

    def _made(
        self, asked: Runs, progress: RunProgress | None = None
    ) -> Generator[Runs, None, None]:
        """The runs as they are made; after Ctrl-C those that were at work are waited for."""
        if self.executor is None:
            yield from made_here(self.simulator, self.cases, self.parameters, asked)
            return
        workers = Dispatcher(self.simulator, self.cases, self.parameters, self.executor)
        try:
            yield from workers.make(asked, progress.stopping if progress else lambda _: None)
        except GeneratorExit:
            for made in workers.rest():
                self._received(made)
            raise

    def _received(self, made: Runs) -> Runs:
        """Keep runs that were made, in the store and here; with the failures of the transform."""
        if self.cache is not None:
            self.cache.add(made)
        judged = self._judged(made)
        self.fresh += len(judged) - len(judged.failures)
        self._remember(judged.keys(), judged)
        return judged

    def _judged(self, runs: Runs) -> Runs:
        """Runs whose outcome the transform cannot take have failed."""
        lost = np.isfinite(runs.outcome) & ~np.isfinite(self.transform(runs.outcome))
        if not np.any(lost):
            return runs
        faults = {
            k: Failure(f"it returned {v:g}: {self.transform.fault(v)}", kind=NOT_FINITE)
            for k, v in zip(np.flatnonzero(lost).tolist(), runs.outcome[lost], strict=True)
        }
        outcome = np.where(lost, np.nan, runs.outcome)
        return replace(runs, outcome=outcome, failures={**runs.failures, **faults})

    def _remember(self, keys: Sequence[bytes], runs: Runs) -> None:
        if not np.all(np.isfinite(runs.outcome)):
            good = np.flatnonzero(np.isfinite(runs.outcome)).tolist()
            self._failures |= {keys[k]: failure for k, failure in runs.failures.items()}
            keys, runs = [keys[k] for k in good], replace(runs, outcome=runs.outcome[good])
        self._outcomes.update(zip(keys, runs.outcome.tolist(), strict=True))
        for key in self._failures.keys() & keys:
            del self._failures[key]

    def _too_many(self, before: int, most: float) -> bool:
        """Whether there are failures more than `before`, and all are too large a share of runs."""
        failed = len(self._failures)
        return failed > before and failed >= FEW and failed > most * self.runs


def _check(retries: int, max_failed: float) -> None:
    if retries < 0:
        raise SimulatorError(f"retries {retries}", "choose 0 or more")
    if not 0.0 <= max_failed <= 1.0:
        raise SimulatorError(f"max_failed {max_failed}", "choose a share in [0, 1], such as 0.2")
