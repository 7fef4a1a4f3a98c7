"""Worker processes on this machine that make runs in parallel."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, ParamSpec, TypeVar

import cloudpickle
from threadpoolctl import threadpool_limits

from aleator.errors import InputsError
from aleator.simulators.surroundings import prevented

P = ParamSpec("P")
T = TypeVar("T")


class ProcessPool(Executor):
    """A ProcessPoolExecutor of `slots` processes that survives the death of one of them.

    If a worker dies (out of memory, a crash in compiled code, a kill), all open futures raise
    BrokenProcessPool, and the next submission starts new workers. Workers are new Python processes,
    not forks of this one. They ignore Ctrl-C, end when this process ends, and use one thread each
    for linear algebra. Raises InputsError for fewer than one worker, and SurroundingsError if the
    system refuses to start a process.

    >>> with ProcessPool(1) as pool:
    ...     pool.submit(divmod, 7, 2).result()
    (3, 1)
    """

    def __init__(self, slots: int) -> None:
        if slots < 1:
            raise InputsError(f"{slots} workers", "ask for at least one")
        self.slots = slots
        self._inner = self._started()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Give a call to a worker; new workers are started if the previous ones died."""
        with _no_interruption():
            try:
                try:
                    return self._inner.submit(fn, *args, **kwargs)
                except BrokenProcessPool:
                    self._inner.shutdown(wait=False)
                    self._inner = self._started()
                    return self._inner.submit(fn, *args, **kwargs)
            except OSError as error:
                raise prevented(error, "a worker process could not be started") from error

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers; without `wait` busy workers are killed."""
        # Only these workers are killed. Python 3.14 has a public method for that.
        workers = [*(self._inner._processes or {}).values()]
        self._inner.shutdown(wait=wait, cancel_futures=cancel_futures)
        if not wait:
            for process in workers:
                process.kill()

    def _started(self) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self.slots, mp_context=context, initializer=_begin)


@contextmanager
def _no_interruption() -> Iterator[None]:
    """Block Ctrl-C in this process, which handles it after the block.

    A worker that starts within the block inherits that, and so is not interrupted by Ctrl-C.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows cannot block signals.
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_limits: list[Any] = []


def _end_with_parent() -> None:
    """End this worker process as soon as the process that started it has ended.

    The programs and folders of its runs are then removed, too (see `command.run`).
    """
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
        os._exit(1)


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _limits.append(threadpool_limits(1))


def packed(work: object) -> bytes | None:
    """An object as pickled bytes; None if it cannot be pickled."""
    try:
        return cloudpickle.dumps(work)  # type: ignore[no-any-return]
    except (pickle.PicklingError, AttributeError, TypeError):
        return None
