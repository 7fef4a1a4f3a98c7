"""What a reader is told: that it is said where it holds, and not where it does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from identifications import Array, identified, unjudged
from problems import SAMPLE

from aleator import (
    Check,
    Gaussian,
    Identification,
    ResponseSurface,
)
from aleator.core.status import Status
from aleator.errors import SimulatorError
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


@pytest.mark.parametrize("status", [s for s in Status if s is not Status.SOLVED], ids=str)
def test_every_failure_of_a_density_has_a_cause_and_a_remedy(status: Status) -> None:
    cause, colon, remedy = status.explanation.partition(": ")
    assert cause
    assert colon
    assert remedy
