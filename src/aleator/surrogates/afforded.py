"""Which surfaces have more runs where a budget does not give all of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aleator.simulators import Account
from aleator.types import Array, Flags, Indices

Afforded = Callable[[Flags, Array, Array], Flags]
"""Of the members (N,), with their relative errors (N,) and the runs (N,) of a round: who has it."""

RESERVED = 2
"""Runs of each unit that a budget keeps for the check of the answer."""


def everyone(members: Flags, _relative: Array, _runs: Array) -> Flags:
    """All members: there is no budget."""
    return members


def within(account: Account, unit: Indices) -> Afforded:
    """The roughest, as many as the account has runs for; `unit` (N,) are those that run together.

    One run of a unit serves all its surfaces: its price is that of the dearest.
    """
    units, of = np.unique(unit, return_inverse=True)

    def afforded(members: Flags, relative: Array, runs: Array) -> Flags:
        price, need = np.zeros((2, units.size))
        np.maximum.at(price, of[members], runs[members])
        np.maximum.at(need, of[members], relative[members])
        asked = int(price.sum())
        given = account.given(asked, RESERVED * units.size)
        if given == asked:
            return members
        order = np.argsort(-need, kind="stable")
        chosen = np.zeros(units.size, dtype=np.bool_)
        chosen[order[np.cumsum(price[order]) <= given]] = True
        return np.asarray(members & chosen[of])

    return afforded
