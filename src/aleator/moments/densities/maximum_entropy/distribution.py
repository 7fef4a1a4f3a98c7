"""Distribution function of a maximum-entropy density and its inverse, on t in [-1, 1]."""

from __future__ import annotations

import numpy as np

from aleator.laws.law import invert
from aleator.moments.densities.interface import Codes
from aleator.moments.densities.maximum_entropy.dual import node_probabilities
from aleator.moments.densities.maximum_entropy.legendre import panel_edges
from aleator.moments.densities.maximum_entropy.solution import PANELS, Solution
from aleator.types import Array

_LARGEST_BATCH = 1_000_000
"""Exponentials evaluated at once."""


def log_density(solution: Solution, t: Array) -> Array:
    """Logarithm of the density by dt/2 at t (N, ...), by the recurrence of the polynomials."""
    multipliers = solution.multipliers
    shape = (-1, *[1] * (t.ndim - 1))
    below, here = np.ones_like(t), t
    total = np.broadcast_to(-solution.log_z.reshape(shape), t.shape)
    for k in range(1, multipliers.shape[1] + 1):
        total = total + np.sqrt(2.0 * k + 1.0) * multipliers[:, k - 1].reshape(shape) * here
        below, here = here, ((2 * k + 1) * t * here - k * below) / (k + 1)
    return total


def cumulative(solution: Solution, t: Array) -> Array:
    """Probability of [-1, t] for t (N, G): whole panels, and Gauss-Legendre on the broken one."""
    below = _below_panels(solution)
    panel = np.clip(np.searchsorted(panel_edges(PANELS), t, side="right") - 1, 0, PANELS - 1)
    value = np.take_along_axis(below, panel, axis=1) + _part(solution, panel, t)
    return np.clip(value, 0.0, 1.0)


def inverse(solution: Solution, p: Array) -> Array:
    """t (N, G) with probability p (N, G) below it.

    The panel by bisection, then Newton's method within it. Cost: some six evaluations of the cdf.
    """
    columns = max(1, _LARGEST_BATCH // (_part_nodes(solution) * max(1, p.shape[0])))
    t = np.empty(p.shape)
    for first in range(0, p.shape[1], columns):
        part = slice(first, first + columns)
        t[:, part] = _inverse(solution, p[:, part])
    return t


def _inverse(solution: Solution, p: Array) -> Array:
    below = _below_panels(solution)
    panel = _panel_of(below, p)
    wanted = p - np.take_along_axis(below, panel, axis=1)
    low, high = panel_edges(PANELS)[panel], panel_edges(PANELS)[panel + 1]
    t = invert(
        lambda t: _part(solution, panel, t),
        lambda t: 0.5 * np.exp(log_density(solution, t)),
        wanted,
        low,
        high,
    )
    return np.where(p <= 0.0, -1.0, np.where(p >= 1.0, 1.0, t))


def _below_panels(solution: Solution) -> Array:
    """Probability below each edge of the panels, (N, PANELS+1)."""
    probability = node_probabilities(solution.multipliers, solution.log_z, solution.check)
    masses = probability.reshape(probability.shape[0], PANELS, -1).sum(axis=2)
    below = np.zeros((masses.shape[0], PANELS + 1))
    np.cumsum(masses, axis=1, out=below[:, 1:])
    return below


def _panel_of(below: Array, p: Array) -> Codes:
    """Panel (N, G) whose probability range holds p, by bisection of its number."""
    panel = np.zeros(p.shape, dtype=np.int64)
    step = PANELS // 2
    while step:
        further = np.take_along_axis(below, panel + step, axis=1) <= p
        panel = np.where(further, panel + step, panel)
        step //= 2
    return panel


def _part(solution: Solution, panel: Codes, t: Array) -> Array:
    """Probability between the left edge of the panel and t, (N, G)."""
    x, w = np.polynomial.legendre.leggauss(_part_nodes(solution))
    left = panel_edges(PANELS)[panel]
    width = t - left
    points = left[..., None] + 0.5 * width[..., None] * (x + 1.0)
    return 0.25 * width * (np.exp(log_density(solution, points)) @ w)


def _part_nodes(solution: Solution) -> int:
    return solution.check.nodes.size // PANELS + 2
