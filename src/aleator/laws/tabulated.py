"""Parameters at very many standard normal variates, where no derivatives are wanted."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from aleator.laws.law import FARTHEST, Law, Tabulated
from aleator.laws.marginals import Normal
from aleator.types import Array

if TYPE_CHECKING:
    from aleator.laws.inputs import Inputs

KNOTS = 3041
"""Knots of a table, 1/160 apart."""
MANY = 4 * KNOTS
"""Variates from where on a table of the law costs less than the law at each of them."""
EXACT = 1e-9
"""Error between the knots, as a share of the distance between the quartiles, that is none."""
QUARTILE = 0.6745
"""The upper quartile of a standard normal variate."""


def image_at(inputs: Inputs, i: int, values: Array, theta: Array, *, often: bool = False) -> Array:
    """x(theta) of the law of parameter i at variates theta of any shape, as `law.standard` has it.

    Of very many by cubic Hermite interpolation, where between its knots that is as exact as a
    law can be told: a law whose quantile has kinks or runs off to infinity is asked itself. Beyond
    9.5, where there is no mass, x is that of 9.5. `often`, this law will be asked again and again.
    """
    law = _law(inputs, i)
    if isinstance(law, Normal):
        return np.asarray(values[0] + values[1] * np.clip(theta, -FARTHEST, FARTHEST))
    table = _table(inputs, i, values.tobytes()) if often or theta.size >= MANY else None
    if table is None:
        found = law.standard(values, theta.ravel())
        return np.asarray(found.x.reshape(theta.shape))
    return table(np.clip(theta, -FARTHEST, FARTHEST))


@lru_cache(maxsize=64)
def _table(inputs: Inputs, i: int, values: bytes) -> Tabulated | None:
    """The table of a law with these values (k,), or None where it would not be exact."""
    law, own, knots = _law(inputs, i), np.frombuffer(values), Tabulated.knots(KNOTS)
    middle = 0.5 * (knots[:-1] + knots[1:])
    with np.errstate(all="ignore"):
        found, between = law.standard(own, knots), law.standard(own, middle).x
        table = Tabulated(found.x, found.dtheta)
        quartiles = table(np.array([-QUARTILE, QUARTILE]))
        error = np.max(np.abs(table(middle) - between))
    exact = table.finite and error <= EXACT * (quartiles[1] - quartiles[0])
    return table if exact else None


def _law(inputs: Inputs, i: int) -> Law:
    return list(inputs.laws.values())[i]
