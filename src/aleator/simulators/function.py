"""A Python function as a simulator."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aleator.errors import SimulatorError, nearest
from aleator.observations.tables import real_numbers
from aleator.simulators.loading import digests, load_function, require_same, source, sources
from aleator.simulators.protocol import (
    ARRAY_BLOCK,
    SINGLE_BLOCK,
    Columns,
    Returned,
    Simulator,
    one_by_one,
)
from aleator.simulators.time_limit import checked_limit, limited
from aleator.types import Array


class FunctionSimulator:
    """A function that takes conditions and parameters by name and returns the outcome.

    `vectorized=False`: the function is called once a run and gets floats (a text condition stays a
    text). `vectorized=True`: it is called with arrays (R,) and returns an array (R,); it must treat
    the runs independently of each other. `series=True`: it is called once for a whole experiment of
    m rows; conditions that vary within any experiment are arrays (m,), the others and the
    parameters are floats; it returns an array (m,), or a number for all rows. For several responses
    it returns a mapping from their names to what it would return for one. Its arguments are
    conditions or parameters; one with a default may be neither. It takes every parameter of the
    study, but only the conditions it names (all of them if it has **kwargs). `version` is the
    user's own name of what the function does: runs that were kept stay valid until it changes,
    whatever happens to the source. `block` is the most runs of one call with arrays (default 8192):
    where outcomes may differ in their last digits with the length of the arrays, runs are the same
    only for the same block. A call that takes longer than `timeout` seconds is stopped (see
    `limited`), and the run has failed.

    Raises SimulatorError if `function` is not callable or has arguments without a name, and for
    a series that is vectorized.

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
        series: bool = False,
        timeout: float | None = None,
    ) -> None:
        if series and vectorized:
            raise SimulatorError(
                "a function of series cannot be vectorized too",
                "keep one: series for arrays of the rows of one experiment, vectorized for arrays "
                "of many runs of one row",
            )
        if block is not None and block < 1:
            raise SimulatorError(f"a block of {block} runs", "choose at least one")
        if not callable(function):
            raise SimulatorError(
                f"the simulator {function!r} is not callable", "give a function or its name"
            )
        self.function = function
        self.vectorized = vectorized
        self.series = series
        self.version = version
        self.timeout = checked_limit(timeout)
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
        series: bool = False,
        timeout: float | None = None,
    ) -> FunctionSimulator:
        """The function that a reference names (see `load_function`), also in other processes.

        They import it from the same file, which they must see. Raises SimulatorError there if that
        file, or one beside it, is not as it was here when it was loaded.

        >>> FunctionSimulator.named("statistics:fmean").name
        'fmean'
        """
        function = load_function(reference, base_dir)
        simulator = cls(function, vectorized, version, block, series, timeout)
        simulator._reference = reference, str(Path(base_dir).resolve())
        simulator._digests = digests(simulator.function)
        return simulator

    def __reduce__(self) -> tuple[Any, ...]:
        """By name where it was named; else the function itself, as far as it can be pickled."""
        origin: tuple[Any, ...] = self._reference or (self.function,)
        expected = digests(self.function) if self._digests is None else self._digests
        options = (self.vectorized, self.version, self.block, self.series, self.timeout)
        return _arrived, (expected, *origin, *options)

    def takes(self, name: str) -> bool:
        """Whether the function has an argument of this name, or takes any."""
        required, optional, anything = self._arguments
        return anything or name in required or name in optional

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

    def __call__(self, conditions: Columns, parameters: Columns) -> Returned:
        """Run R times; raises what the function raises, in a RunStopped unless vectorized."""
        with np.errstate(all="ignore"):  # what is not finite is reported with its experiment
            if self.vectorized:
                return self._timed({**conditions, **parameters})  # type: ignore[no-any-return]
            return one_by_one(self._series if self.series else self._row, conditions, parameters)

    def _row(self, cells: dict[str, Any]) -> Any:
        return _answer(self._timed(cells), _scalar)

    def _series(self, cells: dict[str, Any]) -> Any:
        # copies: a function that changes its arguments must not change the next run's
        own = {k: v.copy() if isinstance(v, np.ndarray) else v for k, v in cells.items()}
        return _answer(self._timed(own), _array)

    def _timed(self, cells: Mapping[str, Any]) -> Any:
        if self.timeout is None:
            return self.function(**cells)
        with limited(self.timeout):
            return self.function(**cells)

    def fingerprint(self) -> str:
        """A hash that changes with the source of the function and of the modules beside it.

        Beside: loaded modules of the same package or, for a file, of the same folder; of a script
        or a notebook, the function alone. What they read from disk or import from elsewhere is not
        seen, nor what the function holds in variables of its own. A `version` takes the place of
        all that.
        """
        kind = "series" if self.series else self.vectorized
        digest = hashlib.sha256(f"{self.name} {kind}".encode())
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


def _answer(value: Any, part: Callable[[Any], Any]) -> Any:
    if isinstance(value, float):
        return value
    if isinstance(value, Mapping):
        return {str(name): part(one) for name, one in value.items()}
    return part(value)


def _array(value: Any) -> float | Array:
    """What a series returned: an array (m,), or one number for all rows."""
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
    if np.ndim(value) != 0:
        raise TypeError(
            f"it returned an array of shape {np.shape(value)} instead of one number a run"
        )
    if isinstance(value, (str, bytes)):
        raise TypeError(f"it returned {value!r} instead of a number")
    try:
        return float(real_numbers(value))
    except TypeError:
        raise TypeError(f"it returned {value!r} instead of a number") from None


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


def as_simulator(simulator: Simulator | Callable[..., Any], vectorized: bool = False) -> Simulator:
    """A plain function as a simulator, called once a run or `vectorized`; a simulator as it is.

    >>> as_simulator(lambda load, stiffness: load / stiffness).vectorized
    False
    """
    if all(hasattr(simulator, member) for member in ("name", "block", "asks", "fingerprint")):
        return simulator  # type: ignore[return-value] # any class that fills the protocol
    return FunctionSimulator(simulator, vectorized)
