"""The log-likelihood at alpha* by Monte Carlo on the simulator itself, with its standard error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aleator.errors import InputsError
from aleator.inputs import Inputs
from aleator.progress import Progress, Silent

Array = NDArray[np.float64]
Run = Callable[[NDArray[np.int64], Array], Array]

CHUNK_RUNS = 20_000
"""Runs handed to the simulator at once, so that progress can be shown and Ctrl-C answered."""


@dataclass(frozen=True)
class MonteCarlo:
    """The user's choice of the check: `samples` simulator runs an experiment (0: no check).

    Raises InputsError for a number of samples between 1 and 49: a density needs more.

    >>> MonteCarlo(samples=1000).samples
    1000
    """

    samples: int = 1000

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if self.samples != 0 and self.samples < 50:
            raise InputsError(f"verification: samples {self.samples}", "use 0 (off) or at least 50")


@dataclass(frozen=True)
class Verification:
    """Monte Carlo log-likelihood at one alpha.

    `each` (N,) log-densities and `each_error` (N,) their standard errors; `total` and
    `standard_error` of the sum; `outcomes` (N, S) of the simulator, noise-free; `x` (N, S, n).
    """

    each: Array
    each_error: Array
    total: float
    standard_error: float
    outcomes: Array
    x: Array


def verify(
    run: Run,
    inputs: Inputs,
    alpha: Array,
    noise_sd: float,
    measured: Array,
    choice: MonteCarlo,
    *,
    seed: int,
    progress: Progress | None = None,
) -> Verification:
    """Estimate every log f_l(y_l | alpha) from `choice.samples` independent runs.

    With noise the density is the mean of Normal(y; Y_s, noise_sd^2), unbiased. Without noise it
    is a kernel estimate of fourth order (Wand and Jones, 1995, sec. 2.8). The logarithm's bias
    -var/2 is corrected. The standard error is that of independent samples, combined with half
    the difference of the kernels of fourth and second order as a bound of the smoothing bias.
    Cost: N S runs.
    """
    count, samples = measured.size, choice.samples
    rng = np.random.default_rng(seed)
    uniform = rng.random((count * samples, len(inputs.names)))
    x = inputs.sample(alpha[: inputs.slices[-1].stop], uniform)
    index = np.repeat(np.arange(count), samples)
    outcomes = _run_in_chunks(run, index, x, progress or Silent()).reshape(count, samples)
    if noise_sd > 0.0:
        terms = _normal_pdf((measured[:, None] - outcomes) / noise_sd) / noise_sd
        smoothing = np.zeros(count)
    else:
        terms, smoothing = _kernel_terms(outcomes, measured)
    density = terms.mean(axis=1)
    relative = terms.std(axis=1, ddof=1) / np.sqrt(samples) / np.where(density > 0, density, 1.0)
    with np.errstate(divide="ignore"):
        log_density = np.log(np.maximum(density, 0.0))
    # E log f^ = log f - var(f^)/(2 f^2); of use only where the relative error is small
    each = log_density + 0.5 * np.minimum(relative, 1.0) ** 2
    total_error = float(np.hypot(np.sqrt(np.sum(relative**2)), np.sum(smoothing)))
    return Verification(
        each,
        np.hypot(relative, smoothing),
        float(each.sum()),
        total_error,
        outcomes,
        x.reshape(count, samples, -1),
    )


def _run_in_chunks(run: Run, index: NDArray[np.int64], x: Array, progress: Progress) -> Array:
    parts = []
    for begin in range(0, index.size, CHUNK_RUNS):
        part = slice(begin, begin + CHUNK_RUNS)
        parts.append(run(index[part], x[part]))
        done = min(begin + CHUNK_RUNS, index.size)
        progress.update(f"{done} of {index.size} runs", done, index.size)
    return np.concatenate(parts)


def _kernel_terms(outcomes: Array, measured: Array) -> tuple[Array, Array]:
    """Fourth-order kernel terms (N, S) at the measured outcomes, and a bound of the bias of log f.

    K4(u) = (3 - u^2) phi(u)/2, bandwidth that of the normal rule for this kernel, from the
    smaller of standard deviation and scaled quartile range so that two modes are not smeared.
    """
    samples = outcomes.shape[1]
    quartiles = np.quantile(outcomes, [0.25, 0.75], axis=1)
    spread = np.minimum(outcomes.std(axis=1), (quartiles[1] - quartiles[0]) / 1.349)
    spread = np.where(spread > 0.0, spread, np.maximum(outcomes.std(axis=1), 1e-300))
    h = (spread * samples ** (-1.0 / 7.0))[:, None]
    u = (measured[:, None] - outcomes) / h
    second = _normal_pdf(u) / h
    fourth = 0.5 * (3.0 - u**2) * second
    mean_fourth, mean_second = fourth.mean(axis=1), second.mean(axis=1)
    # far in a tail the fourth-order estimate may not be positive; the second-order one is
    usable = mean_fourth > 0.2 * mean_second
    terms = np.where(usable[:, None], fourth, second)
    safe = np.where(mean_second > 0.0, mean_second, 1.0)
    bias = np.where(usable, np.log(np.where(usable, mean_fourth, 1.0) / safe), 1.0)
    return terms, 0.5 * bias


def _normal_pdf(u: Array) -> Array:
    return np.asarray(np.exp(-0.5 * u**2) / np.sqrt(2.0 * np.pi))
