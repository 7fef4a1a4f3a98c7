"""The log-likelihood of a random study by quadrature of its own: no code of Aleator computes it.

Of each experiment one standard normal variate, that which moves the outcome most, is cut into
cells, the others have equidistant points. Without noise each crossing of the outcome counts
phi(theta) / |d eta / d theta|; with normal noise of sd s a cell with the probability m and outcomes
between e0 and e1 counts m [Phi((y - e0) / s) - Phi((y - e1) / s)] / (e1 - e0).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import stats

from aleator.core.types import Array, Indices
from benchmarks.random_studies import RandomStudy

REACH = 8.5
"""Standard deviations that the cells cover."""
BLOCK = 2_000_000
"""Simulated outcomes at a time."""


@dataclass(frozen=True)
class Resolution:
    """Cells of one variate, and points of each other one, by the number of scattering parameters.

    The finer of the two that `judges` takes changes the log-likelihood by what it prints.
    """

    cells: tuple[int, ...] = (8000, 1200, 400, 160)
    points: tuple[int, ...] = (1, 81, 25, 13)

    def of(self, scattering: int) -> tuple[int, int]:
        """Cells and points where so many parameters scatter."""
        return self.cells[scattering - 1], self.points[scattering - 1]

    @property
    def coarser(self) -> Resolution:
        """Two thirds of the cells and points."""
        return Resolution(
            tuple(2 * c // 3 for c in self.cells), tuple(max(1, 2 * p // 3) for p in self.points)
        )


@dataclass(frozen=True)
class Reference:
    """log L(alpha) of a study and its table."""

    study: RandomStudy
    table: pd.DataFrame
    resolution: Resolution = Resolution()

    def __call__(self, alpha: Mapping[str, float]) -> float:
        """The total, minus infinity where an outcome is out of reach."""
        return float(self.each(alpha).sum())

    def each(self, alpha: Mapping[str, float]) -> Array:
        """The logarithms (N,) of the densities."""
        s = len(self.study.scattering)
        along = self._most_moving(alpha)
        cells, points = self.resolution.of(s)
        edges = np.linspace(-REACH, REACH, cells + 1)
        right = edges[:-1] >= 0.0
        mass = np.where(
            right, -np.diff(stats.norm.sf(edges)), np.diff(stats.norm.cdf(edges))
        )  # fmt: skip
        grids = [np.linspace(-7.0, 7.0, points)] * (s - 1)
        others = np.stack([g.ravel() for g in np.meshgrid(*grids)]) if s > 1 else np.zeros((0, 1))
        weights = np.exp(-0.5 * np.sum(others**2, axis=0))
        weights = weights / weights.sum()
        kept = weights > 1e-13
        density = np.zeros(len(self.table))
        for k in np.unique(along).tolist():
            theta = np.empty((s, int(kept.sum()), cells + 1))
            theta[k] = edges
            theta[np.arange(s) != k] = others[:, kept, None]
            rows = np.flatnonzero(along == k)
            density[rows] = self._densities(alpha, rows, theta, mass, weights[kept])
        with np.errstate(divide="ignore"):
            return np.log(density)

    def _parameters(self, alpha: Mapping[str, float], theta: Array) -> dict[str, Array]:
        """The parameters at standard normal variates (s, ...)."""
        study, by_name = self.study, dict(zip(self.study.scattering, theta, strict=True))
        if study.correlation is not None:
            first, second = study.correlated
            rho = alpha[f"correlation.{first}.{second}"]
            by_name[second] = rho * by_name[first] + np.sqrt(1.0 - rho**2) * by_name[second]
        return {
            name: marginal.values(by_name[name], alpha[f"{name}.mean"], alpha[f"{name}.sd"])
            if name in by_name
            else np.full(theta.shape[1:], alpha[f"{name}.value"])
            for name, marginal in study.marginals.items()
        }

    def _outcomes(self, rows: Indices, x: Mapping[str, Array]) -> Array:
        """Simulated outcomes of some experiments, which lead the array."""
        shape = (-1, *(1 for _ in next(iter(x.values())).shape))
        own = self.table.drop(columns="y").iloc[rows]
        conditions = {str(name): own[name].to_numpy().reshape(shape) for name in own}
        with np.errstate(all="ignore"):
            return np.asarray(
                self.study.simulator(**conditions, **{n: v[None] for n, v in x.items()})
            )

    def _most_moving(self, alpha: Mapping[str, float]) -> Indices:
        """The number (N,) of the variate that moves each outcome most, in the geometric mean."""
        s = len(self.study.scattering)
        everyone = np.arange(len(self.table))
        moved = np.zeros((s, len(self.table)))
        for k in range(s):
            theta = np.zeros((s, 10))
            theta[k] = np.add.outer([-2.0, -1.0, 0.0, 1.0, 2.0], [-0.3, 0.3]).ravel()
            y = self._outcomes(everyone, self._parameters(alpha, theta))
            steps = np.abs(np.diff(y, axis=1)[:, ::2])
            moved[k] = np.log(np.nan_to_num(steps) + 1e-12).sum(axis=1)
        return np.asarray(np.argmax(moved, axis=0))

    def _densities(self, alpha: Mapping[str, float], rows: Indices, theta: Array,
                   mass: Array, weights: Array) -> Array:  # fmt: skip
        x = self._parameters(alpha, theta)
        noise = None
        if self.study.noise is not None:
            noise = alpha.get("noise.sd", self.study.noise)
        size = max(1, BLOCK // theta[0].size)
        parts = []
        for start in range(0, len(rows), size):
            some = rows[start : start + size]
            eta = np.broadcast_to(self._outcomes(some, x), (len(some), *theta[0].shape))
            apart = eta - self.table["y"].to_numpy()[some, None, None]
            if noise is None:
                parts.append(_exact(apart, weights))
            else:
                parts.append(np.einsum("njc,j,c->n", _noisy(apart, noise), weights, mass))
        return np.concatenate(parts)


def _exact(apart: Array, weights: Array) -> Array:
    """Sums (n,) of phi(theta) / |d eta / d theta| where the outcome is crossed.

    Place by linear interpolation; slope by linear interpolation of central differences, and of the
    cell alone where neighbours have another slope by a fifth (a kink, a jump).
    """
    low, high = apart[..., :-1], apart[..., 1:]
    hit = np.isfinite(low) & np.isfinite(high) & ((low < 0.0) != (high < 0.0))
    hit[..., :1] = hit[..., -1:] = False
    n, j, c = np.nonzero(hit)
    before, first, second, after = (apart[n, j, c + k] for k in (-1, 0, 1, 2))
    width = 2.0 * REACH / (apart.shape[-1] - 1)
    share = first / (first - second)
    theta = -REACH + width * (c + share)
    chord = second - first
    slope = (1.0 - share) * (second - before) / 2.0 + share * (after - first) / 2.0
    with np.errstate(invalid="ignore"):
        bent = ~(np.maximum(np.abs(first - before - chord), np.abs(after - second - chord))
                 < 0.2 * np.abs(chord))  # fmt: skip
    slope = np.where(bent, chord, slope)
    density = stats.norm.pdf(theta) * width / np.abs(slope) * weights[j]
    return np.asarray(np.bincount(n, density, minlength=len(apart)), dtype=float)


def _noisy(apart: Array, sd: float) -> Array:
    """Mean density of the noise over each cell, its ends' difference by the nearer tail."""
    z = apart / sd
    low, high = z[..., :-1], z[..., 1:]
    tail = stats.norm.cdf(-np.abs(z))
    first, second = tail[..., :-1], tail[..., 1:]
    same = (low > 0.0) == (high > 0.0)
    share = np.where(same, np.abs(second - first), 1.0 - first - second)
    wide = np.abs(high - low)
    middle = 0.5 * (low + high)
    narrow = np.exp(-0.5 * middle**2) / np.sqrt(2.0 * np.pi)
    narrow = narrow * (1.0 + wide**2 / 24.0 * (middle**2 - 1.0))
    mean = np.where(wide < 0.05, narrow, share / np.where(wide < 0.05, 1.0, wide))
    return np.asarray(np.nan_to_num(mean / sd))
