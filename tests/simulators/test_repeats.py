"""Some of the runs that are made anyway are made again: a simulator that draws is found out."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged

from aleator import Check, Free, Inputs, Noise, Normal
from aleator.errors import SimulatorError
from aleator.observations.experiments import Conditions
from aleator.simulators import FunctionSimulator, Runner

TABLE = Conditions((*"ABCD",), pd.DataFrame({"load": [1.0, 2.0, 3.0, 4.0]}))


class Sometimes:
    """Random in one of ten runs, and right in all others."""

    def __init__(self, seed: int = 0) -> None:
        self.rng = np.random.default_rng(seed)
        self.runs = 0

    def __call__(self, load: float, x: float) -> float:
        self.runs += 1
        return load * x * (1.0 + 1e-3 * (self.rng.random() < 0.1))


def asked(size: int) -> tuple[np.ndarray, np.ndarray]:
    return np.arange(size) % 4, np.linspace(0.5, 1.5, size)[:, None]


@pytest.mark.parametrize("way", ["attempt", "values", "straight", "__call__"])
def test_what_is_random_in_one_of_ten_runs_is_refused(way: str) -> None:
    """Of 600 runs 24 are made again: 0.81^24, so that one of 157 passes."""
    found = 0
    for seed in range(20):
        run = Runner(Sometimes(seed), TABLE, ["x"])
        run.repeat_some()
        try:
            getattr(run, way)(*asked(600))
        except SimulatorError as error:
            found += "for the same run: experiment" in error.problem
    assert found >= 19


def test_it_costs_two_dozen_runs_and_no_run_counts_twice() -> None:
    class Counted:
        runs = 0

        def __call__(self, load: float, x: float) -> float:
            self.runs += 1
            return load * x

    function = Counted()
    run = Runner(function, TABLE, ["x"])
    index, x = asked(2000)
    for part in range(0, 2000, 20):
        run.attempt(index[part : part + 20], x[part : part + 20])
    assert (function.runs, run.runs) == (2000, 2000)  # unless it is asked for, none is
    run.repeat_some()
    run.attempt(index, x + 1.0)
    run.attempt(index, x + 2.0)
    assert (function.runs, run.runs, len(run.completed)) == (6024, 6000, 6000)
    run.attempt(index, x + 2.0)  # what is known is no run that is made
    assert function.runs == 6024


def test_a_run_that_fails_the_second_time_is_another_matter() -> None:
    tried: set[float] = set()

    def once(load: float, x: float) -> float:
        if x in tried:
            raise RuntimeError("the license is gone")
        tried.add(x)
        return load * x

    run = Runner(once, TABLE, ["x"])
    run.repeat_some()
    assert np.isfinite(run.attempt(*asked(100))).all()


def test_rounding_beside_large_outcomes_is_no_randomness() -> None:
    state = {"last": 0.0}

    def tolerant(load: float, x: float) -> float:
        state["last"] = 1e-7 - state["last"]
        return load * (x - 1.0) + state["last"]  # zero at x = 1, but for the last state

    run = Runner(tolerant, TABLE, ["x"])
    run.repeat_some()
    assert np.isfinite(run.attempt(*asked(401))).all()


def drawing(load: float, x: float) -> float:
    rng = np.random.default_rng()
    return load * x * (1.0 + (rng.random() < 0.5))


def test_it_is_found_among_workers() -> None:
    with ThreadPoolExecutor(2) as pool:
        run = Runner(FunctionSimulator(drawing), TABLE, ["x"], executor=pool)
        run.repeat_some()
        with pytest.raises(SimulatorError, match="for the same run"):
            run.attempt(*asked(100))


@pytest.mark.parametrize("noise", [None, Noise(Free(0.01, 0.5))])
def test_an_identification_refuses_it(noise: Noise | None) -> None:
    rng = np.random.default_rng(1)
    load = np.linspace(1.0, 2.0, 30)
    table = pd.DataFrame({"load": load, "y": load * rng.normal(1.0, 0.1, 30)})
    inputs = Inputs({"x": Normal(Free(0.5, 1.5), Free(0.01, 0.5))})
    with pytest.raises(SimulatorError, match="for the same run"):
        unjudged(Sometimes(), table, inputs, outcome="y", noise=noise, verification=Check(0))
