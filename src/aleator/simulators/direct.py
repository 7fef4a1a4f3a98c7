"""Runs that are cheaper to make than to store: made in this process, many of them by one call."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aleator.core.blocks import blocks
from aleator.core.types import Array, Indices
from aleator.errors import AleatorError, SimulatorError, SurroundingsError
from aleator.simulators.dispatch import Batch, make
from aleator.simulators.function import FunctionSimulator
from aleator.simulators.protocol import RunStopped, describe
from aleator.simulators.runs import NOT_FINITE, Failure, Runs
from aleator.simulators.units import Bound


@dataclass(frozen=True)
class DirectSettings:
    """Settings for runs that are not remembered. The values are chosen by judgement."""

    checked: int = 16
    """The number of runs in which calls with single numbers are compared with one call with arrays,
    if `vectorized` is not stated. They differ in their conditions and in every parameter."""
    relative: float = 1e-12
    """The tolerated relative difference. Powers and exponentials of arrays are computed by other
    code, which may change the last four bits; a difference of two such values loses more."""
    remembered: int = 1000
    """The largest number of failed runs whose reasons are kept for messages."""
    single: tuple[str, ...] = (
        "only length-1 arrays", "only size-1 arrays", "only 0-dimensional arrays",
        "cannot convert the series", "must be real number, not",
    )  # fmt: skip
    """Parts of the messages of Python, NumPy and pandas where a function that takes a single
    number, such as math.exp, gets an array."""


SETTINGS = DirectSettings()


@dataclass(frozen=True)
class ArrayTrial:
    """What the trial of a function with arrays showed.

    `fault` says what is wrong with the call with arrays; it is "" if its values are those of
    `compared` calls with single numbers.
    """

    compared: int
    fault: str = ""


def array_trial(
    bound: Bound, case: Indices, x: Array, settings: DirectSettings = SETTINGS
) -> ArrayTrial:
    """Compare one call of a function with arrays with a call for each run.

    Up to `checked` runs are compared, out of those under conditions number `case` (R,) with
    parameters `x` (R, n); they should differ in both. Relative differences up to `relative` are
    tolerated, and a value that is not finite either way is the same. The call with arrays comes
    first, and the first difference ends the trial, so that a function that takes no arrays
    costs one or two calls. A function that loops over the runs in Python (`np.vectorize`) gains
    nothing by arrays, and may be slow: it is one that makes another call of a function for most
    further runs. A function of series gets the rows of all runs one after the other, with the
    parameters repeated for each row. Cost: at most checked + 2 calls.

    >>> from aleator.simulators.units import Cases
    >>> from aleator.simulators.function import FunctionSimulator
    >>> def tried(function):
    ...     bound = Bound(FunctionSimulator(function), Cases.of({}, 1), ("x",))
    ...     return array_trial(bound, np.zeros(2, int), np.array([[1.0], [2.0]]))
    >>> tried(lambda x: 2.0 * x), tried(lambda x: x - x.mean()).compared
    (ArrayTrial(compared=2, fault=''), 1)
    >>> tried(lambda x: 2.0 if x > 1.5 else x).fault
    'it raised ValueError: The truth value of an array with more than one element is ambiguous...
    >>> import math
    >>> tried(lambda x: math.exp(x)).fault
    'it raised TypeError: ... (math.exp and the like take single numbers)'
    """
    case, x = case[: settings.checked], x[: settings.checked]
    try:
        together, calls = _called(with_arrays(bound), case, x)
        fewer = _called(with_arrays(bound), case[:2], x[:2])[1]
    except (KeyboardInterrupt, SurroundingsError):
        raise
    except BaseException as error:
        told = (
            error.problem if isinstance(error, SimulatorError) else f"it raised {describe(error)}"
        )
        single = any(part in told for part in settings.single)
        cause = " (math.exp and the like take single numbers)" if single else ""
        return ArrayTrial(0, f"{told}{cause}")
    if not np.isfinite(together).any():
        return ArrayTrial(0, "it returned no finite number")
    if 2 * (calls - fewer) > len(case) - 2:
        return ArrayTrial(0, "it loops over the runs")
    for k in range(len(case)):
        try:
            alone = _called(bound, case[k : k + 1], x[k : k + 1])[0][0]
        except SurroundingsError:
            raise
        except BaseException as error:
            _require_no_interrupt(error)
            alone = np.full(together.shape[1], np.nan)
        same = np.isclose(together[k], alone, settings.relative, 0.0, equal_nan=True)
        if not np.all(same | ~(np.isfinite(together[k]) | np.isfinite(alone))):
            return ArrayTrial(k + 1, "it returned other values than a call for each run")
    return ArrayTrial(len(case))


def with_arrays(bound: Bound) -> Bound:
    """The same function, called with arrays of runs; one of series with the rows of many runs."""
    simulator: Any = bound.simulator
    by_rows = bound.form.rows is not None
    return replace(bound, simulator=simulator.with_arrays(), by_rows=by_rows)


def _called(bound: Bound, case: Indices, x: Array) -> tuple[Array, int]:
    """Values (R, W) of one call of the simulator, and the number of calls that it makes itself."""
    columns, before, calls = bound.columns(case, x), sys.getprofile(), 0

    def count(_frame: object, event: str, _argument: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    with warnings.catch_warnings():
        # What a trial warns of is no concern of the user, and must not decide as an error.
        warnings.simplefilter("ignore")
        sys.setprofile(count)
        try:
            returned = bound.simulator(*columns)
        finally:
            sys.setprofile(before)
    return bound.shaped(case, returned), calls


def _require_no_interrupt(error: BaseException) -> None:
    """Raise the KeyboardInterrupt that stopped a simulator that runs one at a time."""
    if isinstance(error, RunStopped) and isinstance(error.__cause__, KeyboardInterrupt):
        raise error.__cause__ from None


Failures = Mapping[int, Failure]


class DirectRuns:
    """Makes runs that are not remembered: `count` counts them, `lost` counts the failed ones.

    A run has failed if it lacks a measured value; `failures` has the first failed runs. `trial`
    is what `find_arrays` found, if it tried the function; if its values are the same, the function
    is called with arrays from then on.

    >>> inverse = FunctionSimulator(lambda x: 1.0 / x, vectorized=True)
    >>> from aleator.simulators.units import Cases
    >>> direct = DirectRuns(Bound(inverse, Cases.of({}, 1), ("x",)))
    >>> direct(np.array([0, 0]), np.array([[2.0], [0.0]])).tolist()
    [[0.5], [inf]]
    """

    def __init__(self, bound: Bound, settings: DirectSettings = SETTINGS) -> None:
        self._bound, self._form, self._called = bound, bound.form, bound
        self._settings = settings
        observed = np.zeros((len(bound.cases), self._form.width), dtype=np.bool_)
        self._unmeasured = replace(bound, form=replace(bound.form, observed=observed))
        self.trial: ArrayTrial | None = None
        self.count = self.lost = self.repeated = 0
        self._worked = False
        self.failures = Runs.planned(np.empty(0, np.intp), np.empty((0, len(bound.parameters))))

    def __call__(self, case: Indices, x: Array) -> Array:
        """Values (R, W) of runs under conditions number `case` (R,) with parameters `x` (R, n).

        The values of a run that raises an exception are NaN; an infinite value is kept. Raises
        SimulatorError for a wrong shape or type, and SurroundingsError for a fault of the machine.
        Cost: some 20 ns a run of a vectorized function, and the function itself.
        """
        self.count += len(case)
        values = np.empty((len(case), self._form.width))
        each = self._form.width if self._called.by_rows else 1
        for rows in blocks(len(case), each, self._called.simulator.block):
            values[rows], failures = self._block(self._called, case[rows], x[rows])
            self._note(case[rows], x[rows], values[rows], failures)
            self._worked = self._worked or not np.isnan(values[rows]).all()
        return values

    def again(self, case: Indices, x: Array) -> Array:
        """Values (R, W) of runs that are made once more, as a check; `repeated` counts them.

        A function that was found to take arrays is called for each run.
        """
        self.repeated += len(case)
        parts = blocks(len(case), 1, self._bound.simulator.block)
        return np.concatenate([self._block(self._bound, case[at], x[at])[0] for at in parts])

    @property
    def calls_arrays(self) -> bool:
        """Whether the trial found that the function takes arrays."""
        return self.trial is not None and not self.trial.fault

    def find_arrays(self, region: Array) -> bool:
        """Whether the simulator takes arrays: as it is stated, or as one trial found.

        A function of which `vectorized` is not stated is tried once, at some points of the
        parameter region (n, 2), each under other conditions. A function is not tried if it gives
        derivatives, or has a time limit, since one call would make many runs.
        """
        simulator = self._bound.simulator
        if not isinstance(simulator, FunctionSimulator) or simulator.vectorized is not None:
            return getattr(simulator, "vectorized", False) is True
        if simulator.sloped or simulator.timeout is not None:
            return False
        if self.trial is None:
            count = self._settings.checked
            case = np.linspace(0, len(self._bound.cases) - 1, count).astype(np.intp)
            share = np.random.default_rng(0).random((count, len(region)))
            points = region[:, 0] + share * (region[:, 1] - region[:, 0])
            self.trial = array_trial(self._bound, case, points, self._settings)
            self.count += self.trial.compared
            if self.calls_arrays:
                self._called = with_arrays(self._bound)
        return self.calls_arrays

    def _note(self, case: Indices, x: Array, values: Array, failures: Failures) -> None:
        """Remember the reasons of the runs that have no outcome."""
        gone = np.isnan(values)
        if not gone.any():
            return
        form = self._form.some(case)
        gone = gone if form.observed is None else gone & form.observed
        runs = np.flatnonzero(gone.any(axis=1))
        self.lost += len(runs)
        first = runs[: self._settings.remembered - len(self.failures)]
        if not len(first):
            return
        noted = {}
        for k, run in enumerate(first.tolist()):
            fault = form.fault(run, int(np.argmax(gone[run])), np.nan)
            noted[k] = failures.get(run) or Failure(fault, kind=NOT_FINITE)
        lost = replace(Runs.planned(case[first], x[first]), failures=noted)
        self.failures = Runs.joined([self.failures, lost])

    def _block(self, bound: Bound, case: Indices, x: Array) -> tuple[Array, Failures]:
        try:
            returned = bound.simulator(*bound.columns(case, x))
            return bound.shaped(case, returned)[:, : self._form.width], {}
        except (AleatorError, KeyboardInterrupt):
            raise
        except BaseException as error:
            _require_no_interrupt(error)
            return self._carefully(case, x)

    def _carefully(self, case: Indices, x: Array) -> tuple[Array, Failures]:
        """Values (R, W) of runs of which some raise an exception; the values of these are NaN.

        As long as no run has worked: if each of a few raises one, spread over all, the others are
        not made.
        """
        few = self._settings.checked
        if len(case) > few and not (self._worked or self.calls_arrays):
            some = np.linspace(0, len(case) - 1, few).astype(np.intp)
            failures = self._carefully(case[some], x[some])[1]
            if len(failures) == few:
                every = range(self._settings.remembered)
                return np.full((len(case), self._form.width), np.nan), dict.fromkeys(
                    every, failures[0]
                )
        runs = Runs.planned(case, x, self._form.width)
        made = make(self._bound.simulator, Batch.of(self._unmeasured, runs), np.inf)
        if made.stopped:
            raise made.stopped
        return made.outcome[:, : self._form.width], made.failures
