"""Messages about runs without an outcome, and about the store of runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from aleator.core.types import Array, Flags
from aleator.errors import SimulatorError, count, setting, short
from aleator.observations.tables import real_numbers
from aleator.simulators.execution import RunCache
from aleator.simulators.function import FunctionSimulator
from aleator.simulators.protocol import NoOutcome, Simulator, with_log
from aleator.simulators.runs import NOT_FINITE, Failure, Runs
from aleator.simulators.units import Cases, Units


@dataclass(frozen=True, eq=False)
class Messages:
    """Makes errors about runs that name the experiments, conditions and parameters concerned."""

    simulator: Simulator
    ids: Sequence[str]
    parameters: Sequence[str]
    cases: Cases
    units: Units

    def first(self, tried: Runs) -> SimulatorError:
        """The error about the first failed run, for callers that need every run."""
        row = min(tried.failures)
        failure = tried.failures[row]
        if failure.kind == NOT_FINITE:
            return self._not_finite(tried, row)
        what, who = (
            ("failed", "simulator") if failure.kind == "RunFailed" else ("raised", "function")
        )
        self._require_numbers(tried, row)
        return self._no_outcome(
            f" {what} for {self._run(tried, row)}: {_with_log(failure)}",
            f"mend the {who} for the conditions {self._conditions(tried, row)}",
            tried,
            np.arange(len(tried)) == row,
        )

    def excess(self, tried: Runs, failed: int, total: int) -> SimulatorError:
        """The error that too large a share of all runs failed."""
        row = min(tried.failures)
        if failed == total:
            self._require_numbers(tried, row)
        hint = "mend the simulator: no run of it worked" if failed == total else ""
        if hint and len(self.units) == len(self.ids) and not self.units.series:
            write = setting("[experiments] id and [simulator] series", 'id="...", series=True')
            hint += f"; if it takes all rows of an experiment at once, say so: {write}"
        if hint and self.units.series:
            hint += "; it gets arrays of an experiment's rows (np.exp in place of math.exp)"
        if hint and getattr(self.simulator, "vectorized", None) is True:
            off = setting("[simulator] vectorized = false", "vectorized=False")
            hint = (
                f"let it take arrays (np.exp in place of math.exp), or call it with numbers: {off}"
            )
        return self._no_outcome(
            f": {failed:,} of {total:,} runs failed, too many to go on; the first for "
            f"{self._run(tried, row)}: {_with_log(tried.failures[row])}",
            f"{hint or self._narrower(tried, row)}; or check the conditions of the experiment: "
            f"{self._conditions(tried, row)}",
            tried,
            _failed(tried),
        )

    def not_repeatable(self, runs: Runs, row: int, first: float, again: float) -> SimulatorError:
        """The error that the same run had two different outcomes."""
        return SimulatorError(
            f"simulator '{self.simulator.name}' returned {first:.8g} and then {again:.8g} for the "
            f"same run: {self._run(runs, row)}",
            "let it return the same outcome every time: fix the seed of its random numbers, keep "
            "no state from run to run, and let it return no measurement noise",
        )

    def not_the_same(self, runs: Runs, row: int, arrays: float, alone: float) -> SimulatorError:
        """The error that a call with arrays of many runs gave another outcome than one alone."""
        return SimulatorError(
            f"simulator '{self.simulator.name}' returned {arrays:.8g} when called with arrays of "
            f"many runs and {alone:.8g} when called for one run, for the same run: "
            f"{self._run(runs, row)}",
            "state vectorized = false (vectorized=False in Python), so that it is called once a "
            "run; or let it treat the runs independently of each other",
        )

    def _not_finite(self, tried: Runs, row: int) -> SimulatorError:
        failed = _failed(tried)
        message = tried.failures[row].message.removeprefix("it ")
        units = np.isin(self.cases.condition, tried.case[failed])
        experiments = np.unique(self.units.experiment[units])
        return self._no_outcome(
            f" {message} for {self._run(tried, row)}: {np.sum(failed)} of "
            f"{count(len(tried), 'run')} failed so, in {len(experiments)} of "
            f"{count(len(self.ids), 'experiment')}",
            f"{self._narrower(tried, row)}; or check the conditions of the experiment: "
            f"{self._conditions(tried, row)}",
            tried,
            failed,
        )

    def _require_numbers(self, tried: Runs, row: int) -> None:
        """Raise SimulatorError if a function wants the arrays of a whole experiment.

        It failed with numbers in this row of some runs. It is called once with all rows of the
        experiment: it wants arrays if it then returns a number for each row.
        """
        case, simulator = int(tried.case[row]), self.simulator
        if not isinstance(simulator, FunctionSimulator) or simulator.series:
            return
        own = self.units.experiment == self.units.experiment[self.cases.first[case]]
        cells = self.cases.at(self.cases.condition[own])
        arrays = {name: cell for name, cell in cells.items() if np.any(cell != cell[0])}
        if not arrays:
            return
        single = {name: cell[0] for name, cell in cells.items() if name not in arrays}
        x = dict(zip(self.parameters, tried.x[row].tolist(), strict=True))
        try:
            returned = simulator.function(**single, **arrays, **x)
            returned = returned[0] if simulator.jac is True else returned
            parts = [*returned.values()] if isinstance(returned, Mapping) else [returned]
            if any(np.shape(real_numbers(part)) != (int(own.sum()),) for part in parts):
                return
        except Exception:
            return  # It fails with arrays, too: the first failure is the one to mend.
        write = setting("[simulator] series = true", "identify(..., series=True)")
        raise SimulatorError(
            f"simulator '{self.simulator.name}' fails for {self._run(tried, row)}: "
            f"{_with_log(tried.failures[row])}; it works when it is called once for the whole "
            f"experiment, with arrays of {' and '.join(arrays)}",
            f"say that a run is a series: {write}, or FunctionSimulator({simulator.name}, "
            "series=True) in place of the function",
        )

    def _no_outcome(self, problem: str, remedy: str, tried: Runs, failed: Flags) -> NoOutcome:
        return NoOutcome(
            f"simulator '{self.simulator.name}'{problem}",
            remedy,
            tried.x[failed],
            self.cases.first[tried.case[failed]],
        )

    def _run(self, runs: Runs, row: int) -> str:
        """A run in words: its experiment and the values of its parameters."""
        unit = int(self.cases.first[runs.case[row]])
        return f"{self._unit(unit)} with {self._parameters(runs.x[row])}"

    def _unit(self, unit: int) -> str:
        """What a run serves, in words: an experiment, or one row of an experiment."""
        experiment = self.units.experiment[unit]
        name = f"experiment '{self.ids[experiment]}'"
        rows = int(np.sum(self.units.experiment == experiment))
        return f"row {self.units.place[unit] + 1} of {rows} of {name}" if rows > 1 else name

    def _parameters(self, x: Array) -> str:
        return ", ".join(f"{name}={v:.6g}" for name, v in zip(self.parameters, x, strict=True))

    def _conditions(self, runs: Runs, row: int) -> str:
        return ", ".join(
            f"{name}={_shown(v)}" for name, v in self.cases.at(int(runs.case[row])).items()
        )

    def _narrower(self, tried: Runs, row: int) -> str:
        """The remedy: narrow the range of a parameter.

        If all failed runs lie on one side of the successful ones in one parameter, it is that
        parameter. Otherwise all parameters are named.
        """
        mine, failed = tried.case == tried.case[row], _failed(tried)
        for k, name in enumerate(self.parameters):
            fails, works = tried.x[mine & failed, k], tried.x[mine & ~failed, k]
            if len(works) and fails.min() > works.max():
                return self._within(f"{name} from above, to {works.max():.6g}")
            if len(works) and fails.max() < works.min():
                return self._within(f"{name} from below, to {works.min():.6g}")
        return self._within(" or ".join(self.parameters))

    def _within(self, which: str) -> str:
        return (
            f"narrow the box or the bounds of {which} (a law without a box, such as a lognormal "
            "one, can become a truncated_normal, which has one)"
        )


def _failed(runs: Runs) -> Flags:
    """Which of R runs have no outcome (R,)."""
    return np.isin(np.arange(len(runs)), list(runs.failures))


def _with_log(failure: Failure) -> str:
    return with_log(failure.message, failure.log or "")


def _shown(value: Any) -> str:
    """The value of a condition in a message; for a series its first and its last value."""
    if isinstance(value, np.ndarray):
        first, *_, last = (_shown(one) for one in (value[0], *value.tolist()))
        return f"{first}...{last}"
    return f"{value:.6g}" if isinstance(value, float) else repr(value)


@contextmanager
def notified(
    cache: RunCache | None, study: str, say: Callable[[str], None] | None = None
) -> Iterator[None]:
    """Tell the user what the store has for this simulator, and after an exception what was added.

    `say` prints a message. `study` is the study file, for the commands `aleator runs ...` in
    messages.
    """
    if cache is None or say is None:
        yield
        return
    _tell_at_start(cache, study, say)
    try:
        yield
    except BaseException:
        if cache.store.added:
            say(
                f"{short(cache.store.path)} keeps {count(cache.store.added, 'new run')}: the same "
                "command goes on from there"
            )
        raise


def _tell_at_start(cache: RunCache, study: str, say: Callable[[str], None]) -> None:
    path, identity = short(cache.store.path), cache.identity
    stored = cache.at_start
    if stored.runs:
        failed = f", {stored.failures:,} of them failed" if stored.failures else ""
        say(f"{path} has {count(stored.runs, 'run')} of this simulator{failed}; none is repeated")
    if stored.other:
        say(
            f"{path} has {count(stored.other, 'run')} of '{identity.name}' with other files or "
            f"settings, not used here (aleator runs list {study})"
        )
    if not cache.store.writable:
        say(f"{path} is read-only: its runs are used, new ones are not kept")
