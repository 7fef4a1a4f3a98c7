"""The emulator as a control: its density is known exactly, so that samples only correct it.

f(y) = f_emulator(y) + E[K(y - Y) - K(y - Y_emulator)], both outcomes at the same parameters. Where
the emulator is good the difference is small, and with it the error of its mean and the bias of a
smoothing kernel K; where it is not, its own scatter says so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.inference.verification.choice import REPLICATES, Score
from aleator.inference.verification.emulator import Emulator
from aleator.inference.verification.importance_sampling import flat
from aleator.inference.verification.kernel import (
    NARROWER,
    Kernel,
    Noise,
    copies_of,
    error_of,
    larger,
    smoothing,
)
from aleator.inference.verification.line_sampling import COARSE, FINE, Lines, densities, drawn
from aleator.laws.inputs import Inputs
from aleator.types import Array, Indices

SCORE_POINTS = 32
"""Points of each copy that correct the score, which is a small part of it."""


@dataclass(frozen=True)
class Samples:
    """Samples of m experiments: `variate` (m, S, d), `weight`, `outcomes` (m, S), `x` (m, S, n).

    `index` (m,) are the experiments, `kernel` what makes densities of the outcomes. Of the S
    samples each of the eight copies has S/8 in one piece.
    """

    index: Indices
    variate: Array
    weight: Array
    x: Array
    outcomes: Array
    kernel: Kernel

    def guess(self, emulator: Emulator, x: Array) -> Array:
        """The emulator's outcomes (m, S) at x (m, S, n)."""
        count, samples = x.shape[:2]
        return emulator.at(np.repeat(self.index, samples), flat(x)).reshape(count, samples)

    def few(self) -> Samples:
        """The first points of each copy."""
        each = self.weight.shape[1] // REPLICATES
        kept = np.flatnonzero(np.arange(each * REPLICATES) % each < SCORE_POINTS)
        return Samples(
            self.index, self.variate[:, kept], self.weight[:, kept], self.x[:, kept],
            self.outcomes[:, kept], self.kernel,
        )  # fmt: skip


@dataclass(frozen=True)
class Controlled:
    """Densities by control: `known` (N, C') of the emulator, `correction` (N, C), C' copies or one.

    `bias` (N,) bounds what smoothing does to the correction, as in `kernel.chosen`; `coarseness` is
    the relative error of `known` that its copies share.
    """

    known: Array
    correction: Array
    bias: Array
    coarseness: float

    @property
    def density(self) -> Array:
        """(N,) the estimate."""
        return np.asarray(self.known.mean(axis=1) + self.correction.mean(axis=1))

    @property
    def error(self) -> Array:
        """(N,) its standard error, without the bias."""
        return np.hypot(error_of(self.known), error_of(self.correction))


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

    def lines(self, sizes: tuple[tuple[int, int], int]) -> list[tuple[Indices, Lines]]:
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

    def correct(self, parts: list[Samples], sd: float) -> Controlled:
        """All densities; each experiment is in one of the parts."""
        correction, bias = np.empty((self.y.size, REPLICATES)), np.zeros(self.y.size)
        for part in parts:
            guess = part.guess(self.emulator, part.x)
            gaps = _gaps(part, part.kernel, guess)
            correction[part.index] = copies_of(gaps[-1])
            if len(gaps) > 1:
                mean, lower = (gap.mean(axis=1) for gap in (gaps[-1], gaps[-2]))
                narrow = [_gaps(part, part.kernel.scaled(f), guess)[-1] for f in NARROWER]
                bias[part.index] = larger(0.5 * (mean - lower), smoothing(gaps[-1], narrow))
        lines = self.lines(FINE)
        return Controlled(self.known(lines, sd), correction, bias, lines[0][1].coarseness)

    def score(self, parts: list[Samples], density: Array, noise_sd: float, steps: Array) -> Score:
        """Derivative of sum log f by central differences of `steps` (K,), the variates held.

        Without noise it is that of the emulator's density: the derivative of a kernel estimate of
        the correction is all error. With noise the samples correct it.
        """
        lines = self.lines(COARSE)
        here = self.known(lines, noise_sd)
        few = [part.few() for part in parts] if noise_sd > 0.0 else []
        scale = 0.5 / (density if few else here.mean(axis=1))[:, None]
        of_known = np.zeros((steps.size, *here.shape))
        of_samples = np.zeros((steps.size, self.y.size, REPLICATES))
        dx = [self._image(part) for part in few]
        for k in np.flatnonzero(steps > 0.0).tolist():
            of_noise = k == self.inputs.size
            for change in (steps[k], -steps[k]):
                sd, step = (noise_sd + change, 0.0) if of_noise else (noise_sd, change)
                at = 0 if of_noise else k
                of_known[k] += scale / change * self.known(lines, sd, at, step)
                for part, slope in zip(few, dx, strict=True):
                    gap = self._gap(part, part.x + step * slope[..., at], sd)
                    of_samples[k, part.index] += scale[part.index] / change * gap
        return _score(of_known, of_samples)

    def _image(self, part: Samples) -> Array:
        _, dx = self.inputs.image(self.alpha, flat(part.variate))
        return np.asarray(dx.reshape(*part.x.shape, -1))

    def _gap(self, part: Samples, x: Array, sd: float) -> Array:
        """Copies (m, C) of the correction at moved parameters.

        The simulator is taken to change by as much as the emulator does.
        """
        here, there = part.guess(self.emulator, part.x), part.guess(self.emulator, x)
        kernel = Noise(self.y[part.index], sd)
        (true,), (guessed,) = kernel.orders(part.outcomes + there - here), kernel.orders(there)
        return copies_of(part.weight * (true - guessed))


def _gaps(part: Samples, kernel: Kernel, guess: Array) -> list[Array]:
    """Weighted differences (m, S) of the kernels at true and at guessed outcomes, by order."""
    pairs = zip(kernel.orders(part.outcomes), kernel.orders(guess), strict=True)
    return [part.weight * (true - guessed) for true, guessed in pairs]


def _score(of_known: Array, of_samples: Array) -> Score:
    """From (K, N, C) each. Lines are shared by the experiments, samples are not."""
    each = of_known.mean(axis=2) + of_samples.mean(axis=2)
    away = of_samples - of_samples.mean(axis=2, keepdims=True)
    count = of_samples.shape[2]
    covariance = np.einsum("knc,jnc->kj", away, away) / (count * (count - 1))
    shared, copies = of_known.sum(axis=1), of_known.shape[2]
    if copies > 1:
        shared = shared - shared.mean(axis=1, keepdims=True)
        covariance += shared @ shared.T / (copies * (copies - 1))
    return Score(each.T, covariance)
