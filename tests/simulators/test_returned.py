"""What a simulator returns: a masked value is none, objects that are numbers are, texts are not."""

from collections.abc import Callable
from decimal import Decimal
from typing import Any

import numpy as np
import pandas as pd
import pytest

from aleator.errors import ExperimentsError, SimulatorError
from aleator.observations.experiments import Conditions, Experiments
from aleator.simulators import FunctionSimulator, Runner

ROWS = Conditions(("A", "B", "C"), pd.DataFrame({"load": [1.0, 2.0, 3.0]}))
SERIES = Conditions(("A",), pd.DataFrame({"load": [1.0, 2.0, 3.0]}), experiment=np.zeros(3))
NAN = float("nan")

GIVEN: dict[str, tuple[Callable[[Any], Any], list[float]]] = {
    "masked": (lambda v: np.ma.masked_greater(v, 2.5), [1.0, 2.0, NAN]),
    "masked whole numbers": (lambda v: np.ma.masked_equal(v.astype(int), 2), [1.0, NAN, 3.0]),
    "objects": (lambda v: v.astype(object), [1.0, 2.0, 3.0]),
    "decimals": (lambda v: np.array([Decimal(str(a)) for a in v]), [1.0, 2.0, 3.0]),
    "missing": (lambda v: np.array([v[0], None, v[2]], dtype=object), [1.0, NAN, 3.0]),
    "missing in a frame": (
        lambda v: pd.array([v[0], pd.NA, v[2]], dtype="Float64"),
        [1.0, NAN, 3.0],
    ),
}
REFUSED: dict[str, Callable[[Any], Any]] = {
    "texts": lambda v: v.astype(str),
    "a list of texts": lambda v: [str(a) for a in v],
    "texts as objects": lambda v: v.astype(str).astype(object),
    "truth values": lambda v: v > 0,
    "complex": lambda v: v + 0j,
    "dates": lambda v: v.astype(int).astype("M8[s]"),
}


def values(make: Callable[[Any], Any], table: Conditions, **kind: bool) -> Runner:
    simulator = FunctionSimulator(lambda load, x: make(np.asarray(load * x)), **kind)
    return Runner(simulator, table, ["x"], max_failed=1.0)


@pytest.mark.parametrize(("make", "expected"), GIVEN.values(), ids=GIVEN)
def test_values_are_those_that_were_returned(
    make: Callable[[Any], Any], expected: list[float]
) -> None:
    vectorized = values(make, ROWS, vectorized=True)
    found = vectorized.attempt([0, 1, 2], np.ones((3, 1)))
    np.testing.assert_array_equal(found, expected)
    assert len(vectorized.failures) == np.isnan(expected).sum()
    straight = vectorized.straight([0, 1, 2], np.ones((3, 1)))
    np.testing.assert_array_equal(straight[:, 0], expected)
    series = values(make, SERIES, series=True).values([0], [[1.0]])
    lost = [NAN] * 3 if np.isnan(expected).any() else expected  # of a series all rows are needed
    np.testing.assert_array_equal(series[0], lost)


@pytest.mark.parametrize("make", REFUSED.values(), ids=REFUSED)
def test_what_is_no_number_is_none(make: Callable[[Any], Any]) -> None:
    with pytest.raises(SimulatorError, match="returned values of type"):
        values(make, ROWS, vectorized=True)([0, 1, 2], np.ones((3, 1)))
    run = values(make, SERIES, series=True)
    assert np.isnan(run.values([0], [[1.0]])).all()
    assert "values of type" in next(iter(run.failures.failures.values())).message
    with pytest.raises(ExperimentsError, match="values of type"):
        Experiments(ROWS.ids, ROWS.conditions, make(np.array([1.0, 2.0, 3.0])))


@pytest.mark.parametrize("returned", ["2.0", b"2.0", True, 1j, [2.0], None])
def test_one_run_gives_one_number(returned: object) -> None:
    run = Runner(lambda load, x: returned if load > 1 else load * x, ROWS, ["x"])  # type: ignore[arg-type]
    assert run([0], [[1.0]]).tolist() == [1.0]
    with pytest.raises(SimulatorError, match="experiment 'B'"):
        run([1], [[1.0]])


def test_a_function_that_masks_is_not_called_with_arrays_unseen() -> None:
    """Where a call with many numbers masks some of them, these runs have no outcome."""
    run = Runner(lambda load, x: np.ma.masked_less(load * x, 1.5), ROWS, ["x"])
    assert run.takes_arrays(np.array([[2.0, 3.0]]))
    found = run.straight([0, 1, 2], np.ones((3, 1)))
    np.testing.assert_array_equal(found[:, 0], [NAN, 2.0, 3.0])


def test_a_masked_measurement_is_no_outcome() -> None:
    with pytest.raises(ExperimentsError, match="1 of them not finite"):
        Experiments(ROWS.ids, ROWS.conditions, np.ma.masked_equal([1.0, 2.0, 3.0], 2.0))
    exact = Experiments(ROWS.ids, ROWS.conditions, np.array([1, Decimal(2), 3.0], dtype=object))
    assert exact.outcomes.tolist() == [1.0, 2.0, 3.0]
