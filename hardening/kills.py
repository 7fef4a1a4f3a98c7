"""Part 2: kill -9 at random moments; nothing is lost, and nothing is left."""

from __future__ import annotations

import json
import os
import secrets
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aleator.simulators import Store
from hardening.dask_processes import DaskProcesses

MARK = "ALEATOR_HARDENING"
"""A variable in the environment of whatever a command starts: so all of it is found again."""

STUDY = """\
[experiments]
file = "springs.csv"
outcome = "length"
[simulator]
{simulator}
[parameters.softness]
law = "truncated_normal"
box = [0.5, 1.5]
mean = {{lower = 0.6, upper = 1.4}}
sd = {{lower = 0.01, upper = 0.4}}
[search]
starts = 1
[verification]
samples = {samples}
"""
FUNCTION = """\
import time
def length(load, softness):
    time.sleep(0.004)
    return load * softness ** 1.1
"""
CALLED_ONCE_A_RUN = 'function = "model.py:length"\nvectorized = false'
LENGTHS = (0.93, 2.1, 3.2, 3.7, 5.4, 5.8, 7.9, 7.6)
PROGRAM = """\
command = 'sleep 0.02; awk "BEGIN {{{{print {load} * {softness}}}}}" > length.txt'
shell = true
output = "length.txt"
"""


@dataclass(frozen=True)
class Way:
    """A command: its options, how many of them share a store, and what it writes."""

    name: str
    options: tuple[str, ...] = ()
    program: bool = False
    together: int = 1
    cluster: bool = False
    command: tuple[str, ...] = ("identify", "study.toml", "--no-figures")
    result: str = "identification.json"


WAYS = (
    Way("this process"),
    Way("workers", ("--workers", "2")),
    Way("programs", ("--workers", "2"), program=True),
    Way("a shared store", together=2),
    Way("recover, workers", ("--workers", "2"), result="recovery.json",
        command=("recover", "study.toml", "--truth", "softness.mean=1", "--truth",
                 "softness.sd=0.1", "--replicates", "6")),
    Way("Dask", cluster=True),
)  # fmt: skip


@dataclass(frozen=True)
class Folder:
    """The folder of a study, with a folder of its own for what is temporary."""

    path: Path
    mark: str

    @classmethod
    def made(cls, path: Path, way: Way, mark: str) -> Folder:
        """A new one, with the files of the study."""
        (path / "temporary").mkdir(parents=True)
        rows = [f"{chr(65 + k)},{k + 1},{length}" for k, length in enumerate(LENGTHS)]
        (path / "springs.csv").write_text("\n".join(["id,load,length", *rows]) + "\n")
        (path / "model.py").write_text(FUNCTION)
        simulator = PROGRAM if way.program else CALLED_ONCE_A_RUN
        samples = 0 if way.program else 50
        (path / "study.toml").write_text(STUDY.format(simulator=simulator, samples=samples))
        return cls(path, mark)

    @property
    def store(self) -> Path:
        """The file of its runs."""
        return self.path / "runs.sqlite"

    def start(self, way: Way, number: int, scheduler: Path | None) -> subprocess.Popen[bytes]:
        """Start the command; results lie in a folder of this number."""
        dask = ("--dask", str(scheduler)) if scheduler else ()
        output = ("--quiet", "--output", f"out{number}")
        with (self.path / f"log{number}.txt").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "aleator", *way.command, *way.options, *dask, *output],
                cwd=self.path,
                stdout=log,
                stderr=log,
                env={**os.environ, MARK: self.mark, "TMPDIR": str(self.path / "temporary")},
            )

    def answer(self, way: Way, number: int) -> dict[str, Any]:
        """What it wrote, but for the seconds."""
        found: dict[str, Any] = json.loads((self.path / f"out{number}" / way.result).read_text())
        found.pop("seconds", None)
        return found

    def runs(self) -> dict[tuple[str, bytes], Any]:
        """Every run in the store, which must open and be sound."""
        if not self.store.exists():
            return {}
        with Store(self.store):
            pass
        with closing(sqlite3.connect(self.store)) as connection:
            (sound,) = connection.execute("PRAGMA integrity_check").fetchone()
            if sound != "ok":
                raise sqlite3.DatabaseError(sound)
            rows = connection.execute(
                'SELECT hash, x, outcome FROM runs JOIN cases ON "case" = cases.id'
            ).fetchall()
        return {(case, x): outcome for case, x, outcome in rows}

    def processes(self) -> list[int]:
        """Those that its commands started and that are still there."""
        wanted, found = f"{MARK}={self.mark}".encode(), []
        for place in Path("/proc").glob("[0-9]*"):
            try:
                if wanted in (place / "environ").read_bytes().split(b"\0"):
                    found.append(int(place.name))
            except OSError:  # it has ended, or is another user's
                continue
        return found

    def temporary(self) -> list[str]:
        """What lies in its temporary folder."""
        return [path.name for path in (self.path / "temporary").iterdir()]


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
