"""Where searches begin: what is known first, then points that fill the limits evenly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import qmc

from aleator.search.coordinates import Coordinates
from aleator.search.limits import outsized
from aleator.types import Array


def starting_points(
    coordinates: Coordinates, guesses: Sequence[Array], count: int, seed: int
) -> Array:
    """The hyperparameters' own start, the guesses, and scrambled Sobol' points: alphas (count, K).

    The first of more are the same. One that is given twice is one start.

    Points of a box that is a million times wider than every guess is large would all be far from
    anything: there they lie around the guesses instead, at distances of every size.
    """
    given = coordinates.filled(
        np.array([a[coordinates.free] for a in (coordinates.start, *guesses)])
    )
    known = given[np.sort(np.unique(given, axis=0, return_index=True)[1])]
    missing = count - len(known)
    if missing <= 0:
        return known[:count]
    # a start on a bound tells the search little: keep a twentieth away
    spread = 0.05 + 0.9 * evenly(coordinates.free.size, missing, seed)
    points = coordinates.to_alpha(spread)
    if guesses:
        centers = given[1:][np.arange(missing) % len(guesses)]
        free = _around(coordinates, given[1:], centers, points, spread)
        points = coordinates.filled(free)
    return np.concatenate([known, points])


def evenly(dimensions: int, count: int, seed: int) -> Array:
    """Scrambled Sobol' points (count, dimensions) of the unit cube.

    >>> evenly(2, 4, seed=0).round(0).sum(axis=0).tolist()  # two in either half
    [2.0, 2.0]
    """
    sobol = qmc.Sobol(dimensions, rng=np.random.default_rng(seed))
    return np.asarray(sobol.random_base2(int(np.ceil(np.log2(count))))[:count])


def _around(
    coordinates: Coordinates, guesses: Array, centers: Array, points: Array, spread: Array
) -> Array:
    """The points' free entries; those of wide linear limits at any distance from a center."""
    free, middle = points[:, coordinates.free], centers[:, coordinates.free]
    width = coordinates.upper - coordinates.lower
    size = np.max(np.abs(guesses[:, coordinates.free]), axis=0)
    wide = ~coordinates.log & outsized(width, size)
    nearest = 0.01 * np.where(wide, size, width)
    share = np.abs(2.0 * spread - 1.0)
    distance = nearest * (width / nearest) ** share * np.sign(spread - 0.5)
    return np.where(wide, middle + distance, free)
