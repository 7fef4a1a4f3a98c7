"""What makes a series of the observations of an experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any


def varying_number(seen: Sequence[Mapping[str, Any]]) -> str | None:
    """The condition that varies within experiments, is a number, and has the most values.

    `seen` are the observations of a document.

    >>> varying_number([{"conditions": {"time": 1.0}}, {"conditions": {"time": 2.0}}])
    'time'
    """
    values: dict[str, set[float]] = {}
    for entry in seen:
        for name, value in entry["conditions"].items():
            if isinstance(value, int | float):
                values.setdefault(name, set()).add(float(value))
    return max(values, key=lambda name: len(values[name])) if values else None
