"""A Dask cluster: found, checked, and left again."""

from __future__ import annotations

import json
import logging
import socket
import sys
from asyncio import run_coroutine_threadsafe
from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from aleator.errors import ClusterError
from aleator.simulators.workers.dask_executor import DaskExecutor

if TYPE_CHECKING:
    from distributed import Client

CONNECT = 10.0
"""Seconds in which a scheduler has to answer at first."""
SCHEDULER = 8786
"""The port where a scheduler listens if nothing else is said."""
_ANSWER = 60.0
"""Seconds in which it has to answer later, when it may be busy."""
_LEAVE = 2.0
"""Seconds that taking leave may take."""
_LOGGERS = ("distributed", "distributed.client", "tornado", "tornado.application", "asyncio")


@contextmanager
def dask_executor(
    address: str | Path | Client, say: Callable[[str], None] = lambda _: None
) -> Iterator[DaskExecutor]:
    """The workers of the Dask cluster at `address`, as an executor for a Runner.

    `address` is that of the scheduler ("tcp://host:8786"), its scheduler file, or a Client that is
    connected, such as one of dask-jobqueue. `say` is told of workers that are lost or cannot be
    used. In the end the cluster is left as it was; after an exception calls that run are given up.

    Raises ClusterError within some CONNECT seconds if nobody answers there, at once if there are
    workers but none has this Python (major and minor version) and this Aleator.

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
        cluster = _DaskCluster(address)
        try:
            executor = DaskExecutor(cluster, say)
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
    """A connected client, in the words of DaskExecutor."""

    def __init__(self, address: str | Path | Client) -> None:
        self._client: Any
        self._own = isinstance(address, (str, Path))
        self._client = _connected(str(address)) if self._own else address
        self._at = str(getattr(self._client.scheduler, "address", address))
        self._loop = self._client.loop.asyncio_loop
        self._call = _caller()
        self._senders: dict[str, Any] = {}
        self._asked: dict[str, Future[dict[str, Any]]] = {}

    def alive(self) -> bool:
        return bool(self._client.status == "running")

    def workers(self) -> Set[str]:
        return frozenset(self._client.nthreads(callback_timeout=_ANSWER))

    def faults(self, workers: Iterable[str]) -> Mapping[str, str]:
        found = {}
        for worker in workers:
            answer = self._asked.get(worker)
            if answer is None:
                asking = self._versions(worker)
                self._asked[worker] = run_coroutine_threadsafe(asking, self._loop)
            elif answer.done():
                del self._asked[worker]
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
        for answer in self._asked.values():
            answer.cancel()
        if self._own:
            with suppress(TimeoutError, OSError):  # of a scheduler that does not answer
                self._client.close(timeout=_LEAVE)


def _caller() -> Callable[[bytes], Any]:
    """What a worker runs; made here so that it travels whole: the scheduler need not import it."""

    def call(parcel: bytes) -> Any:
        import pickle

        return pickle.loads(parcel)()

    return call


def _connected(address: str) -> Any:
    import dask
    import distributed

    file = address if address.endswith(".json") else None
    if file is not None and not Path(file).is_file():
        raise ClusterError(
            f"the scheduler file {file} does not exist",
            "start the scheduler so: dask scheduler --scheduler-file FILE",
        )
    # A simulator that carries large tables is meant to.
    dask.config.set({"distributed.admin.large-graph-warning-threshold": "1TB"})
    client: Any = distributed.Client
    try:
        # A client that finds nobody complains once more, and late, when it is collected.
        _knock(json.loads(Path(file).read_text())["address"] if file else address)
        return client(
            None if file else address,
            scheduler_file=file,
            timeout=CONNECT,
            name="aleator",
            set_as_default=False,
        )
    except Exception as error:  # whatever else may listen there
        text = " ".join(str(error).split()) or type(error).__name__
        raise ClusterError(
            f"no Dask scheduler answers at {address} ({text})",
            "name it as it calls itself, such as tcp://HOST:8786; start one with: dask scheduler",
        ) from error


def _knock(address: str) -> None:
    """Raises an OSError or a ValueError where nobody listens."""
    parts = urlsplit(address if "://" in address else f"tcp://{address}")
    with socket.create_connection((parts.hostname or "", parts.port or SCHEDULER), CONNECT):
        return


def _fault(packages: Mapping[str, Any]) -> str:
    """Why a worker with these versions cannot be used, as the end of a sentence."""
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
    """No log of Dask on the terminal: what matters of it is told in one message."""
    import distributed  # noqa: F401  # sets the levels of its loggers when it is imported

    loggers = [logging.getLogger(name) for name in _LOGGERS]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
