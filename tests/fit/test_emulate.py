"""Gaussian processes in place of a simulator: few runs, and an error that is told."""

import numpy as np
import pandas as pd
import pytest

from aleator import Budget, Free, Identification, Inputs, Noise, Normal, TruncatedNormal, identify

RNG = np.random.default_rng(12)
COUNT = 30
LAWS = {
    "a": Normal(Free(0.3, 4.0), Free(0.02, 1.5)),
    "b": TruncatedNormal((0.0, 3.0), Free(0.2, 2.8), Free(0.02, 1.2)),
}
CONDITION = RNG.uniform(0.2, 2.5, COUNT)
A, B = RNG.normal(1.5, 0.3, COUNT), RNG.normal(1.0, 0.25, COUNT)


def decay(c, a, b):
    return a * np.exp(-b * c) + 0.2 * a * a


def answer(noise: float, *, exact: bool = False, budget: Budget | None = None) -> Identification:
    """The answer by an emulator, or the exact one by the simulator itself."""
    y = decay(CONDITION, A, B) + noise * np.random.default_rng(3).standard_normal(COUNT)
    return identify(
        decay, pd.DataFrame({"c": CONDITION, "y": y}), Inputs(LAWS), outcome="y",
        noise=Noise(noise) if noise else None, vectorized=exact, budget=budget or Budget(),
        consistency=False, best_law=False,
    )  # fmt: skip


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_few_runs_give_the_exact_answer_within_what_is_told(noise: float) -> None:
    exact, found = answer(noise, exact=True), answer(noise)
    assert found.sound
    assert found.runs < 7 * COUNT
    assert exact.emulator_error is None
    assert found.emulator_error <= 0.2
    off = np.abs(found.values - exact.values) / exact.errors
    assert off.max() < max(2.0 * found.emulator_error, 0.05)
    told = found.log_likelihood.error
    apart = found.log_likelihood.estimated - exact.log_likelihood.estimated
    assert abs(apart) < max(2.0 * told, 0.05)


def test_a_budget_leaves_a_larger_error_that_is_told() -> None:
    found = answer(0.05, budget=Budget(runs=3 * COUNT + 2))
    assert found.runs <= 3 * COUNT + 3
    assert found.emulator_error > answer(0.05).emulator_error
    assert np.isfinite(found.values).all()
