"""Worker processes on this machine."""

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
    BrokenProcessPool, and the next submission starts new workers. Workers are started afresh, not
    forked. They leave Ctrl-C to this process, end when it ends, and use one thread each for linear
    algebra. Raises InputsError for fewer than one worker, and SurroundingsError if the system
    starts none.

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
        """Hand a call to a worker; new workers are started if the last ones died."""
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
        """End the workers; without `wait` those that are busy are killed."""
        # Only these workers: the caller may have other children. Python 3.14 has a public name.
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
    """Block Ctrl-C: a worker that starts in the block inherits that, this process answers later."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_limits: list[Any] = []


def _end_with_parent() -> None:
    """End this worker, whatever it does, when the process that started it has ended.

    Programs and folders of its runs are removed then, too (see `command.run`).
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
    """The pickled work with its simulator; None if it cannot be pickled."""
    try:
        return cloudpickle.dumps(work)  # type: ignore[no-any-return]
    except (pickle.PicklingError, AttributeError, TypeError):
        return None
