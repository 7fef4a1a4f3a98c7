"""Commands that are given damaged files, each within a time limit: what came of them."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import tempfile
import time
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path

from hardening.damaged import KINDS, damaged
from hardening.sound import prepared

LIMIT = 20.0
"""Seconds of a processor that no command may take."""
PATIENCE = 600.0
"""Seconds of the clock after which a worker that does nothing is ended."""
DONE, REFUSED, TRACEBACK, SLOW, ENDED = "done", "refused", "traceback", "slow", "ended"
BROKEN = (TRACEBACK, SLOW, ENDED)
"""What is promised not to be."""
MOST_MEMORY = 6 * 2**30
"""Bytes of address space of a worker: who wants more is told that there is no memory."""


@dataclass(frozen=True)
class Verdict:
    """What came of one command: done, refused (a message, exit code 2), or one of BROKEN."""

    number: int
    kind: str
    command: tuple[str, ...]
    outcome: str
    seconds: float
    words: str


def judged(numbers: Iterable[int], seed: int, sound: Path, workers: int) -> Iterator[Verdict]:
    """The verdicts of damaged files by their numbers, in the order in which they come."""
    left = deque(numbers)
    pool = [_Worker(seed, sound) for _ in range(workers)]
    try:
        while left or any(one.number is not None for one in pool):
            for one in pool:
                if one.number is None and left:
                    one.begin(left.popleft())
            ready = wait([one.answers for one in pool if one.number is not None], timeout=1.0)
            for one in pool:
                if one.number is not None and one.answers in ready:
                    yield one.answer()
                elif one.number is not None and one.late():
                    yield one.ended(SLOW)
    finally:
        for one in pool:
            one.close()


class _Worker:
    """A process that runs commands, and is started again where one ends it."""

    def __init__(self, seed: int, sound: Path) -> None:
        self._given = seed, sound
        self.number: int | None = None
        self._began = self._used = 0.0
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.answers, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs, *self._given))
        self._process.start()
        theirs.close()

    def begin(self, number: int) -> None:
        self.number, self._began = number, time.monotonic()
        self._used = _used(self._process.pid)
        self.answers.send(number)

    def late(self) -> bool:
        """Whether its command has taken twice the time that it may take."""
        waited = time.monotonic() - self._began
        return waited > PATIENCE or _used(self._process.pid) - self._used > 2.0 * LIMIT

    def answer(self) -> Verdict:
        try:
            verdict: Verdict = self.answers.recv()
        except (EOFError, OSError):
            return self.ended(ENDED)
        self.number = None
        return verdict

    def ended(self, outcome: str) -> Verdict:
        number, self.number = self.number, None
        took = time.monotonic() - self._began
        self.close()
        self._start()
        return Verdict(number or 0, "", (), outcome, took, f"exit code {self._process.exitcode}")

    def close(self) -> None:
        self._process.kill()
        self._process.join()
        self.answers.close()


def _work(numbers: Connection, seed: int, sound: Path) -> None:
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    while True:
        try:
            number = numbers.recv()
        except EOFError:
            return
        with tempfile.TemporaryDirectory(prefix="hardening-") as folder:
            verdict = one(number, seed, sound, Path(folder) / "study")
        numbers.send(verdict)


def one(number: int, seed: int, sound: Path, folder: Path) -> Verdict:
    """Make the damaged files of this number in a folder, and run the command on them here."""
    from click.testing import CliRunner

    from aleator.cli import main

    kind, command = damaged(number, seed, sound, folder)
    here = Path.cwd()
    os.chdir(folder)
    began = _used()
    try:
        done = CliRunner().invoke(main, command)
    finally:
        os.chdir(here)
        shutil.rmtree(folder, ignore_errors=True)
    took = _used() - began
    return Verdict(number, kind, command, _outcome(done.exit_code, took), took, _words(done))


def _used(process: int | str | None = "self") -> float:
    """Seconds of a processor that a process and its children took: what else runs is no matter."""
    try:
        stat = Path(f"/proc/{process}/stat").read_text()
    except OSError:  # it has ended
        return 0.0
    ticks = stat.rpartition(")")[2].split()[11:15]
    return sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")


def _outcome(code: int, seconds: float) -> str:
    if code not in (0, 2):
        return TRACEBACK
    if seconds > LIMIT:
        return SLOW
    return REFUSED if code else DONE


def _words(done: object) -> str:
    info = getattr(done, "exc_info", None)
    if info and not isinstance(info[1], SystemExit):
        return "".join(traceback.format_exception(*info))
    return str(getattr(done, "output", ""))[-400:]


@dataclass(frozen=True)
class Mutations:
    """How often what came of which kind of damage, and the verdicts that break the promise."""

    counts: Counter[tuple[str, str]]
    slowest: float
    broken: tuple[Verdict, ...]


def mutations(
    numbers: range, seed: int, workers: int, say: Callable[[Verdict], None] = lambda _: None
) -> Mutations:
    """Try the damaged files of these numbers; `say` is called with each verdict as it comes."""
    counts, slowest, broken = Counter[tuple[str, str]](), 0.0, list[Verdict]()
    with tempfile.TemporaryDirectory(prefix="hardening-") as folder:
        sound = Path(folder) / "sound"
        prepared(sound)
        for verdict in judged(numbers, seed, sound, workers):
            say(verdict)
            counts[KINDS[verdict.number % len(KINDS)], verdict.outcome] += 1
            slowest = max(slowest, verdict.seconds)
            if verdict.outcome in BROKEN:
                broken.append(verdict)
    return Mutations(counts, slowest, tuple(broken))
