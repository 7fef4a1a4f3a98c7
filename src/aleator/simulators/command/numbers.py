"""Numbers as programs write them."""

from __future__ import annotations

import math
import re

from aleator.simulators.failure import RunFailed


def finite(text: str, where: str) -> float:
    """A finite number as programs write it; Fortran's 1.0D+3 too. Raises RunFailed.

    >>> finite("1.5D+03", "result.txt")
    1500.0
    """
    value = number(text, where)
    if not math.isfinite(value):
        raise RunFailed(f"the outcome in '{where}' is {text}, which is not finite")
    return value


def number(text: str, where: str) -> float:
    """A number, finite or not: one of a series may be missing where nobody measured.

    >>> number("NaN", "result.txt")
    nan
    """
    try:
        # Python would take 1_000 for a number, which is no program's way of writing one.
        return float(re.sub(r"(?<=[\d.])[dD](?=[+-]?\d)", "e", text.replace("_", "?")))
    except ValueError:
        shown = f"'{text[:60]}'" if text else "empty"
        raise RunFailed(f"the outcome in '{where}' is {shown}, not a number") from None
