"""One run of an FMU serves a whole experiment."""

import pickle
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fmus.build import compiled, rewritten
from fmus.truths import column_of, cooled, flown

from aleator.observations.experiments import Experiments
from aleator.simulators import RunFailed, Runner
from aleator.simulators.fmu import Course, Crossing, Extreme, Final, FMUSimulator, Operation, Signal

HERE = Operation(isolated=False)
KINDS = ("co_simulation", "model_exchange")
K = {"k": "surface.k"}
TIMES = np.array([1.234, 0.0, 0.1, 0.777, 0.1, 3.3])  # neither sorted nor on the steps of 0.1 s


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("version", [2, 3])
def test_a_series_is_the_closed_form_at_its_times(
    fmus: dict[int, Path], version: int, kind: str
) -> None:
    simulator = FMUSimulator(
        fmus[version],
        Final("T"),
        course=Course(kind=kind),
        variables={**K, "hot": "T0"},
        operation=HERE,
        series=True,
    )
    assert simulator.asks(["hot", "time"], ["k"]) == ("hot", "time")
    error = 1e-9 if kind == "co_simulation" else 1e-4
    for k, hot in ((0.5, 400.0), (2.0, 500.0), (0.5, 400.0)):
        found = simulator.sample({"time": TIMES, "hot": hot}, {"k": k})
        assert found[:, 0] == pytest.approx(cooled(k, TIMES, hot), abs=error)
    assert simulator.notes == ()
    simulator.close()


def test_a_runner_takes_a_series_of_two_responses(ball: Path) -> None:
    """Two experiments of six and of two rows, in any order."""
    outcomes = {"speed": Final("v"), "height": Final("h")}
    simulator = FMUSimulator(ball, outcomes, course=Course(step=0.1), series=True)
    table = pd.DataFrame(
        {
            "id": [*"aabaaaba"],
            "time": [*TIMES[:2], 0.5, *TIMES[2:5], 0.2, TIMES[5]],
            "h": [1.0, 1.0, 2.0, 1.0, 1.0, 1.0, 2.0, 1.0],
            "height": 0.0,
            "speed": 0.0,
        }
    )
    experiments = Experiments.from_frame(table, outcome=["height", "speed"], id="id")
    run = Runner(simulator, experiments, ["g", "e"])
    values = run.values([0, 1], [[9.81, 0.9], [1.62, 0.8]])
    assert values.shape == (2, 12)
    assert values[0].reshape(-1, 2) == pytest.approx(flown(TIMES, 1.0, 0.0, 9.81, 0.9), abs=1e-9)
    late = flown(np.array([0.5, 0.2]), 2.0, 0.0, 1.62, 0.8)
    assert values[1, :4].reshape(-1, 2) == pytest.approx(late, abs=1e-9)
    assert np.all(np.isnan(values[1, 4:]))
    simulator.close()


def test_a_time_that_is_the_same_in_all_rows_serves_them_all(fmus: dict[int, Path]) -> None:
    simulator = FMUSimulator(fmus[2], Final("T"), variables=K, operation=HERE, series=True)
    table = pd.DataFrame({"id": [*"aab"], "time": [1.3, 1.3, 0.2], "T0": 400.0, "y": 0.0})
    run = Runner(simulator, Experiments.from_frame(table, outcome="y", id="id"), ["k"])
    values = run.values([0, 1], [[1.0], [2.0]])
    assert values[0] == pytest.approx([cooled(1.0, np.array(1.3))] * 2)
    assert values[1, 0] == pytest.approx(cooled(2.0, np.array(0.2)))
    simulator.close()


def test_times_closer_than_a_step_are_all_met(fmus: dict[int, Path]) -> None:
    """Also those that differ by less than what is taken for equal."""
    simulator = FMUSimulator(fmus[2], Final("T"), variables=K, operation=HERE, series=True)
    times = np.array([1e-12, 0.5, 0.5 + 1e-13, 0.5 + 1e-7, 0.7 - 1e-12, 2.0, 2.0 - 1e-12])
    found = simulator.sample({"time": times}, {"k": 1.0})[:, 0]
    assert found == pytest.approx(cooled(1.0, times), abs=1e-8)
    simulator.close()


@pytest.mark.parametrize("outcome", [Final("T"), Extreme("-der(T)"), Crossing("T", 350.0)])
def test_a_row_of_a_series_is_the_run_that_ends_there(
    fmus: dict[int, Path], outcome: Final | Extreme | Crossing
) -> None:
    times = np.array([1.9, 0.85, 0.8])
    parameters = {"k": 1.0}
    series, single = (
        FMUSimulator(fmus[2], outcome, variables=K, operation=HERE, **how)  # type: ignore[arg-type]
        for how in ({"series": True}, {"course": Course(stop_time="time")})
    )
    found = series.sample({"time": times}, parameters)[:, 0]
    assert found == pytest.approx(
        [single.run_one({"time": t}, parameters) for t in times.tolist()], rel=1e-9
    )
    series.close()
    single.close()


def test_an_fmu_with_steps_of_one_length_is_interpolated(tmp_path: Path) -> None:
    fixed = compiled(2, tmp_path, step_sizes=False)
    errors = []
    for step in (0.1, 0.05):
        simulator = FMUSimulator(
            fixed, Final("T"), course=Course(step=step), operation=HERE, series=True
        )
        found = simulator.sample({"time": TIMES}, {})[:, 0]
        on_steps = np.isin(TIMES, [0.0, 0.1, 3.3])
        assert found[on_steps] == pytest.approx(cooled(1.0, TIMES[on_steps]), abs=1e-9)
        # Of a straight line: an eighth of the step squared, times the second derivative.
        errors.append(np.max(np.abs(found - cooled(1.0, TIMES))))
        assert errors[-1] <= step**2 / 8.0 * 100.0
        simulator.close()
    assert errors[1] > 0.0


def test_a_solver_of_known_step_is_asked_at_the_ends_of_its_steps(
    fmus: dict[int, Path], tmp_path: Path
) -> None:
    """Within its step it may answer with the last one; a straight line errs by second order."""
    stepping = rewritten(
        fmus[3],
        tmp_path / "stepping.fmu",
        'StepSize="true"',
        'StepSize="true" fixedInternalStepSize="0.05"',
    )
    simulator = FMUSimulator(
        stepping, Final("T"), course=Course(step=0.5), operation=HERE, series=True
    )
    between, ends = np.array([0.333, 1.0, 1.777]), np.array([0.3, 0.35, 0.5, 1.0, 1.5, 1.75, 1.8])
    assert simulator.trajectory({"time": between}, {})["time"] == pytest.approx([0.0, *ends])
    error = np.abs(simulator.sample({"time": between}, {})[:, 0] - cooled(1.0, between))
    assert error[1] < 1e-9
    assert np.all(error <= 0.05**2 / 8.0 * 100.0)
    simulator.close()


RAMP = Signal(np.array([0.0, 2.0]), np.array([300.0, 400.0]))
JUMP = Signal(np.array([0.0, 0.777, 0.777, 5.0]), np.array([300.0, 300.0, 350.0, 350.0]))


@pytest.mark.parametrize("version", [2, 3])
def test_a_series_sees_inputs_over_time(fmus: dict[int, Path], version: int) -> None:
    """T' = -k (T - ambient), for a ramp of the ambient that ends at 2 s, and for a jump."""
    k, times = 2.0, np.array([1.9, 0.777, 0.333])

    def sampled(signal: Signal) -> np.ndarray:
        simulator = FMUSimulator(
            fmus[version],
            Final("T"),
            course=Course(kind="model_exchange", step=0.2),
            variables=K,
            inputs={"ambient": signal},
            operation=HERE,
            series=True,
        )
        found = simulator.sample({"time": times}, {"k": k})[:, 0]
        simulator.close()
        return found

    ramped = 300.0 + 50.0 * (times - 1.0 / k) + (100.0 + 50.0 / k) * np.exp(-k * times)
    assert sampled(RAMP) == pytest.approx(ramped, abs=2e-4)
    later = 350.0 + (cooled(k, np.array(0.777)) - 350.0) * np.exp(-k * (times - 0.777))
    jumped = np.where(times > 0.777, later, cooled(k, times))
    assert sampled(JUMP) == pytest.approx(jumped, abs=2e-4)


def test_what_does_not_exist_yet_is_not_a_number(fmus: dict[int, Path]) -> None:
    """The body passes 350 K at ln(2) s."""
    simulator = FMUSimulator(fmus[2], Crossing("T", 350.0), operation=HERE, series=True)
    found = simulator.sample({"time": np.array([0.5, 1.0])}, {})[:, 0]
    assert np.isnan(found[0])
    assert found[1] == pytest.approx(np.log(2.0), abs=1e-5)
    with pytest.raises(RunFailed, match=r"does not cross 350 by time 0\.5 s"):
        simulator.sample({"time": np.array([0.5, 0.25])}, {})
    simulator.close()


def test_a_series_travels_and_its_fingerprint_tells_it(fmus: dict[int, Path]) -> None:
    series = FMUSimulator(fmus[2], Final("T"), variables=K, series=True)
    conditions, parameters = {"time": column_of(TIMES)}, {"k": np.ones(1)}
    copy = pickle.loads(pickle.dumps(series))
    assert np.array_equal(copy(conditions, parameters), series(conditions, parameters))
    others = [
        FMUSimulator(fmus[2], Final("T"), variables=K, course=Course(stop_time="time")),
        FMUSimulator(fmus[2], Final("T"), variables=K, series=True, time="t"),
        FMUSimulator(fmus[2], {"T": Final("T")}, variables=K, series=True),
    ]
    assert len({each.fingerprint() for each in (series, *others)}) == 4
    assert copy.fingerprint() == series.fingerprint()
    copy.close()
    series.close()
