"""One run of a program: its folder and its process, of which nothing is left behind."""

from __future__ import annotations

import atexit
import errno
import json
import os
import shutil
import signal
import subprocess
import tempfile
import threading
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from aleator.errors import SimulatorError, SurroundingsError
from aleator.simulators.command.inputs import Columns
from aleator.simulators.protocol import RunFailed, require_file
from aleator.simulators.surroundings import (
    STOP_ON,
    checked_limit,
    full_disk,
    prevented,
    printed,
    require_pattern,
)


@contextmanager
def _signals_deferred() -> Iterator[None]:
    """Delay the handlers of signals, such as Ctrl-C, to the end of the block.

    The signals are not blocked, because a process started in the block would inherit that.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # Python calls signal handlers in the main thread only.
        return
    signals: list[int] = [*signal.valid_signals()]
    handlers = {one: to for one in signals if callable(to := signal.getsignal(one))}
    came: list[int] = []

    def note(signum: int, _frame: object) -> None:
        came.append(signum)

    try:
        for signum in handlers:
            signal.signal(signum, note)
        yield
    finally:
        for signum, handler in handlers.items():
            signal.signal(signum, handler)
        for signum in came:
            handlers[signum](signum, None)


# The shell program that removes folders. Its input ends when this process ends, in whatever way.
_SCRIPT = """\
cat > /dev/null
for file in "$1"/*.pid; do
    [ -f "$file" ] && kill -s KILL -- "-$(cat "$file")"
done
rm -rf "$1"
"""


class _Janitor:
    """A helper process that removes the folders of runs when this process ends, in whatever way.

    The folders are in `home`, a folder in `base`. The helper process also kills the programs of
    these runs. Raises OSError if the folder cannot be made.
    """

    def __init__(self, base: Path) -> None:
        self.base, self.pid = base, os.getpid()
        self.home = base / f"aleator_{uuid.uuid4().hex}"
        self._process: subprocess.Popen[bytes] | None = None
        if Path("/bin/sh").exists():
            self._process = subprocess.Popen(
                ["/bin/sh", "-c", _SCRIPT, "janitor", str(self.home)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                cwd="/",
                start_new_session=True,  # Ctrl-C must not end the helper process.
            )
        try:
            self.home.mkdir(mode=0o700)
        except OSError:
            self.close()
            raise

    def close(self) -> None:
        """End the helper process; in a fork of the process that started it nothing happens."""
        if self.pid != os.getpid():
            return
        if self._process is not None:
            self._process.communicate()
        shutil.rmtree(self.home, ignore_errors=True)


_lock = threading.Lock()
_janitors: list[_Janitor] = []


def run_folder() -> Path:
    """A new folder for a run; the caller removes it, or else the end of this process does.

    Raises OSError if it cannot be made.
    """
    with _lock:
        home = _mine().home
    return Path(tempfile.mkdtemp(prefix="run_", dir=home))


@contextmanager
def passing() -> Iterator[Path]:
    """A temporary folder that is removed at the end of the block, or when this process ends."""
    folder = run_folder()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def leads(folder: Path, group: int) -> Iterator[None]:
    """Tell the helper process within the block which process group the run in `folder` has."""
    note = folder.with_name(f"{folder.name}.pid")
    try:
        note.write_text(str(group))
        yield
    finally:
        note.unlink(missing_ok=True)


def _mine() -> _Janitor:
    """The helper process that removes folders of this process; a fork has a helper of its own."""
    base = Path(tempfile.gettempdir())
    now = _janitors[0] if _janitors else None
    if now is None or (now.pid, now.base) != (os.getpid(), base) or not now.home.is_dir():
        close()
        _janitors.append(_Janitor(base))
    return _janitors[0]


@atexit.register
def close() -> None:
    """End the helper process that removes the folders of runs."""
    while _janitors:
        _janitors.pop().close()


STDIN, STDOUT, STDERR = "aleator.stdin", "aleator.stdout", "aleator.stderr"


@dataclass(frozen=True)
class Limits:
    """When a run is successful: it ends with one of these exit codes within `timeout` seconds.

    A failed run that printed `stop_on`, or left a full disk, does not count as made: the machine is
    at fault. After the time limit a program has `grace` seconds to end properly (by judgement).

    Raises SimulatorError for an invalid limit, no exit codes, or an invalid `stop_on`.
    """

    success_codes: tuple[int, ...] = (0,)
    timeout: float | None = None
    stop_on: str = STOP_ON
    grace: float = 1.0

    def __post_init__(self) -> None:
        checked_limit(self.timeout)
        if not self.success_codes:
            raise SimulatorError("success_codes is empty: every run would fail", "write [0]")
        require_pattern(self.stop_on)

    def judged(self, failure: RunFailed, folder: Path) -> RunFailed | SurroundingsError:
        """The failure of a run in `folder`, or the error for a machine at fault.

        The message of the failure has the last lines of the error output, its log has more.
        """
        said = failure.log or log(folder)
        fault = printed(said, self.stop_on) or full_disk(folder)
        return fault or RunFailed(f"{failure.message}{_last_words(folder)}", said)


def run(
    arguments: Sequence[str], folder: Path, environment: Mapping[str, str], limits: Limits
) -> int:
    """Run a program in `folder`, and return its exit code; it reads the file STDIN if that exists.

    The whole process group of the program ends with it, or with this process. The program prints to
    files and not to pipes, so that neither much output nor a child that keeps a pipe open can block
    it.

    Raises RunFailed for arguments that no program can have and for a run that takes too long.
    Raises SurroundingsError if the system does not start the program.
    """
    stdin = folder / STDIN
    source = stdin if stdin.exists() else Path(os.devnull)
    with (
        source.open("rb") as read,
        (folder / STDOUT).open("wb") as out,
        (folder / STDERR).open("wb") as err,
        ExitStack() as ends,
    ):
        with _signals_deferred():
            try:
                process = subprocess.Popen(
                    arguments,
                    cwd=folder,
                    env={**os.environ, **environment},
                    stdin=read,
                    stdout=out,
                    stderr=err,
                    start_new_session=True,
                )
            except (OSError, ValueError) as error:
                raise _not_started(arguments[0], error) from error
            ends.callback(_end, process)
            ends.enter_context(leads(folder, process.pid))
        try:
            return process.wait(limits.timeout)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                process.wait(limits.grace)
            raise RunFailed(f"it was stopped after its {limits.timeout:g} s", log(folder)) from None


def _not_started(program: str, error: OSError | ValueError) -> RunFailed | SurroundingsError:
    """The error for a program that did not start: a failed run, or a refusal of the system."""
    if isinstance(error, ValueError) or error.errno == errno.E2BIG:
        reason = getattr(error, "strerror", None) or str(error)
        return RunFailed(f"'{program}' cannot be started: {reason}")
    return prevented(error, f"'{program}' cannot be started")


def _end(process: subprocess.Popen[bytes]) -> None:
    """Kill the remaining processes of the program's process group."""
    # macOS raises PermissionError if all processes of the group have ended.
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def log(folder: Path, most: int = 4000) -> str:
    """The end of a run's output and error output, `most` bytes of each (chosen by judgement).

    >>> log(Path("nowhere"))
    ''
    """
    texts = [_tail(folder / name, most) for name in (STDOUT, STDERR)]
    return "\n".join(filter(None, texts))


def _last_words(folder: Path, lines: int = 3, most: int = 200) -> str:
    """The last lines of a run's error output after a colon, cut (both by judgement), or nothing."""
    last = _tail(folder / STDERR, 4 * most).splitlines()[-lines:]
    text = " / ".join(" ".join(line.split()) for line in last)
    return f": {text[-most:]}" if text else ""


def _tail(path: Path, most: int) -> str:
    try:
        with path.open("rb") as file:
            file.seek(max(path.stat().st_size - most, 0))
            return file.read().decode("utf-8", "replace").strip()
    except OSError:
        return ""


def read_text(path: Path) -> str:
    """The text of a file that a program wrote; bytes that are not UTF-8 are replaced."""
    return path.read_bytes().decode("utf-8", "replace")


FAILED, COMPLETED, VALUES = "failed_runs", "completed_runs", "aleator.run.json"


class Keep(Enum):
    """Which folders of runs are kept, in `failed_runs/` and `completed_runs/` beside the study."""

    FAILED = "failed"
    ALL = "all"
    NONE = "none"


@dataclass(frozen=True)
class Folder:
    """How the folder of a run is made, with copies of the study's `files`, and whether it is kept.

    `base` is the study's folder. A folder among the files is copied with all its contents. With
    `link` the files are links, which cost no time; but a program that writes to one changes the
    original. At most `most_failed` folders of failed runs are kept (by judgement), so that they do
    not fill the disk.

    Raises SimulatorError for a file that does not exist, and for two files with the same name.
    """

    base: Path = Path(".")
    files: tuple[str, ...] = ()
    link: bool = False
    keep: Keep = Keep.FAILED
    most_failed: int = 100

    def __post_init__(self) -> None:
        names = [path.name for path in self.sources]
        for name, path in zip(self.files, self.sources, strict=True):
            require_file(path, f"the file {name!r}")
            if names.count(path.name) > 1:
                raise SimulatorError(
                    f"two of the files are named '{path.name}'", "a run's folder holds one"
                )

    @property
    def sources(self) -> tuple[Path, ...]:
        """The absolute paths of the files and folders that are copied."""
        return tuple(Path(os.path.abspath(self.base / name)) for name in self.files)

    @contextmanager
    def made(self, values: Columns, outputs: Sequence[str] = ()) -> Iterator[Path]:
        """A folder with the files, from which old `outputs` are removed.

        A RunFailed raised in the block gets the place where the folder is kept.
        """
        folder = run_folder()
        try:
            self._fill(folder)
            for output in outputs:
                (folder / output).unlink(missing_ok=True)
            yield folder
            if self.keep is Keep.ALL:
                self._move(folder, COMPLETED, values, None)
        except RunFailed as failure:
            if self.keep is Keep.NONE:
                raise
            where = self._move(folder, FAILED, values, failure)
            raise RunFailed(f"{failure.message} ({where})", failure.log) from failure
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _fill(self, folder: Path) -> None:
        copy = os.symlink if self.link else shutil.copy2
        for source in self.sources:
            if source.is_dir():
                shutil.copytree(source, folder / source.name, copy_function=copy)
            else:
                copy(source, folder / source.name)

    def _move(self, folder: Path, kind: str, values: Columns, failure: RunFailed | None) -> str:
        """Keep the folder and its values beside the study; returns the words that say where."""
        home = self.base / kind
        if failure is not None and home.is_dir() and len([*home.iterdir()]) >= self.most_failed:
            return f"not kept: {home} holds {self.most_failed} runs"
        content = {"values": dict(values), "failure": failure and failure.message}
        target = home / folder.name
        try:
            text = json.dumps(content, indent=2) + "\n"
            (folder / VALUES).write_text(text, encoding="utf-8")
            home.mkdir(parents=True, exist_ok=True)
            shutil.move(folder, target)
        except OSError as error:
            return f"not kept in {home}: {error.strerror}"
        return f"kept in {target}"


def contents(paths: Sequence[Path]) -> Iterator[Path]:
    """Every file in or under `paths`, in an order that does not depend on the disk."""
    for path in paths:
        if path.is_dir():
            yield from sorted(inner for inner in path.rglob("*") if inner.is_file())
        elif path.is_file():
            yield path
