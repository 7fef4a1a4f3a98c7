"""Simulator runs of all tasks: runners under the conditions of a table, and worker processes."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, as_completed
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd

from aleator.errors import SurroundingsError
from aleator.observations.experiments import Conditions, Experiments
from aleator.simulators import ProcessPool, Runner, Simulator, as_runner
from aleator.simulators.command.run import passing
from aleator.tasks.arguments import Columns, conditions_in

AnySimulator = Callable[..., Any] | Simulator | Runner
"""The type of a simulator: a function, a Simulator, or a Runner with its conditions and store."""
AnyTable = Experiments | Conditions | pd.DataFrame | Columns
"""The type of a table of conditions, with or without outcomes."""


def runner_on(
    simulator: AnySimulator,
    table: AnyTable,
    parameters: Sequence[str],
    vectorized: bool | None = None,
    executor: Executor | None = None,
) -> Runner:
    """The runner of a simulator under the conditions of a table; a Runner is returned unchanged.

    >>> table = pd.DataFrame({"load": [1.0], "length": [2.1]})
    >>> runner_on(lambda load, x: load * x, table, ["x"])([0], [[2.0]])
    array([2.])
    """
    if not isinstance(table, Experiments):
        table = conditions_in(table, "experiments", None)
    return as_runner(simulator, table, parameters, vectorized, executor)


Result = TypeVar("Result")


def in_processes(
    parcel: bytes, function: Callable[..., Result], pieces: Mapping[int, tuple[Any, ...]],
    workers: int,
) -> Generator[tuple[int, Result], None, None]:  # fmt: skip
    """The results of `function(work, *piece)` in several processes, with the number of each piece.

    They come in the order in which they are finished. `parcel` is the serialized object `work` (see
    `packed`). Raises SurroundingsError if a process dies.
    """
    with passing() as folder:
        path = folder / "work.pickle"
        path.write_bytes(parcel)
        pool = ProcessPool(min(workers, len(pieces)))
        try:
            jobs = {pool.submit(_done, str(path), function, p): n for n, p in pieces.items()}
            for job in as_completed(jobs):
                yield jobs[job], job.result()
        except BrokenExecutor as death:
            raise SurroundingsError(
                f"a worker process ended before its work was finished ({death})",
                "ask for fewer workers, there may be no memory left, and give the same command "
                "again: what is kept is not made again",
            ) from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _done(path: str, function: Callable[..., Result], piece: tuple[Any, ...]) -> Result:
    return function(_unpacked(path), *piece)


@lru_cache(maxsize=1)
def _unpacked(path: str) -> Any:
    return pickle.loads(Path(path).read_bytes())
