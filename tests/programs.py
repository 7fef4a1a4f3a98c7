"""Programs for the tests of commands."""

from __future__ import annotations

import stat
import time
from pathlib import Path

import pytest

from aleator.simulators import RunFailed
from aleator.simulators.command import CommandSimulator


def script(folder: Path, text: str, name: str = "program") -> str:
    path = folder / name
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return f"./{name}"


def failing(tmp_path: Path, text: str, **choices: object) -> RunFailed:
    simulator = CommandSimulator([script(tmp_path, text)], base=tmp_path, **choices)  # type: ignore[arg-type]
    with pytest.raises(RunFailed) as failure:
        simulator.run_one({}, {})
    return failure.value


def gone(pid: int, seconds: float = 2.0) -> bool:
    """Whether a process has ended within so many seconds."""
    give_up = time.monotonic() + seconds
    while time.monotonic() < give_up:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return True
        if state == "Z":  # killed; whoever adopted it has not asked after it
            return True
        time.sleep(0.01)
    return False


def emptied(folder: Path, pattern: str = "*", seconds: float = 30.0) -> bool:
    """Whether somebody has removed what lay in a folder, within so many seconds."""
    give_up = time.monotonic() + seconds
    while [*folder.glob(pattern)] and time.monotonic() < give_up:
        time.sleep(0.01)
    return [*folder.glob(pattern)] == []
