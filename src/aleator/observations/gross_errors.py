"""Slips of the pen in a table: a wrong sign, a misplaced decimal point, a name used twice."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aleator.core.types import Array
from aleator.errors import count
from aleator.observations.experiments import Experiments


@dataclass(frozen=True)
class GrossErrorSettings:
    """Settings of the search for gross errors; chosen by judgement, and only notes follow.

    share: the largest share of values, or of experiments, that are questioned. If there are more,
    the outcome itself has both signs, or spans decades, or experiments differ in their rows. range:
    the ratio of the ends of a range about the median, in which all other values lie; a value times
    or over ten then leaves it, or nearly.
    """

    share: float = 0.1
    range: float = 10.0


GROSS_ERRORS = GrossErrorSettings()


def gross_errors(values: Array, settings: GrossErrorSettings = GROSS_ERRORS) -> dict[int, float]:
    """The indices of values (M,) that look like gross errors, each with the value that would fit.

    All but a tenth of the values lie within a decade about their median. The others are questioned
    if they lie among these with the other sign, or with the decimal point moved by one place. NaN
    is a value that is not known.

    >>> gross_errors(np.array([3.2, 4.4, 4.5, 5.1, 8.0, 7.9, 3.1, 3.6, 4.1, 4.2, -4.4]))
    {10: 4.4}
    >>> gross_errors(np.array([3.2, 44.0, 4.5, 5.1, 8.0, 7.9, 3.1, 3.6, 4.1, 4.2]))
    {1: 4.4}
    >>> gross_errors(np.array([0.1, 1.0, 10.0, 100.0])), gross_errors(np.array([-1.0, 1.0]))
    ({}, {})
    """
    known = values[np.isfinite(values)]
    median = float(np.median(known)) if known.size else 0.0
    if not median > 0.0:
        return {}
    half = settings.range**0.5
    with np.errstate(invalid="ignore"):
        usual = (values >= median / half) & (values <= median * half)
    odd = np.flatnonzero(np.isfinite(values) & ~usual)
    if odd.size > settings.share * known.size:
        return {}
    low, high = float(values[usual].min()), float(values[usual].max())
    found = {}
    for k in odd.tolist():
        right = [moved for moved in (-values[k], values[k] / 10.0, 10.0 * values[k])
                 if low <= moved <= high]  # fmt: skip
        if right:
            found[k] = float(f"{right[0]:.12g}")
    return found


@dataclass(frozen=True)
class Slip:
    """A measured `value` of a `response` that looks like a gross error; `fits` would fit.

    `place` says where it stands in the table.

    >>> str(Slip("line 5", "time", 37.4, 3.74))
    'line 5: time = 37.4, where 3.74 would lie among the others: a misplaced decimal point?'
    """

    place: str
    response: str
    value: float
    fits: float

    def __str__(self) -> str:
        what = "a wrong sign" if self.value == -self.fits else "a misplaced decimal point"
        return (
            f"{self.place}: {self.response} = {self.value:g}, where {self.fits:g} would lie among "
            f"the others: {what}?"
        )


def slips(places: Sequence[str], response: str, values: Array) -> list[Slip]:
    """The gross errors among the values (R,) of a response in the rows that stand at `places`."""
    return [
        Slip(places[row], response, float(values[row]), fits)
        for row, fits in gross_errors(values).items()
    ]


def slips_of(table: Experiments) -> list[Slip]:
    """The measured values that look like gross errors, in the unit of the outcome."""
    seen, found = table.observations, list[Slip]()
    places = [table.places[row] for row in seen.row.tolist()]
    exact = np.where(seen.lower == seen.upper, seen.lower, np.nan)
    for k, response in enumerate(seen.responses):
        values = response.transform.inverse(np.where(seen.response == k, exact, np.nan))
        found += slips(places, response.name, values)
    return found


def odd_repeats(
    names: Sequence[str], places: Sequence[str], settings: GrossErrorSettings = GROSS_ERRORS
) -> list[str]:
    """The experiments with another number of rows than all the others, in words; a tenth at most.

    `names` (R,) has the experiment of each row, and `places` (R,) where the row stands. A name that
    was copied or mistyped makes one experiment of two.

    >>> names = [f"S{k}" for k in range(12)]
    >>> odd_repeats([*names, "S4"], [f"line {k}" for k in range(2, 15)])
    ['S4 has 2 rows (line 6, line 14) where the others have 1: one experiment, or a typing error?']
    >>> odd_repeats(names, [f"line {k}" for k in range(2, 14)])
    []
    """
    rows = Counter(names)
    usual, _ = Counter(rows.values()).most_common(1)[0] if rows else (0, 0)
    odd = [name for name, size in rows.items() if size != usual]
    if len(odd) > settings.share * len(rows):
        return []
    found: dict[str, list[str]] = {name: [] for name in odd}
    for name, place in zip(names, places, strict=True):
        if name in found:
            found[name].append(place)
    return [
        f"{name} has {count(len(at), 'row')} ({', '.join(at)}) where the others "
        f"have {usual}: one experiment, or a typing error?"
        for name, at in found.items()
    ]
