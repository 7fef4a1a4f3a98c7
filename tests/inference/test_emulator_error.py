"""The change of alpha by errors of simulated values, against maximizing with the wrong values."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pandas as pd
import pytest

from aleator import Constant, Experiments, Free, Inputs, Noise, Normal, ResponseSurface
from aleator.core.progress import Silent
from aleator.core.types import Array
from aleator.fit.ledger import Ledger
from aleator.fit.quadrature import Maximum
from aleator.fit.question import Choices
from aleator.fit.refine import refined
from aleator.inference.emulator_error import functional, near_outcomes
from aleator.inference.information import infer
from aleator.laws import Law
from aleator.likelihood.individual import Direct, GaussHermite, IndividualLikelihood
from aleator.likelihood.problem import Problem
from aleator.simulators import Runner, as_runner
from aleator.simulators.function import FunctionSimulator

RNG = np.random.default_rng(8)
CONDITION = np.linspace(0.5, 2.0, 24)
NORMAL = {"mean": Free(-3.0, 5.0), "sd": Free(0.05, 2.0)}
NOISE = Noise(Free(0.02, 1.0))

Simulated = Callable[..., Array]


def line(c: Array, a: Array) -> Array:
    return np.asarray(2.0 + a * c + 0.1 * a * a)


def bent(c: Array, a: Array, b: Array) -> Array:
    return np.asarray(a * c + b + 0.2 * a * b)


def drift(c: Array, a: Array, k: Array) -> Array:
    return np.asarray(a * np.exp(-k * c))


def runner_of(simulator: Simulated, table: Experiments, names: Sequence[str]) -> Runner:
    made = FunctionSimulator(simulator, vectorized=True)
    return as_runner(made, table, tuple(names), True, None)


def maximum(
    simulator: Simulated, laws: Mapping[str, Law], noise: Noise | None, frame: pd.DataFrame
) -> Maximum:
    """The maximum of the likelihood of a table, with the simulator itself."""
    table, inputs = Experiments.from_frame(frame, outcome="y"), Inputs(dict(laws))
    runner = runner_of(simulator, table, inputs.names)
    choices = Choices.of(table, inputs, noise, ResponseSurface(surfaces="none"))
    question = choices.question(runner, table.observations, 0)
    return refined(question, Ledger(runner, Silent())).maximum


def data(simulator: Simulated, x: Mapping[str, Array], noise: float) -> pd.DataFrame:
    y = simulator(CONDITION, **x) + noise * RNG.standard_normal(24)
    return pd.DataFrame({"c": CONDITION, "y": y})


A, B = 1.0 + 0.3 * RNG.standard_normal(24), 0.5 + 0.4 * RNG.standard_normal(24)
TWO = {"a": Normal(**NORMAL), "b": Normal(0.5, Free(0.05, 2.0))}
CASES = {
    "one": (line, {"a": Normal(**NORMAL)}, {"a": A}, 0.1),
    "two": (bent, TWO, {"a": A, "b": B}, 0.1),
    "constant": (drift, {"a": Normal(**NORMAL), "k": Constant(Free(0.05, 3.0))}, {"a": A, "k": 0.7},
                 0.05),
    "exact": (bent, TWO, {"a": A, "b": B}, 0.0),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_the_change_of_alpha_is_that_of_maximizing_with_the_wrong_values(name: str) -> None:
    simulator, laws, x, sd = CASES[name]
    noise = NOISE if sd else None
    frame = data(simulator, x, sd)
    before = maximum(simulator, laws, noise, frame)
    likelihood, names = before.likelihood, [*laws]

    def error(c: Array, *values: Array) -> Array:
        return np.asarray(2e-2 * np.cos(3.0 * c) + 1e-2 * values[0] * c - 5e-3 * values[-1])

    def wrong(c: Array, **values: Array) -> Array:
        return simulator(c, **values) + error(c, *(values[one] for one in names))

    after = maximum(wrong, laws, noise, frame)
    inference = infer(likelihood.followed, before.alpha, likelihood.hyperparameters)
    of = np.arange(24)
    held = likelihood
    if isinstance(held, Problem):
        runner = runner_of(simulator, Experiments.from_frame(frame, outcome="y"), names)
        held = near_outcomes(held, before.alpha, Direct(runner, np.arange(2), held.inputs.box))
    assert isinstance(held, IndividualLikelihood)
    held = held.by(GaussHermite(5), before.alpha)
    found = functional(
        held, before.alpha, inference.free, inference.covariance, np.arange(len(names)),
        np.full(len(names), 0.05), of, np.full(24, 0.3),
    )  # fmt: skip
    told = error(CONDITION[found.site], *found.x.T) @ found.weights
    moved = (after.alpha - before.alpha)[inference.free]
    information = np.linalg.inv(inference.covariance)

    def length(step: Array) -> float:
        return float(np.sqrt(step @ information @ step))

    assert length(moved) > 0.05
    assert length(told[:-1] - moved) < 0.25 * length(moved)
    change = after.likelihood.evaluate(before.alpha).total - before.value
    assert told[-1] == pytest.approx(change, rel=0.15, abs=0.02)
