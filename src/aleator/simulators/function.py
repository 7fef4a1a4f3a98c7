"""A Python function as a simulator."""

from __future__ import annotations

import difflib
import hashlib
import importlib
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from aleator.errors import SimulatorError, nearest
from aleator.simulators.failure import RunFailed
from aleator.simulators.sources import digests, require_same, source, sources

# Large enough that arrays pay, small enough that an interruption loses little. Fixed, because the
# last digits of an array operation may depend on its length.
ARRAY_BLOCK = 8192
# One at a time loses nothing; a block is what is timed together at most.
SINGLE_BLOCK = 256

Columns = Mapping[str, NDArray[Any]]


class Simulator(Protocol):
    """The user's deterministic model: conditions and parameters to one outcome a run.

    A function is made one by FunctionSimulator; further kinds of simulator fill the same members.
    """

    @property
    def name(self) -> str:
        """What messages call the simulator."""

    @property
    def block(self) -> int:
        """The most runs that one call is given; what completed before a call is never lost."""

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """The conditions that the simulator wants to be given, of those that there are.

        Raises SimulatorError if it cannot be called with these conditions and parameters.
        """

    def __call__(self, conditions: Columns, parameters: Columns) -> NDArray[np.float64]:
        """Run R times: arrays (R,) of conditions asked for and of parameters, outcomes (R,).

        May raise anything; RunStopped hands over the runs that completed before.
        """

    def fingerprint(self) -> str:
        """A text that changes when the simulator does: runs are reused only if it is the same."""


class RunStopped(Exception):
    """A simulator that runs one at a time stopped: `completed` (k,) are the outcomes before.

    Its `__cause__` is what stopped run number k (from 0).
    """

    def __init__(self, completed: NDArray[np.float64]) -> None:
        super().__init__(f"stopped after {len(completed)} runs")
        self.completed = completed


class FunctionSimulator:
    """A function that takes conditions and parameters by name and returns the outcome.

    `vectorized=False`: the function is called once a run and gets floats (a text condition stays a
    text). `vectorized=True`: it is called with arrays (R,) and returns an array (R,); it must treat
    the runs independently of each other. Its arguments are conditions or parameters; one with a
    default may be neither. It takes every parameter of the study, but only the conditions it names
    (all of them if it has **kwargs). `version` is the user's own name of what the function does:
    runs that were kept stay valid until it changes, whatever happens to the source. `block` is the
    most runs of one call with arrays (default 8192): where outcomes may differ in their last digits
    with the length of the arrays, runs are the same only for the same block.

    Raises SimulatorError if `function` is not callable or has arguments without a name.

    >>> def model(load, stiffness):
    ...     return load / stiffness
    >>> simulator = FunctionSimulator(model)
    >>> simulator.asks(["load", "bench"], ["stiffness"])
    ('load',)
    >>> simulator({"load": np.array([1.0, 2.0])}, {"stiffness": np.array([4.0, 4.0])})
    array([0.25, 0.5 ])
    """

    def __init__(
        self,
        function: Callable[..., Any],
        vectorized: bool = False,
        version: str = "",
        block: int | None = None,
    ) -> None:
        if block is not None and block < 1:
            raise SimulatorError(f"a block of {block} runs", "choose at least one")
        if not callable(function):
            raise SimulatorError(
                f"the simulator {function!r} is not callable", "give a function or its name"
            )
        self.function = function
        self.vectorized = vectorized
        self.version = version
        self.block = block or (ARRAY_BLOCK if vectorized else SINGLE_BLOCK)
        self._reference: tuple[str, str] | None = None
        self._digests: dict[str, str] | None = None
        self.name = str(getattr(function, "__qualname__", type(function).__name__))
        self.description = f"{getattr(function, '__module__', None) or ''}:{self.name}"
        self._arguments = _arguments(function, self.name)

    @classmethod
    def named(
        cls,
        reference: str,
        base_dir: str | Path = ".",
        vectorized: bool = False,
        version: str = "",
        block: int | None = None,
    ) -> FunctionSimulator:
        """The function that a reference names (see `load_function`), also in other processes.

        They import it from the same file, which they must see. Raises SimulatorError there if that
        file, or one beside it, is not as it was here when it was loaded.

        >>> FunctionSimulator.named("statistics:fmean").name
        'fmean'
        """
        simulator = cls(load_function(reference, base_dir), vectorized, version, block)
        simulator._reference = reference, str(Path(base_dir).resolve())
        simulator._digests = digests(simulator.function)
        return simulator

    def __reduce__(self) -> tuple[Any, ...]:
        """By name where it was named; else the function itself, as far as it can be pickled."""
        origin: tuple[Any, ...] = self._reference or (self.function,)
        expected = digests(self.function) if self._digests is None else self._digests
        return _arrived, (expected, *origin, self.vectorized, self.version, self.block)

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """The conditions that the function has an argument for, in the order of `conditions`.

        Raises SimulatorError for a parameter that the function does not take, and for an argument
        without a default that is neither a condition nor a parameter.
        """
        required, optional, anything = self._arguments
        taken = (*required, *optional)
        for name in parameters:
            if name not in taken and not anything:
                raise SimulatorError(
                    f"simulator '{self.name}' has no argument for the parameter "
                    f"'{name}'{nearest(name, taken)}",
                    "name an argument of the function after each parameter; it has "
                    + (", ".join(taken) or "none"),
                )
            if name in conditions and name in taken:
                raise SimulatorError(
                    f"simulator '{self.name}': '{name}' is both a condition and a parameter",
                    "rename the column or the parameter, or name the conditions without it",
                )
        known = (*conditions, *parameters)
        for name in required:
            if name not in known:
                raise SimulatorError(
                    f"simulator '{self.name}': its argument '{name}' is neither a condition nor a "
                    f"parameter{nearest(name, known)}",
                    f"conditions: {', '.join(conditions) or 'none'}; "
                    f"parameters: {', '.join(parameters) or 'none'}; "
                    "or give the argument a default",
                )
        return tuple(name for name in conditions if anything or name in taken)

    def __call__(self, conditions: Columns, parameters: Columns) -> NDArray[np.float64]:
        """Run R times; raises what the function raises, in a RunStopped unless vectorized."""
        columns = {**conditions, **parameters}
        with np.errstate(all="ignore"):  # what is not finite is reported with its experiment
            if self.vectorized:
                return self.function(**columns)  # type: ignore[no-any-return] # checked by Runner
            return self._one_by_one(columns)

    def _one_by_one(self, columns: dict[str, NDArray[Any]]) -> NDArray[np.float64]:
        names = tuple(columns)
        outcomes: list[float] = []
        try:
            for values in zip(*(column.tolist() for column in columns.values()), strict=True):
                outcome = self.function(**dict(zip(names, values, strict=True)))
                # One by one: an exception finds in the list what completed before it.
                outcomes.append(_scalar(outcome))
        except BaseException as cause:
            raise RunStopped(np.array(outcomes, dtype=np.float64)) from cause
        return np.array(outcomes, dtype=np.float64)

    def fingerprint(self) -> str:
        """A hash that changes with the source of the function and of the modules beside it.

        Beside: loaded modules of the same package or, for a file, of the same folder; of a script
        or a notebook, the function alone. What they read from disk or import from elsewhere is not
        seen, nor what the function holds in variables of its own. A `version` takes the place of
        all that.
        """
        digest = hashlib.sha256(f"{self.name} {self.vectorized}".encode())
        if self.version:
            digest.update(f" version {self.version}".encode())
            return digest.hexdigest()
        files = sorted(sources(self.function).values())
        for path in files:
            digest.update(path.read_bytes())
        if not files:
            digest.update(source(self.function).encode())
        return digest.hexdigest()


def _arrived(expected: dict[str, str], origin: Any, *rest: Any) -> FunctionSimulator:
    """A simulator of another process, held against the files that it came from."""
    if isinstance(origin, str):
        simulator = FunctionSimulator.named(origin, *rest)
    else:
        simulator = FunctionSimulator(origin, *rest)
    is_file = isinstance(origin, str) and origin.rpartition(":")[0].endswith(".py")
    require_same(simulator.function, expected, read_again=is_file)
    return simulator


def _scalar(value: Any) -> float:
    if isinstance(value, float):
        return value
    if value is None:
        raise TypeError("it returned None: is a return statement missing?")
    if np.ndim(value) != 0:
        raise TypeError(
            f"it returned an array of shape {np.shape(value)} instead of one number a run"
        )
    if isinstance(value, (str, bytes, complex)):
        raise TypeError(f"it returned {value!r} instead of a number")
    return float(value)


def _arguments(
    function: Callable[..., Any], name: str
) -> tuple[tuple[str, ...], tuple[str, ...], bool]:
    """Names of the arguments without and with a default, and whether any other name is taken."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        raise SimulatorError(
            f"simulator '{name}' does not say what its arguments are called",
            "wrap it in a Python function with named arguments",
        ) from None
    required, optional, anything = [], [], False
    for parameter in parameters:
        if parameter.kind is parameter.VAR_KEYWORD:
            anything = True
        elif parameter.kind is parameter.VAR_POSITIONAL:
            continue
        elif parameter.default is not parameter.empty:
            if parameter.kind is not parameter.POSITIONAL_ONLY:
                optional.append(parameter.name)
        elif parameter.kind is parameter.POSITIONAL_ONLY:
            raise SimulatorError(
                f"simulator '{name}': its argument '{parameter.name}' cannot be given by name",
                "move the '/' out of its definition: conditions and parameters are given by name",
            )
        else:
            required.append(parameter.name)
    return tuple(required), tuple(optional), anything


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


def describe(error: BaseException) -> str:
    """An exception as one line: kind, message and, where it is known, file and line of its cause.

    >>> describe(ValueError("too cold"))
    'ValueError: too cold'
    """
    if isinstance(error, RunFailed):
        return str(error)
    if isinstance(error, SyntaxError):
        place = f" ({Path(error.filename or '?').name}, line {error.lineno})"
        return f"{type(error).__name__}: {error.msg}{place}"
    text = " ".join(str(error).split())
    kind = type(error).__name__
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith("<") and Path(frame.filename) != Path(__file__)
        if "importlib" not in frame.filename
    ]
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{kind}: {text}{place}" if text else f"{kind}{place}"
