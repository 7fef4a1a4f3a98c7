"""Start values of an FMU and the times of its runs come from conditions."""

from pathlib import Path

import numpy as np
import pytest
from fmus.build import rewritten
from fmus.truths import cooled, flown

from aleator.errors import SimulatorError
from aleator.simulators.fmu import Course, Final, FMUSimulator, Operation

HERE = Operation(isolated=False)
KINDS = ("co_simulation", "model_exchange")
K = {"k": "surface.k"}


@pytest.fixture(scope="module")
def started(fmus: dict[int, Path], tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """The bodies that cool, with the temperature a state whose start value is exact."""
    folder = tmp_path_factory.mktemp("started")
    second = (
        'initial="calculated" description="temperature of the body">'
        '<Real declaredType="Temperature"/>',
        'initial="exact"><Real declaredType="Temperature" start="400"/>',
    )
    third = ('initial="calculated" unit="K"/>', 'initial="exact" start="400" unit="K"/>')
    return {
        2: rewritten(fmus[2], folder / "started2.fmu", *second),
        3: rewritten(fmus[3], folder / "started3.fmu", *third),
    }


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("version", [2, 3])
def test_a_state_with_an_exact_start_value_is_set(
    started: dict[int, Path], version: int, kind: str
) -> None:
    course = Course(kind=kind, stop_time="duration")
    simulator = FMUSimulator(
        started[version], Final("T"), course=course, variables=K, operation=HERE
    )
    asked = simulator.asks(["T", "duration", "bench"], ["k"])
    assert asked == ("T", "duration")
    conditions = {"T": np.array([500.0, 350.0]), "duration": np.array([1.234, 0.3])}
    found = simulator(conditions, {"k": np.array([0.5, 2.0])})
    expected = [cooled(0.5, 1.234, 500.0), cooled(2.0, 0.3, 350.0)]
    assert found == pytest.approx(expected, abs=1e-9 if kind == "co_simulation" else 1e-4)
    simulator.close()


def test_a_ball_flies_its_parabola_from_the_height_and_speed_of_its_experiment(ball: Path) -> None:
    simulator = FMUSimulator(
        ball, {"height": Final("h"), "speed": Final("v")}, course=Course(stop_time="time", step=0.1)
    )
    assert simulator.asks(["time", "h", "v"], ["g", "e"]) == ("time", "h", "v")
    assert simulator.responses == ("height", "speed")
    times = np.array([0.314, 1.7, 0.0])
    conditions = {"time": times, "h": np.array([1.0, 2.0, 3.0]), "v": np.array([0.5, -0.5, 1.0])}
    found = simulator(conditions, {"g": np.full(3, 9.81), "e": np.full(3, 0.7)})
    assert [*found[0]] == ["height", "speed"]
    for row, (t, h, v) in enumerate(zip(*conditions.values(), strict=True)):
        expected = flown(np.array([t]), h, v, 9.81, 0.7)[0]
        assert [*found[row].values()] == pytest.approx(expected, abs=1e-9)
    simulator.close()


def test_a_start_time_comes_from_a_condition(fmus: dict[int, Path]) -> None:
    course = Course(start_time="begin", stop_time=2.0, step=0.1)
    simulator = FMUSimulator(fmus[2], Final("T"), course=course, operation=HERE)
    found = simulator({"begin": np.array([0.0, 1.5])}, {"surface.k": np.array([1.0, 1.0])})
    assert found == pytest.approx(cooled(1.0, np.array([2.0, 0.5])))
    simulator.close()


def test_a_condition_may_be_a_time_and_a_variable(fmus: dict[int, Path]) -> None:
    """A time that is a parameter of the FMU, as the length of a pulse is, is set there too."""
    simulator = FMUSimulator(
        fmus[2], Final("level - T"), course=Course(stop_time="level", step=0.1), operation=HERE
    )
    found = simulator.run_one({"level": 1.7}, {"surface.k": 1.0})
    assert found == pytest.approx(1.7 - cooled(1.0, np.array(1.7)))
    simulator.close()


def test_a_variable_that_is_only_guessed_or_the_time_is_no_start_value(
    fmus: dict[int, Path], tmp_path: Path
) -> None:
    guessed = rewritten(
        fmus[3], tmp_path / "guessed.fmu", 'initial="calculated"', 'initial="approx"'
    )
    simulator = FMUSimulator(guessed, Final("T"), variables=K)
    for name, message in (("T", "guess"), ("time", "is the time of the simulation")):
        with pytest.raises(SimulatorError, match=message):
            simulator.asks([name], ["k"])
