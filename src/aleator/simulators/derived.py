"""Parameters of a simulator that are computed from others, by arithmetic written as text."""

from __future__ import annotations

import ast
import hashlib
import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from aleator.core.arithmetic import (
    BINARY,
    UNARY,
    NoArithmeticError,
    function,
    in_short,
    number,
    require_arithmetic,
    tree,
)
from aleator.errors import SimulatorError, nearest
from aleator.simulators.function import FunctionSimulator, as_simulator
from aleator.simulators.protocol import Columns, Returned, Simulator

LEAVES = (ast.Name, ast.Attribute, ast.Subscript, ast.Call)
"""Syntax that may be the name of a variable: `w`, `gear.w`, `gear.flange[1].w`, `der(x)`."""


@dataclass(frozen=True)
class Words:
    """The words of error messages: for the expression, for its variables, and for the remedies."""

    subject: str = "the outcome"
    variable: str = "variable of the FMU"
    remedy: str = "write the name as the FMU has it"
    otherwise: str = 'write + - * / ** of variables, or a Python function: "module.py:function"'


@dataclass(frozen=True)
class Expression:
    """A parsed expression; called with arrays by variable name, it returns an array or a number."""

    text: str
    names: tuple[str, ...]
    _tree: ast.expr
    _leaves: Mapping[ast.expr, str]

    def __call__(self, values: Mapping[str, NDArray[Any]]) -> Any:
        """The value of the expression for these values of its variables."""
        with np.errstate(all="ignore"):  # An outcome that is not finite is a failed run.
            return self._value(self._tree, values)

    def _value(self, node: ast.expr, values: Mapping[str, NDArray[Any]]) -> Any:
        if node in self._leaves:
            return np.asarray(values[self._leaves[node]], dtype=np.float64)
        if isinstance(node, ast.BinOp):
            left, right = self._value(node.left, values), self._value(node.right, values)
            return BINARY[type(node.op)](left, right)
        if isinstance(node, ast.UnaryOp):
            return UNARY[type(node.op)](self._value(node.operand, values))
        if isinstance(node, ast.Call):
            return function(node)(*[self._value(argument, values) for argument in node.args])
        return number(cast(ast.Constant, node))


def parse(text: str, variables: Sequence[str], words: Words = Words()) -> Expression:
    """Parse an expression of variables: + - * / **, numbers, parentheses, and functions.

    The functions are abs, exp, log (natural), log10, sqrt, sin, cos, tan, tanh, and min and max of
    two values. Names may be structured as in an FMU (`gear.flange[1].w`, `der(x)`). If the whole
    text is the name of one of the `variables`, it is that variable.

    Raises SimulatorError for other syntax and for unknown names; `words` go into its message.

    >>> slip = parse("shaft.w[1] - 2*shaft.w[2]", ["shaft.w[1]", "shaft.w[2]"])
    >>> slip.names
    ('shaft.w[1]', 'shaft.w[2]')
    >>> slip({"shaft.w[1]": np.array([5.0]), "shaft.w[2]": np.array([2.0])})
    array([1.])
    """
    text = text.strip()
    if text in variables:
        return Expression(text, (text,), leaf := ast.Name(text), {leaf: text})
    written = {name.replace(" ", ""): name for name in variables}
    leaves: dict[ast.expr, str] = {}

    def is_leaf(node: ast.expr) -> bool:
        name = written.get(_source(text, node)) if isinstance(node, LEAVES) else None
        if name is not None:
            leaves[node] = name
        return name is not None

    try:
        found = tree(text)
        require_arithmetic(found, is_leaf)
    except NoArithmeticError as error:
        raise _refused(text, error, variables, words) from None
    return Expression(text, tuple(dict.fromkeys(leaves.values())), found, leaves)


def _source(text: str, node: ast.expr) -> str:
    """The source text of a node of the syntax tree, without blanks."""
    return (ast.get_source_segment(text, node) or "").replace(" ", "")


def _refused(
    text: str, error: NoArithmeticError, variables: Sequence[str], words: Words
) -> SimulatorError:
    """The error for an expression that was refused; `words` go into its message."""
    start, place = f"{words.subject} {in_short(text)}", error.node
    if place is None:
        return SimulatorError(
            f"{start} {error.problem}{nearest(text, variables)}",
            error.remedy or f"{words.remedy}, or arithmetic such as w1 - 2*w2",
        )
    part = ast.get_source_segment(text, place) or ""
    if isinstance(place, LEAVES):
        name = part.replace(" ", "")
        return SimulatorError(
            f"{start}: there is no {words.variable} '{name}'{nearest(name, variables)}",
            words.remedy,
        )
    return SimulatorError(
        f"{start} has {in_short(ast.get_source_segment(text, place) or '')}, which {error.problem}",
        error.remedy or words.otherwise,
    )


def derived(simulator: Simulator | Callable[..., Any], expressions: Mapping[str, str]) -> Simulator:
    """A simulator with parameters that are computed from the study's parameters and conditions.

    `expressions` has an arithmetic text for each computed parameter, by its name; a text may use
    the parameters computed before it. A variable of an expression is also passed to the simulator,
    if the simulator takes it. In a simulator of series an expression may use a condition that
    varies within an experiment; its value is then an array.

    Raises SimulatorError for a name that is no identifier and for a text that is no arithmetic. For
    an unknown variable it is raised later, when conditions and parameters are known.

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
    if getattr(inner, "sloped", False):
        raise SimulatorError(
            "derived parameters and jac: the derivatives are by other parameters than the study's",
            "compute the derived parameters in the function, or leave out jac",
        )
    if isinstance(inner, FunctionSimulator):
        return DerivedFunction(inner, expressions)
    return Derived(inner, expressions)


@dataclass(frozen=True)
class Derivation:
    """Expressions in the order of their evaluation, each with the parameter that it computes."""

    expressions: tuple[tuple[str, Expression], ...]

    @classmethod
    def of(cls, texts: Mapping[str, str], variables: Sequence[str]) -> Derivation:
        """Parse the text for each parameter; it may use `variables` and parameters before it.

        Raises SimulatorError for an unknown variable, and for a name that is used already.
        """
        names, found = [*variables], []
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
        """The names of the variables in all expressions."""
        return frozenset(name for _, expression in self.expressions for name in expression.names)

    def made(self, inputs: Mapping[str, Any]) -> dict[str, Any]:
        """The computed parameters by name, from arrays (R,) or from the values of one run.

        Raises SimulatorError for a condition that is a text, and for one that varies within an
        experiment if the simulator makes a single row in a run.
        """
        values, made = dict(inputs), {}
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


@lru_cache
def _derivation(texts: tuple[tuple[str, str], ...], variables: tuple[str, ...]) -> Derivation:
    return Derivation.of(dict(texts), variables)


class _Calculated:
    """A function that computes the derived parameters and then calls the user's function."""

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
        super().__init__(_Calculated(inner, expressions), *inner.options)
        self.inner, self.expressions = inner, dict(expressions)
        self.description = inner.description

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the wrapped function and the expressions."""
        return DerivedFunction, (self.inner, self.expressions)

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """The conditions that the function takes or that an expression uses."""
        found = Derivation.of(self.expressions, (*conditions, *parameters))
        names = (*parameters, *self.expressions)
        passed = [name for name in names if name not in found.used or self.inner.takes(name)]
        asked = self.inner.asks(conditions, passed)
        return tuple(name for name in conditions if name in asked or name in found.used)

    def fingerprint(self) -> str:
        """A hash of the function's fingerprint and of the expressions."""
        return _fingerprint(self.inner, self.expressions)


class Derived:
    """A program, an FMU or another simulator with derived parameters (see `derived`).

    All other attributes are those of the wrapped simulator `inner`.
    """

    def __init__(self, inner: Simulator, expressions: Mapping[str, str]) -> None:
        self.inner, self.expressions = inner, dict(expressions)
        self._passed_names: dict[tuple[tuple[str, ...], ...], tuple[str, ...]] = {}

    def __getattr__(self, name: str) -> Any:
        """An attribute of the wrapped simulator."""
        if name in ("inner", "expressions") or name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.inner, name)

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """The conditions that the simulator takes or that an expression uses."""
        used = self._of(conditions, parameters).used
        asked = self.inner.asks(conditions, self.passed(conditions, parameters))
        return tuple(name for name in conditions if name in asked or name in used)

    def __call__(self, conditions: Columns, parameters: Columns) -> Returned:
        """Run R times, with the computed parameters among the others."""
        made = self._of([*conditions], [*parameters]).made({**conditions, **parameters})
        given = {**parameters, **made}
        names = self.passed([*conditions], [*parameters])
        asked = self.inner.asks([*conditions], names)
        return self.inner(
            {name: conditions[name] for name in asked}, {name: given[name] for name in names}
        )

    def fingerprint(self) -> str:
        """A hash of the wrapped simulator's fingerprint and of the expressions."""
        return _fingerprint(self.inner, self.expressions)

    def passed(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """The parameters that are passed to the wrapped simulator: all that it accepts."""
        names = tuple(conditions), tuple(parameters)
        if names not in self._passed_names:
            used = self._of(conditions, parameters).used
            self._passed_names[names] = _passed(
                self.inner, names[0], (*names[1], *self.expressions), used
            )
        return self._passed_names[names]

    def _of(self, conditions: Sequence[str], parameters: Sequence[str]) -> Derivation:
        return _derivation(tuple(self.expressions.items()), (*conditions, *parameters))


def _passed(
    inner: Simulator,
    conditions: tuple[str, ...],
    parameters: tuple[str, ...],
    used: frozenset[str],
) -> tuple[str, ...]:
    """The parameters that the simulator accepts, as many as possible.

    The simulator may not know a variable that an expression uses; such a variable is then not
    passed. If the simulator accepts no choice, none of these variables is passed.
    """
    optional = [name for name in parameters if name in used]
    for left_out in range(len(optional)):
        for out in combinations(optional, left_out):
            names = tuple(name for name in parameters if name not in out)
            try:
                inner.asks(conditions, names)
            except SimulatorError:
                continue
            return names
    return tuple(name for name in parameters if name not in optional)


def _fingerprint(inner: Simulator, expressions: Mapping[str, str]) -> str:
    return hashlib.sha256(f"{inner.fingerprint()} {[*expressions.items()]}".encode()).hexdigest()


def defaults_left(simulator: Simulator, given: Collection[str]) -> dict[str, float]:
    """The arguments of a Python function that keep a number as their default, by name.

    `given` are the names of conditions and parameters; derived parameters are given too. Any other
    simulator has none.

    >>> def model(load, stiffness, gap=0.5, unit="mm"):
    ...     return load / stiffness + gap
    >>> defaults_left(FunctionSimulator(model), {"load", "stiffness"})
    {'gap': 0.5}
    """
    if isinstance(simulator, Derived | DerivedFunction):
        return defaults_left(simulator.inner, {*given, *simulator.expressions})
    function = getattr(simulator, "function", None)
    try:
        arguments = inspect.signature(function).parameters if callable(function) else {}
    except (TypeError, ValueError):
        return {}
    return {
        name: argument.default
        for name, argument in arguments.items()
        if name not in given
        and isinstance(argument.default, int | float)
        and not isinstance(argument.default, bool)
    }
