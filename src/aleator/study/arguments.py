"""What the source of a function says about its arguments, without calling it."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable, Iterator
from typing import Any


def is_array(annotation: object) -> bool:
    """Whether an annotation says that an argument is an array."""
    return any(word in str(annotation) for word in ("Array", "ndarray"))


def arrays_among(function: Callable[..., Any]) -> frozenset[str]:
    """The arguments that can only be arrays where others are numbers.

    Those that are annotated so while others are not, and those that the function subscripts, loops
    over, measures by `len`, or hands to an integrator as its times. Empty where all are annotated
    as arrays, and where the source is not at hand.

    >>> def level(time, rate):
    ...     return [time[0] * rate]
    >>> sorted(arrays_among(level))
    ['time']
    """
    named = inspect.signature(function).parameters
    told = {name for name, p in named.items() if is_array(p.annotation)}
    if told:
        return frozenset(told if len(told) < len(named) else ())
    used = {one.id for node in _nodes(function) for one in _sequences(node)
            if isinstance(one, ast.Name)}  # fmt: skip
    return frozenset(used & set(named))


def returned_by(function: Callable[..., Any]) -> tuple[str, ...]:
    """The names of several responses: the texts that a function returns numbers under.

    Empty where it returns no such table, and where the source is not at hand.

    >>> def coasting(time, drag):
    ...     return {"speed": time, "way": drag}
    >>> returned_by(coasting)
    ('speed', 'way')
    """
    tables = [node.value for node in _nodes(function) if isinstance(node, ast.Return)]
    keys = [key for table in tables if isinstance(table, ast.Dict) for key in table.keys]
    names = [key.value for key in keys if isinstance(key, ast.Constant)]
    return tuple(dict.fromkeys(name for name in names if isinstance(name, str)))


def _nodes(function: Callable[..., Any]) -> list[ast.AST]:
    """All nodes of the source; none where it is not at hand."""
    try:
        return [*ast.walk(ast.parse(textwrap.dedent(inspect.getsource(function))))]
    except (OSError, TypeError, SyntaxError):
        return []


def _sequences(node: ast.AST) -> Iterator[ast.AST]:
    """What a node of the source takes for a sequence."""
    if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Load):
        yield node.value
    if isinstance(node, ast.For | ast.comprehension):
        yield node.iter
    if isinstance(node, ast.Call):
        called = ast.unparse(node.func).rpartition(".")[2]
        if called in ("len", "enumerate", "zip", "diff"):
            yield from node.args
        if called == "odeint":
            yield from node.args[2:3]
        yield from (word.value for word in node.keywords if word.arg == "t_eval")
