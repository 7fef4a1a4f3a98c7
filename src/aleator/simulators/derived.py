"""Parameters that a simulator is given and that follow from others and from conditions."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np

from aleator.errors import SimulatorError
from aleator.simulators.expression import Expression, Words, parse
from aleator.simulators.function import FunctionSimulator, as_simulator
from aleator.simulators.protocol import Columns, Returned, Simulator


def derived(simulator: Simulator | Callable[..., Any], expressions: Mapping[str, str]) -> Simulator:
    """The simulator with parameters that are computed of the study's parameters and conditions.

    `expressions` are arithmetic by the name of what they make; one may name those before it. What
    an expression names is given to the simulator as well if it takes it. In a function of series an
    expression may name a condition that varies, and makes an array then.

    Raises SimulatorError for a name that is no identifier and for what is no arithmetic; unknown
    names are told when the conditions and parameters are known.

    >>> import numpy as np
    >>> stiffer = derived(lambda load, e: load / e, {"e": "a + b*(humidity - 1)"})
    >>> stiffer.asks(["load", "humidity", "bench"], ["a", "b"])
    ('load', 'humidity')
    >>> stiffer({"load": np.array([6.0]), "humidity": np.array([3.0])},
    ...         {"a": np.array([1.0]), "b": np.array([0.5])})
    array([3.])
    """
    expressions = dict(expressions)
    for name, text in expressions.items():
        if not name.isidentifier():
            raise SimulatorError(
                f"derived '{name}' is no name", "use letters, digits and underscores"
            )
        if not isinstance(text, str):
            raise SimulatorError(f"derived {name} = {text!r} is no text", f'write {name} = "..."')
    inner = as_simulator(simulator)
    if isinstance(inner, FunctionSimulator):
        return DerivedFunction(inner, expressions)
    return Derived(inner, expressions)


@dataclass(frozen=True)
class Derivation:
    """Expressions by the name of what they make, in order, for known conditions and parameters."""

    expressions: tuple[tuple[str, Expression], ...]

    @classmethod
    def of(cls, texts: Mapping[str, str], known: Sequence[str]) -> Derivation:
        """Raises SimulatorError for an unknown name, and for a name that something else has."""
        names, found = [*known], []
        for name, text in texts.items():
            if name in names:
                raise SimulatorError(
                    f"derived.{name}: '{name}' is a condition or a parameter already",
                    "give what is derived another name",
                )
            words = Words(
                f"derived.{name} =", "parameter or condition", f"name one of {', '.join(names)}",
                "write + - * / **, numbers, parentheses and exp, log, sqrt, ... of names",
            )  # fmt: skip
            found.append((name, parse(text, names, words)))
            names.append(name)
        return cls(tuple(found))

    @property
    def used(self) -> frozenset[str]:
        """What the expressions name."""
        return frozenset(name for _, expression in self.expressions for name in expression.names)

    def made(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """What the expressions make of columns, or of the values of one run.

        Raises SimulatorError for a text, and for series where one number a run is wanted.
        """
        values, made = dict(given), {}
        for name, expression in self.expressions:
            for used in expression.names:
                if np.asarray(values[used]).dtype.kind not in "fiub":
                    raise SimulatorError(
                        f"derived.{name} = '{expression.text}': the condition '{used}' is a text, "
                        "or varies within an experiment of which one run makes all rows",
                        "name conditions that are one number a run",
                    )
            values[name] = made[name] = expression(values)
        return made


@lru_cache(maxsize=64)
def _derivation(texts: tuple[tuple[str, str], ...], known: tuple[str, ...]) -> Derivation:
    return Derivation.of(dict(texts), known)


class _Calculated:
    """A function with derived parameters, called as it is: with numbers or arrays by name."""

    def __init__(self, inner: FunctionSimulator, texts: Mapping[str, str]) -> None:
        self._inner, self._texts = inner, tuple(texts.items())
        self.__qualname__ = inner.name

    def __call__(self, **cells: Any) -> Any:
        made = _derivation(self._texts, tuple(cells)).made(cells)
        given = {**cells, **made}
        return self._inner.function(**{k: v for k, v in given.items() if self._inner.takes(k)})


class DerivedFunction(FunctionSimulator):
    """A Python function with derived parameters (see `derived`)."""

    def __init__(self, inner: FunctionSimulator, expressions: Mapping[str, str]) -> None:
        super().__init__(
            _Calculated(inner, expressions), inner.vectorized, inner.version, inner.block,
            inner.series, inner.timeout,
        )  # fmt: skip
        self.inner, self.expressions = inner, dict(expressions)
        self.description = inner.description

    def __reduce__(self) -> tuple[Any, ...]:
        """The function, as it reaches other processes, and the expressions."""
        return DerivedFunction, (self.inner, self.expressions)

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """What the function asks for, and what the expressions name."""
        found = Derivation.of(self.expressions, (*conditions, *parameters))
        names = (*parameters, *self.expressions)
        passed = [name for name in names if name not in found.used or self.inner.takes(name)]
        asked = self.inner.asks(conditions, passed)
        return tuple(name for name in conditions if name in asked or name in found.used)

    def fingerprint(self) -> str:
        """That of the function, and the expressions."""
        return _fingerprint(self.inner, self.expressions)


class Derived:
    """A program, an FMU or another simulator with derived parameters (see `derived`).

    What it has beside the members of every simulator is that of `inner`.
    """

    def __init__(self, inner: Simulator, expressions: Mapping[str, str]) -> None:
        self.inner, self.expressions = inner, dict(expressions)
        self._known: dict[tuple[tuple[str, ...], ...], tuple[str, ...]] = {}

    def __getattr__(self, name: str) -> Any:
        """A member of the simulator itself."""
        if name in ("inner", "expressions") or name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.inner, name)

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """What the simulator asks for, and what the expressions name."""
        used = self._of(conditions, parameters).used
        asked = self.inner.asks(conditions, self.passed(conditions, parameters))
        return tuple(name for name in conditions if name in asked or name in used)

    def __call__(self, conditions: Columns, parameters: Columns) -> Returned:
        """Run R times, with what the expressions make among the parameters."""
        made = self._of([*conditions], [*parameters]).made({**conditions, **parameters})
        given = {**parameters, **made}
        names = self.passed([*conditions], [*parameters])
        asked = self.inner.asks([*conditions], names)
        return self.inner(
            {name: conditions[name] for name in asked}, {name: given[name] for name in names}
        )

    def fingerprint(self) -> str:
        """That of the simulator, and the expressions."""
        return _fingerprint(self.inner, self.expressions)

    def passed(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """The parameters that the simulator itself is given: all that it accepts."""
        names = tuple(conditions), tuple(parameters)
        if names not in self._known:
            used = self._of(conditions, parameters).used
            self._known[names] = _passed(self.inner, names[0], (*names[1], *self.expressions), used)
        return self._known[names]

    def _of(self, conditions: Sequence[str], parameters: Sequence[str]) -> Derivation:
        return _derivation(tuple(self.expressions.items()), (*conditions, *parameters))


def _passed(
    inner: Simulator,
    conditions: tuple[str, ...],
    parameters: tuple[str, ...],
    used: frozenset[str],
) -> tuple[str, ...]:
    """The most parameters that the simulator accepts; without those that expressions use, if none.

    What an expression uses may be unknown to the simulator, and what is not is meant for it too.
    """
    ours = [name for name in parameters if name in used]
    for left_out in range(len(ours)):
        for out in combinations(ours, left_out):
            names = tuple(name for name in parameters if name not in out)
            try:
                inner.asks(conditions, names)
            except SimulatorError:
                continue
            return names
    return tuple(name for name in parameters if name not in ours)


def _fingerprint(inner: Simulator, expressions: Mapping[str, str]) -> str:
    return hashlib.sha256(f"{inner.fingerprint()} {[*expressions.items()]}".encode()).hexdigest()
