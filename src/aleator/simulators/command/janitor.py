"""A shell that outlives this process, and ends and removes what is left of its runs."""

from __future__ import annotations

import atexit
import os
import secrets
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# It waits for the end of its input, which comes when this process ends, however that ends.
_SCRIPT = """\
cat > /dev/null
for file in "$1"/*.pid; do
    [ -f "$file" ] && kill -s KILL -- "-$(cat "$file")"
done
rm -rf "$1"
"""


class _Janitor:
    """Watches `home`, the folder of this process's runs in `base`. Raises OSError."""

    def __init__(self, base: Path) -> None:
        self.base, self.pid = base, os.getpid()
        self.home = base / f"aleator_{secrets.token_hex(8)}"
        self._process: subprocess.Popen[bytes] | None = None
        if Path("/bin/sh").exists():
            self._process = subprocess.Popen(
                ["/bin/sh", "-c", _SCRIPT, "janitor", str(self.home)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                cwd="/",
                start_new_session=True,  # it is not for Ctrl-C
            )
        try:
            self.home.mkdir(mode=0o700)
        except OSError:
            self.close()
            raise

    def close(self) -> None:
        """Let it end, if it is this process's."""
        if self.pid != os.getpid():
            return
        if self._process is not None:
            self._process.communicate()
        shutil.rmtree(self.home, ignore_errors=True)


_lock = threading.Lock()
_janitors: list[_Janitor] = []


def watched() -> Path:
    """A new folder for a run; with the processes of `leads`, it does not outlive this process.

    As long as this process lives, both are the caller's to end and remove. Raises OSError where
    none can be made.
    """
    with _lock:
        home = _mine().home
    return Path(tempfile.mkdtemp(prefix="run_", dir=home))


@contextmanager
def passing() -> Iterator[Path]:
    """A folder that is gone when the block or this process ends, however that ends."""
    folder = watched()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def leads(folder: Path, group: int) -> Iterator[None]:
    """While a process leads a process group for the run in `folder`, it is known to the janitor."""
    note = folder.with_name(f"{folder.name}.pid")
    try:
        note.write_text(str(group))
        yield
    finally:
        note.unlink(missing_ok=True)


def _mine() -> _Janitor:
    """That of this process, which may be a fork of another, for the present temporary folder."""
    base = Path(tempfile.gettempdir())
    now = _janitors[0] if _janitors else None
    if now is None or (now.pid, now.base) != (os.getpid(), base) or not now.home.is_dir():
        close()
        _janitors.append(_Janitor(base))
    return _janitors[0]


@atexit.register
def close() -> None:
    """Let the janitor of this process end."""
    while _janitors:
        _janitors.pop().close()
