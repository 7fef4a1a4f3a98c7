"""Measurements of an hour and more: each one is kept as it comes, and none is made twice."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

Key = tuple[str | int, ...]
Entry = Mapping[str, Any]


def kept(path: Path, keys: Iterable[Key], made: Callable[..., Entry]) -> dict[Key, Entry]:
    """The entries of a file with lines of JSON by key; `made(*key)` gives those that it lacks."""
    lines = path.read_text().splitlines() if path.exists() else []
    known = {tuple(line["key"]): line for line in map(json.loads, lines)}
    with path.open("a") as file:
        for key in keys:
            if key not in known:
                known[key] = {"key": key, **made(*key)}
                file.write(json.dumps(known[key]) + "\n")
                file.flush()
    return known
