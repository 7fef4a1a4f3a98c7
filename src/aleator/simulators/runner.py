"""The only way to call a simulator: the runner checks, counts and remembers every run."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from datetime import timedelta
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from aleator.core.progress import Progress, Silent
from aleator.core.types import Array, Indices
from aleator.errors import SimulatorError, count
from aleator.simulators.direct import DirectRuns
from aleator.simulators.dispatch import BATCHING, Batching, slots
from aleator.simulators.execution import Execution, RunCache, RunProgress
from aleator.simulators.function import FunctionSimulator, as_simulator
from aleator.simulators.messages import Messages
from aleator.simulators.protocol import Simulator
from aleator.simulators.runs import REPEATABILITY, Repeats, Runs, differing
from aleator.simulators.store import Store
from aleator.simulators.surroundings import end_reported, ending
from aleator.simulators.units import Bound, Cases, Form, Units

if TYPE_CHECKING:
    from aleator.observations.experiments import Conditions, Experiments
    from aleator.observations.responses import Transform


@dataclass(frozen=True)
class Budget:
    """The most that an identification may take: new runs of the simulator, and hours of real time.

    Stored runs cost nothing, so that the same identification, repeated with the same budget, gets
    further each time. None is no limit. Raises SimulatorError for a limit that is not positive.

    >>> Budget(runs=500)
    Budget(runs=500, hours=None)
    """

    runs: int | None = None
    hours: float | None = None

    def __post_init__(self) -> None:
        """Check the limits at once, so that a mistake is reported where it was made."""
        for name, value in (("runs", self.runs), ("hours", self.hours)):
            if value is not None and not 0.0 < value < math.inf:
                raise SimulatorError(f"budget: {name} {value}", "choose a positive number")

    def __str__(self) -> str:
        """The budget in words, for messages."""
        runs = [] if self.runs is None else [count(self.runs, "run")]
        hours = [] if self.hours is None else [f"{self.hours:g} h"]
        return " and ".join(runs + hours)


class Account:
    """What is left of a budget from now on; the runs that `by` makes are subtracted.

    `refused` says whether a request for runs was ever reduced.
    """

    def __init__(self, budget: Budget, by: Execution) -> None:
        self.budget, self.refused = budget, False
        self._by, self._before = by, by.tried
        self._began = time.monotonic()

    def granted(self, runs: int, reserve: int = 0) -> int:
        """How many of the requested `runs` may be made, so that `reserve` runs are left."""
        granted = int(max(0, min(runs, self._left() - reserve)))
        self.refused |= granted < runs
        return granted

    @property
    def made(self) -> int:
        """The number of new runs that were made since the budget was set."""
        return self._by.tried - self._before

    def _left(self) -> float:
        """The number of runs left; the limit of hours counts from the first timed run on."""
        left = math.inf if self.budget.runs is None else self.budget.runs - self.made
        if self.budget.hours is None or not self._by.waited:
            return left
        hours = timedelta(hours=self.budget.hours)
        seconds = hours.total_seconds() - (time.monotonic() - self._began)
        return min(left, seconds * self._by.tried / self._by.waited)


MAX_FAILED = 0.2
"""The share of failed runs beyond which a study stops. Chosen by judgement."""
_APART = "with --workers 1 such a run is one that failed"


def as_runner(
    simulator: Runner | Simulator | Callable[..., Any],
    experiments: Experiments | Conditions,
    parameters: Sequence[str],
    vectorized: bool | None = None,
    executor: Executor | None = None,
    jac: bool | Callable[..., Any] = False,
    series: bool = False,
) -> Runner:
    """A runner for a simulator or a function (see `as_simulator`) on the experiments.

    A runner is returned unchanged.

    >>> import pandas as pd
    >>> from aleator.observations.experiments import Conditions
    >>> table = Conditions(("a",), pd.DataFrame({"load": [1.0]}))
    >>> as_runner(lambda load, x: load * x, table, ["x"])([0], [[2.0]])
    array([2.])
    """
    if isinstance(simulator, Runner):
        return simulator
    simulator = as_simulator(simulator, vectorized, jac, series)
    return Runner(simulator, experiments, parameters, executor=executor)


class Runner:
    """`run(index (R,), x (R, n)) -> outcome (R,)`: runs of a simulator on experiments.

    `parameters` names the n columns of x. A unit is what one run serves: a row of the table, or a
    whole experiment if the simulator makes series. A run returns W values; observation k of M is
    column `column[k]` of the run of unit `unit[k]`. Outcomes are on the scale of the likelihood,
    after the transforms.

    Units under equal conditions are one case (see `cases`). A run is determined by its case and by
    every bit of x; the runner remembers it, and makes no run twice. With a `store` it takes known
    runs from there, and commits every new one at once; a failed run is stored with its message.
    `used_conditions` are the conditions that the simulator takes. In a series the conditions
    `varying` are arrays even if they are constant in the table.

    Runs are made in this process, one batch after the other, or by the workers of an `executor`
    (any concurrent.futures.Executor); outcomes do not depend on it. A run that fails is tried again
    `retries` times. `attempt` stops if at least `min_failed` runs, and more than the share
    `max_failed` of all runs, have failed (both by judgement). `batching` has the sizes of batches.

    `runs` counts the distinct runs that were needed, including stored ones, so that an interrupted
    identification reports the same number as an undisturbed one. `fresh` counts the new runs with
    an outcome. `completed` are all runs with an outcome, `failures` those without. `outlook` is a
    text about what will follow, which is added to the progress of runs. Memory: some 150
    bytes a run.

    Raises SimulatorError at once if the simulator does not take these conditions and parameters.
    During a run it is raised for an exception, an outcome that is not a finite number, or a wrong
    shape. StoreError is raised if the store cannot be read or written. A call of the runner tries
    runs that failed before once more, as their cause may have been corrected.

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
        min_failed: int = 10,
        varying: Collection[str] = (),
        batching: Batching = BATCHING,
    ) -> None:
        if retries < 0:
            raise SimulatorError(f"retries {retries}", "choose 0 or more")
        if not 0.0 <= max_failed <= 1.0:
            raise SimulatorError(
                f"max_failed {max_failed}", "choose a share in [0, 1], such as 0.2"
            )
        self.simulator = as_simulator(simulator)
        self.ids, self.parameters = experiments.ids, tuple(parameters)
        self.progress, self.outlook = progress or Silent(), ""
        self.executor, self.retries = executor, retries
        self.max_failed, self.min_failed, self._batching = max_failed, min_failed, batching
        table = experiments.conditions
        self.used_conditions = self.simulator.asks([*map(str, table.columns)], self.parameters)
        self._served = served = Units.of(experiments, getattr(self.simulator, "series", False))
        columns = served.columns(table, self.used_conditions, varying)
        self.cases = Cases.of(columns, len(served), served.rows if served.series else None)
        sloped = getattr(self.simulator, "sloped", False) is True
        form = Form.of(served, self.cases, self.ids, len(self.parameters) if sloped else 0)
        self._bound = bound = Bound(self.simulator, self.cases, self.parameters, form)
        self.cache = None if store is None else RunCache(store, bound, served)
        self._execution = Execution(bound, served, self.cache, executor, retries, batching)
        self._memory = self._execution.memory
        self._direct = DirectRuns(bound)
        self._repeats = Repeats()
        self._messages = Messages(self.simulator, self.ids, self.parameters, self.cases, served)
        self.account = Account(Budget(), self._execution)

    def __getstate__(self) -> dict[str, Any]:
        """The runner for another process: without store, workers, and progress reports."""
        alone = Execution(self._bound, self._served, None, None, self.retries, self._batching)
        here = {"cache": None, "executor": None, "progress": Silent()}
        made = {"_execution": alone, "_memory": alone.memory, "account": Account(Budget(), alone)}
        return {**vars(self), **here, **made}

    @property
    def units(self) -> int:
        """U, the number of units: rows of the table, or experiments of a series."""
        return len(self._served)

    @property
    def unit(self) -> Indices:
        """The unit whose run makes each observation (M,)."""
        return self._served.unit

    @property
    def column(self) -> Indices:
        """The position of each observation among the W values of its run (M,)."""
        return self._served.column

    @property
    def experiment(self) -> Indices:
        """The experiment to which each unit belongs (U,)."""
        return self._served.experiment

    @property
    def transform(self) -> Transform:
        """The transform of the only response, or of the first one."""
        return self._served.responses[0].transform

    @property
    def workers(self) -> int:
        """The number of workers that make runs at once; one without an executor."""
        return 1 if self.executor is None else slots(self.executor)

    @property
    def runs(self) -> int:
        """The number of different runs that were needed so far."""
        return len(self._memory) + self._direct.count

    @property
    def repeated(self) -> int:
        """The number of runs that were made a second time, to check that their outcomes repeat."""
        return self._execution.repeated + self._direct.repeated

    @property
    def fresh(self) -> int:
        """The number of runs that were made by this runner and have an outcome."""
        return self._execution.fresh

    def allow(self, budget: Budget) -> None:
        """Limit new runs, and hours from now on, by a budget; see `account`."""
        self.account = Account(budget, self._execution)

    @property
    def seconds(self) -> float:
        """The mean duration of a run in seconds; NaN if none is known.

        It is the mean of runs made here, or else of stored runs. Runs that are made by one call
        have equal shares of its duration.
        """
        tried, took = self._execution.tried, self._execution.seconds
        if not tried and self.cache is not None:
            stored = self.cache.store.counts(self.cache.identity)
            tried, took = stored.runs, stored.seconds
        return took / tried if tried else float("nan")

    @property
    def completed(self) -> Runs:
        """Every run that has an outcome, in the order in which they became known."""
        return self._memory.remembered([*self._memory.places])

    @property
    def failures(self) -> Runs:
        """Every run that was needed and has no outcome."""
        return self._memory.remembered([*self._memory.failures])

    @property
    def lost(self) -> tuple[int, Runs]:
        """How many runs of `straight` had no outcome, and the first 1000 of these with reasons."""
        return self._direct.lost, self._direct.failures

    def require_some_outcome(self) -> None:
        """Raise NoOutcome, with the first reason, if every run failed.

        Where there are runs of `straight`, these are meant.
        """
        made, (lost, failures) = self._direct.count, self.lost
        if not made:
            made, failures = len(self._memory), self.failures
            lost = len(failures)
        if lost and lost == made:
            raise self._messages.excess(failures, lost, lost)

    def __call__(self, index: ArrayLike, x: ArrayLike) -> Array:
        """Transformed outcomes (R,) of units `index` (R,) with parameters `x` (R, n)."""
        keys, distinct = self._keys(index, x)
        self._execution.recall(distinct, failures=False)
        missing = [key for key in distinct if key not in self._memory.places]
        with self._making(missing, len(distinct)) as batches:
            for made in batches:
                if made.failures:
                    break
        tried = self._memory.remembered([key for key in missing if key in self._memory])
        if tried.failures:
            raise self._messages.first(tried)
        self._repeat(missing)
        return self._single(self._memory.values(keys))

    def attempt(self, index: ArrayLike, x: ArrayLike, most: float | None = None) -> Array:
        """Outcomes (R,) as from a call, but NaN for a run that raises an error or is not finite.

        A run that was made before is not repeated, even if it failed. Raises SimulatorError for a
        wrong shape, and NoOutcome if more than the share `most` (default `max_failed`) of the runs
        failed.
        """
        return self._single(self._attempted(index, x, most))

    def values(self, unit: ArrayLike, x: ArrayLike, most: float | None = None) -> Array:
        """All transformed values (R, W) of runs of units `unit` (R,) with parameters `x` (R, n).

        All values of a failed run are NaN, as with `attempt`. In a series shorter than others the
        values beyond its last row are NaN. A value that no experiment measured may be anything that
        the simulator returned.
        """
        return self.with_slopes(unit, x, most)[0]

    def with_slopes(
        self, unit: ArrayLike, x: ArrayLike, most: float | None = None
    ) -> tuple[Array, Array]:
        """Values (R, W) as from `values`, and their derivatives by the parameters (R, W, n).

        Those that the simulator did not give are NaN.
        """
        found, form = self._attempted(unit, x, most), self._bound.form
        values = self._served.transformed(found[:, : form.width])
        slopes = np.full((*values.shape, len(self.parameters)), np.nan)
        if form.slopes:
            given = found[:, form.width :].reshape(slopes.shape)
            rates = self._served.rates(found[:, : form.width])
            slopes = given * rates[..., None]
        return values, slopes

    def straight(self, unit: ArrayLike, x: ArrayLike) -> Array:
        """Values (R, W) like those of `values`, by runs that are neither remembered nor stored.

        This is for functions that cost less than remembering does; the runs are made in this
        process. `runs` counts all of them. A run that raises an exception is NaN. An infinite
        outcome, such as a life without a limit, is kept.
        """
        case, x = self.cases.condition[np.asarray(unit, dtype=np.intp)], np.asarray(x, np.float64)
        values = self._direct(case, x)
        if len(again := self._repeats.chosen(len(case))):
            first = replace(Runs.planned(case[again], x[again]), outcome=values[again])
            values_again = self._direct.again(first.case, first.x)
            self._compare(first, values_again, self._direct.calls_arrays)
        return self._served.transformed(values)

    @property
    def sloped(self) -> bool:
        """Whether runs give the derivatives of their values by the parameters."""
        return bool(self._bound.form.slopes)

    @property
    def vectorized(self) -> bool:
        """Whether the simulator is declared to take arrays of runs."""
        return getattr(self.simulator, "vectorized", False) is True

    def takes_arrays(self, region: Array) -> bool:
        """Whether `straight` makes many runs in one call; tried at 16 points of `region` (n, 2).

        It does so for a vectorized function, and for one of which `vectorized` is not stated if
        arrays give the same values as single numbers: it is tried once, by at most 18 calls (see
        `array_trial`). The calls with single numbers count as runs, those with arrays do not,
        and none is stored.
        """
        return self._direct.find_arrays(region)

    @property
    def array_fault(self) -> str:
        """What was wrong with the call with arrays; "" if nothing was, or none was made."""
        return self._direct.trial.fault if self._direct.trial else ""

    def _attempted(self, index: ArrayLike, x: ArrayLike, most: float | None) -> Array:
        keys, distinct = self._keys(index, x)
        memory = self._memory
        before, share = len(memory.failures), self.max_failed if most is None else most
        self._execution.recall(distinct, failures=True)
        missing = self._each_unit_first([key for key in distinct if key not in memory])
        whole = len(memory) + len(missing)
        with self._making(missing, len(distinct)) as batches:
            for _ in batches:
                if self._too_many(before, share, whole) or (share < 1.0 and self._works_nowhere()):
                    break
        if self._too_many(before, share, len(memory)):
            tried = memory.remembered([key for key in distinct if key in memory])
            raise self._messages.excess(tried, len(memory.failures), len(memory))
        self._repeat(missing)
        return memory.values(keys)

    def _single(self, values: Array) -> Array:
        """Transformed outcomes (R,) of runs that have a single value."""
        if (width := self._served.width) != 1:
            raise SimulatorError(
                f"a run of simulator '{self.simulator.name}' returns {width} values",
                "ask for `values`",
            )
        return self._served.transformed(values)[:, 0]

    def require_repeatable(self, x: ArrayLike) -> None:
        """Check that the first experiment at x (n,) has the same outcome when it is run again.

        If that run is stored, a simulator that has changed since then is noticed, too. Nothing is
        compared if the run fails. Raises SimulatorError if the outcomes differ by more than a
        millionth. A simulator that draws random numbers cannot have a response surface, and its
        runs cannot be reused.
        """
        point, at = np.atleast_2d(np.asarray(x, dtype=np.float64)), np.zeros(1, np.intp)
        first = self.values(at, point)[0]
        if np.all(np.isnan(first)):
            return
        known = Runs.planned(self.cases.condition[at], point, self._bound.form.columns)
        for _ in range(1 + self.retries):
            made = self._execution.again(known)[:, : len(first)]
            again = self._served.transformed(made)
            if not np.all(np.isnan(again)) and differing(first[None], again) is None:
                return
        column = int(
            np.argmin(np.isclose(first, again[0], rtol=REPEATABILITY.relative, equal_nan=True))
        )
        raise self._messages.not_repeatable(known, 0, float(first[column]), float(again[0, column]))

    @contextmanager
    def survived(self, x: ArrayLike) -> Iterator[None]:
        """Report it if a Python function ends this process within the block.

        A function may do so by `os._exit`, by a crash of compiled code, or by a Fortran STOP. If no
        runs are stored, the first experiment at x (n,) is tried in a copy of the process;
        SimulatorError is raised if that ends the copy (see `ending`). A later end is reported on
        the standard error (see `end_reported`). Workers and simulators other than functions run in
        separate processes, and need no such check.
        """
        if self.executor or not isinstance(self.simulator, FunctionSimulator):
            yield
            return
        if self.cache is None or not self.cache.at_start.runs:
            point, at = np.atleast_2d(np.asarray(x, dtype=np.float64)), np.zeros(1, np.intp)
            columns = self._bound.columns(self.cases.condition[at], point)
            self._execution.repeated += 1
            if (how := ending(lambda: self.simulator(*columns))) is not None:
                raise SimulatorError(
                    f"the simulator '{self.simulator.name}' ended the process of its first run "
                    f"({how})",
                    f"let it raise an exception there; {_APART}",
                )
        with end_reported(
            "aleator: error: the process ended before the command did: the simulator "
            f"'{self.simulator.name}' ended it (os._exit, a crash, STOP), or a signal. There is "
            f"no answer.\n  Remedy: let the simulator raise an exception there; {_APART}"
        ):
            yield

    def repeat_some(self) -> None:
        """From now on make some of the runs twice, at most 24, to check that outcomes repeat.

        A call that makes runs raises SimulatorError if a repeated run has another outcome.
        """
        self._repeats.begin()

    def _repeat(self, keys: Sequence[bytes]) -> None:
        """Make some of these runs, which were just made, once more, and compare the outcomes."""
        made = [key for key in keys if key in self._memory.places]
        first = self._memory.remembered([made[k] for k in self._repeats.chosen(len(made)).tolist()])
        if len(first):
            self._compare(first, self._execution.again(first))

    def _compare(self, first: Runs, again: Array, arrays: bool = False) -> None:
        """Raise SimulatorError if outcomes differ from the first, which `arrays` may have given."""
        width = self._served.width
        values, others = (
            self._served.transformed(part[:, :width]) for part in (first.outcome, again)
        )
        if found := differing(values, others):
            differ = self._messages.not_the_same if arrays else self._messages.not_repeatable
            raise differ(first, found[0], float(values[found]), float(others[found]))

    def _keys(self, index: ArrayLike, x: ArrayLike) -> tuple[list[bytes], list[bytes]]:
        """The key of each run, and the distinct keys in the order of their first appearance."""
        case = self.cases.condition[np.asarray(index, dtype=np.intp)]
        keys = Runs.planned(case, np.asarray(x, dtype=np.float64)).keys()
        return keys, [*dict.fromkeys(keys)]

    def _making(
        self, missing: Sequence[bytes], requested: int
    ) -> closing[Generator[Runs, None, None]]:
        """The missing runs as they are made; `requested` is the number of all requested runs."""
        reused = requested - len(missing)
        progress = RunProgress(self.progress, len(missing), reused, self.outlook)
        return closing(self._execution.make(missing, progress))

    def _too_many(self, before: int, most: float, whole: int) -> bool:
        """Whether there are new failures since `before`, and their share of `whole` exceeds `most`.

        `whole` counts all runs, including those not yet made, so that the order of batches does not
        matter.
        """
        failed = len(self._memory.failures)
        return failed > before and failed >= self.min_failed and failed > most * whole

    def _works_nowhere(self) -> bool:
        """Whether all runs failed so far, under ten different conditions or under all."""
        if self._memory.places or len(self._memory.failures) < self.min_failed:
            return False
        return bool(np.unique(self.failures.case).size >= min(self.min_failed, len(self.cases)))

    def _each_unit_first(self, keys: list[bytes]) -> list[bytes]:
        """The same runs reordered: one under each condition first, to see early if any succeeds."""
        if not keys:
            return keys
        first = np.unique(self._memory.planned(keys).case, return_index=True)[1]
        chosen = set(first.tolist())
        return [keys[k] for k in first] + [key for k, key in enumerate(keys) if k not in chosen]
