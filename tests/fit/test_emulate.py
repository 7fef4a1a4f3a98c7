"""Gaussian processes in place of a simulator: few runs, and an error that is told."""

from functools import cache
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy import integrate

from aleator import (
    Budget,
    Constant,
    Experiments,
    Free,
    Identification,
    Inputs,
    LogNormal,
    Noise,
    Normal,
    TruncatedNormal,
    identify,
)
from aleator.fit.rounds import (
    EMULATION,
    EmulatorError,
    EmulatorRound,
    RoundsAhead,
    admitted_change,
    usual,
)
from aleator.fit.soundness import emulator_warnings
from aleator.simulators.function import FunctionSimulator
from aleator.surrogates import ResponseSurface

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


@cache
def answer(noise: float, *, exact: bool = False, budget: Budget | None = None) -> Identification:
    """The answer by an emulator, or the exact one by the simulator itself."""
    y = decay(CONDITION, A, B) + noise * np.random.default_rng(3).standard_normal(COUNT)
    return identify(
        decay, pd.DataFrame({"c": CONDITION, "y": y}), Inputs(LAWS), outcome="y",
        noise=Noise(noise) if noise else None, vectorized=exact, budget=budget or Budget(),
        consistency=False, best_law=False,
    )  # fmt: skip


@pytest.mark.parametrize("noise", [pytest.param(0.0, marks=pytest.mark.long), 0.05])
def test_few_runs_give_the_exact_answer_within_what_is_told(noise: float) -> None:
    exact, found = answer(noise, exact=True), answer(noise)
    assert found.sound
    assert found.runs < 7 * COUNT
    assert exact.emulator_error is None
    assert found.emulator_error <= 0.2
    off = np.abs(found.values - exact.values) / exact.errors
    assert off.max() < max(2.0 * found.emulator_error, 0.05)
    ends = np.array([
        [(found.alpha[name].interval[k] - exact.alpha[name].interval[k]) / error for k in (0, 1)]
        for name, error in exact.errors.dropna().items()
    ])  # fmt: skip
    assert np.nanmax(np.abs(ends)) < max(2.0 * found.surface["intervals_error"], 0.1)
    told = found.log_likelihood.error
    apart = found.log_likelihood.estimated - exact.log_likelihood.estimated
    assert abs(apart) < max(2.0 * told, 0.05)


@pytest.mark.long
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_budget_leaves_a_larger_error_that_is_told(noise: float) -> None:
    found, exact = answer(noise, budget=Budget(runs=3 * COUNT + 8)), answer(noise, exact=True)
    assert found.runs <= 3 * COUNT + 9
    assert found.emulator_error > answer(noise).emulator_error
    off = np.abs(found.values - exact.values) / exact.errors
    assert off.max() < max(2.0 * found.emulator_error, 0.05)
    data = {one.about for one in exact.warnings}
    own = [one.about for one in found.warnings if one.about not in data]
    assert own == ["budget"] * (found.emulator_error > 0.2)


@pytest.mark.long
def test_a_budget_below_the_first_runs_of_few_conditions_is_kept() -> None:
    """Five conditions would have four first runs each."""

    def bent(c, a):
        return a + c * np.sin(3.0 * a) / 3.0

    c = CONDITION[np.arange(COUNT) % 5]
    y = bent(c, A) + 0.05 * np.random.default_rng(3).standard_normal(COUNT)

    def within(**how: object) -> Identification:
        return identify(
            bent, pd.DataFrame({"c": c, "y": y}), Inputs({"a": LAWS["a"]}), outcome="y",
            noise=Noise(0.05), consistency=False, best_law=False, **how,
        )  # fmt: skip

    found, free, exact = (
        within(**how) for how in (
            {"budget": Budget(runs=22)}, {"vectorized": False}, {"vectorized": True},
        )
    )  # fmt: skip
    assert found.runs <= 23
    assert found.emulator_error > free.emulator_error
    off = np.abs(found.values - exact.values) / exact.errors
    assert off.max() < 2.0 * found.emulator_error
    assert [one.about for one in found.warnings] == ["budget"] * (found.emulator_error > 0.2)


def test_what_each_round_leaves_is_recorded_and_says_how_many_runs_follow() -> None:
    found = answer(0.05)
    rounds = [EmulatorRound(*one.values()) for one in found.surface["rounds"]]
    assert rounds[0].runs == 3 * COUNT
    assert all(one.runs < other.runs for one, other in pairwise(rounds))
    assert rounds[-1].alpha == found.emulator_error
    ahead = RoundsAhead(usual(COUNT), EMULATION.rounds, admitted_change(COUNT))
    first = ahead.expected(*vars(rounds[0]).values(), EMULATION.enough)
    assert found.runs / 1.5 < first < 1.5 * found.runs


@pytest.mark.parametrize(
    ("errors", "max_runs", "ended"),
    [(3 * [0.3], 99, "largest number of rounds"), ([0.5, 0.2, *22 * [0.3]], 99, "more exact"),
     (3 * [0.3], 12, "max_runs = 12")],
)  # fmt: skip
def test_what_ended_the_runs_is_told(errors: list[float], max_runs: int, ended: str) -> None:
    """The error does not fall in the second; more runs are advised in the others only."""
    runner = SimpleNamespace(
        account=SimpleNamespace(refused=False), cache=None, simulator=FunctionSimulator(decay)
    )
    emulation = SimpleNamespace(
        error=EmulatorError(0.3, 0.1, 1.0, np.ones(1)), settings=EMULATION,
        told=[EmulatorRound(6 * k, one, 0.1) for k, one in enumerate(errors)],
        maxima=[0.0 for _ in errors], expected_runs=lambda _: np.inf,
        start=np.array([[0.0, 1.0]]), region=np.array([[0.0, 1.0]]),
        processes=SimpleNamespace(made=np.array([11, 12]), contradicted=False),
        question=SimpleNamespace(
            ids=("1", "2"), runner=runner, inputs=Inputs({"a": LAWS["a"]}),
            choices=SimpleNamespace(surfaces=ResponseSurface(max_runs=max_runs)),
        ),
    )  # fmt: skip
    (found,) = emulator_warnings(emulation)
    assert ended in found.message
    assert ("allow more runs" in found.remedy) is (ended != "more exact")


@pytest.mark.long
def test_an_outcome_that_jumps_is_given_up_and_never_called_sound() -> None:
    def step(c, a):
        return c * a + np.where(a > 1.5, 1.0, 0.0)

    y = step(CONDITION, A) + 0.05 * np.random.default_rng(3).standard_normal(COUNT)
    found = identify(
        step, pd.DataFrame({"c": CONDITION, "y": y}), Inputs({"a": LAWS["a"]}), outcome="y",
        noise=Noise(0.05), vectorized=False, consistency=False, best_law=False,
    )  # fmt: skip
    assert found.runs < 40 * COUNT
    assert found.emulator_error > EMULATION.unknown
    assert not found.sound


TIMES = np.array([0.5, 1.0, 2.0, 4.0, 6.0, 9.0, 12.0, 18.0])


def compartments(dose, cl, v, q, v2, base):
    """The concentration in the first of two compartments, as a series over `TIMES`."""

    def rate(_, amount):
        to_second = q * (amount[0] / v - amount[1] / v2)
        return [-cl * amount[0] / v - to_second, to_second]

    first = integrate.solve_ivp(
        rate, (0.0, TIMES[-1]), [dose, 0.0], t_eval=TIMES, rtol=1e-8, atol=1e-10
    ).y[0]
    return base + first / v


def in_closed_form(dose, time, cl, v, q, v2, base):
    """The same concentration from the two rates of decay."""
    total, product = (cl + q) / v + q / v2, cl * q / (v * v2)
    root = np.sqrt(total**2 - 4.0 * product)
    fast, slow = (total + root) / 2.0, (total - root) / 2.0
    falls = (fast - q / v2) * np.exp(-fast * time) + (q / v2 - slow) * np.exp(-slow * time)
    return base + dose / v * falls / root


@pytest.mark.long
def test_series_by_an_ode_with_three_constants_are_as_exact_as_their_closed_form() -> None:
    rng, units = np.random.default_rng(21), 12
    dose = np.repeat(np.repeat([1.0, 2.0, 4.0], 4), TIMES.size)
    cl, v = (
        np.repeat(m * np.exp(s * rng.standard_normal(units)), TIMES.size)
        for m, s in ((0.6, 0.25), (2.0, 0.2))
    )
    time = np.tile(TIMES, units)
    y = in_closed_form(dose, time, cl, v, 0.5, 2.0, 0.1) + 0.03 * rng.standard_normal(dose.size)
    unit = np.repeat(np.arange(units), TIMES.size)
    table = pd.DataFrame({"id": unit, "dose": dose, "time": time, "y": y})
    inputs = Inputs({
        "cl": LogNormal(Free(0.1, 2.0), Free(0.01, 1.0)),
        "v": LogNormal(Free(0.5, 5.0), Free(0.02, 2.0)),
        "q": Constant(Free(0.05, 2.0)), "v2": Constant(Free(0.5, 6.0)),
        "base": Constant(Free(-0.2, 0.4)),
    })  # fmt: skip
    some = {"noise": Noise(Free(0.005, 0.3)), "consistency": False, "best_law": False}
    slow = FunctionSimulator(compartments, series=True)
    quick = FunctionSimulator(in_closed_form, vectorized=True)
    experiments = Experiments.from_frame(table, outcome="y")
    found, exact = (identify(one, experiments, inputs, **some) for one in (slow, quick))
    assert found.sound
    assert found.runs < 60 * units
    off = np.abs(found.values - exact.values) / exact.errors
    assert np.nanmax(off) < max(2.0 * found.emulator_error, 0.05)


def test_more_runs_are_expected_for_less_error() -> None:
    ahead = RoundsAhead(size=20, confirmed=2, change=0.3)
    told = [ahead.expected(120, 2.0, 1.0, goal) for goal in (0.4, 0.2, 0.1)]
    assert 120 + 2 * 20 <= told[0] < told[1] < told[2]
    assert ahead.expected(120, np.inf, 1.0, 0.2) == np.inf
    at_the_end = RoundsAhead(size=20, confirmed=2, change=0.3, calm=2)
    assert at_the_end.expected(160, 0.1, 0.1, 0.2) == 160


def test_small_errors_are_not_believed_where_new_runs_contradict_the_processes() -> None:
    expected, contradicted = (
        EmulatorError(0.03, 0.1, surprise, np.ones(1)) for surprise in (1.1, 3.2)
    )
    assert expected.enough(40)
    assert not contradicted.enough(40)
