"""Arithmetic of variables, written as text."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from aleator.arithmetic import (
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

LEAVES = (ast.Name, ast.Attribute, ast.Subscript, ast.Call)
"""What the name of a variable may look like: `w`, `gear.w`, `gear.flange[1].w`, `der(x)`."""


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
    _leaves: Mapping[ast.expr, str]

    def __call__(self, values: Mapping[str, NDArray[Any]]) -> Any:
        """The value of the expression."""
        with np.errstate(all="ignore"):  # an outcome that is not finite is a failed run
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
    text = text.strip()
    if text in known:
        return Expression(text, (text,), leaf := ast.Name(text), {leaf: text})
    written = {name.replace(" ", ""): name for name in known}
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
        raise _refused(text, error, known, words) from None
    return Expression(text, tuple(dict.fromkeys(leaves.values())), found, leaves)


def _source(text: str, node: ast.expr) -> str:
    """A part of the text, as it is written but for blanks."""
    return (ast.get_source_segment(text, node) or "").replace(" ", "")


def _refused(
    text: str, error: NoArithmeticError, known: Sequence[str], words: Words
) -> SimulatorError:
    """What is wrong with an expression, in the words of its reader."""
    start, place = f"{words.subject} {in_short(text)}", error.node
    if place is None:
        return SimulatorError(
            f"{start} {error.problem}{nearest(text, known)}",
            error.remedy or f"{words.remedy}, or arithmetic such as w1 - 2*w2",
        )
    part = ast.get_source_segment(text, place) or ""
    if isinstance(place, LEAVES):
        name = part.replace(" ", "")
        return SimulatorError(
            f"{start}: there is no {words.variable} '{name}'{nearest(name, known)}", words.remedy
        )
    return SimulatorError(
        f"{start} has {in_short(ast.get_source_segment(text, place) or '')}, which {error.problem}",
        error.remedy or words.otherwise,
    )
