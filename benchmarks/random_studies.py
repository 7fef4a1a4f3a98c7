"""64 small studies of unlike simulators, laws and sizes, with data that are drawn from a known law.

All are synthetic. One to four parameters scatter; the simulators have fronts, peaks, kinks, jumps,
saturation and exponentials. `benchmarks.reference` has the log-likelihood of each by quadrature of
its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from aleator import (
    Beta,
    Constant,
    Free,
    Gamma,
    Inputs,
    LogNormal,
    Noise,
    Normal,
    TruncatedNormal,
    Uniform,
)
from aleator.core.types import Array

Simulator = Callable[..., Array]
Conditions = Callable[[np.random.Generator, int], dict[str, Array]]


@dataclass(frozen=True)
class Marginal:
    """One parameter: its family, its box, its true mean and sd, and where these are sought."""

    family: str
    mean: float
    sd: float = 0.0
    box: tuple[float, float] | None = None
    means: Free = field(default_factory=Free)
    sds: Free = field(default_factory=Free)

    def law(self) -> Any:
        """The law that Aleator identifies."""
        if self.family == "constant":
            return Constant(self.means)
        if self.family == "truncated":
            assert self.box is not None
            return TruncatedNormal(self.box, self.means, self.sds)
        if self.family == "beta":
            assert self.box is not None
            return Beta(self.box, self.means, self.sds)
        kinds = {"normal": Normal, "lognormal": LogNormal, "gamma": Gamma, "uniform": Uniform}
        return kinds[self.family](self.means, self.sds)

    def values(self, theta: Array, mean: float, sd: float) -> Array:
        """x = F^-1(Phi(theta)) by SciPy, in the nearer tail."""
        if self.family == "constant":
            return np.full_like(theta, mean)
        if self.family == "normal":
            return np.asarray(mean + sd * theta)
        if self.family == "lognormal":
            variance = np.log1p((sd / mean) ** 2)
            return np.asarray(mean * np.exp(np.sqrt(variance) * theta - variance / 2.0))
        law = self._frozen(mean, sd)
        low, high = np.minimum(theta, 0.0), np.maximum(theta, 0.0)
        below, above = law.ppf(stats.norm.cdf(low)), law.isf(stats.norm.sf(high))
        return np.asarray(np.where(theta < 0.0, below, above))

    def _frozen(self, mean: float, sd: float) -> Any:
        if self.family == "gamma":
            return stats.gamma((mean / sd) ** 2, scale=sd**2 / mean)
        if self.family == "uniform":
            return stats.uniform(mean - np.sqrt(3.0) * sd, 2.0 * np.sqrt(3.0) * sd)
        assert self.box is not None
        low, high = self.box
        if self.family == "truncated":
            return stats.truncnorm((low - mean) / sd, (high - mean) / sd, loc=mean, scale=sd)
        share, spread = (mean - low) / (high - low), sd / (high - low)
        size = share * (1.0 - share) / spread**2 - 1.0
        return stats.beta(share * size, (1.0 - share) * size, loc=low, scale=high - low)


@dataclass(frozen=True)
class RandomStudy:
    """One study: `count` experiments, outliers of 4.5 standard deviations among them."""

    number: int
    name: str
    simulator: Simulator
    conditions: Conditions
    marginals: Mapping[str, Marginal]
    count: int = 60
    noise: float | None = None
    noise_limits: tuple[float, float] | None = None
    correlation: float | None = None
    correlated: tuple[str, str] = ("a", "b")
    correlation_limits: tuple[float, float] = (-0.95, 0.95)
    outliers: int = 0

    @property
    def scattering(self) -> list[str]:
        """The names of the parameters that scatter."""
        return [n for n, marginal in self.marginals.items() if marginal.family != "constant"]

    @property
    def inputs(self) -> Inputs:
        """The joint law that Aleator identifies."""
        laws = {name: marginal.law() for name, marginal in self.marginals.items()}
        if self.correlation is None:
            return Inputs(laws)
        return Inputs(laws, {self.correlated: Free(*self.correlation_limits)})

    @property
    def errors(self) -> Noise | None:
        """The measurement error, identified where it has limits."""
        if self.noise is None:
            return None
        return Noise(self.noise if self.noise_limits is None else Free(*self.noise_limits))

    def table(self, seed: int | None = None) -> pd.DataFrame:
        """The experiments; those of the number where no other seed is given."""
        rng = np.random.default_rng(1001 + self.number if seed is None else seed)
        conditions = self.conditions(rng, self.count)
        theta = {name: rng.standard_normal(self.count) for name in self.scattering}
        if self.correlation is not None:
            first, second = self.correlated
            own = np.sqrt(1.0 - self.correlation**2)
            theta[second] = self.correlation * theta[first] + own * theta[second]
        for k in range(self.outliers):
            theta[self.scattering[0]][k] = 4.5 if k % 2 == 0 else -4.5
        x = {
            name: m.values(theta.get(name, np.zeros(self.count)), m.mean, m.sd)
            for name, m in self.marginals.items()
        }
        y = self.simulator(**conditions, **x)
        if self.noise is not None:
            y = y + rng.normal(0.0, self.noise, self.count)
        return pd.DataFrame({**conditions, "y": y})


def _between(low: float, high: float, *, logarithmic: bool = False) -> Conditions:
    def drawn(rng: np.random.Generator, count: int) -> dict[str, Array]:
        if logarithmic:
            return {"c": np.exp(rng.uniform(np.log(low), np.log(high), count))}
        return {"c": rng.uniform(low, high, count)}

    return drawn


def _two(rng: np.random.Generator, count: int) -> dict[str, Array]:
    return {"c": rng.uniform(0.0, 3.0, count), "d": rng.uniform(-2.0, 2.0, count)}


def _temperatures(rng: np.random.Generator, count: int) -> dict[str, Array]:
    return {"c": rng.choice([0.65, 0.7, 0.75, 0.8, 0.9], count)}


def tn(low: float, high: float, mean: float, sd: float) -> Marginal:
    return Marginal("truncated", mean, sd, (low, high))


def law(family: str, mean: float, sd: float, means: tuple[float, float],
        sds: tuple[float, float], box: tuple[float, float] | None = None) -> Marginal:  # fmt: skip
    return Marginal(family, mean, sd, box, Free(*means), Free(*sds))


def constant(value: float, low: float, high: float) -> Marginal:
    return Marginal("constant", value, means=Free(low, high))


def line(c: Array, a: Array, b: Array) -> Array:
    return a * c + b


def growth(c: Array, a: Array, b: Array) -> Array:
    return np.asarray(a * np.exp(b * c))


def decay(c: Array, a: Array) -> Array:
    return np.asarray(np.exp(-a * c))


def mild(c: Array, a: Array) -> Array:
    return np.asarray(np.sqrt(c) * a + 0.1 * a * a)


def front(c: Array, a: Array) -> Array:
    return np.asarray(np.tanh((c - a) / 0.05))


def front_times(c: Array, a: Array, b: Array) -> Array:
    return np.asarray(b * np.tanh((c - a) / 0.1))


def peak(c: Array, a: Array, z: Array | float = 0.05) -> Array:
    return np.asarray(1.0 / np.sqrt((1.0 - (c / a) ** 2) ** 2 + (2.0 * z * c / a) ** 2))


def peak_of_one(c: Array, a: Array) -> Array:
    return peak(c, a)


def branches(c: Array, a: Array) -> Array:
    return np.maximum(a - c, 0.3 * (c - a))


def kink(c: Array, a: Array, b: Array) -> Array:
    return np.asarray(np.abs(a - c) + b * c)


def jump(c: Array, a: Array) -> Array:
    return np.asarray(a * c + (a > 1.0) * 1.0)


def oscillation(c: Array, a: Array) -> Array:
    return np.asarray(np.sin(a * c))


def bump(c: Array, a: Array) -> Array:
    return np.asarray(np.exp(-0.5 * ((c - a) / 0.1) ** 2))


def bump_times(c: Array, a: Array, b: Array) -> Array:
    return np.asarray(b * np.exp(-0.5 * ((c - a) / 0.3) ** 2))


def saturation(c: Array, a: Array, b: Array) -> Array:
    return a * c / (b + c)


def sum_of_two(c: Array, a: Array, b: Array) -> Array:
    return a + b + 0.0 * c


def wave(c: Array, a: Array, b: Array) -> Array:
    return np.asarray(a * np.cos(c) + b * np.sin(c))


def fatigue(c: Array, v: Array, b0: Array, b1: Array) -> Array:
    return np.asarray(b0 + b1 * np.log(c - np.exp(v)))


def three(c: Array, d: Array, a: Array, b: Array, e: Array) -> Array:
    return np.asarray(a + b * c + e * np.sin(d))


def three_decay(c: Array, a: Array, b: Array, e: Array) -> Array:
    return np.asarray(a * np.exp(-b * c) + e * c)


def four(c: Array, d: Array, a: Array, b: Array, e: Array, g: Array) -> Array:
    return a + b * c + e * d + g * c * d


def four_curved(c: Array, d: Array, a: Array, b: Array, e: Array, g: Array) -> Array:
    return np.asarray(a * np.exp(-0.5 * b * c) + e * d**2 + 0.5 * np.sqrt(1.0 + g * g) * c)


def _studies() -> list[RandomStudy]:
    made: list[RandomStudy] = []

    def add(name: str, simulator: Simulator, conditions: Conditions,
            marginals: dict[str, Marginal], count: int = 60, noise: float | None = None,
            limits: tuple[float, float] | None = None, **more: Any) -> None:  # fmt: skip
        made.append(RandomStudy(len(made), name, simulator, conditions, marginals, count,
                                noise, limits, **more))  # fmt: skip

    u = _between
    # One parameter.
    add("mild", mild, u(0.5, 4), {"a": tn(0.2, 3, 1.2, 0.25)})
    add("mild, noise", mild, u(0.5, 4), {"a": tn(0.2, 3, 1.2, 0.25)}, 60, 0.05, (0.005, 1))
    add("front", front, u(0.2, 1.8), {"a": tn(0, 2, 1, 0.2)}, 60, 0.05, (0.005, 0.5))
    add("peak", peak_of_one, u(0.5, 2), {"a": tn(0.5, 2, 1.2, 0.15)}, 60, 0.1, (0.01, 2))
    add("clipped", lambda c, a: np.minimum(a * c, 2.0), u(0.5, 3), {"a": tn(0.2, 3, 1, 0.2)}, 60,
        0.05, (0.005, 0.5))  # fmt: skip
    add("jump, noise", jump, u(0.5, 2), {"a": tn(0, 2, 1, 0.2)}, 60, 0.05, (0.005, 0.5))
    add("two branches", branches, u(0.2, 1.8), {"a": tn(0, 2, 1, 0.3)})
    add("oscillation", oscillation, u(0.5, 6),
        {"a": law("beta", 1, 0.15, (0.3, 1.7), (0.01, 0.45), (0, 2))}, 60, 0.05,
        (0.005, 0.5))  # fmt: skip
    add("decay, gamma", decay, u(0.2, 3), {"a": law("gamma", 1, 0.4, (0.1, 3), (0.01, 1.5))})
    add("ten decades", lambda c, a: np.exp(a * c), u(0.5, 3),
        {"a": law("normal", 1, 0.3, (-2, 4), (0.01, 2))}, 15)  # fmt: skip
    add("quadratic, uniform", lambda c, a: a * a * c + a, u(0.5, 3),
        {"a": law("uniform", 1.2, 0.3, (0, 3), (0.02, 1))}, 60, 0.1, (0.01, 1))  # fmt: skip
    add("square", lambda c, a: a * a + 0.01 * c, u(0, 1),
        {"a": law("normal", 0.3, 0.4, (-1, 2), (0.01, 1.5))}, 60, 0.05,
        (0.005, 0.5))  # fmt: skip
    add("reciprocal", lambda c, a: c / a, u(1, 100, logarithmic=True),
        {"a": law("lognormal", 1.5, 0.5, (0.3, 4), (0.01, 2))})  # fmt: skip
    add("bump", bump, u(0.5, 1.5), {"a": tn(0, 2, 1, 0.1)}, 60, 0.05, (0.005, 0.5))
    add("decay, 300", decay, u(0.1, 4), {"a": tn(0, 4, 1, 0.4)}, 300, 0.02)
    add("front, 300", front, u(0.2, 1.8), {"a": tn(0, 2, 1, 0.2)}, 300, 0.01, (0.001, 0.3))
    add("peak, 15", peak_of_one, u(0.8, 1.6), {"a": tn(0.5, 2, 1.2, 0.1)}, 15, 0.02, (0.002, 1))
    add("mild, outlier", mild, u(0.5, 4), {"a": tn(0.2, 3, 1.2, 0.15)}, 60, 0.05, (0.005, 1),
        outliers=1)  # fmt: skip
    add("decay, outliers", decay, u(0.3, 2),
        {"a": law("lognormal", 1, 0.3, (0.2, 3), (0.01, 1.5))}, outliers=2)  # fmt: skip
    add("cube", lambda c, a: (a - 1.0) ** 3 + 0.2 * c * a, u(0, 2),
        {"a": law("normal", 1.5, 0.5, (-1, 4), (0.02, 2))}, 60, 0.1, (0.01, 1))  # fmt: skip
    add("jump, 15", jump, u(0.5, 2), {"a": tn(0, 2, 1.05, 0.15)}, 15, 0.1, (0.01, 0.5))
    add("two branches, noise", branches, u(0.2, 1.8),
        {"a": law("normal", 1, 0.2, (0, 2), (0.01, 1))}, 60, 0.3, (0.02, 2))  # fmt: skip
    # Two parameters.
    pair = {"a": tn(0, 3, 1.5, 0.3), "b": tn(-2, 4, 1, 0.4)}
    normals = {
        "a": law("normal", 1.5, 0.3, (0, 3), (0.01, 1)),
        "b": law("normal", 1, 0.4, (-2, 4), (0.01, 1.5)),
    }
    rise = {"a": tn(0.3, 2, 1, 0.15), "b": tn(0.2, 1.8, 1, 0.2)}
    add("line", line, u(0, 3), pair)
    add("line, noise", line, u(0, 3), normals, 60, 0.1)
    add("growth, noise", growth, u(0, 2), rise, 60, 0.1, (0.01, 1))
    add("growth", growth, u(0.2, 2), {
        "a": law("lognormal", 1, 0.25, (0.3, 2), (0.02, 0.8)),
        "b": law("normal", 1, 0.25, (0, 2), (0.02, 0.8)),
    })  # fmt: skip
    add("front of two", front_times, u(0.2, 1.8),
        {"a": tn(0, 2, 1, 0.15), "b": tn(0.5, 1.5, 1, 0.1)}, 60, 0.05, (0.005, 0.5))  # fmt: skip
    add("logistic", lambda c, a, b: 1.0 / (1.0 + np.exp(-(c - a) / 0.15)) + 0.3 * b * c, u(0, 2),
        {"a": law("beta", 1, 0.2, (0.4, 1.6), (0.02, 0.5), (0, 2)), "b": tn(0, 2, 1, 0.2)}, 60,
        0.03, (0.003, 0.5))  # fmt: skip
    add("peak of two, noise", peak, u(0.5, 2),
        {"a": tn(0.6, 2, 1.2, 0.12), "z": tn(0.03, 0.5, 0.15, 0.04)}, 60, 0.1,
        (0.01, 2))  # fmt: skip
    add("clipped line", lambda c, a, b: np.clip(a * c + b, 0.5, 3.0), u(0.2, 2.5),
        {"a": tn(0, 3, 1.2, 0.3), "b": tn(-1, 2, 0.3, 0.2)}, 60, 0.05, (0.005, 0.5))  # fmt: skip
    add("kink, noise", kink, u(0.2, 1.8), {"a": tn(0, 2, 1, 0.25), "b": tn(0, 2, 1, 0.1)}, 60,
        0.03, (0.003, 0.5))  # fmt: skip
    add("jump of two", lambda c, a, b: a * c + (a + b > 2.0) * 0.8, u(0.2, 2),
        {"a": tn(0, 2, 1, 0.2), "b": tn(0, 2, 1, 0.2)}, 60, 0.05, (0.005, 0.5))  # fmt: skip
    add("saturation, 300", saturation, u(0.1, 20, logarithmic=True), {
        "a": law("gamma", 3, 0.5, (0.5, 6), (0.02, 2)),
        "b": law("gamma", 1, 0.3, (0.2, 4), (0.02, 1.5)),
    }, 300, 0.1)  # fmt: skip
    add("product", lambda c, a, b: a * b * c, u(0.5, 3),
        {"a": tn(0.2, 2, 1, 0.15), "b": tn(0.2, 2, 1, 0.1)})  # fmt: skip
    add("ratio", lambda c, a, b: a / (b + 0.5 * c), u(0.1, 10, logarithmic=True), {
        "a": law("lognormal", 1.5, 0.3, (0.3, 4), (0.02, 1.5)),
        "b": law("lognormal", 1, 0.25, (0.3, 4), (0.02, 1.5)),
    }, 60, 0.02)  # fmt: skip
    add("sum, not to be told apart", sum_of_two, u(0, 1), {
        "a": law("normal", 0.5, 0.3, (-2, 2), (0.02, 1.5)),
        "b": law("normal", 0.2, 0.3, (-2, 2), (0.02, 1.5)),
    }, 60, 0.2)  # fmt: skip
    add("scaled sum, 15", lambda c, a, b: (a + b) * c, u(0.5, 2),
        {"a": tn(0, 2, 1, 0.2), "b": tn(0, 2, 1, 0.2)}, 15)  # fmt: skip
    waves = {
        "a": law("normal", 2, 0.4, (0, 4), (0.02, 2)),
        "b": law("normal", 1, 0.4, (-1, 3), (0.02, 2)),
    }
    add("wave, correlated, noise", wave, u(0, 3), waves, 60, 0.1, correlation=0.6)
    add("wave, correlated, 300", wave, u(0, 3), {"a": tn(0, 4, 2, 0.4), "b": tn(-1, 3, 1, 0.4)},
        300, correlation=-0.5)  # fmt: skip
    add("mildly coupled, correlated", lambda c, a, b: a + b * c + 0.2 * a * b, u(-2, 2), {
        "a": law("lognormal", 1.5, 0.4, (0.5, 4), (0.02, 2)),
        "b": law("gamma", 1, 0.3, (0.3, 3), (0.02, 1.5)),
    }, 60, 0.1, (0.01, 1), correlation=0.4, correlation_limits=(-0.9, 0.9))  # fmt: skip
    add("sum of squares", lambda c, a, b: a * a + b * b * c, u(0.2, 5, logarithmic=True), {
        "a": law("normal", 1.5, 0.3, (-1, 3), (0.02, 1.5)),
        "b": law("normal", 1, 0.3, (-1, 3), (0.02, 1.5)),
    })  # fmt: skip
    add("bump of two", bump_times, u(0, 2), {"a": tn(0, 2, 1, 0.1), "b": tn(0.3, 2, 1, 0.15)}, 60,
        0.03, (0.003, 0.5))  # fmt: skip
    add("line, outliers", line, u(0, 3), {
        "a": law("normal", 1.5, 0.3, (0, 3), (0.02, 1)),
        "b": law("normal", 1, 0.4, (-2, 4), (0.02, 1.5)),
    }, outliers=2)  # fmt: skip
    add("growth, 15", growth, u(0, 2), rise, 15, 0.1, (0.01, 1))
    add("peak of two", peak, u(0.5, 0.9),
        {"a": tn(0.95, 2, 1.3, 0.1), "z": tn(0.03, 0.5, 0.15, 0.05)})  # fmt: skip
    add("kink", kink, u(0.2, 1.8), {"a": tn(0, 2, 1, 0.25), "b": tn(0, 2, 1, 0.2)})
    add("fatigue limit", fatigue, _temperatures, {
        "v": law("normal", -0.7, 0.04, (-1.2, -0.55), (0.005, 0.1)),
        "b0": constant(-9, -14, -4), "b1": constant(-8, -13, -4),
    }, 60, 0.3, (0.02, 1))  # fmt: skip
    add("line, uniform", line, u(0, 3),
        {"a": law("uniform", 1.5, 0.4, (0, 3), (0.05, 0.8)), "b": tn(-2, 4, 1, 0.1)}, 60,
        0.1)  # fmt: skip
    add("line, tiny sd, 300", line, u(0, 3), {"a": tn(0, 3, 1.5, 0.3), "b": tn(-2, 4, 1, 0.01)},
        300, 0.2, (0.01, 1))  # fmt: skip
    add("growth, wide", growth, u(0, 6), {
        "a": law("lognormal", 1, 0.2, (0.3, 2), (0.02, 0.8)),
        "b": law("normal", 1, 0.15, (0, 2), (0.02, 0.6)),
    })  # fmt: skip
    add("steep front of two", lambda c, a, b: np.tanh((c - a) / 0.1) + b * c, u(0.2, 1.8),
        {"b": tn(0, 2, 1, 0.2), "a": tn(0, 2, 1, 0.2)})  # fmt: skip
    # Three and four parameters.
    trio = {"a": tn(-2, 4, 1, 0.3), "b": tn(-1, 3, 1, 0.2), "e": tn(-1, 3, 1, 0.4)}
    add("three, noise", three, _two, trio, 60, 0.1)
    add("three", three, _two, trio)
    add("three, decay, 15", three_decay, u(0, 3), {
        "a": law("lognormal", 2, 0.3, (0.5, 4), (0.02, 1.5)),
        "b": law("gamma", 1, 0.2, (0.2, 3), (0.02, 1)),
        "e": law("normal", 0.5, 0.1, (-1, 2), (0.02, 1)),
    }, 15, 0.1)  # fmt: skip
    add("three, decay, correlated", three_decay, u(0, 3),
        {"a": tn(0, 4, 2, 0.4), "b": tn(0.1, 3, 1, 0.2), "e": tn(-1, 2, 0.5, 0.1)}, 60, 0.05,
        correlation=0.5, correlation_limits=(-0.9, 0.9))  # fmt: skip
    add("four, noise", four, _two, {"a": tn(-2, 4, 1, 0.3), "b": tn(-1, 3, 1, 0.2),
        "e": tn(-1, 3, 1, 0.3), "g": tn(-1, 3, 1, 0.1)}, 60, 0.2)  # fmt: skip
    quartet = {"a": tn(0, 4, 2, 0.4), "b": tn(0, 2, 1, 0.2), "e": tn(-1, 3, 1, 0.2),
               "g": tn(0, 2, 1, 0.2)}  # fmt: skip
    add("four, curved, 15", four_curved, _two, quartet, 15)
    add("four, curved, noise", four_curved, _two, quartet, 60, 0.1)
    add("line, large noise, 300", line, u(0, 3), {"a": tn(0, 3, 1.5, 0.3), "b": tn(-2, 4, 1, 0.2)},
        300, 1.0, (0.05, 3))  # fmt: skip
    add("oscillation, small noise", oscillation, u(4, 9), {"a": tn(0, 2, 1, 0.2)}, 60, 0.02,
        (0.002, 0.5))  # fmt: skip
    add("jump", jump, u(0.5, 2), {"a": tn(0, 2, 1, 0.2)})
    add("clipped hard", lambda c, a: np.clip(a * c, 0.8, 1.2), u(0.5, 2), {"a": tn(0, 3, 1, 0.3)},
        60, 0.02, (0.002, 0.5))  # fmt: skip
    add("very steep front", lambda c, a: np.tanh((c - a) / 0.01), u(0.2, 1.8),
        {"a": tn(0, 2, 1, 0.2)}, 60, 0.05, (0.005, 0.5))  # fmt: skip
    add("two jumps", lambda c, a: c + (a > 0.9) * 1.0 + (a > 1.15) * 0.5, u(0, 1),
        {"a": tn(0, 2, 1, 0.2)}, 60, 0.1, (0.01, 0.5))  # fmt: skip
    return made


RANDOM_STUDIES = tuple(_studies())
