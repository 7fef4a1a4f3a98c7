"""How every task makes its runs: a simulator under conditions, and work in several processes."""

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

AnySimulator = Callable[..., Any] | Simulator | Runner
"""A function, another simulator, or a Runner, which has conditions, store and workers already."""
AnyTable = Experiments | Conditions | pd.DataFrame
"""Conditions with or without outcomes; a simulator is given the columns that it asks for."""


def runner_on(
    simulator: AnySimulator,
    table: AnyTable,
    parameters: Sequence[str],
    vectorized: bool = False,
    executor: Executor | None = None,
) -> Runner:
    """The runner of a simulator under the conditions of a table; a Runner as it is.

    >>> table = pd.DataFrame({"load": [1.0], "length": [2.1]})
    >>> runner_on(lambda load, x: load * x, table, ["x"])([0], [[2.0]])
    array([2.])
    """
    if isinstance(table, pd.DataFrame):
        table = Conditions.from_frame(table)
    return as_runner(simulator, table, parameters, vectorized, executor)


Result = TypeVar("Result")


def in_processes(
    parcel: bytes, function: Callable[..., Result], pieces: Mapping[int, tuple[Any, ...]],
    workers: int,
) -> Generator[tuple[int, Result], None, None]:  # fmt: skip
    """Results of `function(work, *piece)` by piece number, as they are finished.

    The work is what the parcel holds (see `packed`). Raises SurroundingsError where a process dies.
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
