"""What a simulator is to the rest of Aleator, and how a run of it fails."""

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
    """The most runs of one call of a function that does not say itself; by judgement."""

    arrays: int = 8192
    """Runs of one call with arrays: enough that arrays pay, few enough that an interruption loses
    little. Fixed, because the last digits of an array operation may depend on its length."""
    single: int = 256
    """Runs that are made one by one and timed together."""


BLOCKS = Blocks()

Columns = Mapping[str, NDArray[Any]]
Returned = NDArray[np.float64] | Mapping[str, NDArray[np.float64]] | list[Any]
"""What a call returned: an array, arrays by response, or the answers one by one."""


class Simulator(Protocol):
    """The user's deterministic model: conditions and parameters to the outcome of a run.

    FunctionSimulator makes one of a function; further kinds of simulator fill the same members. One
    more is optional: where `series` is true one run serves a whole experiment. Conditions that vary
    within any experiment then come as object arrays (R,) of arrays (m,).
    """

    @property
    def name(self) -> str:
        """What messages call the simulator."""

    @property
    def block(self) -> int:
        """The most runs of one call; what completed before a call is never lost."""

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """Those of the conditions that the simulator is called with.

        Raises SimulatorError if it cannot be called with these conditions and parameters.
        """

    def __call__(self, conditions: Columns, parameters: Columns) -> Returned:
        """Run R times, with arrays (R,) of the conditions of `asks` and of the parameters.

        Returns outcomes (R,); or for several responses a mapping from their names to arrays (R,);
        or a list of what each run returned: a number, an array (m,) of a series, or a mapping from
        responses to such.

        May raise anything; RunStopped hands over the runs that completed before.
        """

    def fingerprint(self) -> str:
        """A text that changes when the simulator does: runs are reused only if it is the same."""


class RunStopped(Exception):
    """A simulator that runs one at a time stopped after k runs, whose outcomes are `completed`.

    Its `__cause__` is what stopped the next run.
    """

    def __init__(self, completed: NDArray[np.float64] | list[Any]) -> None:
        super().__init__(f"stopped after {len(completed)} runs")
        self.completed = completed


def one_by_one(
    run: Callable[[dict[str, Any]], Any], conditions: Columns, parameters: Columns
) -> NDArray[np.float64] | list[Any]:
    """Outcomes of `run`, which is called for one run after the other with its values by name.

    They are an array (R,) if all are numbers, else a list. Raises RunStopped, with the outcomes
    before, where `run` raises.

    >>> one_by_one(lambda cells: cells["a"] * cells["x"], {"a": np.ones(2)}, {"x": np.arange(2.0)})
    array([0., 1.])
    """
    columns = {**conditions, **parameters}
    outcomes: list[Any] = []
    try:
        for cells in zip(*(column.tolist() for column in columns.values()), strict=True):
            outcome = run(dict(zip(columns, cells, strict=True)))
            # One by one: an exception finds in the list what completed before it.
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
    """The names of conditions and parameters as a remedy lists them.

    >>> name_lists(["load"], [])
    'conditions: load; parameters: none'
    """
    lists = {"conditions": conditions, "parameters": parameters}
    return "; ".join(f"{what}: {', '.join(names) or 'none'}" for what, names in lists.items())


def require_file(
    path: Path, what: str, kind: str = "*", remedy: str = "name it relative to the study file"
) -> None:
    """Raise SimulatorError for a path that does not exist, with the nearest name of that `kind`."""
    if not path.exists():
        close = nearest(path.name, [one.name for one in path.parent.glob(kind)])
        raise SimulatorError(f"{what} does not exist{close}", remedy)


class RunFailed(Exception):
    """A run gave no outcome: `message` says why in one line, `log` is what it printed last.

    It can be pickled, and so reaches this process from a worker as it was raised.

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
    """A message with the end of what the run printed, if it printed anything."""
    last = " ".join(log.split())[-300:]
    return f"{message}; its log ends: {last}" if last else message


class WorkerLost(BrokenExecutor):
    """Several workers were lost with the same call; the executor serves other calls still."""


class NoOutcome(SimulatorError):
    """The simulator gave no outcome at parameters `failed` (F, n) of experiments `index` (F,)."""

    def __init__(self, problem: str, remedy: str, failed: Array, index: Indices) -> None:
        super().__init__(problem, remedy)
        self.failed, self.index = failed, index


def working_box(worked: Array, failed: Array, open_ended: Sequence[int]) -> Array:
    """A box (n, 2) of points that worked (W, n), without those that failed (F, n).

    It is the smallest box of all points that worked, made smaller for each failure in it: by the
    limit of one of the parameters `open_ended` that costs the fewest points that worked. A failure
    that no such limit excludes may remain inside.

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
    """The text of an exception, as every file can hold it; "" of one whose text raises.

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
    """A text that UTF-8 can hold: halves of a character (in names of files) are written out."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def describe(error: BaseException) -> str:
    """An exception as one line: kind, message, and the user's file and line that raised it.

    >>> describe(ValueError("too cold"))
    'ValueError: too cold'
    """
    if isinstance(error, RunFailed):
        return said(error)
    text = " ".join(said(error).split())
    kind = readable(type(error).__name__)
    if isinstance(error, SyntaxError):  # its own text has the place
        return f"{kind}: {text}"
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith("<") and _ROOM not in Path(frame.filename).parents
        if "importlib" not in frame.filename
    ]
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{kind}: {text}{place}" if text else f"{kind}{place}"
