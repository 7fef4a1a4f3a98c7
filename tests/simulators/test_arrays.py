"""A function of numbers is called with arrays only where that gives the same values."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest

from aleator.inference.diagnostics.experiments import failure_report
from aleator.observations.experiments import Conditions
from aleator.observations.responses import Response
from aleator.simulators import FunctionSimulator, Runner

IDS = tuple(f"E{k // 4}" for k in range(20))
ROWS = pd.DataFrame(
    {"load": 1.0 + np.arange(20) // 4, "time": 0.1 * np.arange(20), "site": [*"ab"] * 10}
)
REGION = np.array([[0.5, 2.0], [-1.0, 1.0]])


def runner(function: Callable[..., Any], responses: tuple[str, ...] = ("way",), **kind: Any) -> Any:
    table = Conditions(
        tuple(dict.fromkeys(IDS)), ROWS, responses=[Response(name) for name in responses],
        experiment=np.arange(20) // 4,
    )  # fmt: skip
    return Runner(FunctionSimulator(function, **kind), table, ["x", "y"])


def formula(load: Any, time: Any, x: Any, y: Any) -> Any:
    return load * np.exp(-x * time) + y**3


def named(load: Any, time: Any, x: Any, y: Any) -> dict[str, Any]:
    return {"speed": x * load, "way": y * time, "grade": 2.0}


def branching(load: Any, time: Any, x: Any, y: Any) -> Any:
    return load * time if x > 1.0 else y


def scalar(load: Any, time: Any, x: Any, y: Any) -> Any:
    return load * math.exp(-x * time) + y


def smoothed(load: Any, time: Any, x: Any, y: Any) -> Any:
    return load * time - np.mean(x) + np.mean(y)


def texts(site: Any, x: Any, y: Any) -> Any:
    return x if site == "a" else y


def seldom(load: Any, time: Any, x: Any, y: Any) -> Any:
    if np.any(x == 7.0):
        raise ValueError("too fast")
    return load * x + y * time


@pytest.mark.parametrize(
    ("function", "responses", "expected", "series"),
    [
        (formula, ("way",), True, False),
        (formula, ("way",), True, True),
        (named, ("way", "speed"), True, False),
        (named, ("way", "speed"), True, True),
        (branching, ("way",), False, False),
        (branching, ("way",), False, True),
        (smoothed, ("way",), False, False),
        (smoothed, ("way",), False, True),
        (scalar, ("way",), False, False),
        (texts, ("way",), False, False),
    ],
)
def test_arrays_are_given_only_to_a_function_that_treats_them_as_numbers(
    function: Callable[..., Any], responses: tuple[str, ...], expected: bool, series: bool
) -> None:
    run = runner(function, responses, series=series)
    x = np.random.default_rng(0).uniform(*REGION.T, size=(50, 2))
    units = np.arange(50) % run.units
    before = run.straight(units, x)
    assert run.takes_arrays(REGION) is expected
    np.testing.assert_allclose(run.straight(units, x), before, rtol=1e-14)
    np.testing.assert_allclose(run.straight(units, x), run.values(units, x), rtol=1e-14)


def test_a_run_that_raises_does_not_spoil_the_others() -> None:
    run = runner(seldom)
    assert run.takes_arrays(REGION)
    values = run.straight([0, 1, 2], [[1.0, 1.0], [7.0, 1.0], [2.0, 1.0]])
    np.testing.assert_allclose(values[:, 0], [1.0, np.nan, 2.2])
    lost, failures = run.lost
    assert (lost, failures.case.tolist(), failures.x.tolist()) == (1, [1], [[7.0, 1.0]])
    assert "too fast" in failures.failures[0].message
    report = failure_report(run)
    assert report is not None
    assert (report.runs, report.needed, report.experiments) == (1, 19, ("E0",))
    assert report.region == {"x": (7.0, 7.0), "y": (1.0, 1.0)}


def test_what_is_no_number_is_counted_and_the_first_are_told() -> None:
    def half(load: Any, time: Any, x: Any, y: Any) -> Any:
        return np.where(x > 1.0, np.nan, np.inf) + 0 * load * time * y

    run = runner(half, vectorized=True)
    values = run.straight(np.zeros(4000, int), np.tile([[0.5, 0.0], [1.5, 0.0]], (2000, 1)))
    assert np.sum(np.isnan(values)) == 2000
    lost, failures = run.lost
    assert (lost, len(failures), np.unique(failures.x[:, 0]).tolist()) == (2000, 1000, [1.5])
    assert failures.failures[0].message == "it returned nan"


def test_few_calls_find_it_out() -> None:
    calls = []

    def counted(load: Any, time: Any, x: Any, y: Any) -> Any:
        calls.append(1)
        return formula(load, time, x, y)

    run = runner(counted)
    assert run.takes_arrays(REGION)
    assert len(calls) == 17
    run.straight(np.zeros(1000, int), np.ones((1000, 2)))
    assert len(calls) == 18


def test_a_series_that_changes_its_arguments_changes_no_other_run() -> None:
    def careless(load: float, time: Any, x: float, y: float) -> Any:
        time -= time[0]
        return time * load * x + y

    run = runner(careless, series=True)
    first = run.values([1], [[1.0, 0.0]])
    np.testing.assert_array_equal(run.values([1], [[2.0, 0.0]]), 2.0 * first)
