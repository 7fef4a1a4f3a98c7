"""Eleven unlike simulators with the laws, the experiments and the errors of a study; all synthetic.

Each study is drawn from its own law by a seed. The truth of a benchmark is the exact answer to a
study, not the law that it was drawn from.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import RectBivariateSpline

from aleator import (
    Beta,
    Constant,
    Experiments,
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
from aleator.simulators.function import FunctionSimulator
from examples.wet_clutch.bench import BOX, LEVELS, design
from examples.wet_clutch.model import shifting_time

Simulated = Array | Mapping[str, Array]
Errors = Noise | Mapping[str, Noise] | None


@dataclass(frozen=True)
class Marginal:
    """A law with what is known of each of its hyperparameters."""

    made: Callable[..., Any]
    known: Mapping[str, Free]

    def law(self, of: Callable[[str, Free], Free | float], name: str) -> Any:
        """The law of parameter `name` with `of(name, known)` for each hyperparameter."""
        return self.made(**{key: of(f"{name}.{key}", one) for key, one in self.known.items()})


@dataclass(frozen=True)
class Studied:
    """One simulator with all that a study of it needs; `table(seed)` draws its experiments.

    `simulator` takes arrays, one row of the table for each run. `series` is the same model as one
    run that makes all rows of an experiment, where there is one. `truth` is the alpha of the data,
    by name, with the noise.
    """

    name: str
    simulator: Callable[..., Simulated]
    laws: Mapping[str, Marginal]
    truth: Mapping[str, float]
    conditions: Callable[[np.random.Generator], pd.DataFrame]
    noise: Errors = None
    series: Callable[..., Array] | None = None
    correlation: Mapping[tuple[str, str], Free] = field(default_factory=dict)

    def table(self, seed: int) -> Experiments:
        """The experiments of a seed, drawn from the law of the truth."""
        frame = self._frame(seed)
        outcomes = list(self.noise) if isinstance(self.noise, Mapping) else ["y"]
        return Experiments.from_frame(frame, outcome=outcomes)

    @property
    def slow(self) -> FunctionSimulator:
        """The simulator as one of which runs are dear: that of a series, where there is one."""
        if self.series is not None:
            return FunctionSimulator(self.series, series=True)
        return self.exact

    @property
    def sloped(self) -> FunctionSimulator:
        """The simulator as one of which runs are dear and give derivatives."""
        return FunctionSimulator(WithDifferences(self.simulator, self.inputs.names), jac=True)

    @property
    def exact(self) -> FunctionSimulator:
        """The simulator as one that can be integrated over itself."""
        return FunctionSimulator(self.simulator, vectorized=True)

    @property
    def inputs(self) -> Inputs:
        """The laws as a user gives them."""
        return self._with(lambda _, known: known)[0]

    def at(self, alpha: Mapping[str, float]) -> tuple[Inputs, Errors]:
        """The laws and the noise with every hyperparameter fixed at alpha."""
        return self._with(lambda name, _: alpha[name])

    def from_truth(self) -> tuple[Inputs, Errors]:
        """The laws and the noise with the search started from the law of the data."""
        return self._with(lambda name, known: replace(known, start=self.truth[name]))

    def _with(self, of: Callable[[str, Free], Free | float]) -> tuple[Inputs, Errors]:
        laws = {name: marginal.law(of, name) for name, marginal in self.laws.items()}
        tied = {
            pair: of(f"correlation.{'.'.join(pair)}", known)
            for pair, known in self.correlation.items()
        }
        if isinstance(self.noise, Mapping):
            each = {name: _noise(one, of, f"noise.{name}.sd") for name, one in self.noise.items()}
            return Inputs(laws, tied), each
        one = self.noise
        return Inputs(laws, tied), None if one is None else _noise(one, of, "noise.sd")

    def _frame(self, seed: int) -> pd.DataFrame:
        rng = np.random.default_rng(seed)
        table = self.conditions(rng)
        names = [h.name for h in self.inputs.hyperparameters]
        alpha = np.array([self.truth[name] for name in names])
        owner = pd.factorize(table["id"])[0] if "id" in table else np.arange(len(table))
        count = int(owner.max()) + 1
        x = self.inputs.sample(alpha, rng.random((count, len(self.inputs.names))))[owner]
        used = {str(name): table[name].to_numpy() for name in table if name != "id"}
        found = self.simulator(**used, **dict(zip(self.inputs.names, x.T, strict=True)))
        values = found if isinstance(found, Mapping) else {"y": found}
        sd = self.truth.get("noise.sd", 0.0)
        return table.assign(
            **{name: y + sd * rng.standard_normal(len(table)) for name, y in values.items()}
        )


@dataclass(frozen=True)
class WithDifferences:
    """One run of a simulator that takes arrays, with its derivatives by the parameters `names`.

    They are differences of fourth order, exact to some 1e-10 for smooth simulators.
    """

    simulator: Callable[..., Simulated]
    names: Sequence[str]
    step: float = 1e-4

    @property
    def __signature__(self) -> inspect.Signature:
        return inspect.signature(self.simulator)

    def __call__(self, **cells: Any) -> tuple[Any, Any]:
        """The outcome and its derivatives (n,), or mappings of these by response."""
        n = len(self.names)
        x = np.array([cells[name] for name in self.names], dtype=np.float64)
        steps = self.step * np.maximum(np.abs(x), 0.1)
        away = np.concatenate([np.zeros((1, n)), *([k * np.eye(n) for k in (1, -1, 2, -2)])])
        points = dict(zip(self.names, (x + away * steps).T, strict=True))
        some = {key: np.full(len(away), cell) for key, cell in cells.items()}
        found = self.simulator(**{**some, **points})

        def slopes(y: Array) -> Array:
            up, down, up2, down2 = np.asarray(y)[1:].reshape(4, n)
            return np.asarray((8.0 * (up - down) - (up2 - down2)) / (12.0 * steps))

        if isinstance(found, Mapping):
            return (
                {key: float(y[0]) for key, y in found.items()},
                {key: slopes(y) for key, y in found.items()},
            )
        return float(found[0]), slopes(found)


def _noise(noise: Noise, of: Callable[[str, Free], Free | float], name: str) -> Noise:
    return replace(noise, sd=of(name, noise.sd)) if isinstance(noise.sd, Free) else noise


def _evenly(low: float, high: float, count: int) -> Callable[[np.random.Generator], pd.DataFrame]:
    return lambda rng: pd.DataFrame({"c": rng.uniform(low, high, count)})


def _law(kind: Any, mean: tuple[float, float], sd: tuple[float, float]) -> Marginal:
    return Marginal(kind, {"mean": Free(*mean), "sd": Free(*sd)})


def _in_box(kind: Any, low: float, high: float) -> Marginal:
    """Its mean anywhere in the box, its sd up to half of the box."""
    known = {"mean": Free(low, high), "sd": Free(0.005 * (high - low), 0.45 * (high - low))}
    return Marginal(partial(kind, (low, high)), known)


def _constant(low: float, high: float) -> Marginal:
    return Marginal(Constant, {"value": Free(low, high)})


def line(c: Array, a: Array) -> Array:
    """Linear in its parameter."""
    return 1.0 + 3.0 * a * c


def decay(c: Array, a: Array, b: Array) -> Array:
    """Smooth, with the condition in the exponent."""
    return np.asarray(a * np.exp(-b * c) + 0.2 * a * a)


SHORT = 0.25
"""The step of the two compartments, of which all times are multiples."""
TIMES = SHORT * np.array([1, 2, 4, 8, 12, 16, 24, 32])


def _steps(cl: Array, v: Array, q: Array, v2: Array) -> tuple[Any, Any, Any, Any]:
    """The matrix of one Runge-Kutta step of order 4 of the amounts in two compartments."""
    h, a, b, c = SHORT, -(cl + q) / v, q / v2, q / v
    one = (h * a, h * b, h * c, -h * b)
    total, power = (1.0 + one[0], one[1], one[2], 1.0 + one[3]), one
    for share in (0.5, 1.0 / 6.0, 1.0 / 24.0):
        power = _product(power, one)
        total = tuple(t + share * p for t, p in zip(total, power, strict=True))  # type: ignore[assignment]
    return total


def _product(a: tuple[Any, ...], b: tuple[Any, ...]) -> tuple[Any, Any, Any, Any]:
    return (
        a[0] * b[0] + a[1] * b[2], a[0] * b[1] + a[1] * b[3],
        a[2] * b[0] + a[3] * b[2], a[2] * b[1] + a[3] * b[3],
    )  # fmt: skip


def compartments(dose: Array, time: Array, cl: Array, v: Array, q: Array, v2: Array,
                 base: Array) -> Array:  # fmt: skip
    """The concentration in the first of two compartments after a dose: an ODE, by Runge-Kutta.

    The equations are linear, so that a step is a matrix, and many steps are its powers.
    """
    count, power = np.rint(np.asarray(time) / SHORT).astype(int), _steps(cl, v, q, v2)
    first, second = 1.0 + 0.0 * power[0] * count, 0.0 * power[0] * count
    while np.any(count):
        odd = count % 2 == 1
        first, second = (
            np.where(odd, power[0] * first + power[1] * second, first),
            np.where(odd, power[2] * first + power[3] * second, second),
        )
        power, count = _product(power, power), count // 2
    return np.asarray(base + dose * first / v)


def _units(rng: np.random.Generator) -> pd.DataFrame:
    dose = np.repeat(rng.permutation(np.repeat([1.0, 2.0, 4.0], 4)), TIMES.size)
    unit = np.repeat(np.arange(12), TIMES.size)
    return pd.DataFrame({"id": unit, "dose": dose, "time": np.tile(TIMES, 12)})


def front(c: Array, a: Array, b: Array) -> Array:
    """A steep front, whose place among the parameters moves with the condition."""
    return np.asarray(np.tanh((c - a - 0.3 * b) / 0.1) + b * c)


SWINGS = 0.25 * np.arange(1, 21)
"""The times at which an oscillator is measured: seven half cycles."""


def oscillator(amplitude: Array, time: Array, decay: Array, dry: Array, rate: Array) -> Array:
    """A mass on a spring with viscous and dry friction that comes to rest: one with kinks.

    Each half cycle begins and ends at a turning point. The mass moves about the offset `dry` on its
    side, as one without dry friction, or stays where it is, if that is no farther out.
    """
    half, left = np.pi / rate, np.asarray(time, dtype=np.float64)
    turning = out = amplitude + 0.0 * left * rate
    for _ in range(int(np.ceil(np.max(time) / np.min(half)))):
        side, away = np.sign(turning), np.maximum(np.abs(turning) - dry, 0.0)
        t = np.clip(left, 0.0, half)
        swing = np.exp(-decay * t) * (np.cos(rate * t) + decay / rate * np.sin(rate * t))
        out = np.where((left > 0.0) & (away > 0.0), side * (dry + away * swing), out)
        end = side * (dry - away * np.exp(-decay * half))
        turning, left = np.where(away > 0.0, end, turning), left - half
        out = np.where(left > 0.0, turning, out)
    return np.asarray(out)


def _masses(rng: np.random.Generator) -> pd.DataFrame:
    amplitude = np.repeat(rng.permutation(np.repeat([10.0, 20.0], 7)), SWINGS.size)
    unit = np.repeat(np.arange(14), SWINGS.size)
    return pd.DataFrame({"id": unit, "amplitude": amplitude, "time": np.tile(SWINGS, 14)})


COEFFICIENTS = np.random.default_rng(31).standard_normal((40, 8))


def unlike(specimen: Array, a: Array, b: Array) -> Array:
    """A response of its own for each specimen, which is known by its name only."""
    number = np.array([int(str(name)[1:]) for name in np.atleast_1d(specimen)])
    w = COEFFICIENTS[number].T
    level, tilt = 2.0 * w[0], np.arctan2(w[1], w[2])
    main = np.cos(tilt) * a + np.sin(tilt) * b
    curved = 0.15 * (w[3] * a * a + w[4] * a * b + w[5] * b * b)
    return np.asarray(level + main + curved + 0.1 * np.sin(2.0 * w[6] * a + w[7] * b))


def ratio(c: Array, d: Array, a: Array, b: Array, e: Array) -> Array:
    """Saturating in one condition, with a product that the other one scales."""
    return np.asarray(a * c / (e + c) + a * b * d)


def four(c: Array, d: Array, a: Array, b: Array, e: Array, g: Array) -> Array:
    """Smooth, mildly nonlinear, and with two products."""
    return np.asarray(a + b * c + e * d + g * c * d + 0.1 * (a * a + b * e * c))


def several(c: Array, a: Array, b: Array) -> dict[str, Array]:
    """Three outcomes of one run."""
    return {
        "level": a * np.sqrt(c) + 0.0 * b,
        "rate": np.asarray(b * np.exp(-a * c)),
        "peak": np.asarray(np.log1p(a * b * c)),
    }


@cache
def _table(conditions: tuple[float, ...]) -> RectBivariateSpline:
    """The clutch under one condition, over its box."""
    x, z = (np.linspace(low, high, TABULATED) for low, high in BOX)
    c2, zp = np.meshgrid(x, z, indexing="ij")
    times = shifting_time(
        **dict(zip(LEVELS, conditions, strict=True)), c2_scale=c2.ravel(), zp_scale=zp.ravel()
    )
    return RectBivariateSpline(x, z, times.reshape(c2.shape), kx=5, ky=5)


def tabulated_clutch(pulse_duration: Array, hold_current: Array, pulse_current: Array,
                     motor_speed: Array, brake_torque: Array, c2_scale: Array,
                     zp_scale: Array) -> Array:  # fmt: skip
    """The wet clutch of the examples, from a table: the exact answer takes millions of its runs.

    The table, with splines of degree 5, is the simulator of both answers, and its data come from
    it too.
    """
    every = (pulse_duration, hold_current, pulse_current, motor_speed, brake_torque)
    different, of = np.unique(np.stack(np.broadcast_arrays(*every)), axis=1, return_inverse=True)
    c2, zp, found = np.atleast_1d(c2_scale), np.atleast_1d(zp_scale), np.empty(np.size(c2_scale))
    order = np.argsort(of.ravel(), kind="stable")
    for k, rows in enumerate(np.split(order, np.cumsum(np.bincount(of.ravel()))[:-1])):
        found[rows] = _table(tuple(different[:, k].tolist())).ev(c2[rows], zp[rows])
    return found


TABULATED = 41
"""Values of each parameter in the table of the clutch. The table is off the clutch by up to 2e-4 s,
in nine of ten runs by less than 1e-5 s; the times scatter by 0.2 s."""
CORRELATED = {("a", "b"): Free(-0.9, 0.9), ("e", "g"): Free(-0.9, 0.9)}
CLUTCH = {
    "c2_scale": _in_box(TruncatedNormal, *BOX[0]),
    "zp_scale": _in_box(TruncatedNormal, *BOX[1]),
}
CLUTCH_TRUTH = {"c2_scale.mean": 0.91, "zp_scale.mean": 0.55, "c2_scale.sd": 0.081,
                "zp_scale.sd": 0.046}  # fmt: skip


def _clutch(rows: Sequence[int]) -> Callable[[np.random.Generator], pd.DataFrame]:
    """Experiments of the clutch at these rows of its design."""
    return lambda _: design().drop(columns="id").iloc[list(rows)].reset_index(drop=True)


FIVE = (89, 80, 41, 98, 90)
"""Rows of the clutch's design, from the least to the largest effect of its second parameter."""


def _means_and_sds(**values: tuple[float, float]) -> dict[str, float]:
    pairs = values.items()
    return {f"{n}.{k}": v for n, two in pairs for k, v in zip(("mean", "sd"), two, strict=True)}


SIMULATORS = (
    Studied("linear", line, ({"a": _law(Normal, (-2.0, 3.0), (0.01, 2.0))}),
            _means_and_sds(a=(0.6, 0.25)), _evenly(0.3, 2.0, 30)),
    Studied("smooth", decay,
            ({"a": _law(LogNormal, (0.3, 4.0), (0.02, 1.5)),
                    "b": _in_box(TruncatedNormal, 0.0, 3.0)}),
            _means_and_sds(a=(1.5, 0.3), b=(1.0, 0.25)), _evenly(0.2, 2.5, 40)),
    Studied("clutch", tabulated_clutch, CLUTCH, CLUTCH_TRUTH, _clutch(range(108))),
    Studied("clutch-shared", tabulated_clutch, CLUTCH, CLUTCH_TRUTH, _clutch(4 * FIVE)),
    Studied("series", compartments,
            ({"cl": _law(LogNormal, (0.1, 2.0), (0.01, 1.0)),
                    "v": _law(LogNormal, (0.5, 5.0), (0.02, 2.0)),
                    "q": _constant(0.05, 2.0), "v2": _constant(0.5, 6.0),
                    "base": _constant(-0.2, 0.4)}),
            {**_means_and_sds(cl=(0.6, 0.15), v=(2.0, 0.4)), "q.value": 0.5, "v2.value": 2.0,
             "base.value": 0.1, "noise.sd": 0.03},
            _units, Noise(Free(0.005, 0.3)), series=compartments),
    Studied("oscillator", oscillator,
            {"decay": _in_box(TruncatedNormal, 0.0, 0.5), "dry": _in_box(TruncatedNormal, 0.0, 3.0),
             "rate": _constant(4.2, 4.7)},
            {**_means_and_sds(decay=(0.09, 0.025), dry=(0.7, 0.16)), "rate.value": 4.43,
             "noise.sd": 0.3},
            _masses, Noise(Free(0.05, 2.0)), series=oscillator),
    Studied("front", front,
            ({"a": _law(Normal, (0.3, 1.7), (0.01, 0.8)), "b": _in_box(TruncatedNormal, 0.0, 2.0)}),
            {**_means_and_sds(a=(0.8, 0.2), b=(1.0, 0.15)), "noise.sd": 0.1},
            _evenly(0.2, 2.0, 60), Noise(Free(0.01, 0.6))),
    Studied("ids", unlike,
            ({"a": _law(Normal, (-2.0, 4.0), (0.02, 2.0)),
                    "b": _law(Normal, (-2.0, 4.0), (0.02, 2.0))}),
            {**_means_and_sds(a=(1.0, 0.5), b=(0.5, 0.4)), "noise.sd": 0.1},
            lambda _: pd.DataFrame({"specimen": [f"s{k}" for k in range(40)]}), Noise(0.1)),
    Studied("three", ratio,
            {"a": _law(LogNormal, (0.5, 5.0), (0.02, 1.5)),
             "b": _law(Gamma, (0.1, 3.0), (0.02, 1.0)),
             "e": _law(Uniform, (0.6, 3.0), (0.05, 0.34))},
            {**_means_and_sds(a=(2.0, 0.3), b=(0.8, 0.2), e=(1.5, 0.3)), "noise.sd": 0.1},
            lambda rng: pd.DataFrame({"c": np.exp(rng.uniform(-1.5, 1.8, 80)),
                                      "d": rng.uniform(-1.0, 1.0, 80)}), Noise(0.1)),
    Studied("four-correlated", four,
            ({"a": _law(Normal, (0.0, 4.0), (0.02, 1.5)),
                    "b": _law(Normal, (-1.0, 3.0), (0.02, 1.5)),
                    "e": _law(Normal, (-1.0, 3.0), (0.02, 1.5)),
                    "g": _law(Normal, (-1.0, 3.0), (0.02, 1.5))}),
            {**_means_and_sds(a=(2.0, 0.4), b=(1.0, 0.3), e=(1.0, 0.3), g=(0.8, 0.2)),
             "correlation.a.b": 0.6, "correlation.e.g": -0.4, "noise.sd": 0.1},
            lambda rng: pd.DataFrame({"c": rng.uniform(-2.0, 2.0, 120),
                                      "d": rng.uniform(-2.0, 2.0, 120)}), Noise(0.1),
            correlation=CORRELATED),
    Studied("several", several,
            ({"a": Marginal(partial(Beta, (0.0, 2.0)),
                                  {"mean": Free(0.3, 1.7), "sd": Free(0.02, 0.5)}),
                    "b": _law(Gamma, (0.5, 6.0), (0.02, 2.0))}),
            {**_means_and_sds(a=(0.9, 0.2), b=(2.5, 0.5)), "noise.sd": 0.08,
             **{f"noise.{name}.sd": 0.08 for name in ("level", "rate", "peak")}},
            _evenly(0.3, 3.0, 24),
            dict.fromkeys(("level", "rate", "peak"), Noise(Free(0.01, 0.5)))),
)  # fmt: skip
"""Eleven simulators: 12 to 120 experiments, one to four parameters that scatter, seven laws."""
