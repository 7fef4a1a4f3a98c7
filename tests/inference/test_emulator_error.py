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
from aleator.inference.check import smoothed
from aleator.inference.emulator_error import FUNCTIONAL, eased, functional, near_outcomes
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


def held_of(sd: float | Free, frame: pd.DataFrame) -> IndividualLikelihood:
    """The likelihood of a table by `bent` itself, with this sd of the noise."""
    table, inputs = Experiments.from_frame(frame, outcome="y"), Inputs(TWO)
    runner = runner_of(bent, table, ("a", "b"))
    choices = Choices.of(table, inputs, Noise(sd), ResponseSurface(surfaces="none"))
    return choices.question(runner, table.observations, 0).integral(
        Direct(runner, np.arange(2), inputs.box)
    )


def test_an_error_of_a_value_acts_alike_whether_noise_is_negligible_or_none() -> None:
    frame, law = data(bent, {"a": A, "b": B}, 0.0), np.array([1.0, 0.3, 0.5, 0.4])
    noisy, y = held_of(1e-6, frame), frame["y"].to_numpy()
    exact = smoothed(noisy.inputs, law, noisy.predictor, noisy.layout, y, FUNCTIONAL.smooth)
    alpha = np.append(law, 1e-6)
    told = []
    for held, at in ((eased(noisy, alpha), alpha), (exact, law)):
        found = functional(
            held.by(GaussHermite(5), at), at, np.array([0, 1]), np.eye(2), np.arange(2),
            np.full(2, 0.05), np.arange(24), np.full(24, 0.3),
        )  # fmt: skip
        told.append(np.sin(found.x @ [1.0, 2.0] + CONDITION[found.site]) @ found.weights)
    np.testing.assert_allclose(*told, rtol=1e-3)


def test_auxiliary_errors_are_added_only_where_the_only_value_of_an_experiment_has_less() -> None:
    frame, alpha = data(bent, {"a": A, "b": B}, 0.0), np.array([1.0, 0.3, 0.5, 0.4, 0.1])
    ordinary = held_of(0.1, frame)
    assert eased(ordinary, alpha) is ordinary
    repeated = pd.concat([frame, frame]).assign(id=np.tile(np.arange(24), 2))
    alpha[-1] = 1e-6
    several = held_of(1e-6, repeated)
    assert eased(several, alpha) is several
    errors = eased(held_of(Free(1e-6, 1.0), frame), alpha).errors
    eta, rows = np.linspace(0.0, 3.0, 24)[:, None], slice(0, 24)
    scale = errors.scale(alpha[-1:], eta, rows)
    scatter = np.array([np.std(bent(c, *draws())) for c in CONDITION])
    np.testing.assert_allclose(scale[:, 0], FUNCTIONAL.smooth * scatter, rtol=0.05)
    sd, step = np.array([0.05]), 1e-6
    above, below = (errors.log_density(sd + by, eta, rows) for by in (step, -step))
    ((_, slope),) = errors.terms(sd, eta, rows).d_values
    np.testing.assert_allclose(slope, (above - below) / (2.0 * step), rtol=1e-5, atol=1e-6)


def draws() -> tuple[Array, Array]:
    """Values of a and b under the law of the test above."""
    rng = np.random.default_rng(0)
    return 1.0 + 0.3 * rng.standard_normal(4000), 0.5 + 0.4 * rng.standard_normal(4000)
