"""The only way to a simulator: it checks, counts and keeps every run."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.errors import SimulatorError
from aleator.experiments import Conditions, Experiments, transformed
from aleator.progress import Progress, Silent
from aleator.simulate.failure import NoOutcome
from aleator.simulate.function import FunctionSimulator, RunStopped, Simulator, describe
from aleator.simulate.kept import Kept
from aleator.simulate.record import Runs
from aleator.simulate.store import Store

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

REPEATABLE = 1e-6
"""Relative difference of two outcomes of the same run that is no cause for concern."""

_SOON = 0.1
"""Seconds of runs, one by one, after which those that completed are committed."""


def as_simulator(simulator: Simulator | Callable[..., Any], vectorized: bool = False) -> Simulator:
    """A plain function as a simulator, called once a run or `vectorized`; a simulator as it is.

    >>> as_simulator(lambda load, stiffness: load / stiffness).block
    16
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
) -> Runner:
    """A runner as it is; a simulator or a function (see `as_simulator`) on the experiments.

    >>> import pandas as pd
    >>> table = Conditions(("a",), pd.DataFrame({"load": [1.0]}))
    >>> as_runner(lambda load, x: load * x, table, ["x"])([0], [[2.0]])
    array([2.])
    """
    if isinstance(simulator, Runner):
        return simulator
    return Runner(as_simulator(simulator, vectorized), experiments, parameters)


class Runner:
    """`run(index (R,), x (R, n)) -> outcome (R,)`: runs of a simulator on experiments.

    `parameters` names the n columns of x. The outcome is what the likelihood sees: after the
    transform of the experiments. Experiments under the same conditions share their runs. A run
    that is in `known` or in `store` is not repeated, and every new run is committed to the store
    as soon as it is known, one that failed with its message; numbers must be exactly equal.

    `group` (N,) is, for each experiment, the first one under the same conditions.
    `runs` counts the runs that were needed, those that were known (`reused`) included, so that an
    identification resumed tells the same number as one that was not interrupted.

    Raises SimulatorError at once if the simulator does not take these conditions and parameters;
    in a run for an exception, an outcome that is not a finite number, or a wrong shape; StoreError
    if the store cannot be read or written. What completed before is kept in `completed`. A run
    that failed is tried again when it is needed again: whoever asks again has mended something.

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
    ) -> None:
        self.simulator = as_simulator(simulator)
        self.ids = experiments.ids
        self.parameters = tuple(parameters)
        self.transform = experiments.transform
        self.progress = progress or Silent()
        asked = self.simulator.asks([*map(str, experiments.conditions.columns)], self.parameters)
        self._conditions = {name: experiments.conditions[name].to_numpy() for name in asked}
        self.group = _groups([*self._conditions.values()], len(self.ids))
        self._known: dict[bytes, float] = {}
        self._reused_runs: list[Runs] = []
        self._blocks: list[Runs] = []
        self.kept = (
            None
            if store is None
            else Kept(store, self.simulator, self._conditions, len(self.ids), self.parameters)
        )
        self._each = 0.0
        self._part = 1 if getattr(self.simulator, "vectorized", True) is False else 0
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
    def fresh(self) -> int:
        """The number of runs that completed here."""
        return sum(map(len, self._blocks))

    def __call__(self, index: ArrayLike, x: ArrayLike) -> Floats:
        """Run experiment `index` (R,) with parameters `x` (R, n): outcomes (R,), transformed."""
        at = np.asarray(index, dtype=np.intp)
        points = np.asarray(x, dtype=np.float64)
        # Distinct runs in the order of their first appearance.
        place: dict[bytes, int] = {}
        inverse = [place.setdefault(key, len(place)) for key in self._keys(at, points)]
        _, first = np.unique(inverse, return_index=True)
        outcome, _ = self._recalled(at[first], points[first], [*place])
        new = ~np.isfinite(transformed(outcome, self.transform))
        self.runs += len(place)
        self.reused += len(place) - int(np.sum(new))
        outcome[new] = self._run(at[first[new]], points[first[new]])
        return transformed(outcome[inverse], self.transform)

    def _recalled(
        self, index: Ints, x: Floats, keys: Sequence[bytes]
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Outcomes (R,) and which of the runs are known; one that failed is known as NaN."""
        outcome = np.array([self._known.get(key, np.nan) for key in keys], dtype=np.float64)
        known = ~np.isnan(outcome)
        if self.kept is not None and not np.all(known):
            rest = np.flatnonzero(~known)
            outcome[rest], known[rest] = self.kept.find(self.group[index[rest]], x[rest])
        return outcome, known

    def require_repeatable(self, x: ArrayLike) -> None:
        """Run the first experiment at x (n,) twice, and once only if that run is known.

        It is the one run that is ever repeated: it finds out, too, that a simulator no longer does
        what it did when its runs were stored.

        Raises SimulatorError where the outcomes differ by more than a millionth: a simulator that
        draws random numbers has neither a response surface nor runs that can be reused.
        """
        point = np.atleast_2d(np.asarray(x, dtype=np.float64))
        first = float(self([0], point)[0])
        again = float(transformed(self._tried(np.zeros(1, np.intp), point), self.transform)[0])
        self.runs += 1
        if abs(first - again) <= REPEATABLE * max(abs(first), abs(again)):
            return
        raise SimulatorError(
            f"simulator '{self.simulator.name}' returned {first:.8g} and then {again:.8g} for the "
            f"same run: experiment '{self.ids[0]}' with {self._parameters(point[0])}",
            "let it return the same outcome every time: fix the seed of its random numbers, keep "
            "no state from run to run, and leave measurement noise to [noise]",
        )

    def attempt(self, index: ArrayLike, x: ArrayLike) -> Floats:
        """Run as a call does, but a run that raises or is not finite is NaN and stops nothing.

        A run that is known, even as failed, is not repeated. Raises SimulatorError for a wrong
        shape.
        """
        at, points = np.asarray(index, dtype=np.intp), np.asarray(x, dtype=np.float64)
        outcome, known = self._recalled(at, points, self._keys(at, points))
        new = np.flatnonzero(~known)
        outcome[new] = self._tried(at[new], points[new])
        self.runs += len(at)
        return transformed(outcome, self.transform)

    def _tried(self, index: Ints, x: Floats) -> Floats:
        outcome = np.empty(len(index))
        for part in self._parts(len(index)):
            outcome[part] = self._attempted(index[part], x[part])
        return outcome

    def _attempted(self, index: Ints, x: Floats) -> Floats:
        """One block; what raises is found by halves, or by the function that told where it was."""
        try:
            outcome = self._call(index, x)
        except SimulatorError:
            raise
        except RunStopped as stop:
            done = len(stop.completed)
            self._commit(index[:done], x[:done], stop.completed)
            if not isinstance(stop.__cause__, Exception):
                raise (stop.__cause__ or stop) from None  # Ctrl-C
            self._commit_failure(index[done], x[done], stop.__cause__)
            failed, rest = np.full(1, np.nan), slice(done + 1, None)
            after = self._attempted(index[rest], x[rest]) if done + 1 < len(index) else failed[:0]
            return np.concatenate([stop.completed, failed, after])
        except Exception as error:
            if len(index) == 1:
                self._commit_failure(index[0], x[0], error)
                return np.full(1, np.nan)
            half = len(index) // 2
            parts = (slice(None, half), slice(half, None))
            return np.concatenate([self._attempted(index[part], x[part]) for part in parts])
        self._commit(index, x, outcome)
        return outcome

    def _keys(self, index: Ints, x: Floats) -> list[bytes]:
        rows = np.column_stack([self.group[index], x])
        return [row.tobytes() for row in rows]

    def _parts(self, count: int) -> Iterator[slice]:
        """Blocks of `count` runs. Of runs one by one as few as take no longer than _SOON."""
        start = 0
        while start < count:
            part = slice(start, min(start + (self._part or self.simulator.block), count))
            yield part
            start = part.stop
            if self._part:
                self._part = int(np.clip(_SOON / max(self._each, 1e-9), 1, self.simulator.block))

    def _run(self, index: Ints, x: Floats) -> Floats:
        outcome = np.empty(len(index))
        begin = time.monotonic()
        for part in self._parts(len(index)):
            outcome[part] = self._block(index[part], x[part])
            seconds, done = time.monotonic() - begin, part.stop
            if seconds > 1 and done < len(index):
                rate = f"{done:,} of {len(index):,} runs, {done / seconds:.3g} runs/s"
                self.progress.update(rate, done, len(index))
        return outcome

    def _block(self, index: Ints, x: Floats) -> Floats:
        """One block of runs, recorded; after an exception halves of it, to find the run at fault.

        The runs that do complete on the way are kept, so the search costs one block at most.
        """
        try:
            raw = self._call(index, x)
        except SimulatorError:
            raise
        except RunStopped as stop:
            done = len(stop.completed)
            self._keep(index[:done], x[:done], stop.completed)
            cause = stop.__cause__
            if not isinstance(cause, (Exception, SystemExit)):
                raise (cause or stop) from None  # Ctrl-C
            self._commit_failure(index[done], x[done], cause)
            raise self._raised(index[done], x[done], cause) from cause
        except (Exception, SystemExit) as error:
            if len(index) == 1:
                self._commit_failure(index[0], x[0], error)
                raise self._raised(index[0], x[0], error) from error
            half = len(index) // 2
            self._block(index[:half], x[:half])
            self._block(index[half:], x[half:])
            raise SimulatorError(
                f"simulator '{self.simulator.name}' raised when called with {len(index)} runs, "
                f"but not with fewer: {describe(error)}",
                "set vectorized = false, or make it take arrays of any length",
            ) from error
        self._keep(index, x, raw)
        return raw

    def _call(self, index: Ints, x: Floats) -> Floats:
        conditions = {name: column[index] for name, column in self._conditions.items()}
        parameters = {name: x[:, k].copy() for k, name in enumerate(self.parameters)}
        began, share = time.perf_counter(), len(index)
        try:
            returned: object = self.simulator(conditions, parameters)
        except RunStopped as stop:
            share = len(stop.completed) + 1
            raise
        finally:
            self._each = (time.perf_counter() - began) / share
        shape = np.shape(np.asanyarray(returned))
        if shape != (len(index),):
            kind = type(returned).__name__
            got = f"{kind} of shape {shape}" if shape else f"a single {kind}"
            raise SimulatorError(
                f"simulator '{self.simulator.name}' returned {'None' if returned is None else got} "
                f"for {len(index)} runs, expected an array of shape ({len(index)},)",
                "set vectorized = false if it computes one run at a time (as float() and the "
                "functions of math do); else let it return one number a run",
            )
        if np.asarray(returned).dtype.kind not in "fiu":
            raise SimulatorError(
                f"simulator '{self.simulator.name}' returned {np.asarray(returned).dtype} values",
                "let it return real numbers",
            )
        return np.asarray(returned, dtype=np.float64)

    def _commit(self, index: Ints, x: Floats, raw: Floats) -> None:
        if self.kept is not None:
            self.kept.add(self.group[index], x, raw, self._each)

    def _commit_failure(self, at: np.intp, x: Floats, error: BaseException) -> None:
        if self.kept is not None:
            self.kept.add_failure(self.group[at], x, error, self._each)

    def _keep(self, index: Ints, x: Floats, raw: Floats) -> None:
        self._commit(index, x, raw)
        good = np.isfinite(transformed(raw, self.transform))
        if np.any(good):
            self._blocks.append(Runs(index[good], x[good].copy(), raw[good].copy()))
        if not np.all(good):
            raise self._not_finite(index, x, raw, good)

    def _raised(self, at: np.intp, x: Floats, error: BaseException) -> SimulatorError:
        if isinstance(error, TypeError) and getattr(self.simulator, "vectorized", False):
            return SimulatorError(
                f"simulator '{self.simulator.name}' is called with arrays, because vectorized is "
                f"true, and raised for any number of runs: {describe(error)}",
                "set vectorized = false if it computes one run at a time (as float() and the "
                "functions of math do); else let it take arrays, with the functions of numpy",
            )
        text = [name for name, column in self._conditions.items() if column.dtype == object]
        return NoOutcome(
            f"simulator '{self.simulator.name}' raised for experiment '{self.ids[at]}' with "
            f"{self._parameters(x)}: {describe(error)}",
            f"mend the function for the conditions {self._values(at)}"
            + (f"; {', '.join(text)} is text in the table" if text else ""),
            x[None, :],
        )

    def _not_finite(
        self, index: Ints, x: Floats, raw: Floats, good: NDArray[np.bool_]
    ) -> SimulatorError:
        first = int(np.argmin(good))
        at = index[first]
        what = f"{raw[first]:g}" + (", which has no logarithm," if np.isfinite(raw[first]) else "")
        mine = index == at
        hint = _separating(self.parameters, x[mine], good[mine])
        return NoOutcome(
            f"simulator '{self.simulator.name}' returned {what} for experiment '{self.ids[at]}' "
            f"with {self._parameters(x[first])}: {np.sum(~good)} of {len(good)} runs failed so, "
            f"in {len(set(index[~good].tolist()))} of {len(self.ids)} experiments",
            (hint or f"narrow the box or the bounds of {' or '.join(self.parameters)}")
            + f"; or check the conditions of the experiment: {self._values(at)}",
            x[~good],
        )

    def _parameters(self, x: Floats) -> str:
        return ", ".join(f"{name}={v:.6g}" for name, v in zip(self.parameters, x, strict=True))

    def _values(self, at: np.intp) -> str:
        cells = {name: column[at] for name, column in self._conditions.items()}
        return ", ".join(
            f"{name}={v:.6g}" if isinstance(v, float) else f"{name}={v!r}"
            for name, v in cells.items()
        )


def _separating(names: Sequence[str], x: Floats, good: NDArray[np.bool_]) -> str:
    """Words for a parameter whose one end fails throughout, if there is one."""
    for k, name in enumerate(names):
        fails, works = x[~good, k], x[good, k]
        if len(works) and fails.min() > works.max():
            return f"narrow the box or the bounds of {name} from above, to {works.max():.6g}"
        if len(works) and fails.max() < works.min():
            return f"narrow the box or the bounds of {name} from below, to {works.min():.6g}"
    return ""


def _groups(columns: Sequence[NDArray[Any]], number: int) -> Ints:
    """For each experiment the first one with the same values in every column, (N,)."""
    first: dict[tuple[Any, ...], int] = {}
    rows = zip(*(column.tolist() for column in columns), strict=True) if columns else [()] * number
    return np.array([first.setdefault(row, k) for k, row in enumerate(rows)], dtype=np.intp)
