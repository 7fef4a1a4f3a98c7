"""Probabilities of limit states whose exact values are known, of twenty-two shapes.

`python -m benchmarks limit_states` prints z = (probability - exact)/error of each state, directly
on the simulator and by surfaces. Parameters of the shapes and the depth of the states, 1e-7 to
1e-2, are drawn by a seed. Exact values are integrals over a of the tail of the normal law over the
sections in b, whose ends are found by bisection; in more than two variates they are closed forms,
or sums over further normal variates.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from rich.console import Console
from scipy import special, stats

from aleator import Inputs, Normal
from aleator.core.types import Array
from aleator.inference.alpha_draws import AlphaDraws
from aleator.inference.rare_events import Event
from aleator.observations.experiments import Conditions
from aleator.simulators import Runner, as_simulator
from aleator.surrogates import ResponseSurface
from aleator.tasks.new_experiments import PredictedValue, PredictionContext
from aleator.tasks.probability import Probability, probability

Shape = Callable[[Array, Array], Array]
END = 8.6
"""Standard normal variates beyond which nothing counts: 8e-18 lie there."""


@dataclass(frozen=True, eq=False)
class LimitState:
    """y(u) > `limit`, u standard normal variates (..., `variates`), of probability `exact`."""

    name: str
    variates: int
    response: Callable[[Array], Array]
    limit: float
    exact: float


def limit_states(seed: int, rounds: int = 3) -> Iterator[LimitState]:
    """Every shape `rounds` times, with parameters and depths of their own."""
    rng = np.random.default_rng([seed, 28])
    for _ in range(rounds):
        for name, make in SHAPES.items():
            yield _in_plane(name, make(rng), rng)
        yield from _of_more_variates(rng)


def print_limit_states(console: Console, seed: int = 2) -> None:
    """z of every state and their spread, directly and by surfaces; those unsettled apart."""
    states = list(limit_states(seed))
    for direct in (True, False):
        scores, settled = [], []
        for state in states:
            found, runs = estimated(state, direct)
            scores.append((found.probability - state.exact) / found.error)
            settled.append(found.status == "solved")
            console.print(
                f"{'direct' if direct else 'surface':8s} {state.name:20s} exact {state.exact:.2e} "
                f"found {found.probability:.2e} z {scores[-1]:6.2f} {found.status} runs {runs}"
            )
        solved = np.array(settled)
        z, others = np.array(scores)[solved], np.array(scores)[~solved]
        console.print(
            f"{z.size} solved: z has the sd {z.std():.2f}, at most {np.abs(z).max():.1f}; "
            f"{others.size} not, {np.sum(np.abs(others) < 2.0)} of them within two errors"
        )


def estimated(state: LimitState, direct: bool) -> tuple[Probability, int]:
    """The probability of a state, and the runs that the simulator made besides the checks."""
    names = tuple("abcdef"[: state.variates])
    inputs = Inputs({name: Normal(0.0, 1.0) for name in names})
    table = Conditions.from_frame(pd.DataFrame({"load": [1.0]}))
    source = f"lambda load, {', '.join(names)}: response(stacked(({', '.join(names)},)))"
    simulator = eval(source, {"response": state.response, "stacked": _stacked})
    runner = Runner(as_simulator(simulator, True), table, inputs.names)
    context = PredictionContext(table, inputs, None, runner, direct, ResponseSurface())
    draws = AlphaDraws.at(np.array([h.start for h in inputs.hyperparameters]))
    event = Event(((state.limit, np.inf),))
    return probability(PredictedValue.of(context, 0, draws), draws, event), runner.runs


def _stacked(values: tuple[Array, ...]) -> Array:
    return np.stack(np.broadcast_arrays(*values), axis=-1)


def section_probability(response: Callable[[Array], Array], limit: float) -> float:
    """P(y(a, b) > limit) of two standard normal variates, to about 1e-4 of itself."""
    a = b = np.linspace(-END, END, 5001)
    inside = np.stack([response(np.stack(np.broadcast_arrays(a, y), -1)) > limit for y in b], 1)
    row, place = np.nonzero(inside[:, 1:] != inside[:, :-1])
    low, high, leaves = b[place], b[place + 1], inside[row, place]
    for _ in range(40):
        middle = 0.5 * (low + high)
        same = (response(np.stack([a[row], middle], axis=1)) > limit) == leaves
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    # either side of zero has the tails beyond its ends, and half of the rest if zero is inside
    sign = np.where((low < 0.0) == leaves, 1.0, -1.0)
    section = np.bincount(row, sign * special.ndtr(-np.abs(low)), len(a))
    section += response(np.stack([a, np.zeros_like(a)], axis=1)) > limit
    return float(np.trapezoid(section * stats.norm.pdf(a), a))


def _in_plane(name: str, shape: Shape, rng: np.random.Generator) -> LimitState:
    """The shape in a direction of its own; not so deep that the event is smaller than 0.3."""
    turn = rng.uniform(0.0, 2.0 * np.pi)
    c, s = np.cos(turn), np.sin(turn)

    def response(u: Array) -> Array:
        return shape(c * u[..., 0] + s * u[..., 1], c * u[..., 1] - s * u[..., 0])

    t = np.linspace(-7.5, 7.5, 1201)
    u = np.stack(np.meshgrid(t, t), axis=-1).reshape(-1, 2)
    y, mass = response(u), np.exp(-0.5 * np.sum(u**2, axis=1))
    near = np.sum(u**2, axis=1) < 30.0
    order = np.flatnonzero(near)[np.argsort(-y[near])]
    reached = np.cumsum(mass[order]) / mass.sum()
    least = max(1e-7, float(reached[int(0.3 / (t[1] - t[0]) ** 2)]))
    depth = 10.0 ** rng.uniform(np.log10(least), -2.0)
    limit = float(y[order[np.searchsorted(reached, depth)]])
    return LimitState(name, 2, response, limit, section_probability(response, limit))


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.uniform(low, high))


def _line(_: np.random.Generator) -> Shape:
    return lambda a, _: a


def _parabola(rng: np.random.Generator) -> Shape:
    k = _between(rng, 0.1, 0.4)
    return lambda a, b: a + k * b**2


def _turned_parabola(rng: np.random.Generator) -> Shape:
    k = _between(rng, 0.1, 0.6)
    return lambda a, b: a - k * b**2


def _both_sides(rng: np.random.Generator) -> Shape:
    k = _between(rng, 0.9, 1.1)
    return lambda a, _: np.maximum(a, -k * a)


def _four_branches(rng: np.random.Generator) -> Shape:
    k = _between(rng, 0.05, 0.15)
    w = _between(rng, 0.9, 1.1)
    return lambda a, b: np.maximum(
        np.abs(a + b) / np.sqrt(2.0) - k * (a - b) ** 2, w * (np.abs(a - b) - 0.5) / np.sqrt(2.0)
    )


def _ring(_: np.random.Generator) -> Shape:
    return lambda a, b: a**2 + b**2


def _ellipse(rng: np.random.Generator) -> Shape:
    k = _between(rng, 0.5, 0.95)
    return lambda a, b: a**2 + k * b**2


def _shell(rng: np.random.Generator) -> Shape:
    r = _between(rng, 3.5, 5.0)
    return lambda a, b: -np.abs(np.hypot(a, b) - r) - 0.1 * a


def _exponentials(rng: np.random.Generator) -> Shape:
    k, m = rng.uniform(0.3, 0.8, 2)
    return lambda a, b: np.exp(k * a) + np.exp(m * b)


def _saddle(rng: np.random.Generator) -> Shape:
    k = _between(rng, 0.2, 2.0)
    return lambda a, b: a**2 - k * b**2


def _product(rng: np.random.Generator) -> Shape:
    k, m = rng.uniform(0.0, 2.0, 2)
    return lambda a, b: (a + k) * (b + m)


def _kink(rng: np.random.Generator) -> Shape:
    k = _between(rng, 0.2, 1.0)
    return lambda a, b: a + k * np.abs(b)


def _bent(rng: np.random.Generator) -> Shape:
    at, k = _between(rng, 0.5, 2.5), _between(rng, 1.5, 4.0)
    return lambda a, b: a + k * np.maximum(a + 0.3 * b - at, 0.0)


def _both_high(rng: np.random.Generator) -> Shape:
    k = _between(rng, -0.5, 0.5)
    return lambda a, b: np.minimum(a, b + k)


def _either_high(rng: np.random.Generator) -> Shape:
    k = _between(rng, -0.5, 0.5)
    return lambda a, b: np.maximum(a, b + k)


def _cosines(rng: np.random.Generator) -> Shape:
    k, w = _between(rng, 0.2, 0.6), _between(rng, 1.0, 3.0)
    return lambda a, b: a + k * np.cos(w * b)


def _two_cosines(rng: np.random.Generator) -> Shape:
    k, w = rng.uniform(0.5, 1.5, 2), rng.uniform(1.0, 2.5, 2)
    return lambda a, b: k[0] * np.cos(w[0] * a) + k[1] * np.cos(w[1] * b) + 0.4 * a


def _bump(rng: np.random.Generator) -> Shape:
    r, t, w = _between(rng, 2.5, 4.0), _between(rng, 0.7, np.pi), _between(rng, 0.5, 0.9)
    return lambda a, b: (
        a + 8.0 * np.exp(-((a - r * np.cos(t)) ** 2 + (b - r * np.sin(t)) ** 2) / (2.0 * w**2))
    )


def _two_bumps(rng: np.random.Generator) -> Shape:
    first, other = _bump(rng), _bump(rng)
    return lambda a, b: np.maximum(first(a, b), other(a, -b) - 0.5)


def _wells(rng: np.random.Generator) -> Shape:
    k, m = _between(rng, 0.05, 0.2), _between(rng, 1.0, 4.0)
    return lambda a, b: a - k * (b**2 - m) ** 2


def _ratio(rng: np.random.Generator) -> Shape:
    k, m = rng.uniform(0.1, 0.5, 2)
    return lambda a, b: np.exp(k * a) / (1.0 + np.exp(m * b))


def _step(rng: np.random.Generator) -> Shape:
    k, at = _between(rng, 1.0, 3.0), _between(rng, 1.0, 2.5)
    return lambda a, b: a + k * (b > at)


def _of_more_variates(rng: np.random.Generator) -> Iterator[LimitState]:
    """A plane in six variates, a sphere in five, two planes in four, a parabola in five."""
    depths = 10.0 ** rng.uniform(-7.0, -2.0, 4)
    n = rng.normal(size=6)
    n /= np.linalg.norm(n)
    beta = float(stats.norm.isf(depths[0]))
    yield LimitState("plane of six", 6, lambda u: u @ n, beta, float(depths[0]))
    yield LimitState(
        "sphere of five", 5, lambda u: np.sum(u**2, axis=-1),
        float(stats.chi2.isf(depths[1], 5)), float(depths[1]),
    )  # fmt: skip
    one = float(stats.norm.isf(0.5 * depths[2]))
    yield LimitState(
        "two planes of four", 4,
        lambda u: np.maximum(u[..., 0] + u[..., 1], u[..., 2] - u[..., 3]) / np.sqrt(2.0),
        one, 1.0 - (1.0 - 0.5 * float(depths[2])) ** 2,
    )  # fmt: skip
    k = _between(rng, 0.05, 0.15)
    nodes = np.linspace(0.0, 150.0, 200001)
    reach = float(stats.norm.isf(depths[3]))
    section = stats.norm.sf(reach - k * nodes) * stats.chi2.pdf(nodes, 4)
    yield LimitState(
        "parabola of five", 5, lambda u: u[..., 0] + k * np.sum(u[..., 1:] ** 2, axis=-1), reach,
        float(np.trapezoid(section, nodes)),
    )  # fmt: skip


SHAPES: dict[str, Callable[[np.random.Generator], Shape]] = {
    "line": _line, "parabola": _parabola, "turned parabola": _turned_parabola,
    "both sides": _both_sides, "four branches": _four_branches, "ring": _ring,
    "ellipse": _ellipse, "shell": _shell, "exponentials": _exponentials, "saddle": _saddle,
    "product": _product, "kink": _kink, "bent": _bent, "both high": _both_high,
    "either high": _either_high, "cosines": _cosines, "two cosines": _two_cosines,
    "bump": _bump, "two bumps": _two_bumps, "wells": _wells, "ratio": _ratio, "step": _step,
}  # fmt: skip
