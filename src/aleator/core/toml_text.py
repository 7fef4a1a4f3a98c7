"""Keys and values in the notation of TOML, for study files and for remedies that quote them."""

from __future__ import annotations

import json


def key(name: str) -> str:
    """A name as a key of TOML, in quotes if TOML requires them."""
    bare = all(c.isascii() and (c.isalnum() or c in "_-") for c in name)
    return name if name and bare else written(name)


def written(value: object) -> str:
    """The text of a value in the notation of TOML.

    >>> written([1.0, 0.5]), written("a\\tb"), written({"file": "x"})
    ('[1.0, 0.5]', '"a\\\\tb"', '{file = "x"}')
    """
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key(k)} = {written(v)}' for k, v in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(written, value))}]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False)
