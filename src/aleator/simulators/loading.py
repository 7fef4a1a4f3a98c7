"""A function by its name, and the files of its code, which another process must have too."""

from __future__ import annotations

import difflib
import hashlib
import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from aleator.errors import SimulatorError, nearest
from aleator.simulators.failure import describe

_loaded: dict[str, str] = {}
"""Digests of modules as this process loaded them for simulators that came from another one."""


def load_function(reference: str, base_dir: str | Path = ".") -> Callable[..., Any]:
    """The function that "module:name" or "file.py:name" (relative to `base_dir`) refers to.

    `name` may be dotted. Modules beside the file, or in `base_dir`, can be imported by it.

    Raises SimulatorError if the reference has no name after a colon, the file does not exist, the
    module cannot be imported, has no such name, or what has the name is not callable.

    >>> load_function("math:hypot")
    <built-in function hypot>
    """
    module_name, colon, name = reference.rpartition(":")
    if not colon or not module_name or not name:
        raise SimulatorError(
            f"the simulator '{reference}' does not name a function",
            'write "file.py:name" or "package.module:name"',
        )
    base = Path(base_dir).resolve()
    module = _import(module_name, base)
    found: Any = module
    for part in name.split("."):
        if not hasattr(found, part):
            raise SimulatorError(
                f"the simulator '{reference}': '{module_name}' has no '{name}'"
                f"{_nearest_of(part, found)}",
                "name a function that is defined there",
            )
        found = getattr(found, part)
    if not callable(found):
        raise SimulatorError(
            f"the simulator '{reference}' is {type(found).__name__} {found!r:.60}, not a function",
            "name a function",
        )
    function: Callable[..., Any] = found
    return function


def _nearest_of(name: str, owner: object) -> str:
    public = [known for known in dir(owner) if not known.startswith("_")]
    callables = [known for known in public if callable(getattr(owner, known, None))]
    return nearest(name, callables)


def _import(module_name: str, base: Path) -> ModuleType:
    is_file = module_name.endswith(".py")
    file = base / module_name
    if is_file and not file.is_file():
        folder = file.parent
        beside = [entry.name for entry in folder.glob("*.py")] if folder.is_dir() else []
        close = difflib.get_close_matches(file.name, beside, n=1)
        raise SimulatorError(
            f"the simulator's file {module_name} does not exist"
            + (f" (did you mean '{close[0]}'?)" if close else ""),
            "name it relative to the study file",
        )
    search = str(file.parent if is_file else base)
    if search not in sys.path:
        sys.path.insert(0, search)
    try:
        return _run_file(file) if is_file else importlib.import_module(module_name)
    except (Exception, SystemExit) as error:
        raise SimulatorError(
            f"the simulator's module '{module_name}' cannot be imported: {describe(error)}",
            "mend it, install what it needs, or correct the name",
        ) from error


def _run_file(file: Path) -> ModuleType:
    # A name of its own: two studies may each have a model.py.
    name = f"{file.stem}_{hashlib.sha256(str(file).encode()).hexdigest()[:8]}"
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise ImportError(f"{file.name} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # before it runs, as dataclasses and pickles in it look it up
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


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
