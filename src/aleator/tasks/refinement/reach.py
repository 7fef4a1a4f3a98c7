"""Outcomes that surfaces do not reach: whether the simulator itself does, and where.

An outcome is out of reach only if the simulator, sought by a maximizer from several starts all over
the laws' support, does not come to it. Surfaces that miss one by their own error get runs there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize
from scipy.stats import qmc

from aleator.laws.hyperparameter import limits_of
from aleator.laws.inputs import Inputs, law_region
from aleator.surrogates import AdaptiveSurfaces
from aleator.surrogates.axes import Axes, logarithms
from aleator.surrogates.responses import Run, moving_parameters
from aleator.tasks.region import hull, within
from aleator.types import Array, Indices


@dataclass(frozen=True)
class Reach:
    """How an outcome is sought on the simulator; measured by `benchmarks folds` (its valleys).

    An ascent from the point that the surface says is nearest, then one from each of the best
    `starts` of `looks` points of the support, each of at most `steps` runs a parameter. An outcome
    that is missed by less than the share `near` of all that the outcome changes is not taken to be
    out of reach. Surfaces get runs up to `rounds` times, drawn from the `draws` nearest of
    `candidates` points of the region.
    """

    looks: int = 32
    starts: int = 3
    steps: int = 60
    near: float = 1e-4
    rounds: int = 5
    candidates: int = 4096
    draws: int = 512

    def most(self, parameters: int) -> int:
        """Runs that an outcome is sought by, at most."""
        return self.looks + (1 + self.starts) * self.steps * parameters


REACH = Reach()


def support(inputs: Inputs) -> Array:
    """Where the laws of the admissible alphas have their mass, (n, 2): within the box."""
    lower, upper = (end[: inputs.size] for end in limits_of(inputs.hyperparameters))
    u = qmc.Sobol(max(inputs.size, 1), rng=0).random(REACH.looks)[:, : inputs.size]
    return within(inputs.box, law_region(inputs, [*(lower + u * (upper - lower)), lower, upper]))


def reached(
    run: Run, start: Array, condition: int, outcome: float, side: float, whole: Array
) -> Array | None:
    """A point (n,) where the simulator of a condition is at the outcome or beyond; None without.

    Beyond is above it if `side` is 1, and below it if -1. It is sought from `start` (n,) first;
    `whole` (n, 2) is the support of the parameters that move.
    """
    axes = Axes(whole, logarithms(whole))
    first = np.clip(axes.inward(start), -1.0, 1.0)
    best, farthest, seen = first, -np.inf, [outcome]

    def short(z: Array) -> float:
        """How far the outcome at z is from being reached; negative beyond."""
        nonlocal best, farthest
        inside = np.clip(z, -1.0, 1.0)
        y = float(run(np.array([condition]), axes.outward(inside[None]))[0])
        if not np.isfinite(y):
            return np.inf
        seen.append(y)
        if side * (y - outcome) > farthest:
            best, farthest = inside, side * (y - outcome)
        return -side * (y - outcome)

    def ended(*_: object) -> None:
        if farthest >= 0.0:
            raise StopIteration

    def ascend(z: Array) -> None:
        simplex = np.clip(z + np.vstack([np.zeros(z.size), 0.1 * np.eye(z.size)]), -1.0, 1.0)
        simplex[1:][np.all(simplex[1:] == z, axis=1)] -= 0.1
        optimize.minimize(
            short, z, method="Nelder-Mead", callback=ended,
            options={"initial_simplex": simplex, "maxfev": REACH.steps * z.size,
                     "xatol": 1e-5, "fatol": 1e-9 * max(np.ptp(seen), 1e-300)},
        )  # fmt: skip

    ascend(first)
    if farthest < 0.0:
        looks = 2.0 * qmc.Sobol(len(whole), rng=0).random(REACH.looks) - 1.0
        for z in looks[np.argsort([short(z) for z in looks])[: REACH.starts]]:
            if farthest < 0.0:
                ascend(z)
    missed = farthest < -REACH.near * np.ptp(seen)
    return None if missed else np.asarray(axes.outward(best[None])[0])


def sharpened(surfaces: AdaptiveSurfaces, lost: Indices, outcomes: Array) -> bool:
    """Whether conditions `lost` have more runs now, each where its surface is near its outcome."""
    members = np.isin(np.arange(surfaces.good.size), lost)
    granted = np.flatnonzero(surfaces.granted(members))
    for condition in granted.tolist():
        points, values = by_surface(surfaces, condition)
        away = np.abs(values - outcomes[lost == condition][:, None]).min(axis=0)
        surfaces.sharpen(
            np.arange(members.size) == condition, points[np.argsort(away)[: REACH.draws]]
        )
    return bool(granted.size)


def holding(region: Array, x: Array, box: Array) -> Array:
    """The region (n, 2), wider where a point x (moving,) lies outside: by half as much again."""
    moving = moving_parameters(region)
    wide = region.copy()
    inside = np.clip(x, *region[moving].T)
    wide[moving] = hull(region[moving], np.repeat((x + 0.5 * (x - inside))[:, None], 2, axis=1))
    return within(box, wide)


def spread(box: Array) -> Array:
    """Points (4096, n) all over a box (n, 2)."""
    axes = Axes(box, logarithms(box))
    return np.asarray(axes.outward(2.0 * qmc.Sobol(len(box), rng=0).random(REACH.candidates) - 1.0))


def by_surface(surfaces: AdaptiveSurfaces, condition: int) -> tuple[Array, Array]:
    """Points (4096, n) all over the region, and what the surface of a condition says there."""
    points = spread(surfaces.box)
    return points, surfaces.surface().take(np.array([condition])).evaluate(points)[0]
