"""The log-likelihood at alpha* by Monte Carlo on the simulator itself, with its standard error."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special
from scipy.stats import qmc

from aleator.errors import InputsError
from aleator.inputs import Inputs
from aleator.progress import Progress, Silent

Array = NDArray[np.float64]
Run = Callable[[NDArray[np.int64], Array], Array]

CHUNK_RUNS = 20_000
"""Runs handed to the simulator at once, so that progress can be shown and Ctrl-C answered."""

REPLICATES = 8
"""Independently shifted copies of the points; their scatter gives the standard error."""


@dataclass(frozen=True)
class MonteCarlo:
    """The user's choice of the check: `samples` simulator runs an experiment (0: no check).

    They are spread over eight shifted copies of a Sobol' point set, and rounded up to eight times
    a power of two. Raises InputsError for a number of samples between 1 and 49: a density needs
    more.

    >>> MonteCarlo(samples=1000).points  # of each copy: 8 * 128 = 1024 runs an experiment
    128
    """

    samples: int = 1024

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if self.samples != 0 and self.samples < 50:
            raise InputsError(f"verification: samples {self.samples}", "use 0 (off) or at least 50")

    @property
    def points(self) -> int:
        """Points of each of the eight copies, a power of two."""
        return 1 << math.ceil(math.log2(max(self.samples, 1) / REPLICATES))


@dataclass(frozen=True)
class Verification:
    """Monte Carlo log-likelihood at one alpha.

    `each` (N,) log-densities and `each_error` (N,) their standard errors; `effective` (N,) the
    number of samples that count, (sum t)^2/sum t^2: where it is small the outcome lies where
    hardly a sample falls, and neither value nor error means much; `total` and `standard_error`
    of the sum; `outcomes` (N, S) of the simulator, noise-free; `x` (N, S, n).
    """

    each: Array
    each_error: Array
    effective: Array
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
    lower: ArrayLike = -np.inf,
    upper: ArrayLike = np.inf,
    progress: Progress | None = None,
) -> Verification:
    """Estimate every log f_l(y_l | alpha) from `choice.samples` runs an experiment.

    The points are randomly shifted Sobol' points mapped by the quantiles of the law (randomized
    quasi-Monte Carlo: unbiased, and the scatter of the eight copies gives its error). With noise
    the density is the mean of Normal(y; Y_s, noise_sd^2), unbiased. Without noise it is a kernel
    estimate of fourth order (Wand and Jones, 1995, sec. 2.8), and half its difference from the
    estimate of second order is added to the standard error as a bound of the smoothing bias.
    `lower` and `upper` (N,) are the ends of the noise-free outcome's range, where its density may
    end abruptly; the kernel is then one-sided. The bias -var/2 of the logarithm is corrected.
    Cost: N S runs.
    """
    count = measured.size
    x = _points(inputs, alpha, count, choice.points, seed)
    flat = x.reshape(-1, x.shape[-1])
    index = np.repeat(np.arange(count), REPLICATES * choice.points)
    outcomes = _run_in_chunks(run, index, flat, progress or Silent()).reshape(count, -1)
    if noise_sd > 0.0:
        terms = _normal_pdf((measured[:, None] - outcomes) / noise_sd) / noise_sd
        smoothing = np.zeros(count)
    else:
        ends = np.broadcast_to(lower, (count,)), np.broadcast_to(upper, (count,))
        terms, smoothing = _kernel_terms(outcomes, measured, *ends)
    copies = terms.reshape(count, REPLICATES, choice.points).mean(axis=2)
    density = copies.mean(axis=1)
    error = copies.std(axis=1, ddof=1) / math.sqrt(REPLICATES)
    relative = error / np.where(density > 0.0, density, 1.0)
    with np.errstate(divide="ignore"):
        log_density = np.log(np.maximum(density, 0.0))
    # E log f^ = log f - var(f^)/(2 f^2); of use only where the relative error is small
    each = log_density + 0.5 * np.minimum(relative, 1.0) ** 2
    # the biases have signs: their sum is what they do together, their squares what may remain
    variance = np.sum(relative**2) + np.sum(smoothing) ** 2 + np.sum(smoothing**2)
    return Verification(
        each,
        np.hypot(relative, smoothing),
        _effective(terms),
        float(each.sum()),
        math.sqrt(variance),
        outcomes,
        x.reshape(count, -1, x.shape[-1]),
    )


def _effective(terms: Array) -> Array:
    """Effective number of samples (N,) of the terms (N, S)."""
    squares = np.sum(terms**2, axis=1)
    return np.asarray(np.sum(terms, axis=1) ** 2 / np.where(squares > 0.0, squares, 1.0))


def _points(inputs: Inputs, alpha: Array, count: int, points: int, seed: int) -> Array:
    """Parameters (N, copies, points, n): one Sobol' set, shifted modulo one for every copy."""
    rng = np.random.default_rng(seed)
    n = len(inputs.names)
    base = qmc.Sobol(n, rng=rng).random(points)
    uniform = (base + rng.random((count, REPLICATES, 1, n))) % 1.0
    inside = np.clip(uniform, 1e-12, 1.0 - 1e-12).reshape(-1, n)
    x = inputs.sample(alpha, inside)
    return x.reshape(count, REPLICATES, points, n)


def _run_in_chunks(run: Run, index: NDArray[np.int64], x: Array, progress: Progress) -> Array:
    parts = []
    for begin in range(0, index.size, CHUNK_RUNS):
        part = slice(begin, begin + CHUNK_RUNS)
        parts.append(run(index[part], x[part]))
        done = min(begin + CHUNK_RUNS, index.size)
        progress.update(f"{done} of {index.size} runs", done, index.size)
    return np.concatenate(parts)


def _kernel_terms(
    outcomes: Array, measured: Array, lower: Array, upper: Array
) -> tuple[Array, Array]:
    """Kernel terms (N, S) at the measured outcomes, and a bound of the bias of log f.

    With u = (y - Y)/h and I_k the integral of u^k phi(u) over the window that the range of the
    outcome leaves of it, (c + d u + e u^2) phi(u) integrates 1, u, u^2 to 1, 0, 0 there. In the
    open that is (3 - u^2) phi(u)/2, of fourth order; at an end it is the one-sided kernel of third
    order. Bandwidth from the smaller of standard deviation and scaled quartile range so that two
    modes are not smeared.
    """
    samples = outcomes.shape[1]
    quartiles = np.quantile(outcomes, [0.25, 0.75], axis=1)
    spread = np.minimum(outcomes.std(axis=1), (quartiles[1] - quartiles[0]) / 1.349)
    spread = np.where(spread > 0.0, spread, np.maximum(outcomes.std(axis=1), 1e-300))
    h = spread * samples ** (-1.0 / 7.0)
    inside = (measured >= lower) & (measured <= upper)
    at = np.where(inside, measured, outcomes.mean(axis=1))
    moments = _window_moments((at - upper) / h, (at - lower) / h)
    u = (at[:, None] - outcomes) / h[:, None]
    plain = np.where(inside[:, None], _normal_pdf(u), 0.0) / h[:, None]
    zeroth = plain / moments[0][:, None]
    first, second = (
        plain * np.polynomial.polynomial.polyval(u, _corrected(moments, degree)[:, :, None], False)
        for degree in (1, 2)
    )
    means = [kernel.mean(axis=1) for kernel in (zeroth, first, second)]
    # far in a tail an estimate of higher order may not be positive; that of lower order is
    simple = means[1] > 0.2 * means[0]
    reference = np.where(simple, means[1], means[0])
    usable = means[2] > 0.2 * reference
    terms = np.where(simple[:, None], first, zeroth)
    terms = np.where(usable[:, None], second, terms)
    safe = np.where(reference > 0.0, reference, 1.0)
    bias = np.where(usable, np.log(np.where(usable, means[2], 1.0) / safe), 1.0)
    return terms, 0.5 * bias


def _window_moments(a: Array, b: Array) -> list[Array]:
    """Integrals (5 of (N,)) of u^k phi(u) over [a, b], by parts: k = 0..4."""
    low, high = (np.where(np.isfinite(end), end, 0.0) for end in (a, b))
    at_low, at_high = _normal_pdf(a), _normal_pdf(b)
    moments = [np.asarray(special.ndtr(b) - special.ndtr(a)), at_low - at_high]
    for k in range(2, 5):
        edges = low ** (k - 1) * at_low - high ** (k - 1) * at_high
        moments.append((k - 1) * moments[k - 2] + edges)
    return moments


def _corrected(moments: list[Array], degree: int) -> Array:
    """Coefficients (degree+1, N) of the factor that integrates 1, u, .. to 1, 0, .."""
    size = degree + 1
    matrix = np.stack([np.stack(moments[i : i + size], axis=-1) for i in range(size)], axis=-1)
    first = np.zeros((moments[0].size, size, 1))
    first[:, 0] = 1.0
    return np.asarray(np.linalg.solve(matrix, first)[:, :, 0].T)


def _normal_pdf(u: Array) -> Array:
    return np.asarray(np.exp(-0.5 * u**2) / np.sqrt(2.0 * np.pi))
