"""The density of an emulator's outcome, exact along lines through the variate's space.

f(y) = E[ sum over segments (P_b - P_a)/(eta_b - eta_a) (F((y - eta_a)/s) - F((y - eta_b)/s)) ]:
all variates but one are drawn, the one left is integrated out along its line, on which the outcome
is taken as linear in probability between neighboring points; F is the normal distribution of the
noise, a step where there is none, and there the densities of neighboring segments are joined by
straight lines. This is conditional Monte Carlo (Asmussen and Glynn, 2007, sec. V.4): nothing is
smoothed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.stats import qmc

from aleator.blocks import blocks
from aleator.inference.verification.choice import REPLICATES
from aleator.inference.verification.emulator import Emulator
from aleator.inference.verification.kernel import normal_pdf
from aleator.laws.inputs import Inputs
from aleator.types import Array, Indices

REACH = 7.5
"""End of a line in standard deviations of its variate."""
FINE = (32, 256), 1024
COARSE = (16, 64), 512
"""Lines of each copy and their segments, for several variates; segments of a single one.

Coarse ones are for derivatives, whose error matters less and is told too.
"""
NARROW = 0.3
"""A segment below this many standard deviations of noise is one point to the noise."""
LARGEST = 500_000
"""Outcomes on lines that are looked at once."""


@dataclass(frozen=True)
class Lines:
    """Points on lines along one variate: `x` (C, J, n) and `dx` (C, J, n, K), C copies of J points.

    `mass` (C, L, T) is the probability of each segment of the L lines, J = L (T + 1).
    """

    x: Array
    dx: Array
    mass: Array

    @property
    def coarseness(self) -> float:
        """Relative error h^2/12 of a normal density taken as constant over a distance h.

        That part of the error shifting the points does not average out.
        """
        segments = self.mass.shape[2]
        return (2.0 * REACH / segments) ** 2 / 12.0 if segments > 1 else 0.0


def drawn(
    inputs: Inputs,
    alpha: Array,
    along: int,
    rng: np.random.Generator,
    sizes: tuple[tuple[int, int], int] = FINE,
) -> Lines:
    """Lines along variate number `along` of the law alpha; without any variate a single point.

    The points of a line are shifted at random, so that their distance averages out, and the scatter
    of the copies tells what is left of it.
    """
    d = inputs.scattering
    if d == 0:
        x, dx = inputs.image(alpha, np.zeros((2, 0)))
        return Lines(x[None], dx[None], np.ones((1, 1, 1)))
    lines, segments = sizes[0] if d > 1 else (1, sizes[1])
    base = qmc.Sobol(d, rng=rng).random(lines)
    uniform = (base + rng.random((REPLICATES, 1, d))) % 1.0
    variate = np.zeros((REPLICATES, lines, segments + 1, d))
    variate += special.ndtri(np.clip(uniform, 1e-12, 1.0 - 1e-12))[:, :, None, :]
    t = np.linspace(-REACH, REACH, segments + 1)
    variate[..., along] = t + (uniform[:, :, along, None] - 0.5) * (t[1] - t[0])
    x, dx = inputs.image(alpha, variate.reshape(-1, d))
    shape = (REPLICATES, lines * (segments + 1), x.shape[1])
    mass = _probability(variate[..., along])
    return Lines(x.reshape(shape), dx.reshape(*shape, -1), mass)


def densities(
    emulator: Emulator, lines: Lines, x: Array, y: Array, sd: float, rows: Indices
) -> Array:
    """The density (N', C) of experiments `rows` (N',) at y (N',), noise of `sd` included.

    `x` (C, J, n) are the points of the lines, moved or not.
    """
    found = np.empty((rows.size, x.shape[0]))
    for part in blocks(rows.size, x.shape[1], LARGEST):
        for c, (copy, mass) in enumerate(zip(x, lines.mass, strict=True)):
            found[part, c] = _averaged(emulator.evaluate(copy, rows[part]), mass, y[part], sd)
    return found


def _probability(t: Array) -> Array:
    """Normal probability between neighboring points, kept in the tail that has its digits."""
    below = np.minimum(t, 0.0)
    above = np.maximum(t, 0.0)
    return np.asarray(np.diff(special.ndtr(below)) - np.diff(special.ndtr(-above)))


def _averaged(outcomes: Array, mass: Array, y: Array, sd: float) -> Array:
    """Mean over the lines of one copy: outcomes (N', J), mass (L, T)."""
    lines, segments = mass.shape
    path = outcomes.reshape(outcomes.shape[0], lines, segments + 1)
    a, b = path[..., :-1], path[..., 1:]
    total = _crossed(a, b, mass, y[:, None, None]) if sd == 0.0 else _blurred(a, b, mass, y, sd)
    return np.asarray(total / lines)


def _crossed(a: Array, b: Array, mass: Array, y: Array) -> Array:
    """Densities (N',) where lines cross y, summed over lines.

    Linear between the middles of neighboring segments, so that it moves smoothly with them, and
    constant from the middle of a segment to an end of a line or to a turn of the outcome.
    """
    middle = 0.5 * (a + b)
    before, after, node = middle[..., :-1], middle[..., 1:], b[..., :-1]
    low, high = np.minimum(before, after), np.maximum(before, after)
    at = np.nonzero((np.minimum(low, node) <= y) & (y <= np.maximum(high, node)))
    of, line, here = at
    there = of, line, here + 1
    first, second = (_density(a[i], b[i], mass[i[1:]]) for i in (at, there))
    level, before, after, node = y[of, 0, 0], before[at], after[at], node[at]
    along = ((b[at] > a[at]) == (b[there] > a[there])) & (after != before)
    share = (level - before) / np.where(along, after - before, 1.0)
    straight = np.where(_between(before, after, level), first + share * (second - first), 0.0)
    turned = first * _between(before, node, level) + second * _between(node, after, level)
    crossed = np.bincount(of, np.where(along, straight, turned), minlength=a.shape[0])
    ends = _density(a[..., 0], b[..., 0], mass[:, 0]) * _between(
        a[..., 0], middle[..., 0], y[..., 0]
    )
    ends += _density(a[..., -1], b[..., -1], mass[:, -1]) * _between(
        middle[..., -1], b[..., -1], y[..., 0]
    )
    return np.asarray(crossed + ends.sum(axis=1))


def _density(a: Array, b: Array, mass: Array) -> Array:
    """That of segments from a to b with this mass; zero where they have no width."""
    width = np.abs(b - a)
    return np.asarray(np.where(width > 0.0, mass / np.where(width > 0.0, width, 1.0), 0.0))


def _between(a: Array, b: Array, y: Array) -> NDArray[np.bool_]:
    return np.asarray((np.minimum(a, b) <= y) & (y < np.maximum(a, b)))


def _blurred(a: Array, b: Array, mass: Array, y: Array, sd: float) -> Array:
    """Means (N',) of Normal(y; Y, sd^2) for Y uniform between a and b, summed over lines."""
    middle, width = 0.5 * (a + b), np.abs(b - a) / sd
    u = (y[:, None, None] - middle) / sd
    density = normal_pdf(u)
    wide = width > NARROW
    # the far tail of a segment keeps its digits on the lower side
    low, half = -np.abs(u[wide]), 0.5 * width[wide]
    density[wide] = (special.ndtr(low + half) - special.ndtr(low - half)) / width[wide]
    narrow = ~wide
    density[narrow] *= 1.0 + (u[narrow] ** 2 - 1.0) * width[narrow] ** 2 / 24.0
    return np.asarray(np.sum(density * mass, axis=(1, 2)) / sd)
