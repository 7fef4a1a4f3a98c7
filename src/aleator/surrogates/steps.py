"""Where an outcome jumps as a parameter changes, or is so steep that no polynomial follows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from aleator.surrogates.points import in_unit_box
from aleator.surrogates.samples import Samples
from aleator.types import Array, Indices

NEAR = 0.03
"""Distance of two runs, over the widths of the region, between which a smooth outcome is steady."""
STEEP, LARGE = 15.0, 0.05
"""Slope between them, in ranges of that experiment's outcomes over the width of the region, and
difference over that range, which make a step."""


@dataclass(frozen=True)
class Step:
    """The largest difference `size` of two outcomes of `surface` at points (n,) near each other."""

    surface: int
    size: float
    here: Array
    there: Array


def steps(samples: Samples, box: Array, members: Indices) -> tuple[Step, ...]:
    """The step of each surface among `members` (A,) that has one, by its runs in the box (n, 2).

    An outcome that is so STEEP between points so NEAR each other jumps, or is a front that no
    polynomial follows. Cost: all pairs of near points, for each member.

    >>> x = np.linspace(0.0, 1.0, 201)[:, None]
    >>> made = Samples(x, np.stack([x[:, 0] > 0.5, x[:, 0]]).astype(float), np.ones((2, 201), bool))
    >>> [(step.surface, step.size, step.here.round(3).tolist(), step.there.round(3).tolist())
    ...  for step in steps(made, np.array([[0.0, 1.0]]), np.arange(2))]
    [(0, 1.0, [0.5], [0.505])]
    """
    inside = samples.inside(box)
    z = in_unit_box(box, inside.x)
    pairs = KDTree(z).query_pairs(NEAR, output_type="ndarray")
    if not len(pairs):
        return ()
    distance = np.linalg.norm(z[pairs[:, 0]] - z[pairs[:, 1]], axis=1)
    found = []
    for member in members:
        y = inside.outcome[member]
        size = np.abs(y[pairs[:, 0]] - y[pairs[:, 1]])
        all_of_it = np.nanmax(y) - np.nanmin(y)
        large = np.flatnonzero((size > LARGE * all_of_it) & (size > STEEP * distance * all_of_it))
        if large.size:
            nearest = pairs[large[np.argmin(distance[large])]]
            low, high = sorted(nearest, key=lambda i: tuple(inside.x[i]))
            gap = abs(float(y[high] - y[low]))
            found.append(Step(int(member), gap, inside.x[low], inside.x[high]))
    return tuple(found)
