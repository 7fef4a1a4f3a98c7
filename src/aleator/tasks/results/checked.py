"""Values that were read from a file against the types that they are to have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from functools import lru_cache
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

FORMS: Mapping[str, Mapping[str, Any]] = {
    "search": {
        "method": str, "evaluations": int, "starts": int, "distinct_optima": int,
        "optima": Sequence[Mapping[str, Any]],
    },
    "optima": {"log_likelihood": float, "starts": int},
    "surface": {
        "converged": int, "experiments": int, "median_error": float, "worst_error": float,
        "against": str, "where": str,
    },
    "baselines": {
        "least_squares": Mapping[str, Any] | None, "circe": Mapping[str, Any] | None,
    },
    "least_squares": {"parameters": Mapping[str, float], "rmse": float, "log_likelihood": float},
    "circe": {"alpha": Mapping[str, float], "log_likelihood": float},
    "pictures": {
        "conditions": Mapping[str, Sequence[Any]],
        "laws": Mapping[str, Mapping[str, Sequence[float]]],
        "contours": Sequence[Mapping[str, Any]],
        "profiles": Mapping[str, Mapping[str, Sequence[float]]],
        "surface": Mapping[str, Any] | None,
        "predicted": Mapping[str, Sequence[float]],
        "response": Mapping[str, Any],
        "roughness": Sequence[float],
    },
}  # fmt: skip
"""What reports take from the parts of an identification that have keys, and no class."""

LARGEST = 2**63
"""A whole number that none in a document reaches."""


@lru_cache(maxsize=64)
def hints_of(kind: type) -> dict[str, Any]:
    """The types of the fields of a data class, by name; none of another class."""
    return get_type_hints(kind) if is_dataclass(kind) else {}


def require(value: Any, hint: Any) -> None:
    """Raise TypeError unless a value is of a type; a float may be None, as JSON writes NaN.

    >>> require({"a": (1.0, None)}, Mapping[str, tuple[float, float]])
    >>> require({"a": "1.0"}, Mapping[str, float])
    Traceback (most recent call last):
        ...
    TypeError: {'a': '1.0'} is no Mapping
    """
    if not _is(value, hint):
        raise TypeError(f"{value!r:.60} is no {getattr(hint, '__name__', hint)}")


def require_form(name: str, value: Any) -> None:
    """Raise TypeError unless the entries of FORMS that are there have their types."""
    for key, hint in FORMS[name].items():
        if value and key in value:
            require(value[key], hint)
            if key in FORMS and value[key]:
                for one in value[key] if isinstance(value[key], list) else [value[key]]:
                    require_form(key, one)


def _is(value: Any, hint: Any) -> bool:
    if hint is Any:
        return True
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return any(_is(value, part) for part in parts)
    if hint is float:
        return value is None or isinstance(value, float) or _is(value, int)
    if hint is int:
        return isinstance(value, int) and not isinstance(value, bool) and abs(value) < LARGEST
    if hint is None:
        return value is None
    if origin is None:
        if not isinstance(value, hint):
            return False
        return all(_is(getattr(value, name), part) for name, part in hints_of(hint).items())
    if not isinstance(value, origin) or isinstance(value, str):
        return False
    if isinstance(value, Mapping):
        return all(isinstance(name, str) and _is(one, parts[1]) for name, one in value.items())
    if origin is tuple and parts[-1] is not ...:
        return len(value) == len(parts) and all(map(_is, value, parts))
    return all(_is(one, parts[0]) for one in value)
