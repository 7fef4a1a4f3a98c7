"""The interface of a simulator for the rest of Aleator, and how a run of it fails."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from aleator.core.types import Array, Indices
from aleator.errors import SimulatorError, nearest


@dataclass(frozen=True)
class Blocks:
    """The default number of runs in one call of a function. The values are chosen by judgement."""

    arrays: int = 8192
    """The most runs of one call with arrays: enough to profit from arrays, few enough that an
    interruption loses little. The number is fixed, because the last digits of an array operation
    may depend on the length of the arrays."""
    single: int = 256
    """The most runs of one call that makes them one by one; such runs are timed together."""


BLOCKS = Blocks()

Columns = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class WithSlopes:
    """What one run returned, with its derivatives by the n parameters, in their order.

    `value` is a number, an array (m,) of a series, or a mapping from responses to these. `slopes`
    are an array (n,) or (m, n), or a mapping from responses to these; NaN where one is not known.
    """

    value: Any
    slopes: Any


Returned = NDArray[np.float64] | Mapping[str, NDArray[np.float64]] | list[Any]
"""What a call returned: an array (R,), an array for each response, or a list of R values."""


class Simulator(Protocol):
    """The user's deterministic model: from conditions and parameters to the outcome of a run.

    `FunctionSimulator` makes one from a function; other kinds of simulator have the same members.
    Two more members are optional. If `series` is true, one run makes all rows of an experiment.
    Conditions that vary within any experiment are then object arrays (R,), whose entries are arrays
    (m,). If `sloped` is true, a call returns a list of `WithSlopes`.
    """

    @property
    def name(self) -> str:
        """The name of the simulator in messages."""

    @property
    def block(self) -> int:
        """The most runs of one call; runs that completed in earlier calls are never lost."""

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """The conditions that the simulator needs, out of the given ones.

        Raises SimulatorError if it cannot be called with these conditions and parameters.
        """

    def __call__(self, conditions: Columns, parameters: Columns) -> Returned:
        """Run R times, with arrays (R,) of the conditions that `asks` names and of the parameters.

        Returns the outcomes in one of three forms: an array (R,); for several responses a mapping
        from their names to arrays (R,); or a list with what each run returned, which is a number,
        an array (m,) of a series, or a mapping from responses to these.

        It may raise any exception; RunStopped contains the outcomes of the runs that completed
        before.
        """

    def fingerprint(self) -> str:
        """A text that changes when the simulator changes, so that old runs are not reused then."""


class RunStopped(Exception):
    """A simulator that runs one at a time stopped after k runs, whose outcomes are `completed`.

    Its `__cause__` is the exception that the next run raised.
    """

    def __init__(self, completed: NDArray[np.float64] | list[Any]) -> None:
        super().__init__(f"stopped after {len(completed)} runs")
        self.completed = completed


def one_by_one(
    run: Callable[[dict[str, Any]], Any], conditions: Columns, parameters: Columns
) -> NDArray[np.float64] | list[Any]:
    """Outcomes of R calls of `run`, one after the other, each with its values by name.

    The outcomes are an array (R,) if all are numbers, else a list. If `run` raises an exception,
    RunStopped is raised with the outcomes completed before.

    >>> one_by_one(lambda cells: cells["a"] * cells["x"], {"a": np.ones(2)}, {"x": np.arange(2.0)})
    array([0., 1.])
    """
    columns = {**conditions, **parameters}
    outcomes: list[Any] = []
    try:
        for cells in zip(*(column.tolist() for column in columns.values()), strict=True):
            outcome = run(dict(zip(columns, cells, strict=True)))
            # Appended at once, so that an exception leaves the outcomes before it in the list.
            outcomes.append(outcome)
    except BaseException as cause:
        raise RunStopped(_packed(outcomes)) from cause
    return _packed(outcomes)


def _packed(outcomes: list[Any]) -> NDArray[np.float64] | list[Any]:
    if all(isinstance(outcome, float) for outcome in outcomes):
        return np.array(outcomes, dtype=np.float64)
    return outcomes


_ROOM = Path(__file__).parent


def require_distinct(simulator: str, conditions: Sequence[str], parameters: Sequence[str]) -> None:
    """Raise SimulatorError for a name that is both a condition and a parameter."""
    for name in parameters:
        if name in conditions:
            raise SimulatorError(
                f"simulator '{simulator}': '{name}' is both a condition and a parameter",
                "rename the column or the parameter, or name the conditions without it",
            )


def name_lists(conditions: Sequence[str], parameters: Sequence[str]) -> str:
    """The names of conditions and parameters as a list for a remedy in a message.

    >>> name_lists(["load"], [])
    'conditions: load; parameters: none'
    """
    lists = {"conditions": conditions, "parameters": parameters}
    return "; ".join(f"{what}: {', '.join(names) or 'none'}" for what, names in lists.items())


def require_file(
    path: Path, what: str, kind: str = "*", remedy: str = "name it relative to the study file"
) -> None:
    """Raise SimulatorError if a path does not exist; suggest the nearest name of that `kind`."""
    if not path.exists():
        close = nearest(path.name, [one.name for one in path.parent.glob(kind)])
        raise SimulatorError(f"{what} does not exist{close}", remedy)


class RunFailed(Exception):
    """A run has no outcome: `message` is the reason in one line, `log` the end of its output.

    The exception can be pickled, so that it reaches this process from a worker unchanged.

    >>> failure = RunFailed("it ended with exit code 3", "pressure too high")
    >>> print(failure)
    it ended with exit code 3; its log ends: pressure too high
    >>> failure.message, failure.log
    ('it ended with exit code 3', 'pressure too high')
    """

    def __init__(self, message: str, log: str = "") -> None:
        super().__init__(message, log)
        self.message = message
        self.log = log

    def __str__(self) -> str:
        return with_log(self.message, self.log)


def with_log(message: str, log: str) -> str:
    """A message with the end of the run's output, if there is any that it does not have itself."""
    last = " ".join(log.split())[-300:]
    return message if last in message else f"{message}; its log ends: {last}"


class WorkerLost(BrokenExecutor):
    """Several workers were lost during the same call; the executor still serves other calls."""


class NoOutcome(SimulatorError):
    """The simulator gave no outcome at parameters `failed` (F, n) of experiments `index` (F,)."""

    def __init__(self, problem: str, remedy: str, failed: Array, index: Indices) -> None:
        super().__init__(problem, remedy)
        self.failed, self.index = failed, index


def working_box(worked: Array, failed: Array, open_ended: Sequence[int]) -> Array:
    """A box (n, 2) around points that worked (W, n), which excludes points that failed (F, n).

    It begins as the smallest box around all points that worked. Each failure inside makes it
    smaller, by a new limit of one parameter: of those in `open_ended`, the one that costs the
    fewest points that worked. A failure that no such limit excludes may remain inside.

    >>> worked = np.array([[-1.0], [0.0], [1.0], [2.0]])
    >>> working_box(worked, np.array([[-1.5], [-0.9]]), [0]).tolist()
    [[0.0, 2.0]]
    """
    box = np.stack([worked.min(axis=0), worked.max(axis=0)], axis=1)
    kept = worked
    middle = np.median(worked, axis=0)
    for point in failed[np.argsort(np.abs(failed - middle).max(axis=1))]:
        if np.any((point < box[:, 0]) | (point > box[:, 1])):
            continue
        sides = [
            kept[kept[:, k] > point[k]] if point[k] < middle[k] else kept[kept[:, k] < point[k]]
            for k in open_ended
        ]
        most = max(sides, key=len)
        if len(most) < 2:
            continue
        kept = most
        box = np.stack([kept.min(axis=0), kept.max(axis=0)], axis=1)
    return box


def said(error: BaseException) -> str:
    """The text of an exception in characters that any file can hold; "" if it has no text.

    >>> said(ValueError("a path with \\udcff in it"))
    'a path with \\\\udcff in it'
    """
    try:
        text = str(error)
    except KeyboardInterrupt:
        raise
    except BaseException:
        return ""
    return readable(text)


def readable(text: str) -> str:
    """A text that UTF-8 can hold: invalid half characters, as in file names, become escapes."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def describe(error: BaseException) -> str:
    """An exception as one line: its type, its message, and the user's file and line that raised it.

    >>> describe(ValueError("too cold"))
    'ValueError: too cold'
    """
    if isinstance(error, RunFailed):
        return said(error)
    text = " ".join(said(error).split())
    kind = readable(type(error).__name__)
    if isinstance(error, SyntaxError):  # Its text already names the file and the line.
        return f"{kind}: {text}"
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith("<") and _ROOM not in Path(frame.filename).parents
        if "importlib" not in frame.filename
    ]
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{kind}: {text}{place}" if text else f"{kind}{place}"
