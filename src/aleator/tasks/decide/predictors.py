"""What answers for the simulator where a law is known: itself, or surfaces about the law."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aleator.fit.regions import padded
from aleator.likelihood.individual import Direct, OnSurfaces, Predictor
from aleator.simulators import Runner
from aleator.surrogates import AdaptiveSurfaces, ResponseSurface
from aleator.surrogates.responses import moving_parameters
from aleator.surrogates.sites import Sites
from aleator.types import Array

LEVEL = 0.02
"""Estimated error of a surface over the scatter of its outcome."""
MOST = 512
"""Points of a law by which runs are placed and errors judged."""


def direct(runner: Runner, box: Array, region: Array) -> Predictor:
    """The simulator itself, with arrays where it takes them."""
    runner.takes_arrays(region)
    return Direct(runner, moving_parameters(box), box)


def about(
    runner: Runner,
    box: Array,
    x: Array,
    choice: ResponseSurface,
    ends: Array | None = None,
    tell: Callable[[int, int, int], None] | None = None,
) -> Predictor:
    """Surfaces that are exact where points x (D, n) of the law lie, and reach to `ends` (n, 2)."""
    region = padded(ends_of(x) if ends is None else ends, box)
    moving, sites = moving_parameters(region), Sites.seen(runner, runner.unit, runner.column)
    if not moving.size:
        return direct(runner, box, region)
    where = x[:: max(1, len(x) // MOST)][:, moving]
    run = sites.run(runner, region)
    surfaces = AdaptiveSurfaces(run, region[moving], len(sites), choice)
    surfaces.judge(where)
    surfaces.refine(where, LEVEL, tell)
    return OnSurfaces(surfaces.surface(), region, sites.of)


def ends_of(x: Array) -> Array:
    """The smallest region (n, 2) that holds points x (D, n)."""
    return np.stack([x.min(axis=0), x.max(axis=0)], axis=1)
