"""The most probable points of a rare event, and samples about them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import optimize, special

from aleator.inference.decisions.event import Event
from aleator.types import Array

Response = Callable[[Array], tuple[Array, Array]]
"""u (D, d), standard normal variates -> outcomes (D,) and their gradients (D, d)."""

STARTS = 4
"""Points that each search begins at."""
APART = 0.5
"""Design points nearer to each other are one."""
LESS = 8.0
"""Half the difference of squared distances beyond which a design point counts for nothing."""
FEASIBLE = 1e-3
"""Share of the scatter by which an end of the event may be missed."""
STEPS = 60
WIDER = 1.2
"""Spread of the sample about a design point."""
LAW = 0.25
"""Share of the sample that is drawn from the law itself."""


def design_points(response: Response, event: Event, pilot: Array) -> Array:
    """The points (M, d) of an event that are nearest to the origin: of locally largest density.

    min |u|^2/2 with y(u) in the event, by sequential quadratic programming (Kraft, 1988) from the
    nearest of the `pilot` points (D, d) that are in each interval of it; where none is, from those
    whose outcome is nearest. Points that are too far to matter beside the nearest are left out.
    None where no interval is reached. The first-order approximation of the probability
    is Phi(-|u|) (Hasofer and Lind, 1974).
    """
    y = response(pilot)[0]
    known = np.isfinite(y)
    scatter = float(np.std(y[known])) if known.any() else 0.0
    if not scatter > 0.0:
        return np.empty((0, pilot.shape[1]))
    found = []
    for low, high in event.parts:
        missed = np.maximum(low - y, 0.0) + np.maximum(y - high, 0.0)
        length = 0.5 * np.sum(pilot**2, axis=1)
        cost = np.where(known, length + 100.0 * missed / scatter, np.inf)
        for start in _separate(pilot, cost):
            end = _nearest(response, low, high, scatter, start)
            if end is not None:
                found.append(end)
    return kept_points(np.array(found).reshape(-1, pilot.shape[1]))


def kept_points(points: Array) -> Array:
    """Those that matter, the nearest first; of those that are one, the nearest."""
    length = 0.5 * np.sum(points**2, axis=1)
    chosen: list[int] = []
    for k in np.argsort(length).tolist():
        if length[k] > length.min() + LESS:
            break
        if all(np.linalg.norm(points[k] - points[m]) > APART for m in chosen):
            chosen.append(k)
    return points[chosen]


def about(centers: Array, points: Array) -> tuple[Array, Array]:
    """Points (J, d) about centers (M, d), and weights (J,): the density of the law over theirs.

    Of standard normal `points` (J, d + 1) the last coordinate chooses a center: a quarter stays as
    it is (defensive importance sampling, Hesterberg, 1995); the others are moved to the
    centers, the nearer ones more often.
    """
    normal, d = points[:, :-1], points.shape[1] - 1
    length = 0.5 * np.sum(centers**2, axis=1)
    share = np.exp(-0.5 * (length - length.min()))
    share = (1.0 - LAW) * share / share.sum()
    reached = np.cumsum(share)
    owner = np.searchsorted(reached, special.ndtr(points[:, -1]))
    moved = owner < len(centers)
    u = normal.copy()
    u[moved] = centers[owner[moved]] + WIDER * normal[moved]
    log_law = -0.5 * np.sum(u**2, axis=1)
    parts = [np.log(LAW) + log_law]
    for center, one in zip(centers, share.tolist(), strict=True):
        away = np.sum((u - center) ** 2, axis=1) / WIDER**2
        parts.append(np.log(one) - 0.5 * away - d * np.log(WIDER))
    return u, np.exp(log_law - np.logaddexp.reduce(parts, axis=0))


def _separate(pilot: Array, cost: Array) -> list[Array]:
    """The pilot points of least cost that are apart."""
    chosen: list[Array] = []
    for k in np.argsort(cost).tolist():
        if len(chosen) == STARTS or not np.isfinite(cost[k]):
            break
        if all(np.linalg.norm(pilot[k] - other) > 3.0 * APART for other in chosen):
            chosen.append(pilot[k])
    return chosen


def _nearest(
    response: Response, low: float, high: float, scatter: float, start: Array
) -> Array | None:
    """The point that the search ends at, if it is in the event."""

    def asked(u: Array) -> tuple[float, Array]:
        y, slope = response(u[None])
        return float(y[0]) / scatter, slope[0] / scatter

    ends = [(sign, end / scatter) for sign, end in ((1.0, low), (-1.0, high)) if np.isfinite(end)]
    limits = [
        {
            "type": "ineq",
            "fun": lambda u, s=sign, e=end: np.nan_to_num(s * (asked(u)[0] - e), nan=-1e3),
            "jac": lambda u, s=sign: np.nan_to_num(s * asked(u)[1]),
        }
        for sign, end in ends
    ]
    found = optimize.minimize(
        lambda u: 0.5 * float(u @ u), start, jac=lambda u: u, method="SLSQP",
        constraints=limits, options={"maxiter": STEPS, "ftol": 1e-8},
    )  # fmt: skip
    y = asked(found.x)[0]
    missed = max([sign * (end - y) for sign, end in ends], default=0.0)
    return np.asarray(found.x) if missed <= FEASIBLE else None
