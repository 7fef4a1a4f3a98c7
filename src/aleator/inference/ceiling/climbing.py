"""Local maxima of a function of a few variables from many starts at once."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from aleator.types import Array, Indices

Function = Callable[[Array], Array]
ROUNDS = 40
FINEST = 1e-6
"""Step at the end, over the width of the region."""
FARTHEST = 8.0
"""Steps that Newton's may be long."""


def climbed(function: Function, starts: Array, step: float) -> Array:
    """Points (P, s) of the unit cube uphill from `starts` (P, s), at local maxima.

    Each round asks for the function on a cross about every point, takes the best of the cross and
    of the top of its parabola, and makes the cross a quarter as wide where nothing is better.
    `function` gives (Q,) at points (Q, s). Cost: some 20 rounds of P (2 s^2 + 2) values.
    """
    s = starts.shape[1]
    cross = _cross(s)
    points, width = starts.copy(), np.full(len(starts), step)
    value = function(points)
    for _ in range(ROUNDS):
        moving = np.flatnonzero(width > FINEST)
        if not moving.size:
            break
        about = np.clip(points[moving, None] + width[moving, None, None] * cross, 0.0, 1.0)
        around = function(about.reshape(-1, s)).reshape(len(moving), -1)
        top = _top(points[moving], width[moving], value[moving], around)
        trial = np.concatenate([about, top[:, None]], axis=1)
        values = np.concatenate([around, function(top)[:, None]], axis=1)
        best = np.argmax(values, axis=1)
        rows = np.arange(len(moving))
        higher = values[rows, best] > value[moving]
        length = np.linalg.norm(trial[rows, best] - points[moving], axis=1)
        points[moving[higher]] = trial[rows, best][higher]
        value[moving[higher]] = values[rows, best][higher]
        near = ~higher | ((best == len(cross)) & (length < width[moving]))
        width[moving[near]] *= 0.25
    return points


def local_maxima(points: Array, value: Array, most: int) -> Indices:
    """Those of points (J, s) that are higher than their nearest ones, the highest first."""
    s = points.shape[1]
    nearest = (
        cKDTree(points).query(points, min(1 + 2 * s * s, len(points)))[1].reshape(len(points), -1)
    )
    found = np.flatnonzero(value >= value[nearest].max(axis=1))
    return found[np.argsort(-value[found], kind="stable")][:most]


def _cross(s: int) -> Array:
    """Steps (2 s^2, s) along each axis and along both diagonals of each two."""
    axes = np.eye(s)
    steps = [sign * axis for axis in axes for sign in (1.0, -1.0)]
    for i, j in combinations(range(s), 2):
        steps += [a * axes[i] + b * axes[j] for a in (1.0, -1.0) for b in (1.0, -1.0)]
    return np.array(steps)


def _top(points: Array, width: Array, value: Array, around: Array) -> Array:
    """The top of the parabola through each cross; where it has none, a step up the slope."""
    count, s = points.shape
    up, down = around[:, 0 : 2 * s : 2], around[:, 1 : 2 * s : 2]
    slope = 0.5 * (up - down)
    curvature = np.zeros((count, s, s))
    diagonal = np.arange(s)
    curvature[:, diagonal, diagonal] = up + down - 2.0 * value[:, None]
    for k, (i, j) in enumerate(combinations(range(s), 2)):
        pp, pm, mp, mm = around[:, 2 * s + 4 * k : 2 * s + 4 * k + 4].T
        curvature[:, i, j] = curvature[:, j, i] = 0.25 * (pp - pm - mp + mm)
    bent, axes = np.linalg.eigh(np.nan_to_num(curvature))
    along = np.einsum("pij,pi->pj", axes, np.nan_to_num(slope))
    flat = 1e-3 * np.max(np.abs(bent), axis=1, keepdims=True)
    # a step that is much too long is cut anyhow
    along /= np.maximum(np.maximum(np.abs(bent), flat), 1e-6 * np.abs(along) + 1e-300)
    step = np.einsum("pij,pj->pi", axes, along)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    step *= np.minimum(1.0, FARTHEST / np.maximum(length, 1e-300))
    return np.asarray(np.clip(points + width[:, None] * step, 0.0, 1.0))
