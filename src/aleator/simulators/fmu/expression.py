"""Arithmetic of an FMU's variables, written as text."""

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
        return np.asarray(values[self._known[_name(node)]], dtype=np.float64)


def parse(text: str, known: Sequence[str]) -> Expression:
    """An expression of the known variables: + - * / **, numbers and parentheses.

    Names may be structured as an FMU writes them (`gear.flange[1].w`, `der(x)`). A text that is
    itself the name of a variable is that variable.

    Raises SimulatorError for what cannot be parsed, and for unknown names.

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
            f"the outcome '{text}' is neither a variable of the FMU nor an expression of "
            f"variables{nearest(text, known)}",
            "write a name as the FMU has it, or arithmetic such as w1 - 2*w2",
        ) from None
    written = {name.replace(" ", ""): name for name in known}
    names: dict[str, None] = {}
    _collect(tree, text, written, names)
    return Expression(text, tuple(names), tree, written)


def _name(node: ast.expr) -> str:
    return node.id if isinstance(node, ast.Name) else ast.unparse(node).replace(" ", "")


def _collect(node: ast.expr, text: str, known: Mapping[str, str], names: dict[str, None]) -> None:
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        _collect(node.left, text, known, names)
        _collect(node.right, text, known, names)
    elif isinstance(node, ast.UnaryOp) and type(node.op) in _UNARY:
        _collect(node.operand, text, known, names)
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return
    elif (name := _name(node)) in known:
        names[known[name]] = None
    elif isinstance(node, (ast.Name, ast.Attribute, ast.Subscript, ast.Call)):
        raise SimulatorError(
            f"the outcome '{text}': the FMU has no variable '{name}'{nearest(name, known)}",
            "write the name as the FMU has it",
        )
    else:
        raise SimulatorError(
            f"the outcome '{text}' has '{ast.unparse(node)}', which is not arithmetic",
            'write + - * / ** of variables, or a Python function: "module.py:function"',
        )
