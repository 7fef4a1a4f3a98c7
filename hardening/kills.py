"""Part 2: kill -9 at random moments; nothing is lost, and nothing is left."""

from __future__ import annotations

import os
import secrets
import signal
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hardening.dask_processes import DaskProcesses
from hardening.ways import WAYS, Folder, Way

PATIENCE = 20.0
"""Seconds after which nothing of a command that was killed may be there any more."""
LONGEST = 300.0
"""Seconds after which a command that was not killed counts as one that hangs."""
KILLS = 8
"""Kills of one study, before it is let go to its end."""


@dataclass(frozen=True)
class Kills:
    """How often which way was killed, how many studies that were, and every broken promise."""

    counts: Counter[str]
    studies: int
    runs: int
    broken: tuple[str, ...]


def kills(
    count: int, seed: int, say: Callable[[str], None] = lambda _: None, ways: Sequence[Way] = WAYS
) -> Kills:
    """Kill so many commands, about as many of each way."""
    counts, broken, studies, kept = Counter[str](), list[str](), 0, 0
    with tempfile.TemporaryDirectory(prefix="hardening-") as folder:
        for k, way in enumerate(ways):
            wanted = count // len(ways) + (k < count % len(ways))
            place, chance = Path(folder) / str(k), np.random.default_rng([seed, k])
            place.mkdir()
            cluster = DaskProcesses(place, workers=2) if way.cluster else nullcontext()
            with cluster as dask:
                tried = _Tried(way, place, chance, dask)
                while wanted and counts[way.name] < wanted and not broken:
                    counts[way.name] += tried.study(min(KILLS, wanted - counts[way.name]))
                    studies, kept = studies + 1, kept + tried.kept
                    broken += tried.broken
                    say(f"{way.name}: {counts[way.name]} of {wanted} kills")
    return Kills(counts, studies, kept, tuple(broken))


class _Tried:
    """One way: its undisturbed answer, and studies that are killed and must end with the same."""

    def __init__(
        self, way: Way, place: Path, chance: np.random.Generator, dask: DaskProcesses | None
    ) -> None:
        self.way, self.broken, self.kept = way, list[str](), 0
        self._place, self._chance, self._dask = place, chance, dask
        began = time.monotonic()
        self._whole = self._folder()
        self._end(self._start(self._whole))
        if self.broken:
            raise RuntimeError((self._whole.path / "log0.txt").read_text())
        self._seconds = time.monotonic() - began
        self._answer = self._whole.answer(way, 0)

    def study(self, most: int) -> int:
        """Kill one study so many times, or until it ends before; then let it end. The kills."""
        folder, known, killed = self._folder(), dict[tuple[str, bytes], Any](), 0
        for _ in range(most):
            processes = self._start(folder)
            time.sleep(self._chance.uniform(0.2, 1.0) * self._seconds)
            if any(process.poll() is not None for process in processes):
                self._end(processes)
                break
            self._kill(processes)
            killed += 1
            self._end(processes)
            known = self._looked_after(folder, known)
        self._end(self._start(folder))
        self._looked_after(folder, known)
        self.kept += len(folder.runs())
        for number in range(self.way.together):
            self._require(folder.answer(self.way, number) == self._answer, folder, "other answer")
        return killed

    def _folder(self) -> Folder:
        mark = secrets.token_hex(8)
        return Folder.made(self._place / mark, self.way, mark)

    def _start(self, folder: Folder) -> list[subprocess.Popen[bytes]]:
        scheduler = self._dask.file if self._dask else None
        return [folder.start(self.way, k, scheduler) for k in range(self.way.together)]

    def _kill(self, processes: list[subprocess.Popen[bytes]]) -> None:
        """Kill the command, one of two or both; of a cluster at times a worker."""
        if self._dask and self._chance.random() < 0.3:
            lost = self._dask.workers.pop(0)
            lost.kill()
            self._dask.workers.append(self._dask.worker())
            return
        chosen = [process for process in processes if self._chance.random() < 0.5]
        for process in chosen or processes[:1]:
            os.kill(process.pid, signal.SIGKILL)

    def _end(self, processes: list[subprocess.Popen[bytes]]) -> None:
        for process in processes:
            try:
                code = process.wait(LONGEST)
            except subprocess.TimeoutExpired:
                process.kill()
                code = process.wait()
                self.broken.append(f"{self.way.name}: a command did not end in {LONGEST:.0f} s")
            if code not in (0, -signal.SIGKILL):
                self.broken.append(f"{self.way.name}: exit code {code}")

    def _looked_after(
        self, folder: Folder, known: dict[tuple[str, bytes], Any]
    ) -> dict[tuple[str, bytes], Any]:
        """Nothing is left and nothing is lost: the runs that are kept now."""
        give_up = time.monotonic() + PATIENCE
        while (folder.processes() or folder.temporary()) and time.monotonic() < give_up:
            time.sleep(0.05)
        self._require(not folder.processes(), folder, "a process is left")
        self._require(not folder.temporary(), folder, f"left: {folder.temporary()}")
        now = folder.runs()
        lost = [key for key, outcome in known.items() if now.get(key) != outcome]
        self._require(not lost, folder, f"{len(lost)} runs are lost")
        return now

    def _require(self, sound: bool, folder: Folder, what: str) -> None:
        if not sound:
            logs = [log.read_text()[-500:] for log in sorted(folder.path.glob("log*.txt"))]
            self.broken.append(f"{self.way.name}: {what}\n{''.join(logs)}")
