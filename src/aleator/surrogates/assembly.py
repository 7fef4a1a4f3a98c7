"""Put the fitted surfaces together: one list of terms for all, and the range of each outcome."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from aleator.surrogates.points import fixed_shift, low_discrepancy
from aleator.surrogates.surface import Group, Surface
from aleator.types import Array, Indices

# A term is left out where all that is left out stays under this part of the error: it then adds
# half a percent to it (root of 1 + 0.1^2).
NEGLIGIBLE = 0.1
ROUNDING = 1e-14

Piece = tuple[Indices, Indices, Array]


def merged(pieces: Iterable[Piece], error: Array) -> tuple[Indices, tuple[Group, ...], Array]:
    """Return common indices (P, n), groups over its prefixes, and all coefficients (N, P).

    A piece holds experiments (A,), indices (Q, n) and coefficients (Q, A). Terms used by most
    experiments come first, so that the few large surfaces do not make everyone pay.
    """
    pieces = list(pieces)
    place: dict[tuple[int, ...], int] = {}
    thinned: list[Piece] = []
    for members, indices, coefficients in pieces:
        kept = _thinned(coefficients.T, error[members])
        used = np.flatnonzero((kept != 0.0).any(axis=0) | ~indices.any(axis=1))
        names = [tuple(nu) for nu in indices[used].tolist()]
        column = np.array([place.setdefault(nu, len(place)) for nu in names])
        thinned.append((members, column, kept[:, used]))
    terms = np.zeros((len(error), len(place)))
    for members, column, kept in thinned:
        terms[np.ix_(members, column)] = kept
    listed = np.array(list(place), dtype=np.intp).reshape(len(place), -1)
    order = np.lexsort((*listed.T, listed.sum(axis=1), -(terms != 0.0).sum(axis=0)))
    listed, terms = listed[order], terms[:, order]
    return listed, _groups(terms), terms


def _thinned(coefficients: Array, error: Array) -> Array:
    """Return coefficients (A, Q) with the smallest of each row set to zero."""
    level = np.abs(coefficients).max(axis=1)
    budget = np.maximum(NEGLIGIBLE * error, ROUNDING * level)
    order = np.argsort(np.abs(coefficients), axis=1)
    dropped = np.cumsum(np.take_along_axis(coefficients, order, axis=1) ** 2, axis=1)
    out = np.array(coefficients)
    small = np.take_along_axis(out, order, axis=1)
    small[dropped <= budget[:, None] ** 2] = 0.0
    np.put_along_axis(out, order, small, axis=1)
    return out


def _groups(terms: Array) -> tuple[Group, ...]:
    """Return groups of experiments (rows) that need about the same number of leading terms."""
    count = terms.shape[1]
    needed = count - np.argmax((terms != 0.0)[:, ::-1], axis=1)
    needed[~terms.any(axis=1)] = 1
    steps = np.unique(np.minimum(np.ceil(16.0 * 1.4 ** np.arange(40)), count)).astype(np.intp)
    size = steps[np.searchsorted(steps, needed)]
    members = [np.flatnonzero(size == step) for step in steps]
    return tuple(
        Group(rows, np.ascontiguousarray(terms[rows, :step]))
        for rows, step in zip(members, steps, strict=True)
        if len(rows)
    )


def degrees_of(indices: Indices, terms: Array, error: Array) -> Indices:
    """Return the degree (N, n) of each parameter beyond which all terms stay below the error."""
    out = np.zeros((len(terms), indices.shape[1]), dtype=np.intp)
    floor = np.maximum(error, ROUNDING * np.abs(terms).max(axis=1)) ** 2
    for i, degree in enumerate(indices.T):
        for d in range(int(degree.max(initial=0))):
            beyond = (terms[:, degree > d] ** 2).sum(axis=1)
            out[beyond > floor, i] = d + 1
    return out


def outcome_range(surface: Surface, outcomes: Array) -> tuple[Array, Array]:
    """Return the least and the largest outcome (N,) of each experiment over the box.

    From the runs (N, M), NaN where there is none, a search over 2048 points and the corners of the
    box, and a polish of the best of them that halves its step ten times.
    """
    n = len(surface.box)
    low, high = surface.box.T
    z = low_discrepancy(2048, n, fixed_shift(n))
    corners = 2.0 * (np.arange(2 ** min(n, 10))[:, None] >> np.arange(n) & 1) - 1.0
    x = low + 0.5 * (np.vstack([corners, z]) + 1.0) * (high - low)
    best = [np.fmin.reduce(outcomes, axis=1), -np.fmax.reduce(outcomes, axis=1)]
    start = [np.zeros((len(outcomes), n)), np.zeros((len(outcomes), n))]
    found = [np.full(len(outcomes), np.inf), np.full(len(outcomes), np.inf)]
    for part in range(0, len(x), 256):
        y = surface.evaluate(x[part : part + 256])
        for side, sign in enumerate((1.0, -1.0)):
            least = (sign * y).argmin(axis=1)
            value = sign * y[np.arange(len(y)), least]
            better = value < found[side]
            found[side][better], start[side][better] = value[better], x[part + least[better]]
    for side, sign in enumerate((1.0, -1.0)):
        polished = _polished(surface, start[side], found[side], sign)
        best[side] = np.fmin(best[side], polished)
    return best[0], -best[1]


def _polished(surface: Surface, x: Array, value: Array, sign: float) -> Array:
    """Return the least sign * outcome (N,) that a compass search from x (N, n) finds."""
    count, n = x.shape
    low, high = surface.box.T
    moves = np.vstack([np.eye(n), -np.eye(n)]) * (high - low)
    step = 0.04
    index = np.repeat(np.arange(count), len(moves))
    for _ in range(10):
        trial = np.clip(x[:, None] + step * moves, low, high)
        y = sign * surface.at(index, trial.reshape(-1, n)).reshape(count, -1)
        least = y.argmin(axis=1)
        rows = np.flatnonzero(y[np.arange(count), least] < value)
        value[rows], x[rows] = y[rows, least[rows]], trial[rows, least[rows]]
        step *= 0.5
    return value
