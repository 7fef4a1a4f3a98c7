"""Problems whose truth is known in closed form, in one table.

A problem is a simulator with a law; its truths are the exact moments and the exact log-density of
the measured outcome. None of them is computed with the package: sums of cumulants, integrals with
30 digits, and the distributions of SciPy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mpmath
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats
from scipy.special import log_ndtr

from aleator import Constant, Free, Inputs, Noise, Normal, TruncatedNormal
from aleator.core.types import Array
from aleator.laws import Hyperparameter
from aleator.laws.quadrature import TensorGauss
from aleator.moments.densities import Density
from aleator.moments.likelihood import Likelihood, Predictive
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.moments.propagation import (
    ProjectedPropagation,
    Propagation,
    QuadraturePropagation,
    default_cubature,
)
from aleator.simulators.response_functions import ResponseFunction

INFINITE = float("inf")


@dataclass(frozen=True)
class Problem:
    """A simulator eta(z, *x), one condition z (N,), a law at alpha (K,), and its truths.

    `eta` is analytic, so that a step into the complex plane gives its derivative to rounding.
    `raw` returns E[Y^m] of one noise-free outcome as mpmath numbers; `log_density` the exact
    logarithms (N,) for outcomes (N,), noise included; `limits` the range of the noise-free outcome.
    """

    name: str
    eta: Callable[..., Array]
    inputs: Inputs
    z: Array
    alpha: Array
    raw: Callable[[Array, float, int], mpmath.mpf]
    log_density: Callable[[Array, Array, Array], Array]
    noise: Noise | None = None
    limits: Callable[[Array], tuple[Array, Array]] = lambda z: (0 * z - np.inf, 0 * z + np.inf)

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        noise = (self.noise.hyperparameter,) if self.noise else ()
        return self.inputs.hyperparameters + noise

    @property
    def free(self) -> NDArray[np.intp]:
        return np.array([k for k, h in enumerate(self.hyperparameters) if h.free])

    @property
    def noise_sd(self) -> float:
        return float(self.alpha[-1]) if self.noise else 0.0

    def run(self, index: NDArray[np.intp], x: Array) -> Array:
        """The simulator as the library calls it."""
        return np.asarray(self.eta(self.z[index], *x.T))

    def simulator(self, **named: Array) -> Array:
        """The simulator as a user writes it, vectorized."""
        return np.asarray(self.eta(named.pop("z"), *named.values()))

    def table(self, outcomes: Array) -> pd.DataFrame:
        return pd.DataFrame({"z": self.z, "y": outcomes})

    def draw(self, seed: int, alpha: Array | None = None) -> Array:
        """Outcomes (N,) of the model itself."""
        alpha = self.alpha if alpha is None else alpha
        rng = np.random.default_rng(seed)
        x = self.inputs.sample(alpha, rng.random((self.z.size, len(self.inputs.names))))
        noise = float(alpha[-1]) if self.noise else 0.0
        return self.run(np.arange(self.z.size), x) + noise * rng.standard_normal(self.z.size)

    def exact_moments(self, order: int) -> tuple[Array, Array, Array]:
        """Mean (N,), sd (N,) and standardized moments (N, order+1) of the noise-free outcome."""
        rows = [
            from_raw([self.raw(self.alpha, z, m) for m in range(order + 1)])
            for z in self.z.tolist()
        ]
        mean, sd, standardized = zip(*rows, strict=True)
        return np.array(mean), np.array(sd), np.array(standardized)

    def likelihood(
        self,
        outcomes: Array,
        density: Density | None = None,
        *,
        nodes: int | None = None,
        degree: int | None = None,
    ) -> Likelihood:
        """The package's likelihood of the outcomes, propagated without error in the response."""
        lower, upper = self.limits(self.z)
        density = density or MaximumEntropy(4)
        way: Propagation
        if nodes:
            way = collocated(self.inputs, Exact(self), nodes, degree)
        else:
            cubature = default_cubature(self.inputs, runs=False)
            way = QuadraturePropagation(self.inputs, Exact(self), cubature)
        where = (np.arange(self.z.size), lower, upper)
        distribution = Predictive(way, density, *where, self.hyperparameters)
        return Likelihood(distribution, outcomes)


def collocated(
    inputs: Inputs, response: ResponseFunction, nodes: int, degree: int | None
) -> Propagation:
    """Nodes of a tensor rule, with an expansion of that degree or without one."""
    if degree is None:
        return QuadraturePropagation(inputs, response, TensorGauss(nodes))
    return ProjectedPropagation(inputs, response, nodes, degree)


@dataclass(frozen=True)
class Exact:
    """The response of a problem, with derivatives exact to rounding (complex step)."""

    problem: Problem

    def evaluate(self, x: Array) -> Array:
        z = self.problem.z[:, None]
        value = self.problem.eta(z, *x.T[:, None, :])
        return np.broadcast_to(value, (z.size, x.shape[0])).copy()

    def evaluate_with_gradient(self, x: Array) -> tuple[Array, Array]:
        slope = np.empty((self.problem.z.size, *x.shape))
        for i in range(x.shape[1]):
            moved = x.astype(complex)
            moved[:, i] += 1e-30j
            value = self.problem.eta(self.problem.z[:, None], *moved.T[:, None, :])
            slope[:, :, i] = np.broadcast_to(np.imag(value), slope.shape[:2]) / 1e-30
        return self.evaluate(x), slope


# ------------------------------------------------------------------------------ exact truths


def from_raw(raw: Sequence[mpmath.mpf]) -> tuple[float, float, list[float]]:
    """Mean, sd and standardized moments from raw ones, in 60 digits."""
    with mpmath.workdps(60):
        mean = raw[1]
        central = [
            mpmath.fsum(mpmath.binomial(m, j) * raw[j] * (-mean) ** (m - j) for j in range(m + 1))
            for m in range(len(raw))
        ]
        sd = mpmath.sqrt(central[2])
        return float(mean), float(sd), [float(c / sd**m) for m, c in enumerate(central)]


def raw_from_cumulants(cumulants: Sequence[mpmath.mpf], order: int) -> mpmath.mpf:
    """E[Y^order] from cumulants 1, 2, ..: mu_n = sum_k C(n-1, k-1) kappa_k mu_(n-k)."""
    raw = [mpmath.mpf(1)]
    for n in range(1, order + 1):
        terms = [
            mpmath.binomial(n - 1, k - 1) * cumulants[k - 1] * raw[n - k] for k in range(1, n + 1)
        ]
        raw.append(mpmath.fsum(terms))
    return raw[order]


def raw_normal(mean: float, sd: float, order: int) -> mpmath.mpf:
    with mpmath.workdps(60):
        cumulants = [mpmath.mpf(mean), mpmath.mpf(sd) ** 2, *[mpmath.mpf(0)] * order]
        return raw_from_cumulants(cumulants, order)


def raw_truncated(mean: float, sd: float, box: tuple[float, float], order: int) -> mpmath.mpf:
    """E[x^order] of a truncated normal law, by the recurrence of its integrals by parts.

    t^m phi integrates to (m-1) I_(m-2) - [t^(m-1) phi]; 60 digits pay for its cancellation.
    """
    with mpmath.workdps(80):
        mean, sd = mpmath.mpf(mean), mpmath.mpf(sd)
        a, b = ((mpmath.mpf(end) - mean) / sd for end in box)

        def edge(t: mpmath.mpf, power: int) -> mpmath.mpf:
            return mpmath.mpf(0) if mpmath.isinf(t) else t**power * mpmath.npdf(t)

        # the complement keeps its digits far in the upper tail
        mass = (mpmath.erfc(a / mpmath.sqrt(2)) - mpmath.erfc(b / mpmath.sqrt(2))) / 2
        integrals = [mass, edge(a, 0) - edge(b, 0)]
        for m in range(2, order + 1):
            integrals.append((m - 1) * integrals[m - 2] - (edge(b, m - 1) - edge(a, m - 1)))
        standard = [integral / mass for integral in integrals]
        return mpmath.fsum(
            mpmath.binomial(order, m) * mean ** (order - m) * sd**m * standard[m]
            for m in range(order + 1)
        )


def raw_sum(
    first: Callable[[int], mpmath.mpf], second: Callable[[int], mpmath.mpf], order: int
) -> mpmath.mpf:
    """E[(A + B)^order] of independent A and B."""
    with mpmath.workdps(60):
        return mpmath.fsum(
            mpmath.binomial(order, m) * first(m) * second(order - m) for m in range(order + 1)
        )


def log_interval(a: Array | float, b: Array | float) -> Array:
    """log(Phi(b) - Phi(a)), kept in logarithms so that tails keep their digits."""
    a, b = np.broadcast_arrays(np.asarray(a, dtype=float), np.asarray(b, dtype=float))
    flip = a + b > 0
    low, high = np.where(flip, -b, a), np.where(flip, -a, b)
    return np.asarray(log_ndtr(high) + np.log1p(-np.exp(log_ndtr(low) - log_ndtr(high))))


def log_truncated(y: Array, mean: float, sd: float, box: tuple[float, float]) -> Array:
    """Log-density of a truncated normal law."""
    mass = log_interval((box[0] - mean) / sd, (box[1] - mean) / sd)
    inside = (y >= box[0]) & (y <= box[1])
    return np.where(inside, stats.norm.logpdf(y, mean, sd) - mass, -np.inf)


def log_truncated_plus_noise(
    y: Array, factor: Array, mean: float, sd: float, box: tuple[float, float], noise: float
) -> Array:
    """Log-density of factor x + e: the normal product rule, restricted to the box.

    N(y; factor x, noise^2) N(x; mean, sd^2) = N(y; factor mean, total^2) N(x; m, s^2).
    """
    total = np.hypot(factor * sd, noise)
    s = sd * noise / total
    m = (mean * noise**2 + factor * y * sd**2) / total**2
    mass = log_interval((box[0] - mean) / sd, (box[1] - mean) / sd)
    kept = log_interval((box[0] - m) / s, (box[1] - m) / s)
    return np.asarray(stats.norm.logpdf(y, factor * mean, total) + kept - mass)


# ------------------------------------------------------------------------------ the table

SPREAD = np.linspace(0.5, 2.0, 7)
SAMPLE = Problem(
    "sample: y = x, x normal",
    lambda z, x: x + 0.0 * z,
    Inputs({"x": Normal(mean=Free(-2.0, 4.0), sd=Free(0.05, 3.0))}),
    np.zeros(7),
    np.array([1.0, 0.6]),
    lambda alpha, _, m: raw_normal(alpha[0], alpha[1], m),
    lambda alpha, _, y: stats.norm.logpdf(y, alpha[0], alpha[1]),
)
REGRESSION = Problem(
    "random coefficients: y = a + b z, a and b normal",
    lambda z, a, b: a + b * z,
    Inputs(
        {
            "a": Normal(mean=Free(-5.0, 5.0), sd=Free(0.01, 3.0)),
            "b": Normal(mean=Free(-5.0, 5.0), sd=Free(0.01, 3.0)),
        }
    ),
    np.linspace(-2.0, 3.0, 7),
    np.array([1.0, 0.5, 2.0, 0.3]),
    lambda alpha, z, m: raw_normal(
        alpha[0] + alpha[2] * z, float(np.hypot(alpha[1], alpha[3] * z)), m
    ),
    lambda alpha, z, y: stats.norm.logpdf(
        y, alpha[0] + alpha[2] * z, np.hypot(alpha[1], alpha[3] * z)
    ),
)
GROWTH = Problem(
    "lognormal outcome: y = exp(z x), x normal",
    lambda z, x: np.exp(z * x),
    Inputs({"x": Normal(mean=Free(-1.0, 1.0), sd=Free(0.02, 0.5))}),
    SPREAD,
    np.array([0.3, 0.2]),
    lambda alpha, z, m: mpmath.exp(m * z * alpha[0] + mpmath.mpf(m * z * alpha[1]) ** 2 / 2),
    lambda alpha, z, y: stats.norm.logpdf(np.log(y), z * alpha[0], z * alpha[1]) - np.log(y),
    limits=lambda z: (0 * z, 0 * z + np.inf),
)
SQUARE = Problem(
    "noncentral chi-square: y = (x + z)^2, x normal",
    lambda z, x: (x + z) ** 2,
    Inputs({"x": Normal(mean=Free(-4.0, 4.0), sd=Free(0.05, 2.0))}),
    np.linspace(0.0, 2.0, 7),
    np.array([1.5, 0.5]),
    lambda alpha, z, m: raw_normal(alpha[0] + z, alpha[1], 2 * m),
    lambda alpha, z, y: (
        stats.ncx2.logpdf(y / alpha[1] ** 2, 1, ((alpha[0] + z) / alpha[1]) ** 2)
        - 2.0 * np.log(alpha[1])
    ),
    limits=lambda z: (0 * z, 0 * z + np.inf),
)
BOX = (0.0, 1.0)
BINDING = Problem(
    "box that binds: y = z x, x truncated normal",
    lambda z, x: z * x,
    Inputs({"x": TruncatedNormal(BOX, mean=Free(-0.5, 1.5), sd=Free(0.01, 1.0))}),
    SPREAD,
    np.array([0.8, 0.4]),
    lambda alpha, z, m: z**m * raw_truncated(alpha[0], alpha[1], BOX, m),
    lambda alpha, z, y: log_truncated(y / z, alpha[0], alpha[1], BOX) - np.log(z),
    limits=lambda z: (0 * z, z),
)
NOISY = Problem(
    "box that binds, with noise: y = z x + e",
    BINDING.eta,
    BINDING.inputs,
    BINDING.z,
    np.array([0.8, 0.4, 0.15]),
    BINDING.raw,
    lambda alpha, z, y: log_truncated_plus_noise(y, z, alpha[0], alpha[1], BOX, alpha[2]),
    Noise(Free(0.01, 1.0)),
    BINDING.limits,
)
HALF = (0.0, INFINITE)
FRONTIER = Problem(
    "stochastic frontier: y = b0 + b1 z - u + e, u half normal",
    lambda z, b0, b1, u: b0 + b1 * z - u,
    Inputs(
        {
            "b0": Constant(Free(-1.0, 5.0)),
            "b1": Constant(Free(-1.0, 3.0)),
            "u": TruncatedNormal(HALF, mean=0.0, sd=Free(0.02, 2.0)),
        }
    ),
    np.linspace(0.0, 3.0, 7),
    np.array([1.0, 0.7, 0.0, 0.5, 0.3]),
    lambda alpha, z, m: raw_sum(
        lambda k: mpmath.mpf(alpha[0] + alpha[1] * z) ** k,
        lambda k: (-1) ** k * raw_truncated(0.0, alpha[3], HALF, k),
        m,
    ),
    # the density of Aigner, Lovell and Schmidt (1977), eq. (8)
    lambda alpha, z, y: log_frontier(y - alpha[0] - alpha[1] * z, alpha[3], alpha[4]),
    Noise(Free(0.02, 1.0)),
)
PRODUCT = Problem(
    "two laws: y = w exp(z x), x normal and w truncated normal",
    lambda z, x, w: w * np.exp(z * x),
    Inputs(
        {
            "x": Normal(mean=Free(-1.0, 1.0), sd=Free(0.02, 0.5)),
            "w": TruncatedNormal((0.5, 2.0), mean=Free(0.5, 2.0), sd=Free(0.02, 1.0)),
        }
    ),
    SPREAD,
    np.array([0.3, 0.1, 1.7, 0.4]),
    lambda alpha, z, m: GROWTH.raw(alpha, z, m) * raw_truncated(alpha[2], alpha[3], (0.5, 2.0), m),
    lambda alpha, z, y: np.array([_log_product(alpha, *pair) for pair in zip(z, y, strict=True)]),
    limits=lambda z: (0 * z, 0 * z + np.inf),
)
PROBLEMS = (SAMPLE, REGRESSION, GROWTH, SQUARE, BINDING, PRODUCT)


def log_frontier(residual: Array, inefficiency: float, noise: float) -> Array:
    """Log-density of e - u, e normal and u half normal."""
    total = np.hypot(inefficiency, noise)
    skew = log_ndtr(-residual * inefficiency / (noise * total))
    return np.asarray(np.log(2.0) + stats.norm.logpdf(residual, 0.0, total) + skew)


def _log_product(alpha: Array, z: float, y: float) -> float:
    """Integral over w of the lognormal density of y/w, by 400 Gauss-Legendre points."""
    t, weights = np.polynomial.legendre.leggauss(400)
    w = 1.25 + 0.75 * t
    log_y = stats.norm.logpdf(np.log(y / w), z * alpha[0], z * alpha[1]) - np.log(y)
    terms = log_y + log_truncated(w, alpha[2], alpha[3], (0.5, 2.0))
    return float(np.log(0.75 * np.sum(weights * np.exp(terms))))


def title(problem: Problem) -> str:
    """The name of a problem in the name of a parametrized test."""
    return problem.name.partition(":")[0].replace(" ", "-")
