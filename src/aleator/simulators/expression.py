"""Arithmetic of variables, written as text."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.errors import SimulatorError, nearest

_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "abs": np.abs, "exp": np.exp, "log": np.log, "log10": np.log10, "sqrt": np.sqrt,
    "sin": np.sin, "cos": np.cos, "tan": np.tan, "tanh": np.tanh,
    "min": np.minimum, "max": np.maximum,
}  # fmt: skip
_PAIRS = ("min", "max")


@dataclass(frozen=True)
class Words:
    """How messages call an expression, and what it may name."""

    subject: str = "the outcome"
    variable: str = "variable of the FMU"
    remedy: str = "write the name as the FMU has it"
    otherwise: str = 'write + - * / ** of variables, or a Python function: "module.py:function"'


@dataclass(frozen=True)
class Expression:
    """A parsed expression: called with arrays by variable name, it gives an array or a number."""

    text: str
    names: tuple[str, ...]
    _tree: ast.expr
    _known: Mapping[str, str]

    def __call__(self, values: Mapping[str, NDArray[Any]]) -> Any:
        """The value of the expression."""
        with np.errstate(all="ignore"):  # an outcome that is not finite is a failed run
            return self._value(self._tree, values)

    def _value(self, node: ast.expr, values: Mapping[str, NDArray[Any]]) -> Any:
        if isinstance(node, ast.BinOp):
            left, right = self._value(node.left, values), self._value(node.right, values)
            return _BINARY[type(node.op)](left, right)
        if isinstance(node, ast.UnaryOp):
            return _UNARY[type(node.op)](self._value(node.operand, values))
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.Call) and _name(node) not in self._known:
            arguments = (self._value(argument, values) for argument in node.args)
            return _FUNCTIONS[_name(node.func)](*arguments)
        return np.asarray(values[self._known[_name(node)]], dtype=np.float64)


def parse(text: str, known: Sequence[str], words: Words = Words()) -> Expression:
    """An expression of the known variables: + - * / **, numbers, parentheses, and functions.

    Functions are abs, exp, log (natural), log10, sqrt, sin, cos, tan, tanh, and min, max of two.
    Names may be structured as an FMU writes them (`gear.flange[1].w`, `der(x)`). A text that is
    itself the name of a variable is that variable.

    Raises SimulatorError for what cannot be parsed, and for unknown names; `words` are its.

    >>> slip = parse("shaft.w[1] - 2*shaft.w[2]", ["shaft.w[1]", "shaft.w[2]"])
    >>> slip.names
    ('shaft.w[1]', 'shaft.w[2]')
    >>> slip({"shaft.w[1]": np.array([5.0]), "shaft.w[2]": np.array([2.0])})
    array([1.])
    """
    if text in known:
        return Expression(text, (text,), ast.Name(text), {text: text})
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except SyntaxError:
        raise SimulatorError(
            f"{words.subject} '{text}' is neither a {words.variable} nor an expression of "
            f"such{nearest(text, known)}",
            f"{words.remedy}, or arithmetic such as w1 - 2*w2",
        ) from None
    written = {name.replace(" ", ""): name for name in known}
    names: dict[str, None] = {}
    _Names(text, written, words, names).collect(tree)
    return Expression(text, tuple(names), tree, written)


def _name(node: ast.expr) -> str:
    return node.id if isinstance(node, ast.Name) else ast.unparse(node).replace(" ", "")


@dataclass(frozen=True)
class _Names:
    """The names that an expression uses, as they are met; `known` ones by how they are written."""

    text: str
    known: Mapping[str, str]
    words: Words
    found: dict[str, None]

    def collect(self, node: ast.expr) -> None:
        if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
            self.collect(node.left)
            self.collect(node.right)
        elif isinstance(node, ast.UnaryOp) and type(node.op) in _UNARY:
            self.collect(node.operand)
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            return
        elif (name := _name(node)) in self.known:
            self.found[self.known[name]] = None
        elif isinstance(node, ast.Call) and _is_function(node):
            for argument in node.args:
                self.collect(argument)
        elif isinstance(node, (ast.Name, ast.Attribute, ast.Subscript, ast.Call)):
            raise SimulatorError(
                f"{self.words.subject} '{self.text}': there is no {self.words.variable} "
                f"'{name}'{nearest(name, [*self.known.values()])}",
                self.words.remedy,
            )
        else:
            raise SimulatorError(
                f"{self.words.subject} '{self.text}' has '{ast.unparse(node)}', which is not "
                "arithmetic",
                self.words.otherwise,
            )


def _is_function(node: ast.Call) -> bool:
    name = _name(node.func)
    wanted = 2 if name in _PAIRS else 1
    return name in _FUNCTIONS and len(node.args) == wanted and not node.keywords
