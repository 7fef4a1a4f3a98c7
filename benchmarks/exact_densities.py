"""Twelve small synthetic studies whose likelihood is a closed form, or an integral over one line.

Without noise the simulators are monotone, so that an outcome tells its parameter. With noise,
linear simulators and normal laws make normal outcomes. Two studies have one integral over the
parameter of each experiment, by the trapezoidal rule.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import special

from aleator import (
    Beta,
    By,
    Censoring,
    Constant,
    Experiments,
    Free,
    Gamma,
    Inputs,
    LogNormal,
    Noise,
    Normal,
    TruncatedNormal,
)
from aleator.core.types import Array
from aleator.fit.question import Choices
from aleator.laws import Hyperparameter
from aleator.search.interface import LogLikelihood
from benchmarks.shapes import MEAN, SD, SMALL, decay, line, line_of_two, saturation

Alpha = Mapping[str, Array]
"""The hyperparameters by name, each (A, 1) for A values of alpha."""
Density = Callable[[Alpha, Array, Array], Array]
"""log p(y | alpha) (A, U) of U independent units with outcomes y (U, m) at conditions c (U, m)."""
Draw = Callable[[Mapping[str, float], Array, np.random.Generator], Array]
"""Outcomes (U, m) at conditions (U, m) under alpha."""


@dataclass(frozen=True)
class ExactStudy:
    """A study with its exact density, and the same study as `identify` takes it.

    Each of N experiments has `values` outcomes, at conditions between 0.5 and `upto`. Outcomes
    above `above` are censored. With `pairs` two experiments are one unit of the density, since they
    share a parameter of level `pair`; with `rigs` every other experiment is on rig B, and its
    conditions are negative for the density.
    """

    name: str
    density: Density
    draw: Draw
    simulator: Callable[..., Array]
    inputs: Inputs
    noise: Noise | None
    truth: Mapping[str, float]
    values: int = 1
    upto: float = 3.0
    above: float = np.inf
    pairs: bool = False
    rigs: bool = False

    def conditions(self, count: int) -> Array:
        """The conditions (U, m) of `count` experiments, the same in all data sets."""
        rows = np.linspace(0.5, self.upto, count * self.values)
        return np.random.default_rng(7).permuted(rows).reshape(count // (1 + self.pairs), -1)

    def table(self, y: Array, c: Array) -> Experiments:
        """The experiments as `identify` takes them."""
        count = y.size // self.values
        rows = np.repeat(np.arange(count), self.values)
        frame = pd.DataFrame({"c": c.ravel(), "y": y.ravel()})
        censored = None
        if self.rigs:
            frame["rig"] = np.where(rows % 2 == 1, "B", "A")
        if self.pairs:
            frame["pair"] = [f"p{l // 2}" for l in rows]
        if np.isfinite(self.above):
            frame["status"] = np.where(frame["y"] >= self.above, "above", "seen")
            censored = Censoring("status", right="above", measured="seen")
        frame["id"] = [f"e{l}" for l in rows]
        return Experiments.from_frame(frame, outcome="y", censored=censored)

    def likelihood(self, count: int, seed: int) -> ExactLikelihood:
        """The likelihood of a data set of `count` experiments drawn under the truth, there."""
        c = self.conditions(count)
        y = self.draw(
            {"noise.sd": 0.1, "b.mean": 0.0, **self.truth},
            c,
            np.random.default_rng([seed, count, *self.name.encode()]),
        )
        found = Choices.of(self.table(y, c), self.inputs, self.noise).hyperparameters
        start = np.array([self.truth.get(h.name, h.start) for h in found])
        return ExactLikelihood(self, found, start, y, c)


@dataclass(frozen=True, eq=False)
class ExactLikelihood:
    """The exact likelihood of outcomes y (U, m) at alpha (K,); its methods are `LikelihoodAt`'s.

    Scores are central differences, with steps of a share 1e-6 of the width of the limits.
    """

    study: ExactStudy
    hyperparameters: tuple[Hyperparameter, ...]
    alpha: Array
    y: Array
    c: Array

    def each(self, alphas: Array) -> Array:
        """The log-densities (A, U) of all units at alphas (A, K)."""
        named = {h.name: alphas[:, k, None] for k, h in enumerate(self.hyperparameters)}
        with np.errstate(all="ignore"):
            return self.study.density(named, self.y, self.c)

    def values(self, alphas: Array) -> Array:
        """The log-likelihood (A,) at alphas (A, K)."""
        return np.asarray(self.each(alphas).sum(axis=1))

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood and its scores at alpha (K,)."""
        own = [k for k, h in enumerate(self.hyperparameters) if h.free]
        width = np.array([h.upper - h.lower for h in self.hyperparameters])
        steps = 1e-6 * np.diag(width)[own]
        found = self.each(np.concatenate([alpha[None], alpha + steps, alpha - steps]))
        ahead, behind = np.split(found[1:], 2)
        scores = np.zeros((len(self.y), alpha.size))
        scores[:, own] = ((ahead - behind) / (2e-6 * width[own, None])).T
        return LogLikelihood(found[0], scores, np.zeros(len(self.y), dtype=np.int64))

    def scored(self) -> LogLikelihood:
        """The log-likelihood at alpha."""
        return self(self.alpha)

    def objective(self) -> ExactLikelihood:
        """The log-likelihood as a function of alpha."""
        return self

    def rough(self) -> ExactLikelihood:
        """The same likelihood: there are no nodes."""
        return self

    def drawn(self, _: object, rng: np.random.Generator) -> Array:
        """Outcomes drawn under alpha."""
        named = {h.name: v for h, v in zip(self.hyperparameters, self.alpha.tolist(), strict=True)}
        return self.study.draw(named, self.c, rng)

    def seeing(self, y: Array) -> ExactLikelihood:
        """The likelihood of other outcomes."""
        return replace(self, y=y)


# ------------------------------------------------------------------------------------- densities


def _normal(x: Array, mean: Array, sd: Array) -> Array:
    return np.asarray(-0.5 * ((x - mean) / sd) ** 2 - np.log(sd))


def _of_logarithm(mean: Array, sd: Array) -> tuple[Array, Array]:
    """Mean and sd of the logarithm of a lognormal variate."""
    variance = np.log1p((sd / mean) ** 2)
    return np.log(mean) - 0.5 * variance, np.sqrt(variance)


def _lognormal(a: Alpha, x: Array) -> Array:
    return _normal(np.log(x), *_of_logarithm(a["a.mean"], a["a.sd"]))


def _truncated(a: Alpha, x: Array) -> Array:
    mean, sd = a["a.mean"], a["a.sd"]
    mass = special.ndtr((3.0 - mean) / sd) - special.ndtr((0.2 - mean) / sd)
    return np.asarray(_normal(x, mean, sd) - np.log(mass))


def _beta(a: Alpha, x: Array) -> Array:
    m, s = 0.5 * a["a.mean"], 0.5 * a["a.sd"]
    both = m * (1.0 - m) / s**2 - 1.0
    p, q, u = m * both, (1.0 - m) * both, 0.5 * x
    return np.asarray((p - 1.0) * np.log(u) + (q - 1.0) * np.log1p(-u) - special.betaln(p, q))


def _gamma(a: Alpha, x: Array) -> Array:
    shape, scale = (a["a.mean"] / a["a.sd"]) ** 2, a["a.sd"] ** 2 / a["a.mean"]
    found = (shape - 1.0) * np.log(x) - x / scale - special.gammaln(shape)
    return np.asarray(found - shape * np.log(scale))


def _multinormal(y: Array, mean: Array, covariance: Array) -> Array:
    """log p (A, U) of y (U, m) with means (A, U, m) and covariances (A, U, m, m)."""
    off = (y - mean)[..., None]
    square = np.sum(off * np.linalg.solve(covariance, off), axis=(-2, -1))
    return np.asarray(-0.5 * (square + np.linalg.slogdet(covariance)[1]))


def _series(a: Alpha, y: Array, c: Array) -> Array:
    """Outcomes a c with noise, of a normal a whose mean is larger on rig B, if it depends on it."""
    mean = a.get("a.mean")
    if mean is None:
        mean = a["a.mean[Intercept]"] + a["a.mean[rig=B]"] * (np.arange(len(c)) % 2)
    scatter = _scatter(a["a.sd"], c) + _errors(a, c)
    return _multinormal(y, mean[..., None] * c, scatter)


def _two(a: Alpha, y: Array, c: Array) -> Array:
    """Outcomes a + b c with noise, of correlated normal a and b."""
    ones, rho = np.ones_like(c), a["correlation.a.b"]
    both = (rho * a["a.sd"] * a["b.sd"])[..., None, None] * (c[:, :, None] + c[:, None, :])
    scatter = _scatter(a["a.sd"], ones) + _scatter(a["b.sd"], c) + both + _errors(a, c)
    return _multinormal(y, a["a.mean"][..., None] + a["b.mean"][..., None] * c, scatter)


def _pairs(a: Alpha, y: Array, c: Array) -> Array:
    """Outcomes a + b with noise: two values with one a, two with another, and b of all four."""
    same = np.kron(np.eye(2), np.ones((2, 2)))
    scatter = a["a.sd"][..., None, None] ** 2 * same + _scatter(a["b.sd"], np.ones_like(c))
    return _multinormal(y, a["a.mean"][..., None] + 0.0 * c, scatter + _errors(a, c))


def _scatter(sd: Array, c: Array) -> Array:
    return np.asarray(sd[..., None, None] ** 2 * (c[:, :, None] * c[:, None, :]))


def _errors(a: Alpha, c: Array) -> Array:
    return np.asarray(a["noise.sd"][..., None, None] ** 2 * np.eye(c.shape[1]))


THETA, FINE = np.linspace(-5.0, 5.0, 97), np.linspace(-5.0, 5.0, 193)
"""Values of the normal variate for integrals over a curved and over a steep outcome."""


def _integrated(log_density: Array, theta: Array) -> Array:
    """The logarithm (A, U) of the integral of a density (A, U, J) over a normal variate."""
    terms = log_density - 0.5 * theta**2
    top = terms.max(axis=-1, keepdims=True)
    return np.asarray(np.log(np.exp(terms - top).sum(axis=-1)) + top[..., 0])


def _decays(a: Alpha, y: Array, c: Array) -> Array:
    """Outcomes exp(-a c) with noise, of a lognormal a."""
    mean, sd = _of_logarithm(a["a.mean"], a["a.sd"])
    eta = np.exp(-np.exp(mean + sd * THETA)[:, None, None, :] * c[..., None])
    return _integrated(
        _normal(y[..., None], eta, a["noise.sd"][..., None, None]).sum(axis=2), THETA
    )


def _censored(a: Alpha, y: Array, c: Array) -> Array:
    """Outcomes a c with noise, of a normal a; those above `ABOVE` are known to be above it."""
    eta = (a["a.mean"] + a["a.sd"] * FINE)[:, None, None, :] * c[..., None]
    noise, beyond = a["noise.sd"][..., None, None], y >= ABOVE
    each = _normal(y[..., None], eta, noise)
    each[:, beyond] = special.log_ndtr((eta[:, beyond] - ABOVE) / noise[..., 0])
    return _integrated(each.sum(axis=2), FINE)


def _exactly(
    law: Callable[[Alpha, Array], Array], inverse: Callable[[Array, Array], Array]
) -> Density:
    """The density of exact outcomes, but for a factor without alpha; `inverse` (y, c) gives a."""
    return lambda a, y, c: law(a, inverse(y, c)[:, 0])


# ------------------------------------------------------------------------------------- drawn data


def _noisy(eta: Array, a: Mapping[str, float], rng: np.random.Generator) -> Array:
    return np.asarray(eta + a["noise.sd"] * rng.standard_normal(eta.shape))


def _a_normal(a: Mapping[str, float], c: Array, rng: np.random.Generator) -> Array:
    return rng.normal(a["a.mean"], a["a.sd"], (len(c), 1))


def _a_lognormal(a: Mapping[str, float], c: Array, rng: np.random.Generator) -> Array:
    mean, sd = _of_logarithm(np.array(a["a.mean"]), np.array(a["a.sd"]))
    return rng.lognormal(float(mean), float(sd), (len(c), 1))


def _a_truncated(a: Mapping[str, float], c: Array, rng: np.random.Generator) -> Array:
    low, high = special.ndtr((np.array([0.2, 3.0]) - a["a.mean"]) / a["a.sd"])
    return np.asarray(a["a.mean"] + a["a.sd"] * special.ndtri(rng.uniform(low, high, (len(c), 1))))


def _a_beta(a: Mapping[str, float], c: Array, rng: np.random.Generator) -> Array:
    m, s = 0.5 * a["a.mean"], 0.5 * a["a.sd"]
    both = m * (1.0 - m) / s**2 - 1.0
    return np.asarray(2.0 * rng.beta(m * both, (1.0 - m) * both, (len(c), 1)))


def _a_gamma(a: Mapping[str, float], c: Array, rng: np.random.Generator) -> Array:
    return rng.gamma((a["a.mean"] / a["a.sd"]) ** 2, a["a.sd"] ** 2 / a["a.mean"], (len(c), 1))


def _draw_series(a: Mapping[str, float], c: Array, rng: np.random.Generator) -> Array:
    return _noisy(_a_normal(a, c, rng) * c, a, rng)


def _draw_on_rigs(a: Mapping[str, float], c: Array, rng: np.random.Generator) -> Array:
    rig = np.arange(len(c))[:, None] % 2
    mean = a["a.mean[Intercept]"] + a["a.mean[rig=B]"] * rig
    return _noisy(rng.normal(mean, a["a.sd"]) * c, a, rng)


def _draw_two(a: Mapping[str, float], c: Array, rng: np.random.Generator) -> Array:
    u, v = rng.standard_normal((2, len(c), 1))
    rho = a["correlation.a.b"]
    slope = a["b.mean"] + a["b.sd"] * (rho * u + np.sqrt(1.0 - rho**2) * v)
    return _noisy(a["a.mean"] + a["a.sd"] * u + slope * c, a, rng)


def _draw_pairs(a: Mapping[str, float], c: Array, rng: np.random.Generator) -> Array:
    own = np.repeat(rng.normal(a["a.mean"], a["a.sd"], (len(c), 2)), 2, axis=1)
    return _noisy(own + rng.normal(0.0, a["b.sd"], (len(c), 1)), a, rng)


def _draw_decays(a: Mapping[str, float], c: Array, rng: np.random.Generator) -> Array:
    return _noisy(np.exp(-_a_lognormal(a, c, rng) * c), a, rng)


def _draw_censored(a: Mapping[str, float], c: Array, rng: np.random.Generator) -> Array:
    return np.minimum(_draw_series(a, c, rng), ABOVE)


# ------------------------------------------------------------------------------------- studies


def total(a: Array, b: Array) -> Array:
    """The sum of two parameters."""
    return np.asarray(a + b)


ABOVE = 2.2
"""Outcomes above this are censored: about a third."""
ONE, LOG = {"a.mean": 1.0, "a.sd": 0.25}, {"a.mean": 1.0, "a.sd": 0.4}
NORMALS = Inputs({"a": Normal(MEAN, SD)})
LOGNORMALS = Inputs({"a": LogNormal(MEAN, SD)})
STUDIES = (
    ExactStudy("normal", _exactly(lambda a, x: _normal(x, a["a.mean"], a["a.sd"]), np.divide),
               lambda a, c, rng: _a_normal(a, c, rng) * c, line, NORMALS, None, ONE),
    ExactStudy("lognormal, decay", _exactly(_lognormal, lambda y, c: -np.log(y) / c),
               lambda a, c, rng: np.exp(-_a_lognormal(a, c, rng) * c), decay, LOGNORMALS, None,
               LOG),
    ExactStudy("truncated normal", _exactly(_truncated, np.divide),
               lambda a, c, rng: _a_truncated(a, c, rng) * c, line,
               Inputs({"a": TruncatedNormal((0.2, 3.0), MEAN, SD)}), None, LOG),
    ExactStudy("beta", _exactly(_beta, np.divide), lambda a, c, rng: _a_beta(a, c, rng) * c, line,
               Inputs({"a": Beta((0.0, 2.0), Free(0.4, 1.4), Free(0.02, 0.75))}), None,
               {"a.mean": 0.8, "a.sd": 0.3}),
    ExactStudy("gamma, saturation", _exactly(_gamma, lambda y, c: y * (1.0 + c) / c),
               lambda a, c, rng: _a_gamma(a, c, rng) * c / (1.0 + c), saturation,
               Inputs({"a": Gamma(MEAN, SD), "k": Constant(1.0)}), None, LOG),
    ExactStudy("normal, one value, known noise", _series, _draw_series, line, NORMALS, Noise(0.1),
               ONE),
    ExactStudy("normal, series of 3", _series, _draw_series, line, NORMALS, Noise(SMALL),
               {**ONE, "noise.sd": 0.1}, values=3),
    ExactStudy("lognormal, decay, series of 3", _decays, _draw_decays, decay, LOGNORMALS,
               Noise(SMALL), {**LOG, "noise.sd": 0.05}, values=3),
    ExactStudy("two correlated parameters", _two, _draw_two, line_of_two,
               Inputs({"a": Normal(Free(-1, 4), SD), "b": Normal(Free(-2, 4), SD)},
                      {("a", "b"): Free(-0.95, 0.95)}), Noise(0.1),
               {"a.mean": 1.5, "a.sd": 0.4, "b.mean": 1.0, "b.sd": 0.5, "correlation.a.b": 0.3},
               values=5),
    ExactStudy("a covariate", _series, _draw_on_rigs, line,
               Inputs({"a": Normal(By("1 + C(rig)", -2.0, 4.0), SD)}), Noise(0.1),
               {"a.mean[Intercept]": 1.0, "a.mean[rig=B]": 0.3, "a.sd": 0.25}, values=3, rigs=True),
    ExactStudy("a third censored", _censored, _draw_censored, line, NORMALS, Noise(0.1), ONE,
               values=3, above=ABOVE),
    ExactStudy("pairs (levels)", _pairs, _draw_pairs, total,
               Inputs({"a": Normal(Free(-1.0, 3.0), SD), "b": Normal(0.0, SD)},
                      levels={"b": "pair"}), Noise(0.1),
               {"a.mean": 1.0, "a.sd": 0.2, "b.sd": 0.3}, values=2, pairs=True),
)  # fmt: skip
