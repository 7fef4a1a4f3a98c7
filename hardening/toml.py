"""A tree of values as TOML, which the standard library reads only."""

from __future__ import annotations

import json
import math
from typing import Any


def written(tree: dict[str, Any]) -> str:
    """A tree as TOML, each key of the root on a line of its own.

    >>> written({"search": {"starts": 1}, "x": [0.5, float("inf")]})
    'search = {"starts" = 1}\\nx = [0.5, inf]\\n'
    """
    return "".join(f"{_key(name)} = {_value(value)}\n" for name, value in tree.items())


def _key(name: str) -> str:
    return name if name.isidentifier() and name.isascii() else json.dumps(name)


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return json.dumps(value)
