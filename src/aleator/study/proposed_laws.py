"""Which parameters of a simulator get a law in a first study, and between which limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from aleator.errors import SimulatorError, nearest
from aleator.study.offers import Offer, SimulatorInput
from aleator.study.roles import Roles

Limits = tuple[float, float]

FACTOR = 3.0
"""The box of a parameter reaches from its nominal value over this to this many times it."""
EXPERIMENTS = 10
"""Experiments for each law that is proposed, half as many where they have several rows."""
MOST = 3
"""Laws that are proposed at most."""


@dataclass(frozen=True)
class Proposed:
    """One parameter: `scatters` with limits, or a constant at `value`; None has to be filled in.

    `nominal` is what the limits were made of; None where the user gave them.
    """

    given: SimulatorInput
    scatters: bool
    limits: Limits | None = None
    value: float | None = None
    nominal: float | None = None

    @property
    def name(self) -> str:
        """The parameter's name."""
        return self.given.name

    @property
    def complete(self) -> bool:
        """Whether nothing is left to be filled in."""
        return self.limits is not None or (not self.scatters and self.value is not None)


def parameters_of(
    offer: Offer,
    roles: Roles,
    most: int,
    chosen: Mapping[str, Limits | float | None],
) -> tuple[tuple[Proposed, ...], tuple[SimulatorInput, ...]]:
    """The parameters, and what keeps the value that the simulator gives it.

    Those `chosen` scatter between their limits, or, where these are None, about the nominal value;
    a number makes a constant. Where none is chosen it is those without a default value, else all
    that have a nominal value, but `most` at most. What has no default and does not scatter is a
    constant. Raises SimulatorError for a name that the simulator does not take.
    """
    free = [each for each in offer.given if each.name not in roles.conditions]
    known = {each.name for each in free}
    for name in chosen:
        if name not in known:
            raise SimulatorError(
                f"the simulator takes no parameter '{name}'{nearest(name, known)}",
                f"it takes {', '.join(sorted(known)) or 'no parameter'}",
            )
    laws = [name for name, value in chosen.items() if not isinstance(value, float)]
    laws = laws or [each.name for each in _scattering(free, most) if each.name not in chosen]
    taken = [each for each in free if each.name in (*laws, *chosen) or each.required]
    if not taken:
        raise SimulatorError(
            "nothing is left to be identified: every argument of the simulator is a column",
            "give it an argument for each unknown parameter, or leave a column out",
        )
    return (
        tuple(_proposed(each, each.name in laws, chosen.get(each.name)) for each in taken),
        tuple(each for each in free if each not in taken),
    )


def laws_for(experiments: int, rows: int) -> int:
    """How many laws are proposed at most.

    >>> laws_for(10, 10), laws_for(18, 180), laws_for(108, 108)
    (1, 3, 3)
    """
    each = EXPERIMENTS if experiments == rows else EXPERIMENTS // 2
    return min(max(experiments // each, 1), MOST)


def around(given: SimulatorInput) -> Limits | None:
    """Limits of a factor of three about the nominal value, within those that an FMU states.

    >>> around(SimulatorInput("stiffness", 2.0)), around(SimulatorInput("offset", 0.0))
    ((0.67, 6.0), None)
    """
    if not given.nominal:
        return None
    ends = (given.nominal / FACTOR, given.nominal * FACTOR)
    low, high = sorted(float(f"{end:.2g}") for end in ends)
    low = low if given.lower is None else max(low, given.lower)
    high = high if given.upper is None else min(high, given.upper)
    return (low, high) if low < high else None


def _scattering(free: Sequence[SimulatorInput], most: int) -> list[SimulatorInput]:
    """Those that a law is proposed for."""
    required = [each for each in free if each.required]
    return (required or [each for each in free if around(each)] or [*free])[:most]


def _proposed(given: SimulatorInput, scatters: bool, asked: Limits | float | None) -> Proposed:
    if not scatters:
        return Proposed(given, False, value=asked if isinstance(asked, float) else given.nominal)
    if isinstance(asked, tuple):
        return Proposed(given, True, asked)
    return Proposed(given, True, around(given), nominal=given.nominal)
