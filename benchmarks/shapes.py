"""Small studies with a right model: virtual data of each, identified in about a second."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from aleator import (
    By,
    Censoring,
    Constant,
    Experiments,
    Free,
    Gamma,
    Inputs,
    LogNormal,
    Mixture,
    Noise,
    Normal,
    StudentError,
    TruncatedNormal,
)
from aleator.core.types import Array


@dataclass(frozen=True)
class Shape:
    """One study: `draw` makes what was measured of N experiments under the truth.

    `simulator` takes columns of the conditions and of the parameters. `values` observations of each
    experiment are at conditions between `span`. `law` draws the parameters of N experiments,
    `errors` the measurement errors of simulated values, one for each of the values. Where there is
    a `shift`, every other experiment is on rig B, and its first parameter larger by so much.
    """

    name: str
    simulator: Callable[..., Array]
    inputs: Inputs
    noise: Noise | None
    truth: Mapping[str, float]
    law: Callable[[np.random.Generator, int], dict[str, Array]]
    errors: Callable[[np.random.Generator, Array], Array]
    count: int = 40
    values: int = 3
    span: tuple[float, float] = (0.5, 3.0)
    above: float = np.inf
    shift: float = 0.0

    def table(self, seed: int) -> Experiments:
        """Virtual experiments; what is above `above` is known to be above it."""
        rng = np.random.default_rng([seed, *self.name.encode()])
        law, rig = self.law(rng, self.count), np.arange(self.count) % 2
        first = next(iter(law))
        law[first] = law[first] + self.shift * rig
        rows = np.repeat(np.arange(self.count), self.values)
        # the same conditions of all replicates, spread over the span in another order of each
        c = np.random.default_rng(7).permuted(np.linspace(*self.span, rows.size))
        eta = self.simulator(c, **{name: value[rows] for name, value in law.items()})
        y = eta + self.errors(rng, eta)
        table = pd.DataFrame({"c": c, "y": np.minimum(y, self.above)})
        if self.shift:
            table["rig"] = np.where(rig[rows] == 1, "B", "A")
        censored = None
        if np.isfinite(self.above):
            table["status"] = np.where(y > self.above, "above", "seen")
            censored = Censoring("status", right="above", measured="seen")
        table["id"] = [f"e{l}" for l in rows]
        return Experiments.from_frame(table, outcome="y", censored=censored)


def line(c: Array, a: Array) -> Array:
    """A straight line through zero."""
    return np.asarray(a * c)


def line_of_two(c: Array, a: Array, b: Array) -> Array:
    """A straight line."""
    return np.asarray(a + b * c)


def decay(c: Array, a: Array) -> Array:
    """An exponential decay."""
    return np.asarray(np.exp(-a * c))


def saturation(c: Array, a: Array, k: Array) -> Array:
    """Michaelis and Menten's curve."""
    return np.asarray(a * c / (k + c))


def logistic(c: Array, top: Array, half: Array, rate: Array) -> Array:
    """Growth that slows down towards `top`, half of which is reached at `half`."""
    return np.asarray(top / (1.0 + np.exp(-rate * (c - half))))


def cubic(c: Array, p0: Array, p1: Array, p2: Array, p3: Array) -> Array:
    """A sum of the first four Chebyshev polynomials."""
    return np.asarray(p0 + p1 * c + p2 * (2 * c**2 - 1) + p3 * (4 * c**3 - 3 * c))


def no_errors(_: np.random.Generator, eta: Array) -> Array:
    """None: what is simulated is what is measured."""
    return np.zeros(eta.shape)


def normal_errors(sd: float) -> Callable[[np.random.Generator, Array], Array]:
    """Independent normal errors."""
    return lambda rng, eta: sd * rng.standard_normal(eta.shape)


def _normals(**laws: tuple[float, float]) -> Callable[[np.random.Generator, int], dict[str, Array]]:
    return lambda rng, n: {
        name: mean + sd * rng.standard_normal(n) for name, (mean, sd) in laws.items()
    }


def _lognormal(mean: float, sd: float) -> Callable[[np.random.Generator, int], dict[str, Array]]:
    variance = np.log1p((sd / mean) ** 2)
    return lambda rng, n: {
        "a": np.exp(np.log(mean) - 0.5 * variance + np.sqrt(variance) * rng.standard_normal(n))
    }


def _truncated(rng: np.random.Generator, n: int) -> dict[str, Array]:
    drawn = 0.6 + 0.4 * rng.standard_normal(50 * n)
    return {"a": drawn[(drawn > 0.2) & (drawn < 3.0)][:n]}


def _mixed(rng: np.random.Generator, n: int) -> dict[str, Array]:
    return {"a": rng.choice([0.6, 1.4], n) + 0.1 * rng.standard_normal(n)}


def _gamma(rng: np.random.Generator, n: int) -> dict[str, Array]:
    return {"a": rng.gamma(6.25, 0.16, n)}


def _growth(rng: np.random.Generator, n: int) -> dict[str, Array]:
    normal = _normals(top=(4.0, 0.6), half=(1.2, 0.2))(rng, n)
    return {**normal, "rate": _lognormal(2.5, 0.4)(rng, n)["a"]}


def _correlated(rng: np.random.Generator, n: int) -> dict[str, Array]:
    u, v = rng.standard_normal((2, n))
    return {"a": 1.5 + 0.3 * u, "b": 1.0 + 0.4 * (0.6 * u + 0.8 * v)}


MEAN, SD, SMALL = Free(0.2, 4.0), Free(0.01, 2.0), Free(0.01, 1.0)
ONE = {"a.mean": 1.0, "a.sd": 0.25, "noise.sd": 0.1}
ONE_NORMAL = Inputs({"a": Normal(MEAN, SD)})
TWO = {"a.mean": 1.5, "a.sd": 0.3, "b.mean": 1.0, "b.sd": 0.4, "noise.sd": 0.2}
TWO_NORMALS = Inputs({"a": Normal(Free(-1, 4), SD), "b": Normal(Free(-2, 4), SD)})

SHAPES = (
    Shape("one value each", line, ONE_NORMAL, Noise(SMALL), ONE, _normals(a=(1.0, 0.25)),
          normal_errors(0.1), count=60, values=1),
    Shape("series of 3", line, ONE_NORMAL, Noise(SMALL), ONE, _normals(a=(1.0, 0.25)),
          normal_errors(0.1)),
    Shape("10 experiments", line, ONE_NORMAL, Noise(SMALL), ONE, _normals(a=(1.0, 0.25)),
          normal_errors(0.1), count=10),
    Shape("noise known", decay, Inputs({"a": TruncatedNormal((0.05, 4.0), MEAN, Free(0.02, 2.0))}),
          Noise(0.05), {"a.mean": 1.0, "a.sd": 0.25}, _normals(a=(1.0, 0.25)), normal_errors(0.05)),
    Shape("two parameters", line_of_two, TWO_NORMALS, Noise(SMALL), TWO,
          _normals(a=(1.5, 0.3), b=(1.0, 0.4)), normal_errors(0.2)),
    Shape("sd near zero", line_of_two, TWO_NORMALS, Noise(SMALL), {**TWO, "b.sd": 0.03},
          _normals(a=(1.5, 0.3), b=(1.0, 0.03)), normal_errors(0.2)),
    Shape("correlated", line_of_two,
          Inputs({"a": Normal(Free(-1, 4), SD), "b": Normal(Free(-2, 4), SD)},
                 {("a", "b"): Free(-0.95, 0.95)}),
          Noise(SMALL), {**TWO, "correlation.a.b": 0.6}, _correlated, normal_errors(0.2), values=5),
    Shape("lognormal", decay, Inputs({"a": LogNormal(MEAN, SD)}), Noise(SMALL),
          {"a.mean": 1.0, "a.sd": 0.4, "noise.sd": 0.05}, _lognormal(1.0, 0.4),
          normal_errors(0.05)),
    Shape("gamma", saturation, Inputs({"a": Gamma(MEAN, SD), "k": Constant(Free(0.1, 5.0))}),
          Noise(SMALL), {"a.mean": 1.0, "a.sd": 0.4, "k.value": 1.0, "noise.sd": 0.05},
          lambda rng, n: {**_gamma(rng, n), "k": np.ones(n)}, normal_errors(0.05)),
    Shape("truncated", line, Inputs({"a": TruncatedNormal((0.2, 3.0), Free(0.2, 2.0), SD)}),
          Noise(SMALL), {"a.mean": 0.6, "a.sd": 0.4, "noise.sd": 0.1}, _truncated,
          normal_errors(0.1)),
    Shape("Student's noise", line, ONE_NORMAL, Noise(SMALL, StudentError(4.0)), ONE,
          _normals(a=(1.0, 0.25)), lambda rng, eta: 0.1 * rng.standard_t(4.0, eta.shape)),
    Shape("a third censored", line, ONE_NORMAL, Noise(SMALL), ONE, _normals(a=(1.0, 0.25)),
          normal_errors(0.1), above=2.2),
    Shape("a covariate", line, Inputs({"a": Normal(By("1 + C(rig)", -2.0, 4.0), SD)}), Noise(SMALL),
          {"a.mean[Intercept]": 1.0, "a.mean[rig=B]": 0.3, "a.sd": 0.25, "noise.sd": 0.1},
          _normals(a=(1.0, 0.25)), normal_errors(0.1), shift=0.3),
    Shape("a mixture", line, Inputs({"a": Mixture((Normal(MEAN, SMALL), Normal(MEAN, SMALL)))}),
          Noise(SMALL), {"a.1.mean": 0.6, "a.2.mean": 1.4, "a.1.share": 0.5, "noise.sd": 0.1},
          _mixed, normal_errors(0.1)),
    Shape("12 experiments", line, ONE_NORMAL, Noise(0.1), {"a.mean": 1.0, "a.sd": 0.25},
          _normals(a=(1.0, 0.25)), normal_errors(0.1), count=12, values=1),
    Shape("300 experiments", line, ONE_NORMAL, Noise(0.1), {"a.mean": 1.0, "a.sd": 0.25},
          _normals(a=(1.0, 0.25)), normal_errors(0.1), count=300, values=1),
    Shape("without noise", line, ONE_NORMAL, None, {"a.mean": 1.0, "a.sd": 0.25},
          _normals(a=(1.0, 0.25)), no_errors, values=1),
    Shape("growth curves", logistic,
          Inputs({"top": Normal(Free(1, 9), SD), "half": Normal(Free(0, 3), SD),
                  "rate": LogNormal(Free(0.5, 6), SD)}),
          Noise(SMALL),
          {"top.mean": 4.0, "top.sd": 0.6, "half.mean": 1.2, "half.sd": 0.2, "rate.mean": 2.5,
           "rate.sd": 0.4, "noise.sd": 0.1},
          _growth, normal_errors(0.1), count=30, values=8),
    Shape("slopes and a covariate", line_of_two,
          Inputs({"a": Normal(By("1 + C(rig)", -2.0, 4.0), SD), "b": Normal(Free(-2, 4), SD)}),
          Noise(SMALL),
          {"a.mean[Intercept]": 1.5, "a.mean[rig=B]": 0.3, "a.sd": 0.3, "b.mean": 1.0, "b.sd": 0.4,
           "noise.sd": 0.2},
          _normals(a=(1.5, 0.3), b=(1.0, 0.4)), normal_errors(0.2), values=4, shift=0.3),
    Shape("four parameters", cubic,
          Inputs({f"p{k}": Normal(Free(-2, 4), SD) for k in range(4)}), Noise(SMALL),
          {f"p{k}.{of}": value for k in range(4) for of, value in (("mean", 1.0), ("sd", 0.3))}
          | {"noise.sd": 0.2},
          _normals(**{f"p{k}": (1.0, 0.3) for k in range(4)}), normal_errors(0.2), values=10,
          span=(-1.0, 1.0)),
    Shape("hardly any scatter", line_of_two,
          Inputs({"a": Normal(Free(-1, 4), SD), "b": Normal(Free(-2, 4), Free(0.001, 2.0))}),
          Noise(SMALL), {**TWO, "b.sd": 0.004},
          _normals(a=(1.5, 0.3), b=(1.0, 0.004)), normal_errors(0.2), count=27),
)  # fmt: skip
