"""Part 3: simulators that fail here and there, and the answer of the same ones that do not."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from aleator import Check, Free, Inputs, Noise, Normal, identify
from aleator.tasks.identification import Identification

NEAR = 0.01
"""Standard errors by which alpha may differ."""
EXPERIMENTS = 20

Model = Callable[[float, float], float]
MODELS: dict[str, Callable[[float], Model]] = {
    "power": lambda a: lambda load, x: float(load * abs(x) ** (1.0 + a)),
    "exponential": lambda a: lambda load, x: float(load * np.exp(a * x)),
    "saturation": lambda a: lambda load, x: float(load * np.tanh(x / (0.5 + a))),
    "product": lambda a: lambda load, x: (1.0 + a) * load * x,
}


def _raise(error: BaseException) -> float:
    raise error


FAILURES: dict[str, Callable[[], object]] = {
    "raises": lambda: _raise(RuntimeError("no convergence")),
    "divides by zero": lambda: _raise(ZeroDivisionError()),
    "exits": lambda: _raise(SystemExit(3)),
    "is cancelled": lambda: _raise(GeneratorExit()),
    "nan": lambda: float("nan"),
    "None": lambda: None,
    "a text": lambda: "failed",
}


@dataclass(frozen=True)
class Failing:
    """One simulator: what it is, where it fails and how, and how far alpha moved by that."""

    name: str
    calls: int
    failed: int
    moved: float
    error: str = ""

    @property
    def sound(self) -> bool:
        """Whether alpha is within NEAR standard errors of the healthy one."""
        return not self.error and self.moved <= NEAR


def failing(number: int, seed: int) -> Failing:
    """Identify a healthy simulator, and the same where it fails."""
    chance = np.random.default_rng([seed, number])
    kind, how = (str(chance.choice([*names])) for names in (MODELS, FAILURES))
    model, mean, sd = MODELS[kind](chance.uniform(0.2, 1.0)), 1.0, chance.uniform(0.05, 0.2)
    table = _table(model, mean, sd, chance)
    noise = 0.1 * float(np.std(table["y"]))
    table["y"] += noise * chance.normal(size=len(table))
    if chance.random() < 0.5:
        share = chance.uniform(0.005, 0.05)
        where, fails = f"in {share:.1%} of its runs", _scattered(share)
    else:
        side, limit = chance.choice([-1.0, 1.0]), chance.uniform(3.0, 5.0)
        where, fails = f"{side * limit:+.1f} sd from the mean", _beyond(mean, side * sd, limit)
    made = [0, 0]

    def broken(load: float, x: float) -> object:
        made[0] += 1
        if fails(load, x):
            made[1] += 1
            return FAILURES[how]()
        return model(load, x)

    name = f"{kind}, {how} {where}"
    try:
        healthy, found = (_identified(one, table, noise) for one in (model, broken))
    except Exception as error:
        return Failing(name, made[0], made[1], np.inf, f"{type(error).__name__}: {error}")
    return Failing(name, made[0], made[1], _moved(healthy, found))


def _table(model: Model, mean: float, sd: float, chance: np.random.Generator) -> pd.DataFrame:
    load, x = chance.uniform(1.0, 3.0, EXPERIMENTS), chance.normal(mean, sd, EXPERIMENTS)
    return pd.DataFrame({"load": load, "y": [model(*pair) for pair in zip(load, x, strict=True)]})


def _scattered(share: float) -> Callable[[float, float], bool]:
    """Fails at so many of all arguments, which only its own digits tell: the same ones always."""
    return lambda load, x: hashlib.sha256(struct.pack("<dd", load, x)).digest()[0] < 256 * share


def _beyond(mean: float, sd: float, limit: float) -> Callable[[float, float], bool]:
    return lambda _, x: (x - mean) / sd > limit


def _identified(simulator: Callable[..., object], table: pd.DataFrame, sd: float) -> Identification:
    law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))})
    return identify(
        simulator, table, law, outcome="y", noise=Noise(sd), vectorized=False,
        verification=Check(0), consistency=False, best_law=False,
    )  # fmt: skip


def _moved(healthy: Identification, found: Identification) -> float:
    """The farthest of alpha, in standard errors of the healthy answer."""
    pairs = [(one, found.alpha[name]) for name, one in healthy.alpha.items() if one.standard_error]
    return max(abs(a.estimate - b.estimate) / (a.standard_error or np.nan) for a, b in pairs)
