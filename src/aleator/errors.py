"""Errors that the user can correct, each in one message: what is wrong, where, and what to do.

A failure of a numerical method is not an exception: it is a status on the result.
"""

from __future__ import annotations

import difflib
import functools
import inspect
import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class AleatorError(Exception):
    """A mistake that the user can mend: the message names the place, the cause and the remedy.

    The command line prints the message and exits with code 2.

    >>> str(AleatorError("study.toml: key 'box' has one number", "write two numbers"))
    "study.toml: key 'box' has one number\\n  Remedy: write two numbers"
    """

    def __init__(self, problem: str, remedy: str = "") -> None:
        self.problem = problem
        self.remedy = remedy
        super().__init__(f"{problem}\n  Remedy: {remedy}" if remedy else problem)


class StudyError(AleatorError):
    """The study file lacks a key, or has an unknown key or a key with an inadmissible value."""


class ExperimentsError(AleatorError):
    """The table of experiments cannot be used: a cell, a column or an id in it is wrong."""


class SimulatorError(AleatorError):
    """The simulator cannot be used, raised an exception, or returned no valid outcome."""


class SurroundingsError(AleatorError):
    """The machine prevented a run: full disk, no new process, no memory, or no license."""


class StoreError(AleatorError):
    """The store of runs cannot be opened, read or written."""


class ClusterError(AleatorError):
    """The workers of a cluster cannot be used, or the connection to its scheduler is lost."""


class InputsError(AleatorError):
    """A law, a hyperparameter, or the range of a value is inadmissible."""


@contextmanager
def naming(place: str) -> Iterator[None]:
    """Put the name of a law, or of another place, before the problem of an InputsError.

    >>> try:
    ...     with naming("LogNormal"):
    ...         raise InputsError("mean has no limits", "give two")
    ... except InputsError as error:
    ...     print(error.problem)
    LogNormal: mean has no limits
    """
    try:
        yield
    except InputsError as error:
        raise InputsError(f"{place}: {error.problem}", error.remedy) from None


def installing(extra: str) -> str:
    """The `pip` command that installs the packages of an optional extra of Aleator.

    >>> installing("report")
    "pip install 'bokeh>=...'"
    """
    from importlib import metadata  # This import is slow, and is made only when it is needed.

    declared = (line.partition(";") for line in metadata.requires("aleator") or ())
    named = re.compile(rf"""\bextra\s*==\s*["']{extra}["']""")
    return shlex.join(
        ["pip", "install", *(what for what, _, when in declared if named.search(when))]
    )


def setting(key: str, argument: str) -> str:
    """A setting as a remedy names it: its key in study.toml, and its argument in Python.

    >>> setting("[intervals] small_sample = true", "small_sample=True")
    '[intervals] small_sample = true in study.toml, small_sample=True in Python'
    """
    return f"{key} in study.toml, {argument} in Python"


NOISE = f"measurement noise ({setting('[noise] sd', 'noise=Free(lower, upper)')})"
"""Measurement noise as a remedy names it."""
WORKING_BOX = "`aleator box STUDY.toml` (aleator.feasible_box in Python)"
"""What finds a box in which every run works, as a remedy names it."""


def quoted(words: str) -> str:
    """Plain text in which quotes stand for backticks.

    >>> quoted("see `aleator box`")
    "see 'aleator box'"
    """
    return re.sub("`([^`]+)`", r"'\1'", words)


def count(size: int, what: str) -> str:
    """A number with its noun, which is in the plural unless the number is one.

    >>> count(1, "experiment"), count(1200, "run")
    ('1 experiment', '1,200 runs')
    """
    return f"{size:,} {what}{'' if size == 1 else 's'}"


def nearest(name: str, candidates: Iterable[str]) -> str:
    """A hint `` (did you mean 'x'?)`` with the candidate most like `name`, or an empty text.

    >>> nearest("outcom", ["outcome", "id"])
    " (did you mean 'outcome'?)"
    >>> nearest("zzz", ["outcome", "id"])
    ''
    """
    close = difflib.get_close_matches(name, list(candidates), n=1)
    return f" (did you mean '{close[0]}'?)" if close else ""


def described(value: object) -> str:
    """What a wrong argument is, in a few words.

    >>> described(AleatorError), described([1.0, 2.0]), described("a")
    ('the class AleatorError', 'a list', "'a'")
    """
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, str | int | float | bool) or value is None:
        return repr(value)
    kind = type(value).__name__
    return f"{'an' if kind[0] in 'aeiouAEIOU' else 'a'} {kind}"


def key_path(location: Sequence[str | int], document: Mapping[str, Any], missing: bool) -> str:
    """The path of a key in a file, such as `box[1]`, from the location of a pydantic error.

    pydantic adds parts for alternative types, which are no keys of the file. They are left out.
    `missing` says that the last key of the location is the one that the file lacks.

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
    """A path as messages show it: relative to the current folder where it lies inside.

    >>> short(Path.cwd() / "out" / "runs.sqlite"), short(Path("/elsewhere/runs.sqlite"))
    ('out/runs.sqlite', '/elsewhere/runs.sqlite')
    """
    try:
        here = Path.cwd()
    except OSError:  # The current folder does not exist any more.
        return str(path)
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def disordered(lower: float, upper: float) -> tuple[str, str]:
    """The problem and the remedy of limits of which the lower one is not below the upper one.

    >>> disordered(90.0, 30.0)
    ('the lower limit 90 is above the upper limit 30', 'write 30, 90')
    >>> disordered(1.0, 1.0)
    ('the lower and the upper limit are both 1', 'make the upper limit larger')
    """
    if lower == upper:
        return f"the lower and the upper limit are both {lower:g}", "make the upper limit larger"
    problem = f"the lower limit {lower:g} is above the upper limit {upper:g}"
    return problem, f"write {upper:g}, {lower:g}"


def naming_arguments(call: Callable[..., Any], taken_by: Mapping[str, str]) -> Callable[..., Any]:
    """The same class or function; a call that does not fit its arguments raises InputsError.

    Python itself raises TypeError. The error names the arguments that there are, and for one in
    `taken_by` the class that takes it. A class stays the same object. Cost: nothing in a call that
    fits.

    >>> def stiffness(load, travel):
    ...     return load / travel
    >>> naming_arguments(stiffness, {})(load=1.0, travl=2.0)
    Traceback (most recent call last):
    aleator.errors.InputsError: stiffness has no argument 'travl' (did you mean 'travel'?)
      Remedy: its arguments are load, travel
    """
    made = call.__init__ if isinstance(call, type) else call  # type: ignore[misc]
    signature, name = inspect.signature(call), call.__name__

    @functools.wraps(made)
    def called(*args: Any, **named: Any) -> Any:
        try:
            return made(*args, **named)
        except TypeError:
            own = args[1:] if isinstance(call, type) else args
            try:
                signature.bind(*own, **named)
            except TypeError as error:
                wrong = next((key for key in named if key not in signature.parameters), None)
                others = [
                    key for key, value in vars(call).items() if isinstance(value, classmethod)
                ]
                raise _misfit(
                    name, [*signature.parameters], wrong, error, taken_by, others
                ) from None
            raise

    if not isinstance(call, type):
        return called
    call.__init__ = called  # type: ignore[misc]
    return call


def _misfit(
    name: str,
    known: Sequence[str],
    wrong: str | None,
    error: TypeError,
    taken_by: Mapping[str, str],
    others: Sequence[str],
) -> InputsError:
    """The error of a call of `name` with a `wrong` argument, or with too few or too many.

    `others` are the names of the further constructors of a class.
    """
    remedy = f"its arguments are {', '.join(known)}" if known else "it takes no arguments"
    remedy += "".join(f"; or {name}.{other}(...)" for other in others if other[0] != "_")
    if wrong is None:
        return InputsError(f"{name}: {error}", remedy)
    if (home := taken_by.get(wrong)) and home != name:
        remedy = f"{home} takes it: {home}(..., {wrong}=...)"
    return InputsError(f"{name} has no argument '{wrong}'{nearest(wrong, known)}", remedy)


def require_filled(value: object, interface: type, place: str) -> None:
    """Check that a value has all public members of a protocol class, before any of them is used.

    Raises InputsError with the names of missing members, and for a class given in place of an
    instance.

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
