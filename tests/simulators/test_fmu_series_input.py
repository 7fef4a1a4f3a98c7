"""Times and conditions that a series of an FMU cannot take are told."""

from pathlib import Path

import numpy as np
import pytest
from fmus.truths import column_of

from aleator.errors import SimulatorError
from aleator.simulators.fmu import Course, Final, FMUSimulator, Operation

HERE = Operation(isolated=False)
K = {"k": "surface.k"}
TIMES = np.array([1.234, 0.0, 0.1, 0.777, 0.1, 3.3])  # neither sorted nor on the steps of 0.1 s


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([1.0, -0.5], r"the time -0\.5 s \('time'\) is before the start at 0 s"),
        ([1.0, np.nan], r"a time \('time'\) is not a finite number: 1\.0, nan"),
        (["noon", 1.0], r"a time \('time'\) is not a finite number: noon, 1\.0"),
    ],
)
def test_times_that_cannot_be_are_told(
    fmus: dict[int, Path], times: list[object], message: str
) -> None:
    """By no failed run: no parameters would mend them."""
    simulator = FMUSimulator(fmus[2], Final("T"), operation=HERE, series=True)
    cells = np.array(times, dtype=object)
    with pytest.raises(SimulatorError, match=message):
        simulator({"time": column_of(np.array([0.5]), cells)}, {"surface.k": np.ones(2)})


def test_a_condition_that_varies_beside_the_time_is_refused(fmus: dict[int, Path]) -> None:
    simulator = FMUSimulator(fmus[2], Final("T"), variables=K, operation=HERE, series=True)
    conditions = {"time": column_of(TIMES[:2]), "ambient": column_of(np.array([300.0, 310.0]))}
    with pytest.raises(SimulatorError, match=r"(?s)'ambient' varies .*inputs"):
        simulator(conditions, {"k": np.ones(1)})


def test_a_time_that_is_no_condition_or_given_twice_is_refused(fmus: dict[int, Path]) -> None:
    for how in ({"series": True, "time": "tim"}, {"course": Course(stop_time="tim")}):
        simulator = FMUSimulator(fmus[2], Final("T"), variables=K, **how)  # type: ignore[arg-type]
        with pytest.raises(SimulatorError, match=r"'tim' .*'time'"):
            simulator.asks(["time"], ["k"])
    with pytest.raises(SimulatorError, match="delete stop_time"):
        FMUSimulator(fmus[2], Final("T"), course=Course(stop_time=2.0), series=True)
