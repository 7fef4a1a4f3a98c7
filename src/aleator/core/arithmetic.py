"""Arithmetic that the user writes as text: its syntax tree is checked before anything is computed.

The text has numbers, + - * / **, parentheses and the functions of `FUNCTIONS`. The caller decides
which names and calls are allowed besides. It is used for the expressions of `[derived]` and of
FMUs, and for formulas of covariates.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from aleator.errors import AleatorError

BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "abs": np.abs, "exp": np.exp, "log": np.log, "log10": np.log10, "sqrt": np.sqrt,
    "sin": np.sin, "cos": np.cos, "tan": np.tan, "tanh": np.tanh,
    "min": np.minimum, "max": np.maximum,
}  # fmt: skip
_PAIRS = ("min", "max")


@dataclass(frozen=True)
class Bounds:
    """The largest size of a formula. The limit was chosen with `python -m hardening formulas`."""

    depth: int = 250
    """The largest number of nested operations. In a sum of many terms each addition is nested in
    the next one, so this also limits the number of terms. Python itself allows 1,000 nested calls.
    """


class NoArithmeticError(AleatorError):
    """An error in a formula, with the node of its syntax tree where the error is known to be."""

    def __init__(self, problem: str, remedy: str = "", node: ast.expr | None = None) -> None:
        super().__init__(problem, remedy)
        self.node = node


def share_of(text: str) -> float | None:
    """The number that a text states, or a hundredth of it before a sign %; None if it has none.

    >>> share_of("0.95"), share_of("95 %"), share_of("3%"), share_of("much")
    (0.95, 0.95, 0.03, None)
    """
    number = text.strip().removesuffix("%")
    try:
        return float(number) / (100.0 if number != text.strip() else 1.0)
    except ValueError:
        return None


def in_short(text: str) -> str:
    """A text in quotes for a message, cut to at most 80 characters.

    >>> in_short("a + b"), len(in_short("-" * 3000))
    ("'a + b'", 82)
    """
    return f"'{text if len(text) <= 80 else text[:77] + '...'}'"


def tree(text: str, bounds: Bounds = Bounds()) -> ast.expr:
    """The syntax tree of an expression; nothing is computed.

    Raises NoArithmeticError for invalid syntax and for more nested operations than `bounds` allows.

    >>> type(tree("a + 2*b")).__name__
    'BinOp'
    """
    too_deep = NoArithmeticError(
        f"has more than {bounds.depth} operations within each other",
        "write it in several parts",
    )
    try:
        found = ast.parse(text, mode="eval").body
    except (RecursionError, MemoryError):
        raise too_deep from None
    except (SyntaxError, ValueError):  # ValueError means that the text contains a zero byte.
        raise NoArithmeticError("is no arithmetic") from None
    level: list[ast.AST] = [found]
    for _ in range(bounds.depth):
        level = [child for node in level for child in ast.iter_child_nodes(node)]
        if not level:
            return found
    raise too_deep


def require_arithmetic(node: ast.expr, is_leaf: Callable[[ast.expr], bool]) -> float | None:
    """Check that a syntax tree is arithmetic, and return its value, or None if it has a variable.

    `is_leaf` says whether the caller accepts a node as a variable. Numbers are floats. A part
    without variables must have a finite value: 9**9**9 is refused. Raises NoArithmeticError.

    >>> require_arithmetic(tree("2*3"), lambda node: False)
    6.0
    """
    if is_leaf(node):
        return None
    compute: Callable[..., Any]
    if isinstance(node, ast.BinOp) and type(node.op) in BINARY:
        compute, parts = BINARY[type(node.op)], [node.left, node.right]
    elif isinstance(node, ast.UnaryOp) and type(node.op) in UNARY:
        compute, parts = UNARY[type(node.op)], [node.operand]
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        compute, parts = (lambda: number(node)), []
    elif isinstance(node, ast.Call) and _is_function(node):
        compute, parts = function(node), node.args
    else:
        raise NoArithmeticError("is not arithmetic", node=node)
    values = [require_arithmetic(part, is_leaf) for part in parts]
    if None in values:
        return None
    with np.errstate(all="ignore"):
        value = float(compute(*map(np.float64, values)))
    if not math.isfinite(value):
        raise NoArithmeticError("has no finite value", "write the number itself", node)
    return value


def number(node: ast.Constant) -> np.float64:
    """The value of a constant as a float; infinite where it is too large for one."""
    try:
        return np.float64(cast(float, node.value))
    except OverflowError:
        return np.float64(math.inf)


def function(node: ast.Call) -> Callable[..., Any]:
    """The NumPy function that a function call in a formula stands for."""
    return FUNCTIONS[node.func.id]  # type: ignore[attr-defined]


def _is_function(node: ast.Call) -> bool:
    if not isinstance(node.func, ast.Name) or node.func.id not in FUNCTIONS or node.keywords:
        return False
    wanted = 2 if node.func.id in _PAIRS else 1
    return len(node.args) == wanted and not isinstance(node.args[0], ast.Starred)
