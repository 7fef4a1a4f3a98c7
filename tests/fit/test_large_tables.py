"""A function of which nobody says whether it takes arrays: called so where that is the same.

Synthetic straight lines, whose log-likelihood is a multivariate normal density.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import multivariate_normal

from aleator import (
    Budget,
    Experiments,
    Free,
    Inputs,
    Noise,
    Normal,
    ResponseSurface,
    Runner,
    identify,
)
from aleator.errors import SimulatorError
from aleator.fit.question import way_of
from aleator.simulators import FunctionSimulator, Store

POINTS = 10
REGION = np.array([[-1.0, 3.0], [0.0, 2.0]])
INPUTS = Inputs(
    {
        "a": Normal(Free(-5.0, 5.0), Free(0.01, 3.0)),
        "b": Normal(Free(-5.0, 5.0), Free(0.01, 3.0)),
    }
)


def lines(count: int) -> Experiments:
    rng = np.random.default_rng(31)
    each = np.repeat(np.arange(count), POINTS)
    z = np.tile(np.linspace(-1.0, 1.0, POINTS), count)
    a, b = 1.0 + 0.5 * rng.standard_normal(count), 0.7 + 0.3 * rng.standard_normal(count)
    y = a[each] + b[each] * z + 0.2 * rng.standard_normal(each.size)
    return Experiments.from_frame(pd.DataFrame({"id": each, "z": z, "y": y}), outcome="y", id="id")


MANY, FEW = lines(150), lines(5)


def line(z: float, a: float, b: float) -> float:
    return a + b * z


def rounded(z: float, a: float, b: float) -> float:
    """Like exponentials, whose last bits are other ones in an array."""
    return line(z, a, b) * (1.0 + 1e-13 * np.ndim(a))


def branching(z: float, a: float, b: float) -> float:
    return line(z, a, b) if a > -100.0 else 0.0


def single(z: float, a: float, b: float) -> float:
    return a + b * math.tan(math.atan(z))


def centered(z: Any, a: Any, b: Any) -> Any:
    """The mean of a single number is that number; the mean of an array belongs to no run."""
    return line(z, a, b) + (a - np.mean(a))


def way(
    function: Callable[..., Any],
    table: Experiments = FEW,
    chosen: ResponseSurface | None = None,
    budget: Budget | None = None,
    **kind: Any,
) -> bool:
    runner = Runner(FunctionSimulator(function, **kind), table, ["a", "b"])
    runner.allow(budget or Budget())
    return way_of(runner, chosen or ResponseSurface(), np.array([1.0, 1.0]), REGION).direct


@pytest.mark.parametrize(
    ("function", "direct"),
    [
        (line, True),
        (rounded, True),
        (branching, False),
        (single, False),
        (centered, False),
        (np.vectorize(branching), False),
        (lambda z, a, b: np.array([line(*one) for one in np.broadcast(z, a, b)]).squeeze(), False),
    ],
)
def test_a_function_of_numbers_gets_arrays_where_the_values_are_the_same(
    function: Callable[..., Any], direct: bool
) -> None:
    assert way(function, MANY) is way(function) is direct


@pytest.mark.parametrize(
    ("function", "direct"),
    [
        (line, True),
        (rounded, True),
        (branching, False),
        (centered, False),
        (lambda z, a, b: np.cumsum(line(z, a, b)), False),
        (lambda z, a, b: np.array([line(*one) for one in np.broadcast(z, a, b)]), False),
        (lambda z, a, b: line(z[:POINTS], a, b), False),
    ],
)
def test_a_function_of_series_gets_the_rows_of_many_runs_where_the_values_are_the_same(
    function: Callable[..., Any], direct: bool
) -> None:
    assert way(function, FEW, series=True) is direct


def sloped(z: float, a: float, b: float) -> Any:
    return line(z, a, b), {"a": 1.0, "b": z}


@pytest.mark.parametrize(
    ("function", "how"),
    [
        (line, {"vectorized": False}),
        (line, {"chosen": ResponseSurface(surfaces="own")}),
        (line, {"budget": Budget(runs=100)}),
        (line, {"budget": Budget(hours=1.0)}),
        (line, {"timeout": 5.0}),
        (line, {"series": True, "vectorized": False}),
        (line, {"series": True, "timeout": 5.0}),
        (sloped, {"jac": True}),
    ],
)
def test_what_else_is_stated_keeps_arrays_away(
    function: Callable[..., Any], how: dict[str, Any]
) -> None:
    """The function would take them, and is not even tried."""
    called = []

    def told(z: Any, a: Any, b: Any) -> Any:
        called.append(np.ndim(a))
        return function(z, a, b)

    assert not way(told, **how)
    assert 1 not in called


def nowhere_finite(z: Any, a: Any, b: Any) -> Any:
    return line(z, a, b) + np.inf


def fails_alone(z: Any, a: Any, b: Any) -> Any:
    """Numbers divide by zero where arrays are infinite: no outcome either way."""
    return line(z, a, b) / (a > 0.0)


def written(z: Any, a: Any, b: Any) -> float:
    """What a program would find of arrays in its input: the first number."""
    return float(f"{z} {a} {b}".replace("[", "").split()[0])


def test_what_has_no_outcome_proves_nothing() -> None:
    assert not way(nowhere_finite)
    assert way(lambda z, a, b: np.where(a > 0.0, line(z, a, b), np.nan))
    assert not way(written)


def test_a_trial_counts_its_runs_and_stores_none(tmp_path: Path) -> None:
    with Store(tmp_path / "runs.sqlite") as store:
        for function, compared in ((line, 16), (branching, 0), (centered, 1), (fails_alone, 16)):
            runner = Runner(function, FEW, ["a", "b"], store=store)
            for _ in range(2):  # once
                assert runner.takes_arrays(REGION) is (compared == 16)
            assert (runner.runs, runner.fresh, len(runner.failures)) == (compared, 0, 0)
            assert bool(runner.array_fault) is (compared < 16)
            assert store.counts(runner.cache.identity).runs == 0


def test_stored_runs_serve_a_function_whether_arrays_are_refused_or_not_mentioned() -> None:
    refused, unsaid = (FunctionSimulator(line, vectorized=v) for v in (False, None))
    assert refused.fingerprint() == unsaid.fingerprint()
    assert refused.fingerprint() != FunctionSimulator(line, vectorized=True).fingerprint()


def test_arrays_that_mix_runs_where_the_trial_did_not_look_are_found() -> None:
    def mixed(z: Any, a: Any, b: Any) -> Any:
        return line(z, a, b) + (a - np.mean(a) if np.size(a) > 16 else 0.0)

    runner = Runner(mixed, FEW, ["a", "b"])
    runner.repeat_some()
    assert runner.takes_arrays(REGION)
    x = np.random.default_rng(0).uniform(*REGION.T, (100, 2))
    with pytest.raises(SimulatorError, match="with arrays"):
        runner.straight(np.zeros(100, int), x)


def test_what_takes_no_arrays_is_called_once_for_the_trial() -> None:
    calls = []

    def counted(z: float, a: float, b: float) -> float:
        calls.append(z)
        return branching(z, a, b)

    assert not way(counted)
    assert len(calls) == 1


def test_ctrl_c_in_the_trial_is_no_answer() -> None:
    for dimensions in (0, 1):

        def stopped(z: Any, a: Any, b: Any, at: int = dimensions) -> Any:
            if np.ndim(a) == at:
                raise KeyboardInterrupt
            return line(z, a, b)

        with pytest.raises(KeyboardInterrupt):
            way(stopped)


@pytest.mark.slow
def test_a_large_table_of_a_function_of_numbers_has_the_exact_log_likelihood() -> None:
    found = identify(line, MANY, INPUTS, noise=Noise(Free(0.01, 2.0)), best_law=False)
    assert found.propagation == "direct"
    assert found.sound
    assert found.consistency is not None
    assert found.consistency.consistent
    at = {name: one.estimate for name, one in found.alpha.items()}
    z = np.linspace(-1.0, 1.0, POINTS)
    covariance = (
        at["a.sd"] ** 2 + at["b.sd"] ** 2 * np.outer(z, z) + at["noise.sd"] ** 2 * np.eye(POINTS)
    )
    exact = multivariate_normal(at["a.mean"] + at["b.mean"] * z, covariance)
    y = MANY.observations.lower.reshape(-1, POINTS)
    assert found.log_likelihood.estimated == pytest.approx(exact.logpdf(y).sum(), abs=1e-2)


def test_what_never_worked_is_given_up_after_few_calls_and_what_worked_is_not() -> None:
    called = []

    def rarely(z: Any, a: Any, b: Any) -> Any:
        called.append(1)
        return line(z, a, b) if float(np.max(np.abs(a))) < 1e-3 else 1.0 / float(np.ndim(a) * 0.0)

    unit, x = np.zeros(4000, dtype=np.intp), np.ones((4000, 2))
    runner = Runner(FunctionSimulator(rarely, vectorized=True), FEW, ["a", "b"])
    assert np.isnan(runner.straight(unit, x)).all()
    assert len(called) < 100
    x[1] = 0.0
    assert np.isfinite(runner.straight(unit[:1], x[1:2])).all()
    found = runner.straight(unit, x)[:, 0]
    assert np.flatnonzero(np.isfinite(found)).tolist() == [1]
