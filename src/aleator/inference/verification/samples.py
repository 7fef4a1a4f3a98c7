"""Densities by samples alone: of the law itself, or drawn where an outcome far out is explained."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from aleator.blocks import blocks
from aleator.inference.verification.importance_sampling import (
    defended,
    explaining,
    flat,
    moved,
    uniforms,
)
from aleator.inference.verification.kernel import Kernel, Window, chosen, copies_of, error_of
from aleator.laws.inputs import Inputs
from aleator.progress import Progress
from aleator.types import Array, Indices

Run = Callable[[Indices, Array], Array]
Fields = TypeVar("Fields")

CHUNK_RUNS = 20_000
"""Runs handed to the simulator at once, so that progress can be shown and Ctrl-C answered."""


@dataclass(frozen=True)
class Samples:
    """Samples of m experiments: `outcomes` (m, S) and `weight` (m, S).

    `index` (m,) are the experiments, `kernel` what makes densities of the outcomes. Of the S
    samples each of the eight copies has S/8 in one piece.
    """

    index: Indices
    weight: Array
    outcomes: Array
    kernel: Kernel

    @property
    def scatter(self) -> Array:
        """(m,) the standard deviation of the outcomes that there are."""
        return np.asarray(np.nanstd(np.where(self.weight > 0.0, self.outcomes, np.nan), axis=1))


@dataclass(frozen=True)
class Alone:
    """Densities (N,) of samples alone: standard error, bound of the bias of log f, effective."""

    density: Array
    error: Array
    bias: Array
    effective: Array

    @classmethod
    def of(cls, samples: Samples) -> Alone:
        """The means of the kernels."""
        terms, bias = chosen(samples.kernel, samples.outcomes, samples.weight)
        copies = copies_of(terms)
        squares = np.sum(terms**2, axis=1)
        effective = np.sum(terms, axis=1) ** 2 / np.where(squares > 0.0, squares, 1.0)
        return cls(copies.mean(axis=1), error_of(copies), bias, effective)

    def replaced(self, again: Alone, rows: Indices) -> Alone:
        """Experiments `rows` as they are in `again`, where that has more effective samples."""
        better = again.effective > self.effective[rows]
        kept = Alone(*(field[better] for field in vars(again).values()))
        return with_rows(self, rows[better], kept)


@dataclass(frozen=True)
class Sampler:
    """What samples are made with: `run` makes runs, at one law alpha."""

    run: Run
    inputs: Inputs
    alpha: Array
    points: int
    rng: np.random.Generator
    progress: Progress

    def of_law(
        self, index: Indices, y: Array, ends: tuple[Array, Array], kernel: Kernel | None
    ) -> Samples:
        """Samples of the law itself for experiments (m,); their scatter makes a kernel."""
        n = len(self.inputs.names)
        uniform = flat(uniforms(index.size, self.inputs.scattering, self.points, self.rng))
        full = np.full((uniform.shape[0], n), 0.5)
        full[:, list(self.inputs.scattered)] = uniform
        x = self.inputs.sample(self.alpha, full).reshape(index.size, -1, n)
        outcomes, weight = _of_those_that_worked(made(self.run, index, x, self.progress))
        kernel = kernel or Window.of(y, *ends, outcomes)
        return Samples(index, weight, outcomes, kernel)

    def explaining(self, law: Samples, far: Indices, guess: Run | None) -> Samples:
        """Samples of the rows `far`, drawn where their outcomes are explained by `guess`."""
        kernel, index = law.kernel.take(far), law.index[far]
        tell = guess or self.run

        def outcomes_of(variate: Array) -> Array:
            x = self.inputs.image(self.alpha, flat(variate))[0]
            return tell(np.repeat(index, variate.shape[1]), x).reshape(variate.shape[:2])

        d = self.inputs.scattering
        found = explaining(outcomes_of, kernel.y, kernel.width, d, self.rng)
        variate, weight = defended(found, uniforms(far.size, d, self.points, self.rng))
        variate = variate.reshape(far.size, -1, variate.shape[-1])
        x = self.inputs.image(self.alpha, flat(variate))[0].reshape(*variate.shape[:2], -1)
        outcomes, worked = _of_those_that_worked(made(self.run, index, x, self.progress))
        if isinstance(kernel, Window):
            near = outcomes[:, moved(outcomes.shape[1])]
            kernel = Window.of(kernel.y, kernel.lower, kernel.upper, near)
        return Samples(index, worked * weight.reshape(variate.shape[:2]), outcomes, kernel)


def with_rows(whole: Fields, rows: Indices, others: Fields) -> Fields:
    """A dataclass of arrays (N, ...) with those (m, ...) of another in some rows (m,)."""
    fields = []
    for old, new in zip(vars(whole).values(), vars(others).values(), strict=True):
        mixed = old.copy()
        mixed[rows] = new
        fields.append(mixed)
    return type(whole)(*fields)


def made(run: Run, index: Indices, x: Array, progress: Progress) -> Array:
    """Outcomes (m, S) of experiments (m,) at x (m, S, n)."""
    count, samples = x.shape[:2]
    each, points, parts = np.repeat(index, samples), flat(x), []
    for part in blocks(each.size, 1, CHUNK_RUNS):
        parts.append(run(each[part], points[part]))
        progress.update(f"{part.stop} of {each.size} runs", part.stop, each.size)
    return np.concatenate(parts).reshape(count, samples)


def within(y: Array, ends: tuple[Array, Array], noise_sd: float) -> NDArray[np.bool_]:
    """Whether outcomes lie in the range of the noise-free outcome, or noise leads there."""
    return np.asarray((noise_sd > 0.0) | ((y >= ends[0]) & (y <= ends[1])))


def _of_those_that_worked(outcomes: Array) -> tuple[Array, Array]:
    """Outcomes (m, S) and weights (m, S): a run that failed, NaN, gives its weight to the others.

    What is estimated is then the density of an outcome given that there is one.
    """
    worked = ~np.isnan(outcomes)
    share = worked.mean(axis=1, keepdims=True)
    weight = worked / np.where(share > 0.0, share, 1.0)
    first = np.take_along_axis(outcomes, np.argmax(worked, axis=1)[:, None], axis=1)
    return np.where(worked, outcomes, np.nan_to_num(first)), weight
