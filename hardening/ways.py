"""Ways in which a command makes its runs, each with a study that is killed again and again."""

from __future__ import annotations

import json
import os
import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aleator.simulators import Store

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
        simulator = PROGRAM if way.program else 'function = "model.py:length"'
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
