"""Lines of a study file: a key, its value as TOML has it, and a remark."""

from __future__ import annotations

import json

WIDTH = 34  # where the remarks begin
FILL_IN = "FILL IN"


def line(key: str, value: object, remark: str) -> str:
    """A key with its value."""
    return remarked(f"{key} = {written(value)}", remark)


def off(key: str, value: object, remark: str) -> str:
    """The same as a remark: it holds where the user takes the sign away."""
    return remarked(f"# {key} = {written(value)}", remark)


def fill(key: str, form: str, remark: str) -> str:
    """What the user has to fill in."""
    return remarked(f"# {key} = {form}", f"{FILL_IN}: {remark}")


def remarked(text: str, remark: str) -> str:
    """A line with its remark beside it, or above where it is long."""
    return f"{text:<{WIDTH}} # {remark}" if len(text) <= WIDTH else f"# {remark}:\n{text}"


def key(name: str) -> str:
    """A name as a key of TOML."""
    bare = all(c.isascii() and (c.isalnum() or c in "_-") for c in name)
    return name if name and bare else written(name)


def written(value: object) -> str:
    """A value as TOML has it.

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


def ends(limits: tuple[float, float]) -> str:
    """Limits as a table."""
    return f"{{lower = {written(limits[0])}, upper = {written(limits[1])}}}"
