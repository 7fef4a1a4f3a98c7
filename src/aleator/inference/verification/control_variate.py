"""The emulator as a control: its density is known exactly, so that a few runs only correct it.

f(y) = f_emulator(y) + E[K(y - Y) - K(y - Y_emulator)], both outcomes at the same parameters. Where
the emulator is good the difference is small, and with it the error of its mean and the bias of a
smoothing kernel K; where it is not, its own scatter says so.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from aleator.blocks import blocks
from aleator.inference.verification.choice import Score
from aleator.inference.verification.emulator import Emulator
from aleator.inference.verification.importance_sampling import flat
from aleator.inference.verification.kernel import SEEN, Kernel, Noise, larger
from aleator.inference.verification.line_sampling import COARSE, FINE, Lines, densities, drawn
from aleator.inference.verification.near import REACH, Candidates, Near
from aleator.laws.inputs import Inputs
from aleator.types import Array, Indices

NARROWER = (0.7, 0.5)
"""Bandwidths that tell of smoothing, over that of the estimate: few runs lie in narrower ones."""
BLOCK = 2_000_000
"""Kernels that are held at once."""


@dataclass(frozen=True)
class Made:
    """Runs near outcomes, made: `outcomes` (G, R) of the simulator, NaN where one failed."""

    near: Near
    outcomes: Array

    def blocks(self) -> Iterator[Made]:
        """The same, for some of the experiments at once."""
        near = self.near
        for part in blocks(near.index.size, near.chosen.shape[1], BLOCK):
            yield Made(
                Near(near.index[part], near.group[part], near.first, near.chosen, near.weight),
                self.outcomes,
            )


@dataclass(frozen=True)
class Corrected:
    """What runs add to the densities of the control, (N,), with its standard error.

    `lower` is half of what a kernel of lower order changes; `narrow` (N, W) what narrower ones
    change and `unsure` (N, W) the errors of that: all bound what smoothing does to the correction.
    """

    correction: Array
    error: Array
    lower: Array
    narrow: Array
    unsure: Array

    @classmethod
    def none(cls, count: int) -> Corrected:
        """No correction of so many densities."""
        return cls(*np.zeros((3, count)), *np.zeros((2, count, len(NARROWER))))

    @property
    def bias(self) -> Array:
        """(N,) the bound of each: that of the next narrower kernel, and others beyond chance."""
        found = larger(self.lower, self.narrow[:, 0])
        for narrow, unsure in zip(self.narrow.T[1:], self.unsure.T[1:], strict=True):
            found = np.where(np.abs(narrow) > SEEN * unsure, larger(found, narrow), found)
        return found

    def bias_of_sum(self, factor: Array) -> float:
        """Of the sum times factors (N,): that of the kernels beyond chance, at least of lower."""
        narrow = np.abs(factor @ self.narrow)
        certain = narrow > SEEN * np.sqrt(factor**2 @ self.unsure**2)
        return float(np.max(np.append(np.abs(factor @ self.lower), narrow[certain])))


@dataclass(frozen=True)
class Control:
    """An emulator as control of experiments with outcomes y (N,) at one alpha.

    `along` (N,) is the variate of each experiment that its lines run along.
    """

    emulator: Emulator
    inputs: Inputs
    alpha: Array
    y: Array
    along: Indices
    seed: int

    def lines(self, sizes: tuple[tuple[int, int], int] = FINE) -> list[tuple[Indices, Lines]]:
        """Lines for every variate that they run along, with the experiments (N',) they are for."""
        rng = np.random.default_rng([self.seed, 1])
        return [
            (
                np.flatnonzero(self.along == k),
                drawn(self.inputs, self.alpha, int(k), rng, sizes),
            )
            for k in np.unique(self.along)
        ]

    def known(
        self, lines: list[tuple[Indices, Lines]], sd: float, k: int = 0, step: float = 0.0
    ) -> Array:
        """The emulator's densities (N, C), with hyperparameter k moved by a step."""
        found = np.empty((self.y.size, lines[0][1].x.shape[0]))
        for rows, some in lines:
            x = some.x + step * some.dx[..., k] if step else some.x
            found[rows] = densities(self.emulator, some, x, self.y[rows], sd, rows)
        return found

    def score(
        self,
        candidates: Candidates,
        made: Sequence[Made],
        density: Array,
        noise_sd: float,
        steps: Array,
        condition: Indices,
    ) -> Score | None:
        """Derivative of sum log f by central differences of `steps` (K,), the variates held.

        Without noise it is that of the emulator's density: the derivative of a kernel estimate of
        the correction is all error. With noise the samples correct it, those of equal conditions
        (N,) together. None where an outcome has no density.
        """
        lines = self.lines(COARSE)
        here = self.known(lines, noise_sd)
        few = made if noise_sd > 0.0 else ()
        known = density if few else here.mean(axis=1)
        if not np.all(known > 0.0):
            return None
        scale = 0.5 / known[:, None]
        of_known = np.zeros((steps.size, *here.shape))
        of_samples = np.zeros((steps.size, self.y.size, 2))
        dx = self.inputs.image(self.alpha, candidates.variate)[1] if few else np.zeros(0)
        for k in np.flatnonzero(steps > 0.0).tolist():
            of_noise = k == self.inputs.size
            for change in (steps[k], -steps[k]):
                sd, step = (noise_sd + change, 0.0) if of_noise else (noise_sd, change)
                at = 0 if of_noise else k
                of_known[k] += scale / change * self.known(lines, sd, at, step)
                for one in few:
                    x = candidates.x + (step * dx[..., at] if step else 0.0)
                    for part, gap in self._gaps(candidates, one, x, sd):
                        of_samples[k, part] += scale[part] / change * gap
        return _score(of_known, of_samples, condition)

    def _gaps(
        self, candidates: Candidates, made: Made, x: Array, sd: float
    ) -> Iterator[tuple[Indices, Array]]:
        """Experiments and both halves (m, 2) of their correction, at moved candidates x (J, n).

        The simulator is taken to change by as much as the emulator does.
        """
        near = made.near
        guess = guessed(candidates, made)
        index = np.repeat(near.first, near.chosen.shape[1])
        there = self.emulator.at(index, flat(x[near.chosen])).reshape(guess.shape)
        true = made.outcomes + there - guess
        for block in made.blocks():
            rows = block.near.group
            kernel = Noise(self.y[block.near.index], sd)
            gap = _worked(kernel.orders(true[rows])[0] - kernel.orders(there[rows])[0])
            yield block.near.index, _halves(near.weight[rows] * gap)


def corrected(candidates: Candidates, made: Sequence[Made], kernel: Kernel) -> Corrected:
    """The corrections of all experiments; each is in one of `made`."""
    found = Corrected.none(kernel.y.size)
    for one in made:
        for block in one.blocks():
            part = _corrected(candidates, block, kernel.take(block.near.index))
            for whole, some in zip(vars(found).values(), vars(part).values(), strict=True):
                whole[block.near.index] = some
    return found


def _corrected(candidates: Candidates, made: Made, kernel: Kernel) -> Corrected:
    gaps = gaps_of(candidates, made, kernel)
    best = gaps[-1]
    mean = best.mean(axis=1)
    if len(gaps) == 1:
        return replace(Corrected.none(mean.size), correction=mean, error=_error(best))
    smeared = [best - gaps_of(candidates, made, kernel.scaled(f))[-1] for f in NARROWER]
    return Corrected(
        mean,
        _error(best),
        0.5 * (mean - gaps[-2].mean(axis=1)),
        np.stack([terms.mean(axis=1) for terms in smeared], axis=1),
        np.stack([_error(terms) for terms in smeared], axis=1),
    )


def _error(terms: Array) -> Array:
    return np.asarray(np.sqrt(np.sum(differences(terms) ** 2, axis=1)))


def gaps_of(candidates: Candidates, made: Made, kernel: Kernel) -> list[Array]:
    """Weighted differences (m, R) of the kernels at true and at guessed outcomes, by order.

    Zero where a run failed: nothing is known of it.
    """
    guess = guessed(candidates, made)
    pairs = zip(_terms(made, kernel, made.outcomes), _terms(made, kernel, guess), strict=True)
    return [_worked(true - guessed) for true, guessed in pairs]


def guessed(candidates: Candidates, made: Made) -> Array:
    """What the emulator said of the runs that were made."""
    return candidates.outcomes[made.near.first[:, None], made.near.chosen]


def variance(candidates: Candidates, made: Sequence[Made], kernel: Kernel, factor: Array) -> float:
    """Of the sum of corrections times factors (N,); experiments that share runs go together."""
    total = 0.0
    for one in made:
        together = np.zeros((len(one.near.chosen), one.near.chosen.shape[1] // 2))
        for block in one.blocks():
            rows = block.near.index
            gap = differences(gaps_of(candidates, block, kernel.take(rows))[-1])
            np.add.at(together, block.near.group, gap * factor[rows, None])
        total += float(np.sum(together**2))
    return total


def surface_error(candidates: Candidates, made: Sequence[Made]) -> Array:
    """(N,) root-mean-square error of the emulator at the runs that worked; NaN without any."""
    found = np.full(len(candidates.outcomes), np.nan)
    for one in made:
        guess = guessed(candidates, one)
        square = (guess - one.outcomes) ** 2
        worked = np.isfinite(square)
        count = worked.sum(axis=1)
        mean = np.where(worked, square, 0.0).sum(axis=1) / np.where(count, count, np.nan)
        found[one.near.index] = np.sqrt(mean)[one.near.group]
    return found


def near_error(candidates: Candidates, made: Sequence[Made], kernel: Kernel) -> Array:
    """(N,) largest error of the emulator where it, or the simulator, is near the outcome.

    NaN where no run is.
    """
    found = np.full(kernel.y.size, np.nan)
    reach = REACH * kernel.scale
    for one in made:
        guess = guessed(candidates, one)
        error = _worked(np.abs(guess - one.outcomes))
        for block in one.blocks():
            rows, index = block.near.group, block.near.index
            y, most = kernel.y[index, None], reach[index, None]
            near = (np.abs(guess[rows] - y) < most) | (np.abs(one.outcomes[rows] - y) < most)
            largest = np.max(np.where(near, error[rows], -1.0), axis=1)
            found[index] = np.where(largest < 0.0, np.nan, largest)
    return found


def differences(terms: Array) -> Array:
    """Of the two draws (m, R) of each stratum, (m, R/2): the sum of their squares is the variance.

    That of the mean of all, and of sums over experiments if they are summed first.
    """
    strata = terms.shape[1] // 2
    return np.asarray((terms[:, :strata] - terms[:, strata:]) / (2.0 * strata))


def _terms(made: Made, kernel: Kernel, outcomes: Array) -> list[Array]:
    weight, rows = made.near.weight[made.near.group], outcomes[made.near.group]
    return [_worked(weight * order) for order in kernel.orders(rows)]


def _worked(values: Array) -> Array:
    return np.nan_to_num(values, nan=0.0)


def _halves(terms: Array) -> Array:
    return np.asarray(terms.reshape(terms.shape[0], 2, -1).mean(axis=2))


def _score(of_known: Array, of_samples: Array, condition: Indices) -> Score:
    """From (K, N, C) each. Lines are shared by all experiments, samples by those of a condition."""
    each = of_known.mean(axis=2) + of_samples.mean(axis=2)
    half = 0.5 * (of_samples[..., 0] - of_samples[..., 1])
    together = np.zeros((len(half), condition.max() + 1))
    np.add.at(together.T, condition, half.T)
    covariance = together @ together.T
    shared, copies = of_known.sum(axis=1), of_known.shape[2]
    if copies > 1:
        shared = shared - shared.mean(axis=1, keepdims=True)
        covariance += shared @ shared.T / (copies * (copies - 1))
    return Score(each.T, covariance)
