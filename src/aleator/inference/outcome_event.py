"""An event in the user's words, such as "travel > 26" or "20 < travel < 26 mm"."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from aleator.core.types import Array, Flags
from aleator.errors import InputsError, described, nearest
from aleator.inference.rare_events import Event
from aleator.observations.responses import Transform
from aleator.results.units import with_unit

_COMPARISON = re.compile(r"(<=|>=|<|>)")
_NUMBER = re.compile(r"(?P<number>[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?)\s*(?P<unit>.*)")
_REVERSED = str.maketrans("<>", "><")
_EXAMPLES = "write one as '{0} > 26', '{0} < 26' or '20 < {0} < 26'"


@dataclass(frozen=True)
class OutcomeEvent:
    """The event that an outcome lies between `low` and `high`, in its unit; an end may be infinite.

    `outcome` is the name of an outcome, or of a parameter, whose law has events as well.
    `ends_included` says whether the values `low` and `high` themselves are in the event.
    """

    outcome: str
    low: float
    high: float
    ends_included: tuple[bool, bool]

    @classmethod
    def of(
        cls,
        sentence: str,
        outcomes: Sequence[str],
        units: Mapping[str, str] | None = None,
        parameters: Sequence[str] = (),
    ) -> OutcomeEvent:
        """The event that a sentence states: an outcome or a parameter, and one or two comparisons.

        A comparison is ``<``, ``<=``, ``>`` or ``>=`` between its name and a number, which its unit
        may follow. A name in `outcomes` and in `parameters` is that of the outcome. Raises
        InputsError for any other sentence, for an unknown name, for another unit than that in
        `units`, and for an event that is empty.

        >>> OutcomeEvent.of("travel > 26 mm", ["travel"], {"travel": "mm"})
        OutcomeEvent(outcome='travel', low=26.0, high=inf, ends_included=(False, False))
        >>> OutcomeEvent.of("20 <= travel < 26", ["travel", "force"])
        OutcomeEvent(outcome='travel', low=20.0, high=26.0, ends_included=(True, False))
        """
        known = [*outcomes, *parameters]
        names = {shown: name for name in known for shown in (name, with_unit(
            name, (units or {}).get(name)))}  # fmt: skip
        remedy = _EXAMPLES.format(next(iter(outcomes)))
        if not isinstance(sentence, str):
            raise InputsError(f"the event is {described(sentence)}, not a text", remedy)
        terms = [part.strip() for part in _COMPARISON.split(sentence)]
        if len(terms) not in (3, 5) or not all(terms):
            raise InputsError(f"the event '{sentence}' has no comparison, or too many", remedy)
        reverse = len(terms) == 5 or (terms[0] not in names and _NUMBER.fullmatch(terms[0]))
        told = terms[2] if reverse else terms[0]
        if told not in names:
            beside = f"; the parameters are {', '.join(parameters)}" if parameters else ""
            raise InputsError(
                f"the event '{sentence}': there is no outcome '{told}'"
                f"{' and no such parameter' if parameters else ''}{nearest(told, known)}",
                f"the outcomes are {', '.join(outcomes)}{beside}; {remedy}",
            )
        outcome = names[told]
        # Each comparison with the outcome on its left side: "20 < travel" is "travel > 20".
        compared = [(terms[1].translate(_REVERSED), terms[0])] if reverse else []
        compared += [] if len(terms) == 3 and reverse else [(terms[-2], terms[-1])]
        if len({sign[0] for sign, _ in compared}) < len(compared):
            raise InputsError(f"the event '{sentence}' is not one range of values", remedy)
        low, high, included = -np.inf, np.inf, [False, False]
        for sign, term in compared:
            value = _value(term, sentence, outcome, (units or {}).get(outcome))
            if sign[0] == ">":
                low, included[0] = value, sign == ">="
            else:
                high, included[1] = value, sign == "<="
        if not low < high:
            raise InputsError(
                f"the event '{sentence}': nothing lies between {low:g} and {high:g}",
                "give the lower value first",
            )
        return cls(outcome, low, high, (included[0], included[1]))

    def on(self, transform: Transform) -> Event:
        """The event of the transformed outcome, on the scale of the likelihood.

        Raises InputsError for an end that is not positive if the transform is "log".
        """
        for end in (self.low, self.high):
            if transform is Transform.LOG and np.isfinite(end) and end <= 0.0:
                raise InputsError(
                    f"the event has an end at {end:g}, and the likelihood sees the logarithm of "
                    f"{self.outcome}",
                    "give a positive number: all outcomes are above zero",
                )
        low, high = self._ends(transform)
        # An `Event` is an open interval: an end that belongs to it is moved by one rounding.
        return Event((
            (np.nextafter(low, -np.inf) if self.ends_included[0] else low,
             np.nextafter(high, np.inf) if self.ends_included[1] else high),
        ))  # fmt: skip

    def met_by(self, lower: Array, upper: Array, transform: Transform) -> tuple[Flags, Flags]:
        """Which measured values (M,) are in the event, and of which their bounds leave it open.

        The bounds `lower` and `upper` are on the scale of the likelihood; equal ones are an exact
        value. What is known by bounds only does not lie on them.

        >>> runs, stopped = np.array([3.0, 5.0, 5.0, 2.0]), np.array([3.0, 5.0, np.inf, np.inf])
        >>> event = OutcomeEvent.of("life > 5", ["life"])
        >>> [each.tolist() for each in event.met_by(runs, stopped, Transform.NONE)]
        [[False, False, True, False], [False, False, False, True]]
        """
        low, high = self._ends(transform)
        exact = lower == upper
        within = (lower >= low) & (upper <= high) & ~exact
        without = (upper <= low) | (lower >= high)
        met = within | (exact & self.on(transform).holds(lower))
        return met, ~(exact | within | without)

    def _ends(self, transform: Transform) -> tuple[float, float]:
        ends = (self.low, self.high)
        low, high = (float(transform(end)) if np.isfinite(end) else end for end in ends)
        return low, high

    def __str__(self) -> str:
        signs = ["<=" if included else "<" for included in self.ends_included]
        low, high = (f"{end:.15g}" for end in (self.low, self.high))
        if np.isinf(self.low):
            return f"{self.outcome} {signs[1]} {high}"
        if np.isinf(self.high):
            return f"{self.outcome} {signs[0].replace('<', '>')} {low}"
        return f"{low} {signs[0]} {self.outcome} {signs[1]} {high}"


def _value(term: str, sentence: str, outcome: str, unit: str | None) -> float:
    """The number of a term in the unit of the outcome; InputsError for another unit."""
    found = _NUMBER.fullmatch(term)
    comma = found is not None and found["unit"].startswith(",")
    if found is None or comma or not np.isfinite(float(found["number"])):
        raise InputsError(
            f"the event '{sentence}': '{term}' is no number",
            "write a decimal point" if comma else "write a number, as 26 or 2.6e1",
        )
    if found["unit"] and found["unit"] != unit:
        has = f"the unit of {outcome} is {unit}" if unit else f"{outcome} has no unit"
        raise InputsError(
            f"the event '{sentence}': '{found['unit']}' after {found['number']}, and {has}",
            f"write the number in the unit of {outcome}; nothing is converted",
        )
    return float(found["number"])
