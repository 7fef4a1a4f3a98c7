"""The log-likelihood at alpha* by Monte Carlo on the simulator itself, with its standard error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from aleator.inference.verification.choice import MonteCarlo, Verification
from aleator.inference.verification.control_variate import (
    Control,
    Controlled,
    Samples,
)
from aleator.inference.verification.emulator import Emulator
from aleator.inference.verification.importance_sampling import (
    defended,
    explaining,
    flat,
    moved,
    uniforms,
)
from aleator.inference.verification.kernel import (
    NORMAL,
    Kernel,
    Noise,
    Window,
    chosen,
    copies_of,
    error_of,
)
from aleator.laws.inputs import Inputs
from aleator.observations.model import ObservationModel
from aleator.progress import Progress, Silent
from aleator.types import Array, Indices

Run = Callable[[Indices, Array], Array]

CHUNK_RUNS = 20_000
"""Runs handed to the simulator at once, so that progress can be shown and Ctrl-C answered."""

FEW_SAMPLES = 10
"""Effective samples below which variates are drawn anew, and a density is not verified."""

AGREES = 0.1
"""A density by control that differs by more, and by more than five errors, is not believed."""


@dataclass(frozen=True)
class _Plain:
    """Densities (N,) of samples alone: standard error, bound of the bias of log f, effective."""

    density: Array
    error: Array
    bias: Array
    effective: Array


def verify(
    run: Run,
    inputs: Inputs,
    alpha: Array,
    noise_sd: float,
    measured: Array,
    choice: MonteCarlo,
    *,
    seed: int,
    lower: ArrayLike = -np.inf,
    upper: ArrayLike = np.inf,
    observation: ObservationModel = NORMAL,
    emulator: Emulator | None = None,
    steps: Array | None = None,
    progress: Progress | None = None,
) -> Verification:
    """Estimate every log f_l(y_l | alpha) from `choice.samples` runs an experiment.

    The points are randomly shifted Sobol' points mapped by the quantiles of the law (randomized
    quasi-Monte Carlo: unbiased, and the scatter of the eight copies gives its error). With noise
    the density is the mean of p(y | Y_s, noise_sd) by the `observation` model, unbiased. Without
    noise it is a kernel estimate of fourth order (Wand and Jones, 1995, sec. 2.8), and half its
    difference from the estimate of second order is added to the standard error as a bound of the
    smoothing bias.
    `lower` and `upper` (N,) are the ends of the noise-free outcome's range, where its density may
    end abruptly; the kernel is then one-sided. An experiment with fewer than ten effective samples
    gets as many again by importance sampling. With an `emulator` and normal noise the samples
    correct the emulator's exact density instead (module `control_variate`), where that has the
    smaller error and the two agree; and where `steps` (K,) are positive, of about a quarter of a
    standard error, the score is told too. The bias -var/2 of the logarithm is corrected. A run that
    failed, NaN, is left out: the density is that of an outcome where there is one. Cost: N S runs,
    S more for an experiment far out, and LEVELS times 512 for it without an emulator.
    """
    rng, count = np.random.default_rng(seed), measured.size
    told = progress or Silent()
    ends = np.broadcast_to(lower, (count,)), np.broadcast_to(upper, (count,))
    kernel = Noise(measured, noise_sd, observation) if noise_sd > 0.0 else None
    law = _from_law(run, inputs, alpha, measured, kernel, ends, choice.points, rng, told)
    plain, parts = _plain(law), [law]
    hard = np.zeros(count, dtype=np.bool_)
    within = (noise_sd > 0.0) | ((measured >= ends[0]) & (measured <= ends[1]))
    far = np.flatnonzero((plain.effective < FEW_SAMPLES) & within)
    if far.size and inputs.scattering:
        again = _explaining(run, inputs, alpha, law, far, emulator, choice.points, rng, told)
        plain, better = _replaced(plain, _plain(again), far)
        hard[far] = inputs.scattering > 1
        parts = [_rows(law, ~np.isin(law.index, far[better])), _rows(again, better)]
        parts = [part for part in parts if part.index.size]
    control = None
    if emulator is not None and observation == NORMAL:
        along = _steepest(law)
        control = Control(emulator, inputs, alpha, measured, along, seed)
    return _verification(law, plain, parts, control, hard, noise_sd, steps)


def _verification(
    law: Samples,
    plain: _Plain,
    parts: list[Samples],
    control: Control | None,
    hard: NDArray[np.bool_],
    noise_sd: float,
    steps: Array | None,
) -> Verification:
    density, error, bias = plain.density, plain.error, plain.bias
    of_lines, coarse, score = np.zeros((density.size, 1)), np.zeros(density.size), None
    if control is not None:
        held = control.correct(parts, noise_sd)
        # the lines are drawn from the law, and few of several variates reach far out
        taken = _better(held, plain) & ~hard
        safe = np.where(taken, held.density, 1.0)
        density = np.where(taken, held.density, density)
        error = np.where(taken, error_of(held.correction), error)
        bias = np.where(taken, held.bias / safe, bias)
        of_lines = np.where(taken[:, None], held.known / safe[:, None], 0.0)
        coarse = np.where(taken, held.coarseness, 0.0)
        if steps is not None and np.all(held.density > 0.0):
            score = control.score(parts, held.density, noise_sd, steps)
    relative = error / np.where(density > 0.0, density, 1.0)
    of_each = np.sqrt(relative**2 + error_of(of_lines) ** 2 + coarse**2)
    with np.errstate(divide="ignore"):
        log_density = np.log(np.maximum(density, 0.0))
    # E log f^ = log f - var(f^)/(2 f^2); of use only where the relative error is small
    each = log_density + 0.5 * np.minimum(of_each, 1.0) ** 2
    reached = (plain.effective >= FEW_SAMPLES) & (density > 0.0)
    # biases have signs: their sum is what they do together, their squares what may remain; the
    # lines are common to all experiments, so that their errors add
    alone = np.sum(relative[reached] ** 2) + np.sum(bias[reached] ** 2)
    lines = error_of(of_lines[reached].sum(axis=0))
    common = np.array([np.sum(bias[reached]), lines, np.sum(coarse[reached])])
    return Verification(
        each,
        np.hypot(of_each, bias),
        plain.effective,
        reached,
        float(each[reached].sum()),
        float(np.sqrt(alone + common @ common)),
        np.where(law.weight > 0.0, law.outcomes, np.nan),
        law.x,
        score,
    )


def _better(held: Controlled, plain: _Plain) -> NDArray[np.bool_]:
    """Where the control has the smaller error and the samples alone do not contradict it."""
    positive = (held.density > 0.0) & (plain.density > 0.0)
    f, g = (np.where(positive, d, 1.0) for d in (held.density, plain.density))
    error = np.hypot(plain.error / g, plain.bias)
    better = np.hypot(held.error, held.bias) / f < error
    return np.asarray(positive & better & (np.abs(np.log(f / g)) < np.maximum(AGREES, 5.0 * error)))


def _plain(samples: Samples) -> _Plain:
    terms, bias = chosen(samples.kernel, samples.outcomes, samples.weight)
    copies = copies_of(terms)
    squares = np.sum(terms**2, axis=1)
    effective = np.sum(terms, axis=1) ** 2 / np.where(squares > 0.0, squares, 1.0)
    return _Plain(copies.mean(axis=1), error_of(copies), bias, effective)


def _replaced(plain: _Plain, again: _Plain, far: Indices) -> tuple[_Plain, NDArray[np.bool_]]:
    """The experiments `far` as they are in `again`, where that has more effective samples."""
    better = again.effective > plain.effective[far]
    fields = []
    for old, new in zip(vars(plain).values(), vars(again).values(), strict=True):
        mixed = old.copy()
        mixed[far[better]] = new[better]
        fields.append(mixed)
    return _Plain(*fields), better


def _rows(samples: Samples, which: NDArray[np.bool_]) -> Samples:
    rows = np.flatnonzero(which)
    return Samples(
        samples.index[rows], samples.variate[rows], samples.weight[rows], samples.x[rows],
        samples.outcomes[rows], samples.kernel.take(rows),
    )  # fmt: skip


def _from_law(
    run: Run,
    inputs: Inputs,
    alpha: Array,
    measured: Array,
    kernel: Kernel | None,
    ends: tuple[Array, Array],
    points: int,
    rng: np.random.Generator,
    progress: Progress,
) -> Samples:
    count, n = measured.size, len(inputs.names)
    uniform = flat(uniforms(count, inputs.scattering, points, rng))
    full = np.full((uniform.shape[0], n), 0.5)
    full[:, list(inputs.scattered)] = uniform
    x = inputs.sample(alpha, full).reshape(count, -1, n)
    index = np.arange(count)
    outcomes, weight = _of_those_that_worked(_run_in_chunks(run, index, x, progress))
    kernel = kernel or Window.of(measured, *ends, outcomes)
    variate = special.ndtri(uniform).reshape(count, x.shape[1], uniform.shape[1])
    return Samples(index, variate, weight, x, outcomes, kernel)


def _explaining(
    run: Run,
    inputs: Inputs,
    alpha: Array,
    law: Samples,
    far: Indices,
    emulator: Emulator | None,
    points: int,
    rng: np.random.Generator,
    progress: Progress,
) -> Samples:
    """Samples of the experiments `far`, drawn where their outcomes are explained."""
    kernel = law.kernel.take(far)
    guess = run if emulator is None else emulator.at

    def outcomes_of(variate: Array) -> Array:
        x = inputs.image(alpha, flat(variate))[0]
        return guess(np.repeat(far, variate.shape[1]), x).reshape(variate.shape[:2])

    found = explaining(outcomes_of, kernel.y, kernel.width, inputs.scattering, rng)
    variate, weight = defended(found, uniforms(far.size, inputs.scattering, points, rng))
    variate = variate.reshape(far.size, -1, variate.shape[-1])
    x = inputs.image(alpha, flat(variate))[0].reshape(*variate.shape[:2], -1)
    outcomes, worked = _of_those_that_worked(_run_in_chunks(run, far, x, progress))
    if isinstance(kernel, Window):
        near = outcomes[:, moved(outcomes.shape[1])]
        kernel = Window.of(kernel.y, kernel.lower, kernel.upper, near)
    return Samples(far, variate, worked * weight.reshape(variate.shape[:2]), x, outcomes, kernel)


def _of_those_that_worked(outcomes: Array) -> tuple[Array, Array]:
    """Outcomes (m, S) and weights (m, S): a run that failed, NaN, gives its weight to the others.

    What is estimated is then the density of an outcome given that there is one.
    """
    worked = ~np.isnan(outcomes)
    share = worked.mean(axis=1, keepdims=True)
    weight = worked / np.where(share > 0.0, share, 1.0)
    first = np.take_along_axis(outcomes, np.argmax(worked, axis=1)[:, None], axis=1)
    return np.where(worked, outcomes, np.nan_to_num(first)), weight


def _steepest(law: Samples) -> Indices:
    """The variate (N,) with which each outcome is correlated most; 0 without any."""
    if law.variate.shape[2] == 0:
        return np.zeros(law.index.size, dtype=np.intp)
    away = law.outcomes - law.outcomes.mean(axis=1, keepdims=True)
    return np.asarray(np.argmax(np.abs(np.einsum("ns,nsd->nd", away, law.variate)), axis=1))


def _run_in_chunks(run: Run, index: Indices, x: Array, progress: Progress) -> Array:
    """Outcomes (m, S) of experiments (m,) at x (m, S, n)."""
    count, samples = x.shape[:2]
    each, points, parts = np.repeat(index, samples), flat(x), []
    for begin in range(0, each.size, CHUNK_RUNS):
        part = slice(begin, begin + CHUNK_RUNS)
        parts.append(run(each[part], points[part]))
        done = min(begin + CHUNK_RUNS, each.size)
        progress.update(f"{done} of {each.size} runs", done, each.size)
    return np.concatenate(parts).reshape(count, samples)
