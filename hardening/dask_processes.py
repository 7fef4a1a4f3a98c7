"""A Dask cluster of processes on this machine, each of which a test can kill."""

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self


def until(condition: Callable[[], bool], what: str, patience: float = 120.0) -> None:
    """Wait for a condition, as long as a busy machine may need."""
    end = time.monotonic() + patience
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(what)
        time.sleep(0.02)


class DaskProcesses:
    """A scheduler on a free port of the loopback, and workers as they are asked for."""

    def __init__(self, folder: Path, workers: int = 0) -> None:
        self.file = folder / "scheduler.json"
        self._log = (folder / "dask.log").open("w")
        self._processes: list[subprocess.Popen[bytes]] = []
        self.scheduler = self._start(
            "scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", str(self.file)
        )
        until(self.file.exists, "the scheduler does not start")
        self.workers = [self.worker() for _ in range(workers)]

    def worker(self) -> "subprocess.Popen[bytes]":
        """Start a worker process that nobody starts again when it dies."""
        return self._start(
            "worker", "--scheduler-file", str(self.file), "--nthreads", "1", "--no-nanny",
            "--no-dashboard", "--death-timeout", "10",
        )  # fmt: skip

    def _start(self, kind: str, *options: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", "--host", "127.0.0.1"]
        process = subprocess.Popen(
            [*command, *options], stdout=self._log, stderr=self._log, cwd=self.file.parent
        )
        self._processes.append(process)
        return process

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for process in reversed(self._processes):
            process.kill()
        for process in self._processes:
            process.wait()
        self._log.close()
