"""Events and responses as a user names them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aleator.errors import InputsError, nearest
from aleator.inference.decisions.event import Event
from aleator.observations.responses import Transform
from aleator.tasks.decide.ground import Ground
from aleator.types import Indices


def responses_asked(ground: Ground, response: str | None) -> Indices:
    """The numbers of the response of that name, or of all. Raises InputsError where it is unknown.

    >>> from types import SimpleNamespace as Some
    >>> ground = Some(seen=Some(responses=(Some(name="force"), Some(name="wear"))))
    >>> responses_asked(ground, "wear").tolist(), responses_asked(ground, None).tolist()
    ([1], [0, 1])
    """
    names = [r.name for r in ground.seen.responses]
    # a table with one response may have been given without its name
    if response is None or names == [response] or len(names) == 1:
        return np.arange(len(names))
    if response not in names:
        raise InputsError(
            f"there is no response '{response}'{nearest(response, names)}",
            f"the responses are {', '.join(names)}",
        )
    return np.array([names.index(response)], dtype=np.intp)


def events_asked(
    ground: Ground,
    response: str | None,
    above: float | None,
    below: float | None,
    between: Sequence[float] | None,
) -> dict[int, Event]:
    """The event of one response by its number, as the likelihood sees its values.

    Raises InputsError unless one of the three is given, of one response, with ends that are
    numbers in order and have a logarithm where the likelihood sees that.
    """
    if sum(part is not None for part in (above, below, between)) != 1:
        raise InputsError(
            "the probability of which outcomes?",
            "give one of above, below and between, in the unit of the outcome",
        )
    which = responses_asked(ground, response)
    if which.size > 1:
        names = ", ".join(r.name for r in ground.seen.responses)
        raise InputsError(
            f"the probability of which response? There are {names}", "name one with response"
        )
    transform = ground.seen.responses[which[0]].transform
    low, high = between or (above, below)
    ends = _end(low, -np.inf, transform), _end(high, np.inf, transform)
    if not ends[0] < ends[1]:
        raise InputsError(f"between {low:g} and {high:g} lies nothing", "give the lower end first")
    return {int(which[0]): Event((ends,))}


def _end(value: float | None, other: float, transform: Transform) -> float:
    if value is None:
        return other
    if not np.isfinite(value):
        raise InputsError(f"an end at {value} is no number", "leave it out, or give a number")
    if transform is Transform.LOG and value <= 0.0:
        raise InputsError(
            f"an end at {value:g}, and the likelihood sees the logarithm of the outcome",
            "give a positive number: all outcomes are above zero",
        )
    return float(transform(value))
