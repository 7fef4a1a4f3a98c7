"""A Python function as a simulator: found by its name, called, and recognized by its source."""

from __future__ import annotations

import copy
import hashlib
import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Self

import numpy as np

from aleator.core.types import Array
from aleator.errors import SimulatorError, nearest, setting
from aleator.observations.tables import real_numbers
from aleator.simulators.protocol import (
    BLOCKS,
    Columns,
    Returned,
    Simulator,
    WithSlopes,
    describe,
    name_lists,
    one_by_one,
    require_distinct,
    require_file,
)
from aleator.simulators.surroundings import checked_limit, limited

_loaded: dict[str, str] = {}
"""Hashes of source files at the time when this process loaded them for a received simulator."""


def load_function(reference: str, base_dir: str | Path = ".") -> Callable[..., Any]:
    """The function named by "module:name" or by "file.py:name" (relative to `base_dir`).

    `name` may be dotted. The function can import modules that lie beside its file, or in
    `base_dir`.

    Raises SimulatorError if the reference has no name after a colon, if the file does not exist, if
    the module cannot be imported or lacks the name, or if the named object cannot be called.

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
    if is_file:
        require_file(file, f"the simulator's file {module_name}", "*.py")
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
    # The module gets a unique name, because two studies may each have a model.py.
    name = f"{file.stem}_{hashlib.sha256(str(file).encode()).hexdigest()[:8]}"
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise ImportError(f"{file.name} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    # The module is registered before it runs, because its dataclasses look it up there.
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def source(function: Callable[..., Any]) -> str:
    """The source text of one function; "" where it is not available."""
    try:
        return inspect.getsource(function)
    except (OSError, TypeError):
        return ""  # The function is written in C, or was typed at a prompt.


def sources(function: Callable[..., Any]) -> dict[str, Path]:
    """The source files of the function's module and of loaded modules of its package or folder.

    They are given by module name. A function of a script or a notebook has none.

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
    """A hash of each source file of a function (see `sources`), by the name of the module."""
    return {name: _digest(path) for name, path in sources(function).items()}


def require_same(
    function: Callable[..., Any], expected: Mapping[str, str], read_again: bool
) -> None:
    """Check that the files of a function equal those in the process that the function came from.

    `expected` has the digests of that process. `read_again` says that the function's file was read
    just now. Raises SimulatorError for a file that differs, and for a file that was changed after
    this process loaded it, because its runs would be stored as runs of another simulator.

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


class FunctionSimulator:
    """A function that takes conditions and parameters by name and returns the outcome.

    `vectorized=False`: the function is called once for each run and gets floats (a text condition
    stays a text). `vectorized=True`: it is called with arrays (R,) for R runs and returns an array
    (R,); it must treat the runs independently of each other. None: it is called once for each run,
    but is tried once with arrays where many runs would follow (see `Runner.takes_arrays`), and
    called with arrays there if they give the same values. `series=True`: it is called once for a
    whole experiment of m rows. Conditions that vary within any experiment are then arrays (m,), the
    others and the parameters are floats; it returns an array (m,), or one number for all rows. Its
    trial has the rows of several runs one after the other, and every argument is an array with an
    entry for each row. For several responses the function returns a mapping from their names to
    such values.

    `jac=True`: the function returns a pair, the outcome and its derivatives by the n parameters:
    an array (n,) in the order of the study, or a mapping from the names of parameters to numbers.
    In a series these are arrays (m, n), or a mapping to arrays (m,). For several responses both of
    the pair are mappings. Or `jac` is a function with the same arguments that returns the
    derivatives alone. A derivative that is NaN or left out is not known. Gaussian processes then
    learn from values and slopes.

    Every argument is a condition or a parameter; an argument with a default may be neither. Every
    parameter of the study must be an argument. Conditions are passed only if the function names
    them (all of them if it has **kwargs). `version` replaces the source in the fingerprint: stored
    runs stay valid until the user changes it. `block` is the most runs of one call with arrays
    (default 8192); last digits may depend on it. A call that takes longer than `timeout` seconds is
    stopped (see `limited`), and the run has failed.

    Raises SimulatorError if `function` is not callable or has arguments without a name, for a
    series that is vectorized, and for `jac` with a function that is.

    >>> def model(load, stiffness):
    ...     return load / stiffness
    >>> simulator = FunctionSimulator(model)
    >>> simulator.asks(["load", "bench"], ["stiffness"])
    ('load',)
    >>> simulator({"load": np.array([1.0, 2.0])}, {"stiffness": np.array([4.0, 4.0])})
    array([0.25, 0.5 ])
    >>> def with_slope(load, stiffness):
    ...     return load / stiffness, {"stiffness": -load / stiffness**2}
    >>> FunctionSimulator(with_slope, jac=True)({"load": np.ones(1)}, {"stiffness": np.ones(1)})
    [WithSlopes(value=1.0, slopes=array([-1.]))]
    """

    def __init__(
        self,
        function: Callable[..., Any],
        vectorized: bool | None = None,
        version: str = "",
        block: int | None = None,
        series: bool = False,
        timeout: float | None = None,
        jac: bool | Callable[..., Any] = False,
    ) -> None:
        if jac and vectorized:
            raise SimulatorError(
                "a vectorized function has no use for jac: it is integrated over itself",
                "leave out jac; or vectorized, if a run takes long",
            )
        if series and vectorized:
            raise SimulatorError(
                "a function of series cannot be vectorized too",
                "leave out vectorized: a function of series is tried with the rows of many runs",
            )
        if block is not None and block < 1:
            raise SimulatorError(f"a block of {block} runs", "choose at least one")
        if not callable(function):
            raise SimulatorError(
                f"the simulator {function!r} is not callable",
                "give the function itself, neither its name nor a value of it",
            )
        self.function = function
        self.vectorized = vectorized
        self.series = series
        self.jac = jac
        self.version = version
        self.timeout = checked_limit(timeout)
        self._block = block
        self._reference: tuple[str, str] | None = None
        self._digests: dict[str, str] | None = None
        self.name = str(getattr(function, "__qualname__", type(function).__name__))
        self.description = f"{getattr(function, '__module__', None) or ''}:{self.name}"
        self._arguments = _arguments(function, self.name)

    @classmethod
    def named(
        cls, reference: str, base_dir: str | Path = ".", *options: Any, **more: Any
    ) -> FunctionSimulator:
        """A simulator of the function that a reference names (see `load_function`).

        Further arguments are those of the class after `function`. If the simulator is sent to
        another process, that process imports the function from the same file, which it must be able
        to read. It raises SimulatorError if that file, or one beside it, has changed since it was
        loaded here.

        >>> FunctionSimulator.named("statistics:fmean").name
        'fmean'
        """
        simulator = cls(load_function(reference, base_dir), *options, **more)
        simulator._reference = reference, str(Path(base_dir).resolve())
        simulator._digests = digests(simulator.function)
        return simulator

    @property
    def options(self) -> tuple[Any, ...]:
        """The arguments that the class takes after `function`."""
        return self.vectorized, self.version, self._block, self.series, self.timeout, self.jac

    @property
    def block(self) -> int:
        """The most runs of one call of the simulator."""
        return self._block or (BLOCKS.arrays if self.vectorized else BLOCKS.single)

    def with_arrays(self) -> Self:
        """The same function, called with arrays; one of series with arrays of rows."""
        made = copy.copy(self)
        made.vectorized, made.series = True, False
        return made

    @property
    def sloped(self) -> bool:
        """Whether it returns derivatives beside each outcome."""
        return bool(self.jac)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by reference if the function was named by one; else the function itself."""
        origin: tuple[Any, ...] = self._reference or (self.function,)
        expected = digests(self.function) if self._digests is None else self._digests
        return _arrived, (expected, *origin, *self.options)

    def takes(self, name: str) -> bool:
        """Whether the function has an argument of this name, or **kwargs."""
        required, optional, anything = self._arguments
        return anything or name in required or name in optional

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """The conditions for which the function has an argument, in the order of `conditions`.

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
                    f"{', '.join(taken) or 'none'}",
                )
        require_distinct(self.name, [c for c in conditions if c in taken], parameters)
        known = (*conditions, *parameters)
        for name in required:
            if name not in known:
                raise SimulatorError(
                    f"simulator '{self.name}': its argument '{name}' is neither a condition nor a "
                    f"parameter{nearest(name, known)}",
                    f"{name_lists(conditions, parameters)}; or give the argument a default",
                )
        return tuple(name for name in conditions if anything or name in taken)

    def __call__(self, conditions: Columns, parameters: Columns) -> Returned:
        """Run R times. What the function raises is raised in a RunStopped, unless vectorized."""
        with np.errstate(all="ignore"):  # Values that are not finite are reported later.
            if self.vectorized:
                return self._timed({**conditions, **parameters})  # type: ignore[no-any-return]
            names = tuple(parameters)
            return one_by_one(lambda cells: self._run(cells, names), conditions, parameters)

    def _run(self, cells: dict[str, Any], parameters: tuple[str, ...]) -> Any:
        if self.series:
            # The arrays are copied, as a function may change them and the next run needs them.
            cells = {k: v.copy() if isinstance(v, np.ndarray) else v for k, v in cells.items()}
        part = _array if self.series else _scalar
        if not self.jac:
            return _answer(self._timed(cells), part)
        value, slopes = self._timed_pair(cells)
        return with_slopes(self.name, _answer(value, part), slopes, parameters)

    def _timed(self, cells: Mapping[str, Any]) -> Any:
        if self.timeout is None:
            return self.function(**cells)
        with limited(self.timeout):
            return self.function(**cells)

    def _timed_pair(self, cells: Mapping[str, Any]) -> tuple[Any, Any]:
        """The outcome and its derivatives, as the user's functions return them."""
        value = self._timed(cells)
        if callable(self.jac):
            return value, self.jac(**cells)
        if not isinstance(value, tuple) or len(value) != 2:
            raise SimulatorError(
                f"simulator '{self.name}' returned {type(value).__name__} {value!r:.60}, and with "
                "jac it is to return a pair",
                "return outcome, derivatives; or leave out jac",
            )
        return value

    def fingerprint(self) -> str:
        """A hash that changes with the source of the function and of the modules beside it.

        These are the loaded modules of the same package or, for a file, of the same folder. For a
        script or a notebook only the function itself counts. Changes in data files, in imports from
        elsewhere, and in variables that the function has captured are not noticed. A `version`
        replaces all that.
        """
        kind = "series" if self.series else bool(self.vectorized)
        digest = hashlib.sha256(f"{self.name} {kind}".encode())
        if callable(self.jac) and not self.version:
            digest.update(source(self.jac).encode())
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
    """A simulator received from another process, after its files were compared with those there."""
    named = isinstance(origin, str)
    simulator = (FunctionSimulator.named if named else FunctionSimulator)(origin, *rest)
    is_file = named and origin.rpartition(":")[0].endswith(".py")
    require_same(simulator.function, expected, read_again=is_file)
    return simulator


def _answer(value: Any, part: Callable[[Any], Any]) -> Any:
    """The checked return value: a number or an array, or a mapping of these by response."""
    if isinstance(value, Mapping):
        return {str(name): part(one) for name, one in value.items()}
    return part(value)


def with_slopes(name: str, value: Any, slopes: Any, parameters: tuple[str, ...]) -> WithSlopes:
    """An outcome with its derivatives by the parameters, as arrays (n,) or (m, n) in their order.

    >>> with_slopes("f", 1.0, {"a": 2.0}, ("b", "a")).slopes
    array([nan,  2.])

    Raises SimulatorError, with the `name` of the simulator, for derivatives of another form.
    """

    def array(found: Any) -> Array:
        if isinstance(found, Mapping):
            for other in found:
                if other not in parameters:
                    raise _wrong(f"a derivative by '{other}'{nearest(str(other), parameters)}")
            given = [found.get(one, np.nan) for one in parameters]
            found = np.stack(np.broadcast_arrays(*given), axis=-1)
        try:
            out = np.asarray(real_numbers(found), dtype=np.float64)
        except (TypeError, ValueError):
            raise _wrong(f"{type(found).__name__} {found!r:.60} as derivatives") from None
        if len(parameters) == 1 and out.shape[-1:] != (1,):
            out = out[..., None]
        rows = np.shape(value if not isinstance(value, Mapping) else next(iter(value.values())))
        if out.shape not in ((len(parameters),), (*rows, len(parameters))):
            raise _wrong(f"derivatives of shape {out.shape}")
        return out

    def _wrong(what: str) -> SimulatorError:
        return SimulatorError(
            f"simulator '{name}' returned {what}; the parameters are {', '.join(parameters)}",
            "return an array (n,) in this order, (m, n) in a series, or a mapping from names of "
            "parameters; of several responses a mapping from their names to these",
        )

    if not isinstance(value, Mapping):
        return WithSlopes(value, array(slopes))
    if not isinstance(slopes, Mapping) or any(one not in slopes for one in value):
        raise _wrong("no derivatives of some responses")
    return WithSlopes(value, {one: array(slopes[one]) for one in value})


def _array(value: Any) -> float | Array:
    """The returned value of a series: an array (m,), or one number for all rows."""
    if value is None or isinstance(value, (str, bytes)) or np.ndim(value) == 0:
        return _scalar(value)
    try:
        values = real_numbers(value)
    except TypeError as error:
        raise TypeError(f"it returned {error} instead of real numbers") from None
    if values.ndim != 1:
        raise TypeError(
            f"it returned values of shape {values.shape} instead of one real number for each row "
            "of the experiment"
        )
    return values


def _scalar(value: Any) -> float:
    if isinstance(value, float):
        return value
    if value is None:
        raise TypeError("it returned None: is a return statement missing?")
    if isinstance(value, tuple):
        raise TypeError(
            f"it returned {len(value)} values: if the second are derivatives, say "
            + setting("[simulator] jac = true", "jac=True")
        )
    if np.ndim(value) != 0:
        raise TypeError(
            f"it returned an array of shape {np.shape(value)} instead of one number a run"
        )
    try:
        return float(real_numbers(value))
    except TypeError:
        raise TypeError(f"it returned {value!r} instead of a number") from None


def _arguments(
    function: Callable[..., Any], name: str
) -> tuple[tuple[str, ...], tuple[str, ...], bool]:
    """The names of arguments without and with a default, and whether there is **kwargs."""
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


def as_simulator(
    simulator: Simulator | Callable[..., Any],
    vectorized: bool | None = None,
    jac: bool | Callable[..., Any] = False,
    series: bool = False,
) -> Simulator:
    """A simulator unchanged, or a plain function as a simulator, with options of it.

    `vectorized`, `jac` and `series` are those of `FunctionSimulator`. Raises SimulatorError for
    `series` beside a simulator that is no series: its own option decides.

    >>> as_simulator(lambda load, stiffness: load / stiffness, vectorized=True).vectorized
    True
    """
    if all(hasattr(simulator, member) for member in ("name", "block", "asks", "fingerprint")):
        if series and not getattr(simulator, "series", False):
            raise SimulatorError(
                "series=True stands beside a simulator that takes one row a run",
                f"write it where the simulator is made: {type(simulator).__name__}(..., "
                "series=True)",
            )
        return simulator  # type: ignore[return-value] # any class that fills the protocol
    return FunctionSimulator(simulator, vectorized, jac=jac, series=series)
