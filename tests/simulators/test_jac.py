"""Simulators that give derivatives beside their values."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cloudpickle
import numpy as np
import pandas as pd
import pytest

from aleator import Experiments, Runner, Store
from aleator.errors import SimulatorError
from aleator.simulators import FunctionSimulator
from aleator.simulators.derived import derived
from aleator.simulators.records import read, stored_runs, write
from aleator.simulators.slope_check import require_slopes

TABLE = Experiments.from_frame(pd.DataFrame({"load": [1.0, 2.0], "y": [1.0, 2.0]}), outcome="y")
X = [[3.0, 0.5], [2.0, 0.25]]
REGION = np.array([[1.0, 4.0], [0.0, 1.0]])


def value(load: float, b: float, a: float) -> float:
    return load * b**2 + np.exp(a)


def by_order(load: float, b: float, a: float) -> tuple[float, list[float]]:
    return value(load, b, a), [2.0 * load * b, np.exp(a)]


def by_name(load: float, b: float, a: float) -> tuple[float, dict[str, float]]:
    return value(load, b, a), {"a": np.exp(a), "b": 2.0 * load * b}


def gradient(load: float, b: float, a: float) -> list[float]:
    return by_order(load, b, a)[1]


def runner(function: Callable[..., Any], jac: Any = True, **more: Any) -> Runner:
    names = more.pop("names", ["b", "a"])
    table = more.pop("table", TABLE)
    return Runner(FunctionSimulator(function, jac=jac, version="1"), table, names, **more)


EXPECTED = np.array([[[6.0, np.exp(0.5)]], [[8.0, np.exp(0.25)]]])


@pytest.mark.parametrize(
    ("function", "jac"), [(by_order, True), (by_name, True), (value, gradient)]
)
def test_derivatives_come_by_order_by_name_or_by_a_function_of_their_own(
    function: Callable[..., Any], jac: Any
) -> None:
    run = runner(function, jac)
    values, slopes = run.with_slopes([0, 1], X)
    assert values[:, 0] == pytest.approx([value(1.0, *X[0]), value(2.0, *X[1])], rel=1e-15)
    assert slopes == pytest.approx(EXPECTED, rel=1e-15)
    assert run.values([0, 1], X).tolist() == values.tolist()
    assert run([0, 1], X).tolist() == values[:, 0].tolist()
    assert run.straight([0, 1], X).tolist() == values.tolist()
    assert run.runs == 4
    again = cloudpickle.loads(cloudpickle.dumps(run.simulator))
    assert Runner(again, TABLE, ["b", "a"]).with_slopes([0, 1], X)[1].tolist() == slopes.tolist()


def test_a_simulator_without_derivatives_has_none() -> None:
    assert np.isnan(runner(value, False).with_slopes([0, 1], X)[1]).all()


def test_logarithms_and_several_responses_have_derivatives_of_their_own() -> None:
    def two(load: float, k: float) -> tuple[dict[str, float], dict[str, Any]]:
        return {"u": k * load, "v": k**2}, {"u": {"k": load}, "v": 2.0 * k}

    frame = pd.DataFrame({"load": [5.0], "u": [1.0], "v": [1.0]})
    table = Experiments.from_frame(frame, outcome=["u", "v"], transform={"u": "log"})
    values, slopes = runner(two, names=["k"], table=table).with_slopes([0], [[3.0]])
    assert values == pytest.approx(np.array([[np.log(15.0), 9.0]]))
    assert slopes == pytest.approx(np.array([[[1.0 / 3.0], [6.0]]]))


def test_a_series_has_derivatives_of_each_row() -> None:
    def curve(time: Any, k: float, c: float) -> tuple[Any, Any]:
        return c * np.exp(-k * time), {"k": -time * c * np.exp(-k * time), "c": np.exp(-k * time)}

    frame = pd.DataFrame({"id": ["A", "A", "B"], "time": [1.0, 2.0, 1.5], "y": [1.0, 1.0, 1.0]})
    table = Experiments.from_frame(frame, id="id", outcome="y")
    run = Runner(FunctionSimulator(curve, series=True, jac=True), table, ["k", "c"])
    values, slopes = run.with_slopes([0, 1], [[0.5, 2.0], [0.5, 2.0]])
    assert values[1, 0] == pytest.approx(2.0 * np.exp(-0.75))
    assert slopes[0] == pytest.approx(
        np.array([[-2.0 * np.exp(-0.5), np.exp(-0.5)], [-4.0 * np.exp(-1.0), np.exp(-1.0)]])
    )
    assert np.isnan(slopes[1, 1]).all()


# ------------------------------------------------------------------------ misuse


@pytest.mark.parametrize(
    ("returned", "told"),
    [
        (1.0, "to return a pair"),
        ((1.0, [1.0]), r"shape \(1,\)"),
        ((1.0, {"c": 1.0}), "a derivative by 'c'"),
        ((1.0, "none"), "'none' as derivatives"),
    ],
)
def test_derivatives_of_another_form_are_told(returned: Any, told: str) -> None:
    with pytest.raises(SimulatorError, match=told):
        runner(lambda load, b, a: returned)([0], X[:1])  # noqa: ARG005  names are arguments


def test_a_pair_without_jac_is_told() -> None:
    with pytest.raises(SimulatorError, match="jac = true"):
        runner(by_order, False)([0], X[:1])


def test_what_has_no_use_for_derivatives_refuses_them() -> None:
    with pytest.raises(SimulatorError, match="vectorized"):
        FunctionSimulator(by_order, vectorized=True, jac=True)
    with pytest.raises(SimulatorError, match="derived"):
        derived(FunctionSimulator(by_order, jac=True), {"b": "2*c"})


# ------------------------------------------------------------------------ the check


def check(function: Callable[..., Any]) -> Runner:
    run = runner(function)
    require_slopes(run, np.array([2.0, 0.5]), REGION, np.arange(2))
    return run


def test_right_derivatives_cost_two_runs() -> None:
    assert check(by_order).runs == 3


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        (lambda slopes: slopes[::-1], "derivative 1.6487. by 'b'"),
        (lambda slopes: [slopes[0], -slopes[1]], "derivative -1.6487. by 'a'"),
        (lambda slopes: [2.0 * slopes[0], slopes[1]], "derivative 8 by 'b'.* values give 4"),
        (lambda slopes: {"b": slopes[0]}, "no derivative by 'a'"),
    ],
)
def test_a_wrong_derivative_is_named(wrong: Callable[[Any], Any], named: str) -> None:
    with pytest.raises(SimulatorError, match=named):
        check(lambda load, b, a: (value(load, b, a), wrong(gradient(load, b, a))))


def test_values_of_a_rough_solver_contradict_no_right_derivative() -> None:
    def rough(load: float, b: float, a: float) -> tuple[float, list[float]]:
        found, slopes = by_order(load, b, a)
        return found * (1.0 + 1e-4 * np.sin(1e5 * b)), slopes

    assert check(rough).runs <= 7


# ------------------------------------------------------------------------ the store


def stored(path: Path, function: Callable[..., Any], jac: Any, **more: Any) -> Runner:
    return runner(function, jac, store=Store(path), **more)


def test_stored_runs_have_the_same_derivatives_to_the_last_bit(tmp_path: Path) -> None:
    path = tmp_path / "runs.sqlite"
    first = stored(path, value, gradient).with_slopes([0, 1], X)
    again = stored(path, value, gradient)
    assert all(
        np.array_equal(a, b) for a, b in zip(first, again.with_slopes([0, 1], X), strict=True)
    )
    assert again.fresh == 0
    # In another order of the parameters, and without derivatives.
    swapped = stored(path, value, gradient, names=["a", "b"])
    slopes = swapped.with_slopes([0, 1], np.array(X)[:, ::-1])[1]
    assert np.array_equal(slopes, first[1][..., ::-1])
    assert swapped.fresh == 0
    plain = stored(path, value, False)
    assert np.array_equal(plain.values([0, 1], X), first[0])
    assert plain.fresh == 0


def test_runs_stored_without_derivatives_are_values_only(tmp_path: Path) -> None:
    path = tmp_path / "runs.sqlite"
    before = stored(path, value, False).values([0], X[:1])
    run = stored(path, value, gradient)
    values, slopes = run.with_slopes([0, 1], X)
    assert np.array_equal(values[:1], before)
    assert np.isnan(slopes[0]).all()
    assert slopes[1] == pytest.approx(EXPECTED[1])
    assert run.fresh == 1


def test_derivatives_are_exported_and_imported(tmp_path: Path) -> None:
    run = stored(tmp_path / "runs.sqlite", value, gradient)
    first = run.with_slopes([0, 1], X)
    assert run.cache is not None
    write(stored_runs(run.cache.store), tmp_path / "runs.csv")
    other = Store(tmp_path / "other.sqlite")
    assert read(other, tmp_path / "runs.csv").added == 2
    again = runner(value, gradient, store=other)
    assert all(
        np.array_equal(a, b) for a, b in zip(first, again.with_slopes([0, 1], X), strict=True)
    )
    assert again.fresh == 0
