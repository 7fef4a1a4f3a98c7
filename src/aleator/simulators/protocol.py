"""What a simulator is to the rest of Aleator."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

# Large enough that arrays pay, small enough that an interruption loses little. Fixed, because the
# last digits of an array operation may depend on its length.
ARRAY_BLOCK = 8192
# One at a time loses nothing; a block is what is timed together at most.
SINGLE_BLOCK = 256

Columns = Mapping[str, NDArray[Any]]
Returned = NDArray[np.float64] | Mapping[str, NDArray[np.float64]] | list[Any]
"""What a call returned: an array, arrays by response, or the answers one by one."""


class Simulator(Protocol):
    """The user's deterministic model: conditions and parameters to the outcome of a run.

    A function is made one by FunctionSimulator; further kinds of simulator fill the same members.
    One more is optional: where `series` is true one run serves a whole experiment. Conditions that
    vary within any experiment then come as object arrays (R,) of arrays (m,).
    """

    @property
    def name(self) -> str:
        """What messages call the simulator."""

    @property
    def block(self) -> int:
        """The most runs that one call is given; what completed before a call is never lost."""

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """The conditions that the simulator wants to be given, of those that there are.

        Raises SimulatorError if it cannot be called with these conditions and parameters.
        """

    def __call__(self, conditions: Columns, parameters: Columns) -> Returned:
        """Run R times: arrays (R,) of conditions asked for and of parameters.

        Returns outcomes (R,); or for several responses a mapping from their names to arrays (R,);
        or a list of what each run returned: a number, an array (m,) of a series, or a mapping from
        responses to such.

        May raise anything; RunStopped hands over the runs that completed before.
        """

    def fingerprint(self) -> str:
        """A text that changes when the simulator does: runs are reused only if it is the same."""


class RunStopped(Exception):
    """A simulator that runs one at a time stopped: `completed` are the k outcomes before.

    Its `__cause__` is what stopped run number k (from 0).
    """

    def __init__(self, completed: NDArray[np.float64] | list[Any]) -> None:
        super().__init__(f"stopped after {len(completed)} runs")
        self.completed = completed


def one_by_one(
    run: Callable[[dict[str, Any]], Any], conditions: Columns, parameters: Columns
) -> NDArray[np.float64] | list[Any]:
    """Outcomes of `run`, called with the values of one run by name, one after the other.

    An array (R,) where all are numbers, else a list. Raises RunStopped, with the outcomes before,
    whatever `run` raises.

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
