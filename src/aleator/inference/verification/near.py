"""Runs near the outcomes: where the emulator explains them, a few tell what it misses.

Of the points of a law only those tell of f(y) whose outcomes are near y. Many points are tried on
the emulator, which costs no run; some of them are drawn, with probabilities that follow what they
are likely to tell, and weighted by the inverse of these (Horvitz and Thompson, 1952). Two are drawn
in each of as many strata of equal probability, so that their differences tell the error (Cochran,
1977, sec. 5A.11).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.blocks import blocks
from aleator.inference.verification.emulator import Emulator
from aleator.inference.verification.kernel import Kernel
from aleator.laws.inputs import Inputs
from aleator.types import Array, Indices

EACH, FEWEST, VALUES = 512, 256, 10_000_000
"""Points that are tried on the emulator for each run, at least, and its outcomes in all."""
WIDE = 1.6
"""The second half of them is of a law with so many times the scatter, for outcomes far out."""
LAW = 0.125
"""Share of the runs that are drawn from the law, whatever the emulator says."""
BANDWIDTH = 0.25
"""That of the kernel of a correction, over the spread of the outcome under the law."""
REACH = 1.5
"""Widths of the kernel about an outcome in which the other runs are drawn."""
FEWEST_RUNS = 40
"""Runs of all experiments together, at least."""
TOGETHER = 1_000_000
"""Outcomes of candidates that are looked at together."""
SHARED = 8
"""Experiments of equal conditions have the runs of so many, at most, in common."""


@dataclass(frozen=True)
class Candidates:
    """Points of a law, tried on the emulator.

    `variate` (J, d) and `x` (J, n), `weight` (J,) of mean one, and `outcomes` (N, J).
    """

    variate: Array
    x: Array
    weight: Array
    outcomes: Array

    @cached_property
    def mean(self) -> Array:
        """(N,) the mean of the emulator's outcomes under the law."""
        return np.asarray(self.outcomes @ self.weight / self.weight.sum())

    @cached_property
    def scatter(self) -> Array:
        """(N,) their standard deviation."""
        square = [(self.outcomes[rows] - self.mean[rows, None]) ** 2 @ self.weight
                  for rows in self.blocks]  # fmt: skip
        return np.asarray(np.sqrt(np.concatenate(square) / self.weight.sum()))

    @property
    def blocks(self) -> list[slice]:
        """Experiments whose outcomes are looked at together."""
        return blocks(len(self.outcomes), self.weight.size, TOGETHER)

    def bandwidth(self, y: Array) -> Array:
        """(N,) that of the kernel about outcomes y (N,): narrower where the density falls fast."""
        scatter = self.scatter
        away = np.abs(y - self.mean)
        far = away / np.where(scatter > 0.0, scatter, np.inf)
        return np.asarray(BANDWIDTH * self._spread / np.maximum(1.0, 0.5 * far))

    @property
    def _spread(self) -> Array:
        """(N,) the scatter, or the scaled quartile range if smaller: that of one of two modes."""
        quartile = np.concatenate([self._quartiles(self.outcomes[rows]) for rows in self.blocks])
        return np.where(quartile > 0.0, np.minimum(self.scatter, quartile), self.scatter)

    def _quartiles(self, outcomes: Array) -> Array:
        """(B,) the scaled quartile range of some of the experiments."""
        order = np.argsort(outcomes, axis=1)
        below = np.cumsum(self.weight[order], axis=1) / self.weight.sum()
        rows = np.arange(len(order))
        low, high = (
            outcomes[rows, order[rows, np.argmax(below >= share, axis=1)]] for share in (0.25, 0.75)
        )
        return np.asarray((high - low) / 1.349)

    @property
    def steepest(self) -> Indices:
        """The variate (N,) with which each outcome is correlated most; 0 without any."""
        if self.variate.shape[1] == 0:
            return np.zeros(len(self.outcomes), dtype=np.intp)
        slope = [((self.outcomes[rows] - self.mean[rows, None]) * self.weight) @ self.variate
                 for rows in self.blocks]  # fmt: skip
        return np.asarray(np.argmax(np.abs(np.concatenate(slope)), axis=1))


@dataclass(frozen=True)
class Near:
    """Drawn points of G conditions and the m experiments that have them.

    `index` (m,) are the experiments, `group` (m,) the condition of each among these, `first` (G,)
    an experiment of each condition, `chosen` (G, R) the candidates, first one of each stratum and
    then the other, and `weight` (G, R): the mean of weighted values is that under the law.
    """

    index: Indices
    group: Indices
    first: Indices
    chosen: Indices
    weight: Array


def tried(
    emulator: Emulator, inputs: Inputs, alpha: Array, sizes: Indices, rng: np.random.Generator
) -> Candidates:
    """Candidates for experiments with so many runs (N,), see `sizes_of`.

    They are of the law and of a wider one, weighted as a mixture.
    """
    d = inputs.scattering
    most = max(FEWEST, min(EACH * int(sizes.max()), VALUES // sizes.size))
    size = 1 << (most.bit_length() - 1) if d else 1
    shift = rng.random(max(d, 1))
    uniform = (qmc.Sobol(max(d, 1), rng=rng).random(size) + shift)[:, :d] % 1.0
    variate = special.ndtri(np.clip(uniform, 1e-12, 1.0 - 1e-12))
    variate[size // 2 :] *= WIDE
    square = 0.5 * np.sum(variate**2, axis=1)
    wider = np.exp(np.minimum(square * (1.0 - WIDE**-2), 600.0)) / WIDE**d
    weight = 1.0 / (0.5 + 0.5 * wider)
    x = inputs.image(alpha, variate)[0]
    return Candidates(
        variate, x, weight / weight.mean(), emulator.evaluate(x, np.arange(sizes.size))
    )


def closeness(candidates: Candidates, kernel: Kernel, rows: Indices | slice) -> Array:
    """Weights (B, J) of candidates by how near their outcomes are, for some experiments."""
    away = kernel.y[rows, None] - candidates.outcomes[rows]
    away /= REACH * kernel.scale[rows, None]
    return np.asarray(np.exp(-0.5 * away**2) * candidates.weight)


def effective(candidates: Candidates, kernel: Kernel) -> Array:
    """(N,) how many candidates explain each outcome, by their closeness: (sum t)^2 / sum t^2."""
    found = []
    for rows in candidates.blocks:
        told = closeness(candidates, kernel, rows)
        squares = np.sum(told**2, axis=1)
        found.append(np.sum(told, axis=1) ** 2 / np.where(squares > 0.0, squares, 1.0))
    return np.concatenate(found)


def enough(relative: Array, most: int) -> int:
    """Runs an experiment, even, that errors of an emulator over the kernel's width (N,) ask for.

    The relative error of a density by R runs is about sqrt(0.6 / R) of that; the sum over the
    experiments is to be known to 0.1.

    >>> enough(np.full(100, 1e-4), 20), enough(np.full(100, 0.05), 20), enough(np.ones(3), 20)
    (2, 16, 20)
    """
    count = relative.size
    wanted = max(0.6 * float(np.sum(relative**2)) / 0.1**2, FEWEST_RUNS / count)
    return min(2 * max(1, math.ceil(0.5 * min(wanted, most))), most)


def sizes_of(condition: Indices, runs: int) -> Indices:
    """Runs (N,) that each experiment shares with those of its condition (N,): eight pay at most.

    >>> sizes_of(np.array([0, 1, 1, 2]), 20).tolist()
    [20, 40, 40, 20]
    """
    _, group, count = np.unique(condition, return_inverse=True, return_counts=True)
    return np.asarray(runs * np.minimum(count, SHARED)[group])


def drawn(
    candidates: Candidates,
    kernel: Kernel,
    condition: Indices,
    sizes: Indices,
    rng: np.random.Generator,
) -> Iterator[Near]:
    """Runs of all conditions (N,), as many as `sizes` says; those with equally many together."""
    first, group = np.unique(condition, return_index=True, return_inverse=True)[1:]
    for size in np.unique(sizes):
        some = np.flatnonzero(sizes[first] == size)
        index = np.flatnonzero(np.isin(group, some))
        own = np.searchsorted(some, group[index])
        parts = max(1, index.size * candidates.weight.size // TOGETHER)
        found = []
        for part in np.array_split(np.arange(some.size), min(parts, some.size)):
            inside = (part[0] <= own) & (own <= part[-1])
            chance = _chances(candidates, kernel, index[inside], own[inside] - part[0])
            outcomes = candidates.outcomes[first[some[part]]]
            chosen = _stratified(outcomes, chance, int(size), rng)
            found.append((chosen, np.take_along_axis(chance, chosen, axis=1)))
        chosen, picked = (np.concatenate(both) for both in zip(*found, strict=True))
        weight = candidates.weight[chosen] / (candidates.weight.size * picked)
        yield Near(index, own, first[some], chosen, weight)


def _chances(candidates: Candidates, kernel: Kernel, index: Indices, group: Indices) -> Array:
    """Of each candidate (G, J) to be drawn, for experiments (m,) whose conditions count G."""
    told = closeness(candidates, kernel, index)
    total = told.sum(axis=1, keepdims=True)
    told = np.divide(told, total, out=np.zeros_like(told), where=total > 0.0)
    mean = np.zeros((int(group.max()) + 1, told.shape[1]))
    np.add.at(mean, group, told)
    mean /= np.bincount(group)[:, None]
    law = 1.0 - (1.0 - LAW) * mean.sum(axis=1, keepdims=True)
    return np.asarray((1.0 - LAW) * mean + law * candidates.weight / candidates.weight.sum())


def _stratified(outcomes: Array, chance: Array, size: int, rng: np.random.Generator) -> Indices:
    """Candidates (G, R) by their chances (G, J), two in each stratum along the outcome."""
    order = np.argsort(outcomes, axis=1)
    below = np.cumsum(np.take_along_axis(chance, order, axis=1), axis=1)
    below /= below[:, -1:]
    strata = size // 2
    where = (np.arange(strata) + rng.random((len(order), 2, strata))) / strata
    row = np.arange(len(order))[:, None]
    found = np.searchsorted((below + row).ravel(), (where.reshape(len(order), -1) + row).ravel())
    last = order.shape[1] - 1
    place = np.clip(found.reshape(len(order), -1) - row * order.shape[1], 0, last)
    return np.take_along_axis(order, place, axis=1)
