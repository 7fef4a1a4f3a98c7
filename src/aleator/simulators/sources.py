"""The files that a function's code is in, and whether another process has the same."""

from __future__ import annotations

import hashlib
import inspect
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from aleator.errors import SimulatorError

_loaded: dict[str, str] = {}
"""Digests of modules as this process loaded them for simulators that came from another one."""


def source(function: Callable[..., Any]) -> str:
    """The text of one function, "" where nobody kept it."""
    try:
        return inspect.getsource(function)
    except (OSError, TypeError):
        return ""  # written in C, or typed


def sources(function: Callable[..., Any]) -> dict[str, Path]:
    """Files of the loaded modules of the function's package or folder; none of a script's.

    >>> from statistics import fmean
    >>> sources(fmean)["statistics"].name
    'statistics.py'
    """
    module = sys.modules.get(getattr(function, "__module__", ""))
    own = getattr(module, "__file__", None)
    if module is None or own is None or module.__name__ == "__main__":
        return {}
    package = module.__name__ if hasattr(module, "__path__") else module.__package__
    folder = Path(own).parent
    return {
        name: Path(file)
        for name, other in list(sys.modules.items())
        if (file := getattr(other, "__file__", None)) and str(file).endswith(".py")
        if (package and (name == package or name.startswith(f"{package}.")))
        or (not package and Path(file).parent == folder)
    }


def digests(function: Callable[..., Any]) -> dict[str, str]:
    """A hash of each of `sources`, by the name of the module."""
    return {name: _digest(path) for name, path in sources(function).items()}


def require_same(
    function: Callable[..., Any], expected: Mapping[str, str], read_again: bool
) -> None:
    """Hold a function against the digests that came with it from another process.

    `read_again`: its own file was read just now, not for a simulator that came before. Raises
    SimulatorError for a file that differs, and for one that has changed since this process loaded
    it: runs would be kept as those of a simulator that it is not.

    >>> from statistics import fmean
    >>> require_same(fmean, digests(fmean), read_again=False)
    >>> require_same(fmean, {"statistics": "another"}, read_again=False)
    Traceback (most recent call last):
        ...
    aleator.errors.SimulatorError: .../statistics.py is not the same for this worker ...
    """
    own = function.__module__
    for name, path in sources(function).items():
        if expected.get(name, _digest(path)) != _digest(path):
            raise SimulatorError(
                f"{path} is not the same for this worker as it was where the study was started",
                "let both have the same files, and start the study again",
            )
        if name == own and read_again:
            _loaded[name] = _digest(path)
        if _loaded.setdefault(name, _digest(path)) != _digest(path):
            raise SimulatorError(
                f"{path} has changed since this worker loaded it", "start the workers again"
            )


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
