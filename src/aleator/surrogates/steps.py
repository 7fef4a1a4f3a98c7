"""Where an outcome jumps as a parameter changes, or is so steep that no polynomial follows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from aleator.surrogates.axes import Axes
from aleator.surrogates.samples import Samples
from aleator.types import Array, Indices

NEAR = 0.1
"""Distance of two runs, over the widths of the region, to which an outcome is looked at."""
LARGE = 0.05
"""Difference of two outcomes, over the range of all of that experiment, that may be a step."""
CLOSE, WIDE, AS_MUCH = 0.4, 0.8, 1.5
"""Shares of NEAR within which runs are close, and beyond which they are wide apart; and how many
times as much a smooth outcome differs over the wider distance, at least."""


@dataclass(frozen=True)
class Step:
    """The largest difference `size` of two outcomes of `surface` at points (n,) near each other."""

    surface: int
    size: float
    here: Array
    there: Array


def steps(samples: Samples, box: Array, members: Indices) -> tuple[Step, ...]:
    """The step of each surface among `members` (A,) that has one, by its runs in the box (n, 2).

    Between runs that are close a smooth outcome differs by less than between those wide apart. One
    that jumps differs as much; so does a front as steep as that. Cost: all pairs of near points,
    for each member.

    >>> x = np.linspace(0.0, 1.0, 201)[:, None]
    >>> made = Samples(x, np.stack([x[:, 0] > 0.5, x[:, 0]]).astype(float), np.ones((2, 201), bool))
    >>> [(step.surface, step.size, step.here.round(3).tolist(), step.there.round(3).tolist())
    ...  for step in steps(made, np.array([[0.0, 1.0]]), np.arange(2))]
    [(0, 1.0, [0.5], [0.505])]
    """
    inside = samples.inside(box)
    z = Axes.plain(box).inward(inside.x)
    pairs = KDTree(z).query_pairs(NEAR, output_type="ndarray")
    distance = np.linalg.norm(z[pairs[:, 0]] - z[pairs[:, 1]], axis=1)
    order = np.argsort(distance)
    pairs, distance = pairs[order], distance[order]
    close, wide = pairs[distance < CLOSE * NEAR], pairs[distance > WIDE * NEAR]
    found = (_step(int(member), inside, close, wide) for member in members)
    return tuple(step for step in found if step is not None)


def _step(member: int, samples: Samples, close: Indices, wide: Indices) -> Step | None:
    """That of one surface between close points, pairs (P, 2) with the closest first."""
    y = samples.outcome[member]
    known = np.isfinite(y)
    if not known.any():
        return None
    most = np.zeros(y.size)
    apart = np.nan_to_num(np.abs(y[wide[:, 0]] - y[wide[:, 1]]))
    for end in wide.T:
        np.maximum.at(most, end, apart)
    size = np.abs(y[close[:, 0]] - y[close[:, 1]])
    beyond = np.maximum(most[close[:, 0]], most[close[:, 1]])
    large = size > LARGE * np.ptp(y[known])
    rows = np.flatnonzero(large & (beyond > 0.0) & (beyond < AS_MUCH * size))
    if not rows.size:
        return None
    low, high = sorted(close[rows[0]], key=lambda i: tuple(samples.x[i]))
    return Step(member, abs(float(y[high] - y[low])), samples.x[low], samples.x[high])
