"""Series of an FMU: one run serves a whole experiment; conditions give start values and times."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fmus.build import compiled, rewritten
from fmus.truths import column_of, cooled, flown

from aleator.errors import SimulatorError
from aleator.observations.experiments import Experiments
from aleator.simulators import RunFailed, Runner
from aleator.simulators.fmu import Course, Crossing, Extreme, Final, FMUSimulator, Operation, Signal
from aleator.study import load_study

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


def test_times_closer_than_a_step_are_all_met(fmus: dict[int, Path]) -> None:
    """Also those that differ by less than what is taken for equal."""
    simulator = FMUSimulator(fmus[2], Final("T"), variables=K, operation=HERE, series=True)
    times = np.array([1e-12, 0.5, 0.5 + 1e-13, 0.5 + 1e-7, 0.7 - 1e-12, 2.0, 2.0 - 1e-12])
    found = simulator.sample({"time": times}, {"k": 1.0})[:, 0]
    assert found == pytest.approx(cooled(1.0, times), abs=1e-8)


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
        return simulator.sample({"time": times}, {"k": k})[:, 0]

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


def test_a_start_time_comes_from_a_condition(fmus: dict[int, Path]) -> None:
    course = Course(start_time="begin", stop_time=2.0, step=0.1)
    simulator = FMUSimulator(fmus[2], Final("T"), course=course, operation=HERE)
    found = simulator({"begin": np.array([0.0, 1.5])}, {"surface.k": np.array([1.0, 1.0])})
    assert found == pytest.approx(cooled(1.0, np.array([2.0, 0.5])))


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


STUDY = """
[experiments]
file = "table.csv"
outcome = "cooled"
[simulator]
fmu = "cooling2.fmu"
variables = {{k = "surface.k"}}
{keys}
[parameters.k]
law = "truncated_normal"
box = [0.5, 2.0]
"""


def study(fmu: Path, keys: str) -> Path:
    table = {"time": [0.5, 1.25], "cooled": [350.0, 330.0]}
    pd.DataFrame(table).to_csv(fmu.parent / "table.csv", index=False)
    path = fmu.parent / "study.toml"
    path.write_text(STUDY.format(keys=keys), encoding="utf-8")
    return path


def test_a_study_names_a_series_and_its_responses(fmus: dict[int, Path]) -> None:
    """A response may be called as a key is, if its outcome is a table."""
    outcome = 'outcome = {warmth = "T - ambient", value = {variable = "T", reduce = "maximum"}}'
    for text, responses in ((outcome, ("warmth", "value")), ('outcome = "T"', ())):
        if responses:
            text = text.replace('"T - ambient"', '{variable = "T - ambient"}')
        simulator = load_study(study(fmus[2], f'{text}\nseries = true\ntime = "time"')).simulator
        assert isinstance(simulator, FMUSimulator)
        assert simulator.series
        assert simulator.responses == responses
        assert simulator.course.conditions == ("time",)


def test_a_time_that_is_the_same_in_all_rows_serves_them_all(fmus: dict[int, Path]) -> None:
    simulator = FMUSimulator(fmus[2], Final("T"), variables=K, operation=HERE, series=True)
    table = pd.DataFrame({"id": [*"aab"], "time": [1.3, 1.3, 0.2], "T0": 400.0, "y": 0.0})
    run = Runner(simulator, Experiments.from_frame(table, outcome="y", id="id"), ["k"])
    values = run.values([0, 1], [[1.0], [2.0]])
    assert values[0] == pytest.approx([cooled(1.0, np.array(1.3))] * 2)
    assert values[1, 0] == pytest.approx(cooled(2.0, np.array(0.2)))


def test_a_condition_may_be_a_time_and_a_variable(fmus: dict[int, Path]) -> None:
    """A time that is a parameter of the FMU, as the length of a pulse is, is set there too."""
    simulator = FMUSimulator(
        fmus[2], Final("level - T"), course=Course(stop_time="level", step=0.1), operation=HERE
    )
    found = simulator.run_one({"level": 1.7}, {"surface.k": 1.0})
    assert found == pytest.approx(1.7 - cooled(1.0, np.array(1.7)))
