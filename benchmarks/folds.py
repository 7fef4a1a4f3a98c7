"""Without noise, responses with extremes, saddles, folds and kinks: is what is reported true?

Each study has outcomes drawn with a seed of its own, without noise, of a response whose level sets
are known in closed form. So the exact log-likelihood is a sum over roots, or an integral along a
curve that is smooth by its own parameter, and is maximized exactly too. Reported are the error of
the log-likelihood at the same alpha beside the error that is stated, the distance of the estimates
from the exact maximum in standard errors, and the verdicts.
"""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table
from scipy import optimize, stats

from aleator import (
    Free,
    Identification,
    Inputs,
    LogNormal,
    Normal,
    ResponseSurface,
    TruncatedNormal,
    identify,
)
from aleator.core.types import Array

Points = tuple[Array, Array]
"""Points x (K, s) of a level set, and their weights (K,)."""
Set = Callable[[float, float], Points]
"""The level set {x: eta(c, x) = y} of one experiment, by c and y."""
Level = Callable[..., Set]
"""Level sets by the laws, and by how many panels an integral along one has."""

Curve = Callable[..., Any]
"""A function of conditions and parameters, or of a condition where it gives places."""

PANELS, GAUSS = 1500, np.polynomial.legendre.leggauss(4)
"""Panels of an integral along a curve, and the points of each."""
WIDE = 12.0
"""Standard deviations beyond which a law without a box is taken to end."""
SEED = 5001
"""The first of three seeds."""


@dataclass(frozen=True)
class Law:
    """A law of one parameter with its truth: truncated normal on a box, normal or lognormal."""

    mean: float
    sd: float
    box: tuple[float, float] | None = None
    log: bool = False

    def free(self) -> TruncatedNormal | Normal | LogNormal:
        """The law with a mean and a standard deviation that are identified."""
        if self.box:
            return TruncatedNormal(box=self.box)
        if self.log:
            return LogNormal(Free(0.2 * self.mean, 3.0 * self.mean), Free(0.01, 2.0 * self.mean))
        low, high = self.mean - 5.0 * self.sd, self.mean + 5.0 * self.sd
        return Normal(Free(low, high), Free(0.05 * self.sd, 5.0 * self.sd))

    def of(self, mean: float, sd: float) -> stats.rv_continuous:
        """The distribution at these hyperparameters."""
        if self.box:
            low, high = ((end - mean) / sd for end in self.box)
            return stats.truncnorm(low, high, mean, sd)
        if self.log:
            width = np.sqrt(np.log1p((sd / mean) ** 2))
            return stats.lognorm(width, scale=mean * np.exp(-0.5 * width**2))
        return stats.norm(mean, sd)

    @property
    def ends(self) -> tuple[float, float]:
        """Where it may be."""
        if self.box:
            return self.box
        low = 1e-6 if self.log else self.mean - WIDE * self.sd
        return low, self.mean + WIDE * self.sd


@dataclass(frozen=True)
class Shape:
    """A response of c and one or two parameters, its level sets, and the laws of a study."""

    name: str
    response: Callable[..., Array]
    level: Level
    laws: tuple[Law, ...]
    range: tuple[float, float] = (0.5, 2.0)


def roots(response: Callable[..., Array], breaks: Callable[[float], list[float]]) -> Level:
    """Level sets of one parameter: a root of each monotone branch between `breaks`."""

    def level(laws: tuple[Law, ...], _: int) -> Set:
        low, high = laws[0].ends

        def points(c: float, y: float) -> Points:
            ends = np.unique(np.clip([low, *breaks(c), high], low, high))
            found = []
            for left, right in pairwise(ends):
                inner = np.clip(left + (right - left) * np.array([1e-13, 1 - 1e-13]), left, right)
                off = [float(response(c, a)) - y for a in inner]
                if off[0] * off[1] < 0.0:
                    found.append(optimize.brentq(lambda a: float(response(c, a)) - y, *inner,
                                                 xtol=1e-15, rtol=1e-14))  # fmt: skip
            x = np.array(found)
            room = np.array([np.abs(a - ends).min() for a in found])
            step = np.minimum(1e-5, 0.3 * room)
            slope = (response(c, x + step) - response(c, x - step)) / (2.0 * step)
            return x[:, None], 1.0 / np.abs(slope)

        return points

    return level


def _panels(ends: Array) -> Points:
    """Points and weights of Gauss between rising ends."""
    half, middle = 0.5 * np.diff(ends), 0.5 * (ends[1:] + ends[:-1])
    return (middle[:, None] + half[:, None] * GAUSS[0]).ravel(), (half[:, None] * GAUSS[1]).ravel()


def graph(g: Curve, k: Curve, breaks: Curve) -> Level:
    """Level sets of y = g(c, a) + k(c) b, by a: smooth between `breaks` of a."""

    def level(laws: tuple[Law, ...], panels: int) -> Set:
        low, high = laws[0].ends

        def points(c: float, y: float) -> Points:
            ends = np.unique(np.clip([*np.linspace(low, high, panels + 1), *breaks(c)], low, high))
            a, weight = _panels(ends)
            return np.stack([a, (y - g(c, a)) / k(c)], axis=1), weight / abs(k(c))

        return points

    return level


def ellipse(inner: Curve, m: float, n: float, k: float) -> Level:
    """Level sets of y = f((a - m)^2 + k (b - n)^2), where `inner` gives r^2 and dr^2/dy."""

    def level(_: tuple[Law, ...], __: int) -> Set:
        def points(c: float, y: float) -> Points:
            square, slope = inner(c, y)
            angle = 2.0 * np.pi * (np.arange(4000) + 0.5) / 4000
            r = np.sqrt(max(square, 0.0))
            x = np.stack([m + r * np.cos(angle), n + r / np.sqrt(k) * np.sin(angle)], axis=1)
            return x, np.full(4000, abs(slope) * np.pi / np.sqrt(k) / 4000)

        return points

    return level


def saddle(m: float, n: float) -> Level:
    """Level sets of y = c (a - m)(b - n): hyperbolas."""

    def level(laws: tuple[Law, ...], panels: int) -> Set:
        reach = max(abs(end - at) for law, at in zip(laws, (m, n), strict=True) for end in law.ends)

        def points(c: float, y: float) -> Points:
            z = y / c
            a, b = (np.abs(np.subtract(law.ends, at)) for law, at in zip(laws, (m, n), strict=True))
            low, high = np.log(abs(z) / reach), np.log(reach)
            # the curve leaves a box where a or b is at an end of it
            leaves = np.clip(np.log([*a, *(abs(z) / b)]), low, high)
            t, weight = _panels(np.unique([*np.linspace(low, high, panels + 1), *leaves]))
            u = np.concatenate([np.exp(t), -np.exp(t)])
            return np.stack([m + u, n + z / u], axis=1), np.tile(weight, 2) / c

        return points

    return level


def either(largest: bool) -> Level:
    """Level sets of y = max(a, c b), or of the smallest: two half lines."""

    def level(laws: tuple[Law, ...], panels: int) -> Set:
        def points(c: float, y: float) -> Points:
            parts = []
            for k, (at, scale) in enumerate([(y, 1.0), (y / c, c)]):
                other = 1 - k
                edge = y / c if k == 0 else y
                low, high = laws[other].ends
                low, high = (low, min(edge, high)) if largest else (max(edge, low), high)
                if high <= low:
                    continue
                ends = np.linspace(low, high, panels + 1)
                half, middle = 0.5 * np.diff(ends), 0.5 * (ends[1:] + ends[:-1])
                along = (middle[:, None] + half[:, None] * GAUSS[0]).ravel()
                x = np.empty((along.size, 2))
                x[:, k], x[:, other] = at, along
                parts.append((x, (half[:, None] * GAUSS[1]).ravel() / scale))
            x_of, weights_of = zip(*parts, strict=True)
            return np.concatenate(x_of), np.concatenate(weights_of)

        return points

    return level


def _nothing(_: float) -> list[float]:
    return []


A, B = (0.0, 2.0), (-1.0, 3.0)


def _one(name: str, response: Curve, breaks: Curve, law: Law,
         c: tuple[float, float] = (0.5, 2.0)) -> Shape:  # fmt: skip
    return Shape(name, response, roots(response, breaks), (law,), c)


def _two(name: str, g: Curve, k: Curve, breaks: Curve, *laws: Law,
         c: tuple[float, float] = (0.5, 2.0)) -> Shape:  # fmt: skip
    return Shape(name, lambda c, a, b: g(c, a) + k(c) * b, graph(g, k, breaks), laws, c)


SHAPES = (
    _one("two slopes", lambda c, a: np.maximum(a - c, 0.3 * (c - a)), lambda c: [c],
         Law(1.0, 0.3, A), (0.2, 1.8)),
    _one("|a - c|", lambda c, a: np.abs(a - c) + 0.1 * c, lambda c: [c],
         Law(1.1, 0.35), (0.4, 1.6)),
    _one("square", lambda c, a: a * a + 0.01 * c, lambda _: [0.0], Law(0.3, 0.4), (0.0, 1.0)),
    _one("maximum", lambda c, a: 2.0 - (a - c) ** 2, lambda c: [c], Law(1.0, 0.25, A), (0.6, 1.4)),
    _one("bump", lambda c, a: np.exp(-0.5 * ((a - c) / 0.6) ** 2) + 0.2 * c, lambda c: [c],
         Law(1.0, 0.3, A), (0.3, 1.7)),
    _one("waves", lambda c, a: np.sin(3.0 * c * a) + 0.3 * a,
         lambda c: [s * (np.arccos(-0.1 / c) + 2.0 * np.pi * j) / (3.0 * c) for j in range(-4, 5)
                    for s in (1, -1)], Law(1.0, 0.15, A), (0.8, 1.6)),
    _one("cubic fold", lambda c, a: a**3 - 0.5 * c * a,
         lambda c: [-np.sqrt(c / 6.0), np.sqrt(c / 6.0)], Law(0.3, 0.4), (0.5, 2.0)),
    _one("kink and hill", lambda c, a: np.minimum(c * a, 2.5 - a**2),
         lambda c: [0.5 * (-c + np.sqrt(c * c + 10.0)), 0.0], Law(1.2, 0.3, (0.0, 2.5))),
    _one("valley, lognormal", lambda c, a: np.log(a / c) ** 2 + 0.2 * c, lambda c: [c],
         Law(1.0, 0.4, log=True), (0.5, 1.5)),
    _two("fold |a - c| + b c", lambda c, a: np.abs(a - c), lambda c: c, lambda c: [c],
         Law(1.0, 0.25, A), Law(1.0, 0.2, A), c=(0.2, 1.8)),
    _two("valley floor", lambda c, a: (a - c) ** 2, lambda _: 0.05, lambda c: [c],
         Law(1.0, 0.3, A), Law(1.0, 0.3, B), c=(0.5, 1.5)),
    _two("sharp valley", lambda c, a: np.abs(a - c), lambda _: 0.02, lambda c: [c],
         Law(1.0, 0.3), Law(1.0, 0.3), c=(0.5, 1.5)),
    _two("waves and a line", lambda c, a: np.sin(2.5 * c * a), lambda _: 0.3, _nothing,
         Law(1.0, 0.2, A), Law(1.0, 0.25, B), c=(0.7, 1.4)),
    Shape("hill", lambda c, a, b: c - (a - 1.0) ** 2 - 2.0 * (b - 0.5) ** 2,
          ellipse(lambda c, y: (c - y, 1.0), 1.0, 0.5, 2.0), (Law(1.1, 0.3), Law(0.6, 0.25))),
    Shape("bowl on a box", lambda c, a, b: c * ((a - 1.0) ** 2 + (b - 1.0) ** 2),
          ellipse(lambda c, y: (y / c, 1.0 / c), 1.0, 1.0, 1.0),
          (Law(1.2, 0.4, A), Law(0.8, 0.4, A))),
    Shape("round bump", lambda c, a, b: c * np.exp(-((a - 1.0) ** 2) - 0.5 * (b - 1.0) ** 2),
          ellipse(lambda c, y: (-np.log(y / c), 1.0 / y), 1.0, 1.0, 0.5),
          (Law(1.0, 0.5), Law(1.2, 0.6))),
    Shape("cone", lambda c, a, b: c * np.sqrt((a - 1.0) ** 2 + 2.0 * (b - 1.0) ** 2),
          ellipse(lambda c, y: ((y / c) ** 2, 2.0 * y / c**2), 1.0, 1.0, 2.0),
          (Law(1.0, 0.3, A), Law(1.1, 0.3, A))),
    Shape("saddle", lambda c, a, b: c * (a - 1.0) * (b - 0.8), saddle(1.0, 0.8),
          (Law(1.1, 0.3), Law(0.9, 0.25))),
    Shape("saddle in a box", lambda c, a, b: c * (a - 1.0) * (b - 1.0), saddle(1.0, 1.0),
          (Law(1.2, 0.35, A), Law(0.9, 0.35, A))),
    Shape("the larger", lambda c, a, b: np.maximum(a, c * b), either(True),
          (Law(1.0, 0.25, A), Law(0.9, 0.2, A))),
    Shape("the smaller", lambda c, a, b: np.minimum(a, c * b), either(False),
          (Law(1.0, 0.25), Law(1.0, 0.2))),
)  # fmt: skip


@dataclass(frozen=True)
class Study:
    """Outcomes of a shape, drawn with a seed; of a `slow` simulator surfaces are made."""

    shape: Shape
    seed: int
    count: int = 60
    slow: bool = False

    def table(self) -> pd.DataFrame:
        """The experiments."""
        rng = np.random.default_rng([self.seed, *self.shape.name.encode()])
        c = rng.uniform(*self.shape.range, self.count)
        x = [
            law.of(law.mean, law.sd).ppf(rng.uniform(1e-12, 1.0, self.count))
            for law in self.shape.laws
        ]
        return pd.DataFrame({"c": c, "y": self.shape.response(c, *x)})

    @property
    def inputs(self) -> Inputs:
        """The laws that are identified."""
        return Inputs({n: law.free() for n, law in zip("ab", self.shape.laws, strict=False)})

    def identified(self, **options: Any) -> Identification:
        """What `identify` reports on the simulator itself, or on surfaces of it."""
        choice = ResponseSurface(surfaces="own" if self.slow else None)
        return identify(
            self.shape.response, self.table(), self.inputs, outcome="y", vectorized=True,
            propagation=choice, **options,
        )  # fmt: skip


class Exact:
    """The exact log-likelihood of a study, at any alpha near one that is given."""

    def __init__(self, study: Study, alpha: Array) -> None:
        laws = study.shape.laws
        narrow = max(law.sd / sd for law, sd in zip(laws, alpha[1::2], strict=True))
        level = study.shape.level(laws, round(PANELS * max(1.0, narrow)))
        table = study.table()
        sets = [level(c, y) for c, y in zip(table["c"], table["y"], strict=True)]
        self.laws = study.shape.laws
        owner = np.repeat(np.arange(len(sets)), [len(weight) for _, weight in sets])
        x, weight = (np.concatenate(part) for part in zip(*sets, strict=True))
        # points that no law near alpha has anything at cost time only
        wide = [law.of(mean, 3.0 * sd).pdf(x[:, k]) for k, (law, mean, sd) in
                enumerate(zip(laws, alpha[::2], alpha[1::2], strict=True))]  # fmt: skip
        kept = np.prod(wide, axis=0) > 0.0
        kept &= np.prod([p > 1e-20 * p.max() for p in wide], axis=0, dtype=bool)
        self.owner, self.x, self.weight = owner[kept], x[kept], weight[kept]
        self.count = len(sets)

    def each(self, alpha: Array) -> Array:
        """Log-densities (N,)."""
        p = self.weight.copy()
        for k, law in enumerate(self.laws):
            p *= law.of(*alpha[2 * k : 2 * k + 2]).pdf(self.x[:, k])
        with np.errstate(divide="ignore"):
            return np.log(np.bincount(self.owner, p, minlength=self.count))

    def total(self, alpha: Array) -> float:
        """The log-likelihood."""
        return float(self.each(alpha).sum())

    def maximum(self, alpha: Array, errors: Array, limits: Array) -> Array:
        """The nearest maximum within the limits (K, 2), by steps of `errors`."""

        def lost(z: Array) -> float:
            at = alpha + errors * z
            if np.any(at < limits[:, 0]) or np.any(at > limits[:, 1]):
                return 1e10
            value = self.total(at)
            return -value if np.isfinite(value) else 1e10

        options = {"xatol": 1e-3, "fatol": 1e-5, "maxfev": 1500}
        simplex = np.concatenate([np.zeros((1, alpha.size)), 0.5 * np.eye(alpha.size)])
        found = optimize.minimize(
            lost, simplex[0], method="Nelder-Mead", options={**options, "initial_simplex": simplex}
        )
        return np.asarray(alpha + errors * found.x)


def measured(study: Study) -> dict[str, object]:
    """What is reported, and what is true."""
    began = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = study.identified()
    seconds = time.process_time() - began
    alpha = np.array([one.estimate for one in found.alpha.values()])
    exact = Exact(study, alpha)
    errors = np.array([one.standard_error or np.nan for one in found.alpha.values()])
    steps = np.where(np.isfinite(errors), errors, 0.1 * np.abs(alpha) + 1e-3)
    limits = np.array([(h.lower, h.upper) for h in study.inputs.hyperparameters])
    best = exact.maximum(alpha, steps, limits)
    reported = found.log_likelihood
    return {
        "shape": study.shape.name,
        "seed": study.seed,
        "slow": study.slow,
        "sound": found.sound,
        "consistent": found.consistent,
        "off": reported.estimated - exact.total(alpha),
        "error": reported.error,
        "verified": None if reported.verified is None else reported.verified - exact.total(alpha),
        "verified_error": reported.verified_standard_error,
        "deficit": exact.total(best) - exact.total(alpha),
        "distance": float(np.max(np.abs(alpha - best) / steps)),
        "runs": found.runs,
        "way": found.propagation,
        "seconds": seconds,
        "warnings": [f"{w.about}: {w.message}"[:140] for w in found.warnings],
    }


def studies() -> tuple[Study, ...]:
    """Every shape twice on the simulator itself, and once on surfaces."""
    fast = [Study(shape, SEED + k) for k in (0, 1) for shape in SHAPES]
    return (*fast, *(Study(shape, SEED + 2, 30, slow=True) for shape in SHAPES))


def print_folds(console: Console, path: Path, _: int) -> None:
    """Each study as soon as it is measured, then how many were right."""
    known = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done = {(one["shape"], one["seed"], one["slow"]) for one in known}
    table = Table(
        "shape", "seed", "way", "off", "stated", "distance", "verdicts", "seconds", "runs"
    )
    rows = list(known)
    for study in studies():
        if (study.shape.name, study.seed, study.slow) not in done:
            row = measured(study)
            rows.append(row)
            with path.open("a") as file:
                file.write(json.dumps(row) + "\n")
            console.print(row, soft_wrap=True)
    for row in rows:
        verdict = f"{'sound' if row['sound'] else 'REFUSED'}, consistent {row['consistent']}"
        stated = "-" if row["error"] is None else f"{row['error']:.3g}"
        table.add_row(
            str(row["shape"]), str(row["seed"]), f"{row['way']}{' slow' * bool(row['slow'])}",
            f"{row['off']:.3g}", stated, f"{row['distance']:.2f}", verdict,
            f"{row['seconds']:.1f}", str(row["runs"]),
        )  # fmt: skip
    console.print(table)
