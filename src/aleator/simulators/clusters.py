"""The workers of a Dask cluster or of an MPI job, with the interface of a Python executor."""

from __future__ import annotations

import json
import logging
import socket
import sys
import threading
import time
from asyncio import run_coroutine_threadsafe
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from concurrent.futures import CancelledError, Executor, Future
from concurrent.futures import wait as wait_for
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar
from urllib.parse import urlsplit

from aleator.errors import AleatorError, ClusterError
from aleator.simulators.protocol import WorkerLost

if TYPE_CHECKING:
    from distributed import Client


P = ParamSpec("P")
T = TypeVar("T")

_SAME = "install there the same Python and the same Aleator as here"


@dataclass(frozen=True)
class ClusterSettings:
    """Settings of how long a cluster is waited for. The values are chosen by judgement."""

    lives: int = 3
    """If this many workers are lost during one call, the call is taken for the cause."""
    look: float = 0.5
    """Seconds between two queries of which workers exist."""
    introduction: float = 10.0
    """Seconds to wait at first for the versions of workers; slower ones are used later."""
    connect: float = 10.0
    """Seconds within which a scheduler must answer the first time."""
    answer: float = 60.0
    """Seconds within which a scheduler must answer later, when it may be busy."""
    leave: float = 2.0
    """The longest time in s that closing the connection may take."""
    port: int = 8786
    """The port of a scheduler whose address has none: Dask's default."""


SETTINGS = ClusterSettings()


@dataclass(eq=False)
class _Call:
    parcel: bytes
    future: Future[Any]
    deaths: int = 0
    begun: bool = False

    def begin(self) -> bool:
        """Mark the call as begun unless it was cancelled; returns whether it begins."""
        self.begun = self.begun or self.future.set_running_or_notify_cancel()
        return self.begun


class DaskExecutor(Executor):
    """An executor on the workers of a Dask cluster, which may come and go; see `dask_executor`.

    Each worker process has one call at a time, so that a simulator runs in one thread only, and the
    call of a lost worker is known. That call goes to another worker before all waiting calls. If
    `lives` workers are lost with the same call, its future raises WorkerLost. Calls wait while
    there is no worker. If the scheduler is lost, all futures and `submit` raise ClusterError.

    The function `say` gets messages about workers that are lost, missing or unusable. Raises
    ClusterError if there are workers but none is usable.
    """

    def __init__(
        self,
        cluster: _DaskCluster,
        say: Callable[[str], None],
        settings: ClusterSettings = SETTINGS,
    ) -> None:
        self._cluster, self._say, self._settings = cluster, say, settings
        # Only the thread that runs `_serve` uses these variables.
        self._waiting: deque[_Call] = deque()
        self._running: dict[str, tuple[_Call, Future[Any]]] = {}
        self._judged: dict[str, str] = {}
        self._silent: Set[str] = frozenset()
        # Other threads use these too: they send events, which the thread of `_serve` handles.
        self._events: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._workers: Set[str] = frozenset()
        self._open: set[Future[Any]] = set()
        self._lock = threading.Lock()
        self._end: Exception | None = None
        self._stopped = False
        self._meet()
        if self._judged and not self._workers:
            worker, fault = next(iter(self._judged.items()))
            raise ClusterError(f"no worker can be used: {worker} {fault}", _SAME)
        if not self._workers:
            say("no worker has joined the cluster yet: the runs wait for one")
        self._thread = threading.Thread(target=self._serve, name="aleator-cluster", daemon=True)
        self._thread.start()

    @property
    def slots(self) -> int:
        """The number of calls that run at once: one for each present worker, at least 1."""
        return max(len(self._workers), 1)

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Let a worker call `fn`; function and arguments are pickled at once."""
        import cloudpickle

        call = _Call(cloudpickle.dumps(partial(fn, *args, **kwargs)), Future())
        with self._lock:
            if self._end is not None:
                raise self._end
            self._open.add(call.future)
            self._events.put(partial(self._waiting.append, call))
        call.future.add_done_callback(self._open.discard)
        return call.future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the cluster; without `wait` running calls are abandoned and their results lost."""
        with self._lock:
            self._end = self._end or RuntimeError("the executor was shut down")
            pending = [*self._open]
        if cancel_futures or not wait:
            for future in pending:
                future.cancel()
        if wait:
            wait_for(pending)
        self._events.put(self._stop)
        self._thread.join()
        self._cluster.close()

    def _meet(self) -> None:
        """Wait for the versions of the first workers, for `introduction` seconds at most."""
        end = time.monotonic() + self._settings.introduction
        self._look()
        while self._silent and time.monotonic() < end:
            time.sleep(self._settings.look / 10)
            self._look()

    def _serve(self) -> None:
        """Handle events, check regularly which workers exist, and give free workers calls."""
        due = 0.0
        while not self._stopped:
            with suppress(Empty):
                self._events.get(timeout=self._settings.look)()
            try:
                if not self._cluster.alive():
                    raise self._cluster.lost()
                if time.monotonic() >= due:
                    self._look()
                    due = time.monotonic() + self._settings.look
                self._hand_out()
            except Exception as error:
                lost = error if isinstance(error, ClusterError) else self._cluster.lost()
                lost.__cause__ = error if lost is not error else None
                self._give_up(lost)
                return
        self._give_up(CancelledError())

    def _stop(self) -> None:
        self._stopped = True

    def _give_up(self, error: Exception) -> None:
        """End all open calls with this error."""
        with self._lock:
            self._end = self._end or error
            while not self._events.empty():
                self._events.get()()
        for call, inner in self._running.values():
            inner.cancel()
            call.future.set_exception(error)
        for call in self._waiting:
            if call.begin():
                call.future.set_exception(error)
        self._running.clear()
        self._waiting.clear()

    def _look(self) -> None:
        now = self._cluster.workers()
        for worker in self._running.keys() - now:
            call, inner = self._running.pop(worker)
            inner.cancel()
            self._bury(call, worker)
        for worker, fault in self._cluster.faults(now - self._judged.keys()).items():
            self._judged[worker] = fault
            if fault:
                self._say(f"worker {worker} is not used: it {fault}")
        self._silent = now - self._judged.keys()
        before = self._workers
        self._workers = frozenset(worker for worker in now if self._judged.get(worker) == "")
        if before and not self._workers:
            self._say("no worker is left: the runs wait for another to join")

    def _bury(self, call: _Call, worker: str) -> None:
        call.deaths += 1
        lives = self._settings.lives
        if call.deaths < lives:
            self._say(f"worker {worker} was lost; its runs go to another")
            self._waiting.appendleft(call)
        else:
            call.future.set_exception(WorkerLost(f"{lives} workers were lost while they ran it"))

    def _hand_out(self) -> None:
        for worker in self._workers - self._running.keys() if self._waiting else ():
            call = self._next()
            if call is None:
                return
            inner = self._cluster.send(worker, call.parcel)
            self._running[worker] = call, inner
            inner.add_done_callback(partial(self._tell, worker))

    def _next(self) -> _Call | None:
        while self._waiting:
            call = self._waiting.popleft()
            if call.begin():
                return call
        return None

    def _tell(self, worker: str, inner: Future[Any]) -> None:
        """Queue the event that a worker has ended its call; this runs in a thread of Dask."""
        self._events.put(partial(self._done, worker, inner))

    def _done(self, worker: str, inner: Future[Any]) -> None:
        call, mine = self._running.get(worker, (None, None))
        if call is None or mine is not inner:
            return
        del self._running[worker]
        if inner.cancelled():  # The cluster cancelled the call, as it was restarted or is lost.
            self._waiting.appendleft(call)
            return
        error = inner.exception()
        if error is None:
            call.future.set_result(inner.result())
        elif self._cluster.killed(error):
            self._bury(call, worker)
        else:
            if isinstance(error, AleatorError):
                error.args = (f"on worker {worker}: {error}",)
            call.future.set_exception(error)


_LOGGERS = ("distributed", "distributed.client", "tornado", "tornado.application", "asyncio")


@contextmanager
def dask_executor(
    address: str | Path | Client,
    say: Callable[[str], None] = lambda _: None,
    settings: ClusterSettings = SETTINGS,
) -> Iterator[DaskExecutor]:
    """The workers of the Dask cluster at `address`, as an executor for a Runner.

    `address` is the address of the scheduler ("tcp://host:8786"), its scheduler file, or a
    connected Client, for example of dask-jobqueue. The function `say` gets messages about workers
    that are lost or unusable. The cluster is left running; after an exception running calls are
    abandoned.

    Raises ClusterError if nobody answers there within about `connect` seconds. Raises it at once if
    there are workers, but none has this version of Python (major and minor) and of Aleator.

    >>> with dask_executor("tcp://127.0.0.1:1") as executor:
    ...     runner = Runner(simulator, experiments, ["stiffness"], executor=executor)
    Traceback (most recent call last):
        ...
    aleator.errors.ClusterError: no Dask scheduler answers at tcp://127.0.0.1:1 (...
    """
    if find_spec("distributed") is None:
        raise ClusterError(
            "a Dask cluster needs the package distributed", "pip install distributed"
        )
    with _quiet():
        cluster = _DaskCluster(address, settings)
        try:
            executor = DaskExecutor(cluster, say, settings)
        except BaseException:
            cluster.close()
            raise
        try:
            yield executor
        except BaseException:
            executor.shutdown(wait=False)
            raise
        executor.shutdown()


class _DaskCluster:
    """A connected Dask client; only one thread of DaskExecutor calls its methods, except `lost`."""

    def __init__(self, address: str | Path | Client, settings: ClusterSettings) -> None:
        self._settings = settings
        self._client: Any
        self._connected_here = isinstance(address, (str, Path))
        self._client = _connected(str(address), settings) if self._connected_here else address
        self._at = str(getattr(self._client.scheduler, "address", address))
        self._loop = self._client.loop.asyncio_loop
        self._call = _caller()
        self._senders: dict[str, Any] = {}
        self._version_answers: dict[str, Future[dict[str, Any]]] = {}

    def alive(self) -> bool:
        return bool(self._client.status == "running")

    def workers(self) -> Set[str]:
        return frozenset(self._client.nthreads(callback_timeout=self._settings.answer))

    def faults(self, workers: Iterable[str]) -> Mapping[str, str]:
        """The reason why a worker is unusable, by worker; "" for a usable one.

        A worker that has not yet answered is left out.
        """
        found = {}
        for worker in workers:
            answer = self._version_answers.get(worker)
            if answer is None:
                asking = self._versions(worker)
                self._version_answers[worker] = run_coroutine_threadsafe(asking, self._loop)
            elif answer.done():
                del self._version_answers[worker]
                if answer.exception() is None:
                    found[worker] = _fault(answer.result())
        return found

    async def _versions(self, worker: str) -> dict[str, Any]:
        question = {"op": "versions", "packages": ["aleator"]}
        answers = await self._client.scheduler.broadcast(
            msg=question, workers=[worker], on_error="ignore"
        )
        packages: dict[str, Any] = answers[worker]["packages"]
        return packages

    def send(self, worker: str, parcel: bytes) -> Future[Any]:
        sender = self._senders.get(worker) or self._client.get_executor(
            workers=[worker], allow_other_workers=False, pure=False
        )
        self._senders[worker] = sender
        sent: Future[Any] = sender.submit(self._call, parcel)
        return sent

    def killed(self, error: BaseException) -> bool:
        from distributed import KilledWorker

        return isinstance(error, KilledWorker)

    def lost(self) -> ClusterError:
        return ClusterError(
            f"the Dask scheduler at {self._at} is gone, or does not answer any more",
            "start it again with its workers, or leave the cluster out",
        )

    def close(self) -> None:
        for answer in self._version_answers.values():
            answer.cancel()
        if self._connected_here:
            with suppress(TimeoutError, OSError):  # The scheduler may not answer any more.
                self._client.close(timeout=self._settings.leave)


def _caller() -> Callable[[bytes], Any]:
    """The function that a worker calls; pickled with its code, so that no worker must import it."""

    def call(parcel: bytes) -> Any:
        import pickle

        return pickle.loads(parcel)()

    return call


def _connected(address: str, settings: ClusterSettings) -> Any:
    import dask
    import distributed

    file = address if address.endswith(".json") else None
    if file is not None and not Path(file).is_file():
        raise ClusterError(
            f"the scheduler file {file} does not exist",
            "start the scheduler so: dask scheduler --scheduler-file FILE",
        )
    # Dask warns of large calls, but a simulator may well contain large tables.
    dask.config.set({"distributed.admin.large-graph-warning-threshold": "1TB"})
    client: Any = distributed.Client
    try:
        # A client without a scheduler would warn again later, when Python deletes it.
        _knock(json.loads(Path(file).read_text())["address"] if file else address, settings)
        return client(
            None if file else address,
            scheduler_file=file,
            timeout=settings.connect,
            name="aleator",
            set_as_default=False,
        )
    except Exception as error:  # A server of another kind may listen at this address.
        text = " ".join(str(error).split()) or type(error).__name__
        raise ClusterError(
            f"no Dask scheduler answers at {address} ({text})",
            "name it as it calls itself, such as tcp://HOST:8786; start one with: dask scheduler",
        ) from error


def _knock(address: str, settings: ClusterSettings) -> None:
    """Raise an OSError or a ValueError if no process listens at this address."""
    parts = urlsplit(address if "://" in address else f"tcp://{address}")
    place = parts.hostname or "", parts.port or settings.port
    with socket.create_connection(place, settings.connect):
        return


def _fault(packages: Mapping[str, Any]) -> str:
    """Why a worker with these package versions is unusable, as the end of a sentence; else ""."""
    here = {"python": sys.version.split()[0], "aleator": version("aleator")}
    python = str(packages["python"]).split(".")
    if python[:2] != here["python"].split(".")[:2]:
        return f"has Python {'.'.join(python[:3])}, and this is {here['python']}"
    if packages["aleator"] is None:
        return "has no Aleator installed"
    if packages["aleator"] != here["aleator"]:
        return f"has Aleator {packages['aleator']}, and this is {here['aleator']}"
    return ""


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask's log messages off the terminal; one error message replaces them."""
    import distributed  # noqa: F401  # its import sets the levels of its loggers

    loggers = [logging.getLogger(name) for name in _LOGGERS]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


_START = "mpiexec -n N python -m mpi4py.futures -m aleator ... --mpi (or a script for -m aleator)"


@contextmanager
def mpi_executor() -> Iterator[Executor]:
    """An executor on all processes of this MPI job except the first, which runs the study.

    The job must be started by `mpiexec -n N python -m mpi4py.futures SCRIPT`. If one of its
    processes dies, MPI ends all of them; runs that are in a store are kept.

    Raises ClusterError if the job was not started so, or without mpi4py or an MPI library.

    >>> with mpi_executor() as executor:
    ...     runner = Runner(simulator, experiments, ["stiffness"], executor=executor)
    Traceback (most recent call last):
        ...
    aleator.errors.ClusterError: this process is not the first of an MPI job with workers ...
    """
    if find_spec("mpi4py") is None:
        raise ClusterError("MPI needs the package mpi4py", "pip install mpi4py")
    if "mpi4py.futures" not in sys.orig_argv:
        raise ClusterError(
            "this process is not the first of an MPI job with workers", f"start it so: {_START}"
        )
    # Workers get the function with each call; they do not import this program.
    from mpi4py.futures import MPIPoolExecutor

    executor: Executor = MPIPoolExecutor(main=False)
    try:
        yield executor
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        raise
    executor.shutdown()
