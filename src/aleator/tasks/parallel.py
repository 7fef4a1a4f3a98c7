"""The same work on many pieces by processes of this machine, each of which gets the work once."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import BrokenExecutor, as_completed
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from aleator.errors import SurroundingsError
from aleator.simulators import ProcessPool
from aleator.simulators.command.run import passing

Result = TypeVar("Result")


def in_processes(
    parcel: bytes, function: Callable[..., Result], pieces: Mapping[int, tuple[Any, ...]],
    workers: int,
) -> Generator[tuple[int, Result], None, None]:  # fmt: skip
    """`function(work, *piece)` of each piece with its number, as they are finished.

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
