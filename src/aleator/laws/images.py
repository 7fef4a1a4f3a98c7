"""The image of very many standard normal variates under a law, by a table of the law."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from scipy import special

from aleator.core.types import Array
from aleator.laws.law import NUMERICS, Law, Tabulated
from aleator.laws.marginals import Normal


@dataclass(frozen=True)
class Images:
    """Settings for mapping very many standard normal variates to parameters by a table of the law.

    The values are chosen by tests/laws/test_images.py. knots: the number of knots of the table,
    which are 1/160 apart. worth: the table is made for at least this number of variates per knot,
    because it costs less from there on. exact: the largest error between knots that is accepted,
    relative to the distance between the law's quartiles. region: the probability left out at either
    end of the region of a law; for a normal law the region then ends at 5.2 sds.
    """

    knots: int = 3041
    worth: int = 4
    exact: float = 1e-9
    region: float = 1e-7


IMAGES = Images()


class Marginals(Protocol):
    """The interface that gives the law of parameter i: the part of `Inputs` that is used here."""

    def law(self, i: int) -> Law:
        """The law of parameter i."""

    def __hash__(self) -> int:
        """A hash, by which a table is found again."""


def image_at(
    inputs: Marginals, i: int, values: Array, theta: Array, *, often: bool = False
) -> Array:
    """The parameter x(theta) of the law of parameter i at variates theta of any shape.

    For very many variates x is interpolated in a table (cubic Hermite) if that is as exact as the
    law itself. A law whose quantile function has kinks or is infinite is evaluated directly.
    Variates beyond 9.5, where there is no probability, count as 9.5. `often` says that this law
    will be evaluated many times, so that a table is worth its cost.
    """
    law = inputs.law(i)
    if isinstance(law, Normal):
        return np.asarray(
            values[0] + values[1] * np.clip(theta, -NUMERICS.farthest, NUMERICS.farthest)
        )
    table = (
        _table(inputs, i, values.tobytes())
        if often or theta.size >= IMAGES.worth * IMAGES.knots
        else None
    )
    if table is None:
        found = law.standard(values, theta.ravel())
        return np.asarray(found.x.reshape(theta.shape))
    return table(np.clip(theta, -NUMERICS.farthest, NUMERICS.farthest))


@lru_cache(maxsize=64)
def _table(inputs: Marginals, i: int, values: bytes) -> Tabulated | None:
    """The table of a law with these values (k,), or None where a table would not be exact."""
    law, own, knots = inputs.law(i), np.frombuffer(values), Tabulated.knots(IMAGES.knots)
    middle = 0.5 * (knots[:-1] + knots[1:])
    with np.errstate(all="ignore"):
        found, between = law.standard(own, knots), law.standard(own, middle).x
        table = Tabulated(found.x, found.dtheta)
        quartiles = table(special.ndtri(np.array([0.25, 0.75])))
        error = np.max(np.abs(table(middle) - between))
    exact = table.finite and error <= IMAGES.exact * (quartiles[1] - quartiles[0])
    return table if exact else None
