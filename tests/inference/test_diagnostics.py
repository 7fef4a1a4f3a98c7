"""What a reader is told where it holds and not where it does not, and remedies that do help."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from identifications import identified, unjudged
from problems import SAMPLE

from aleator import (
    Check,
    Constant,
    Free,
    Gaussian,
    GradientMultistart,
    Identification,
    Inputs,
    Noise,
    Normal,
    ResponseSurface,
)
from aleator.core.types import Array
from aleator.errors import SimulatorError
from aleator.inference.diagnostics import Rival, rival_warnings, search_refusals
from aleator.inference.identifiability import exchanged
from aleator.laws import Hyperparameter, Law
from aleator.results.values import Diagnostic


def told(found: Identification, about: str) -> list[Diagnostic]:
    return [w for w in found.warnings if w.about == about]


# ------------------------------------------------------------------------------ the density


def test_a_gaussian_density_of_a_skew_outcome_is_told_and_one_of_a_normal_outcome_is_not() -> None:
    problem = replace(SAMPLE, z=np.zeros(60))
    y = problem.draw(1)
    straight = identified(problem, y, Gaussian(), samples=512)
    assert told(straight, "density") == []
    bent = unjudged(
        lambda x: np.exp(0.8 * x), pd.DataFrame({"y": np.exp(0.8 * y)}), problem.inputs,
        outcome="y", vectorized=True, density=Gaussian(), verification=Check(512),
    )  # fmt: skip
    assert told(bent, "density") or not bent.sound


# ------------------------------------------------------------------------------ experiments, limits


@pytest.mark.parametrize(("count", "warned"), [(8, True), (10, False)])
def test_few_experiments_for_the_hyperparameters_are_told(count: int, warned: bool) -> None:
    problem = replace(SAMPLE, z=np.zeros(count))
    found = identified(problem, problem.draw(3))
    assert bool(told(found, "experiments")) == warned


# ------------------------------------------------------------------------------ surfaces


def saw(x: Array) -> Array:
    """A simulator of coarse accuracy: its outcome comes in steps of a twentieth."""
    return np.round(20.0 * x) / 20.0


def test_a_surface_that_stalls_and_one_that_ran_out_of_runs_are_told_apart() -> None:
    problem = replace(SAMPLE, z=np.zeros(20))
    y = saw(problem.draw(4))
    table = pd.DataFrame({"y": y})
    stopped, ran_out = (
        told(
            unjudged(
                saw, table, problem.inputs, outcome="y", vectorized=True,
                propagation=ResponseSurface(tolerance=0.001, max_runs=runs),
                verification=Check(0),
            ),
            "response surface",
        )
        for runs in (1000, 60)
    )  # fmt: skip
    # only who ran out of runs is told to allow more
    assert ["max_runs" in w.remedy for w in ran_out] == [True]
    assert ["max_runs" in w.remedy for w in stopped] == [False]


# ------------------------------------------------------------------------------ simulators


def test_a_simulator_that_draws_random_numbers_is_refused_at_once() -> None:
    rng, runs = np.random.default_rng(0), []

    def noisy(x: float) -> float:
        runs.append(x)
        return x + 0.1 * rng.standard_normal()

    table = pd.DataFrame({"y": SAMPLE.draw(5)})
    with pytest.raises(SimulatorError, match="x="):
        unjudged(noisy, table, SAMPLE.inputs, outcome="y")
    assert len(runs) == 2


# ------------------------------------------------------------------------------ advice


TEMPERATURE = np.linspace(300.0, 350.0, 40)
LENGTH = 2.0 + 0.05 * TEMPERATURE + 0.3 * np.random.default_rng(0).standard_normal(40)


def remedies(found: Identification, about: str) -> list[str]:
    return [w.remedy for w in found.warnings if w.about == about]


def to_center(found: Identification) -> list[str]:
    """Remedies of two parameters and the condition that makes them alike."""
    return [w.remedy for w in found.warnings if w.concerns == ("a", "b", "T")]


# ------------------------------------------------------------------------------ centering


def expanded(model: Callable[..., Array], a: Law, noise: Noise | None = None) -> Identification:
    table = pd.DataFrame({"T": TEMPERATURE, "day": 20.0, "length": LENGTH})
    return unjudged(
        model, table, Inputs({"a": a, "b": Constant(Free(0.0, 0.1))}), outcome="length",
        vectorized=True, noise=noise, search=GradientMultistart(2), verification=Check(0),
    )  # fmt: skip


def test_a_condition_far_from_zero_is_to_be_measured_from_its_middle() -> None:
    far = expanded(lambda T, a, b: a + b * T, Normal(Free(-20.0, 20.0), Free(0.01, 2.0)))
    (advice,) = to_center(far)
    assert "(T - 325)" in advice
    near = expanded(lambda T, a, b: a + b * (T - 325.0), Normal(Free(10.0, 30.0), Free(0.01, 2.0)))
    assert remedies(near, "identifiability") == []
    # the same line: at 325 the one is what the other says it is, and known better
    a, b = far.alpha["a.mean"], far.alpha["b.value"]
    assert near.alpha["a.mean"].estimate == pytest.approx(a.estimate + 325 * b.estimate, abs=1e-2)
    assert near.alpha["b.value"].estimate == pytest.approx(b.estimate, abs=1e-3)
    assert (near.alpha["a.mean"].standard_error or 1.0) < 0.1 * (a.standard_error or 0.0)


# ------------------------------------------------------------------------------ what is left open


@pytest.mark.parametrize(("spread", "told"), [(1.0, ()), (0.03, ("b.value",))])
def test_a_law_is_left_open_only_where_no_value_is_ruled_out(
    spread: float, told: tuple[str, ...]
) -> None:
    """In y = a + b c with known noise b is known to 0.1 / |c|; a scatter of zero is an answer."""
    c = spread * np.tile([-1.0, 1.0, 0.0, 0.0], 5)
    y = 2.0 + 0.5 * c + 0.06 * np.tile([1.0, 1.0, -1.0, -1.0], 5)  # scatters less than the noise
    found = unjudged(
        lambda c, a, b: a + b * c, pd.DataFrame({"c": c, "y": y}),
        Inputs({"a": Normal(Free(0.0, 4.0), Free(1e-4, 1.0)), "b": Constant(Free(-0.5, 1.5))}),
        outcome="y", vectorized=True, noise=Noise(0.1), verification=Check(0),
    )  # fmt: skip
    assert found.sound
    assert found.alpha["a.sd"].at_bound == "lower"
    falls = float(0.5 * np.sum(c**2) / 0.1**2)  # from the estimate 0.5 to either limit of b
    assert (falls < 1.92) is bool(told)
    assert found.undetermined == told


@pytest.mark.parametrize(
    ("correlation", "lower", "told"),
    [(-0.93, 0.001, [0, 1]), (0.0, 0.001, []), (-0.93, 0.01, [])],
)
def test_sds_are_left_open_if_each_but_not_both_may_be_zero(
    correlation: float, lower: float, told: list[int]
) -> None:
    h = [Hyperparameter(f"{x}.sd", 0.001, 4.0, 0.1, free=True) for x in "ab"]
    inference = SimpleNamespace(
        positive=True, free=np.arange(2), standard_error=np.array([0.1, 0.1]),
        correlation=np.array([[1.0, correlation], [correlation, 1.0]]),
    )  # fmt: skip
    profile = SimpleNamespace(intervals=np.array([[0.001, 0.3], [lower, 0.3]]))
    assert exchanged(np.array([0.12, 0.11]), h, inference, profile) == told  # type: ignore[arg-type]


# ------------------------------------------------------------------------------ nodes


# ------------------------------------------------------------------------------ maxima


def test_a_maximum_is_reached_by_standard_errors() -> None:
    """What is left to gain is half the square of the distance in standard errors."""
    at = [SimpleNamespace(positive=True, edm=0.5 * distance**2) for distance in (0.05, 0.5)]
    assert not search_refusals(at[0], ())  # type: ignore[arg-type]
    assert search_refusals(at[1], ())  # type: ignore[arg-type]


def test_another_maximum_is_news_only_outside_the_intervals() -> None:
    h = [Hyperparameter("x.mean", -4.0, 4.0, 0.0, free=True)]
    rival = Rival(np.array([-1.5]), np.array([1.5]), 0.3, (0,))
    assert rival_warnings([rival], h, np.array([[1.0, 2.0]]))
    assert rival_warnings([rival], h, np.array([[np.nan, np.nan]]))
    assert not rival_warnings([rival], h, np.array([[-2.0, 2.0]]))
