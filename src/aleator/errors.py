"""Misuse of Aleator, reported in one message: what is wrong, where, and what to do.

Failures of numerics are not exceptions: they are a status on the result.
"""

from __future__ import annotations

import difflib
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any


class AleatorError(Exception):
    """A mistake that the user can mend: the message names the place, the cause and the remedy.

    The command line prints the message and exits with code 2.

    >>> str(AleatorError("study.toml: key 'box': lower 2.0 >= upper 1.0", "swap the two numbers"))
    "study.toml: key 'box': lower 2.0 >= upper 1.0\\n  Remedy: swap the two numbers"
    """

    def __init__(self, problem: str, remedy: str = "") -> None:
        self.problem = problem
        self.remedy = remedy
        super().__init__(f"{problem}\n  Remedy: {remedy}" if remedy else problem)


class StudyError(AleatorError):
    """The study file has a missing, unknown or inadmissible key."""


class ExperimentsError(AleatorError):
    """The table of experiments cannot be used as it is."""


class SimulatorError(AleatorError):
    """The simulator cannot be imported, raised, or returned something that is not an outcome."""


class SurroundingsError(AleatorError):
    """A run could not be made: a full disk, no process, no memory, a license that is refused."""


class StoreError(AleatorError):
    """The store of runs cannot be opened, read or written."""


class ClusterError(AleatorError):
    """The workers of a cluster cannot be reached or used, or its scheduler was lost."""


class InputsError(AleatorError):
    """A law, a hyperparameter, a bound or a box is inadmissible."""


def installing(extra: str) -> str:
    """The command that installs the packages of an extra of Aleator.

    >>> installing("report")
    "pip install 'bokeh>=...'"
    """
    from importlib import metadata  # takes longer to import than all else that is needed here

    declared = (line.partition(";") for line in metadata.requires("aleator") or ())
    named = re.compile(rf"""\bextra\s*==\s*["']{extra}["']""")
    return shlex.join(
        ["pip", "install", *(what for what, _, when in declared if named.search(when))]
    )


def nearest(name: str, candidates: Iterable[str]) -> str:
    """Return `` (did you mean 'x'?)`` for the candidate most like `name`, or an empty string.

    >>> nearest("outcom", ["outcome", "id"])
    " (did you mean 'outcome'?)"
    >>> nearest("zzz", ["outcome", "id"])
    ''
    """
    close = difflib.get_close_matches(name, list(candidates), n=1)
    return f" (did you mean '{close[0]}'?)" if close else ""


def key_path(location: Sequence[str | int], document: Mapping[str, Any], missing: bool) -> str:
    """The path of a key in a file, without the parts that pydantic adds for alternatives.

    >>> key_path(("box", "list", 1), {"box": [0.5, "a"]}, missing=False)
    'box[1]'
    """
    at: Any = document
    path = ""
    for k, part in enumerate(location):
        inside = (isinstance(at, Mapping) and part in at) or (
            isinstance(at, list) and isinstance(part, int) and part < len(at)
        )
        if not inside and not (missing and k == len(location) - 1):
            continue
        at = at[part] if inside else None
        path += f"[{part}]" if isinstance(part, int) else f".{part}" if path else str(part)
    return path


def short(path: Path) -> str:
    """A path as messages write it: relative to the current folder if it lies in it.

    >>> short(Path.cwd() / "out" / "runs.sqlite"), short(Path("/elsewhere/runs.sqlite"))
    ('out/runs.sqlite', '/elsewhere/runs.sqlite')
    """
    try:
        here = Path.cwd()
    except OSError:  # it was removed
        return str(path)
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def require_filled(value: object, interface: type, place: str) -> None:
    """Check that a value has all members of an interface, before any of them is used.

    Raises InputsError that names the members it lacks, and for a class in place of its instance.

    >>> from collections.abc import Sized
    >>> require_filled([1.0], Sized, "x")
    >>> require_filled(list, Sized, "x")
    Traceback (most recent call last):
    aleator.errors.InputsError: x: list is a class, not a value of it
      Remedy: call it with its arguments: list(...)
    """
    if isinstance(value, type):
        raise InputsError(
            f"{place}: {value.__name__} is a class, not a value of it",
            f"call it with its arguments: {value.__name__}(...)",
        )
    members = [name for name in vars(interface) if not name.startswith("_")]
    lacking = [name for name in members if name not in dir(value)]
    if lacking:
        raise InputsError(
            f"{place}: {value!r} is no {interface.__name__}: it lacks {', '.join(lacking)}",
            f"define them; {interface.__name__} in {interface.__module__} tells what each is",
        )
