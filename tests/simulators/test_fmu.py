"""FMUs run as they should, and what they do wrong is a failed run that is in the way of none."""

import os
import pickle
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from programs import emptied

from aleator.errors import SimulatorError, SurroundingsError
from aleator.observations.experiments import Conditions
from aleator.simulators import RunFailed, Runner, Store
from aleator.simulators.fmu import (
    Course,
    Crossing,
    Extreme,
    Final,
    FMUSimulator,
    Hook,
    Operation,
    Signal,
)
from aleator.simulators.records import stored_runs

KINDS = ("co_simulation", "model_exchange")
HERE = Operation(isolated=False)
K = {"k": "surface.k"}


def cooled_until(k: float, time: float = 2.0) -> float:
    return 300.0 + 100.0 * np.exp(-k * time)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("version", [2, 3])
def test_every_version_and_kind_gives_the_closed_form(
    fmus: dict[int, Path], version: int, kind: str
) -> None:
    course = Course(kind=kind)
    simulator = FMUSimulator(fmus[version], Final("T"), course=course, variables=K, operation=HERE)
    error = 1e-10 if kind == "co_simulation" else 3e-5  # CVode's, at a tolerance of 1e-8
    for k in (0.5, 1.0, 3.0, 0.5):
        assert simulator.run_one({}, {"k": k}) == pytest.approx(cooled_until(k), abs=error)
    assert simulator.notes == ()


def test_a_model_exchange_is_as_exact_as_its_tolerance(fmus: dict[int, Path]) -> None:
    errors = []
    for tolerance in (1e-4, 1e-6, 1e-8):
        course = Course(kind="model_exchange", tolerance=tolerance)
        simulator = FMUSimulator(fmus[2], Final("T"), course=course, operation=HERE)
        errors.append(abs(simulator.run_one({}, {}) - cooled_until(1.0)))
    assert errors[0] < 0.5
    assert errors[2] < 0.01 * errors[0]
    assert errors == sorted(errors, reverse=True)


@pytest.mark.parametrize(("cubic", "order"), [(False, 2.0), (True, 4.0)])
def test_a_crossing_converges_at_the_order_of_its_interpolant(
    fmus: dict[int, Path], cubic: bool, order: float
) -> None:
    k, exact = 1.3, np.log(100.0 / 41.0) / 1.3
    errors = []
    for step in (0.1, 0.05, 0.025):
        simulator = FMUSimulator(
            fmus[2],
            Crossing("T - ambient", 41.0, "down", cubic=cubic),
            course=Course(stop_time=2.0, step=step),
            variables=K,
            operation=HERE,
        )
        errors.append(abs(simulator.run_one({}, {"k": k}) - exact))
    # The error also depends on where in its step the crossing falls, hence the wide margin.
    assert np.log2(errors[0] / errors[2]) / 2.0 == pytest.approx(order, abs=0.7)
    assert errors[2] < (1e-4 if not cubic else 1e-7)


RAMP = Signal(np.array([0.0, 2.0]), np.array([300.0, 400.0]))
JUMP = Signal(np.array([0.0, 0.73, 0.73, 2.0]), np.array([300.0, 300.0, 350.0, 350.0]))


def ramped(k: float) -> float:
    return 300.0 + 50.0 * (2.0 - 1.0 / k) + (100.0 + 50.0 / k) * np.exp(-2.0 * k)


def jumped(k: float) -> float:
    return 350.0 + (cooled_until(k, 0.73) - 350.0) * np.exp(-k * (2.0 - 0.73))


@pytest.mark.parametrize("step", [0.2, 0.05])
@pytest.mark.parametrize("version", [2, 3])
def test_inputs_over_time_reach_the_solver_of_a_model_exchange(
    fmus: dict[int, Path], version: int, step: float
) -> None:
    """Set at communication points only, as FMPy does without event indicators, the ramp would be
    late by half a step: an error of 1.4 at the smaller one."""
    for ambient, exact in ((RAMP, ramped(2.0)), (JUMP, jumped(2.0))):
        simulator = FMUSimulator(
            fmus[version],
            Final("T"),
            course=Course(kind="model_exchange", step=step),
            variables=K,
            inputs={"ambient": ambient},
            operation=HERE,
        )
        assert simulator.run_one({}, {"k": 2.0}) == pytest.approx(exact, abs=3e-5)


def test_a_co_simulation_holds_its_inputs_during_a_step(fmus: dict[int, Path]) -> None:
    def error(signal: Signal, exact: float, step: float) -> float:
        simulator = FMUSimulator(
            fmus[2],
            Final("T"),
            course=Course(kind="co_simulation", step=step),
            variables=K,
            inputs={"ambient": signal},
            operation=HERE,
        )
        return simulator.run_one({}, {"k": 2.0}) - exact

    late = [error(RAMP, ramped(2.0), step) for step in (0.2, 0.1)]
    assert late[0] / late[1] == pytest.approx(2.0, abs=0.15)  # first order, as documented
    assert error(JUMP, jumped(2.0), 0.2) == pytest.approx(0.0, abs=1e-9)  # a step ends at a jump


def test_conditions_of_every_type_arrive(fmus: dict[int, Path]) -> None:
    simulator = FMUSimulator(
        fmus[2], Final("T"), variables={**K, "hot": "T0"}, operation=HERE, constants={"level": 320}
    )
    conditions = ("hot", "cycles", "insulated", "label", "trap", "ambient", "bench")
    assert simulator.asks(conditions, ["k"]) == conditions[:-1]

    def once(**conditions: object) -> float:
        return simulator.run_one(conditions, {"k": 0.5})

    assert once(hot=500) == pytest.approx(300.0 + 200.0 * np.exp(-1.0))
    assert once(cycles=3.0) == pytest.approx(cooled_until(1.5))
    assert once(insulated="True") == once(insulated=1) == pytest.approx(400.0)
    assert once(insulated=False) == once(insulated=0.0) == pytest.approx(cooled_until(0.5))
    assert once(label="fast") == pytest.approx(cooled_until(1.0))
    assert once(trap="none") == once(trap=0) == pytest.approx(cooled_until(0.5))
    assert once(ambient=350.0) == pytest.approx(350.0 + 50.0 * np.exp(-1.0))


def test_a_hook_gets_the_trajectory(fmus: dict[int, Path], tmp_path: Path) -> None:
    (tmp_path / "post.py").write_text(
        "def area(trajectory):\n"
        "    t, y = trajectory['time'], trajectory['T'] - 300.0\n"
        "    return ((y[1:] + y[:-1]) / 2 * (t[1:] - t[:-1])).sum()\n"
    )
    hook = Hook("post.py:area", ("T",), str(tmp_path))
    course = Course(stop_time=1.0, step=0.001)
    simulator = FMUSimulator(fmus[2], hook, course=course, operation=HERE)
    assert simulator.run_one({}, {}) == pytest.approx(100.0 * (1.0 - np.exp(-1.0)), rel=1e-6)


def test_extremes_and_expressions(fmus: dict[int, Path]) -> None:
    for outcome, expected in (
        (Extreme("T"), 400.0),
        (Extreme("T", largest=False), cooled_until(1.0)),
        (Extreme("-der(T)"), 100.0),
        (Final("(T - ambient) / 100 * 2**1"), 2.0 * np.exp(-2.0)),
        (Final("below"), 1.0),
    ):
        simulator = FMUSimulator(fmus[2], outcome, operation=HERE)
        assert simulator.run_one({}, {}) == pytest.approx(expected)


def run_elsewhere(job: tuple[FMUSimulator, float]) -> float:
    simulator, k = job
    try:
        return simulator.run_one({}, {"k": k})
    finally:
        simulator.close()


def test_a_worker_with_another_file_says_so(fmus: dict[int, Path], tmp_path: Path) -> None:
    file = tmp_path / "copy.fmu"
    file.write_bytes(fmus[2].read_bytes())
    sent = pickle.dumps(FMUSimulator(file, Final("T"), variables=K))
    file.write_bytes(fmus[2].read_bytes() + b" ")
    with pytest.raises(SimulatorError, match=r"copy\.fmu is not the same for this worker"):
        pickle.loads(sent)


def test_a_simulator_in_use_travels_to_worker_processes(fmus: dict[int, Path]) -> None:
    simulator = FMUSimulator(fmus[2], Final("T"), variables=K)
    expected = simulator.run_one({}, {"k": 2.0})
    copy = pickle.loads(pickle.dumps(simulator))
    assert copy.fingerprint() == simulator.fingerprint()
    # Forked: the child process that the simulator has open here must not be used there.
    with ProcessPoolExecutor(1, mp_context=get_context("fork")) as pool:
        assert list(pool.map(run_elsewhere, [(copy, 2.0), (simulator, 1.0)])) == [
            expected,
            pytest.approx(cooled_until(1.0)),
        ]
    assert simulator.run_one({}, {"k": 2.0}) == expected


def test_the_runner_runs_an_fmu(spring: Path) -> None:
    table = Conditions(("a", "b"), pd.DataFrame({"force": [1.0, 3.0], "bench": ["x", "y"]}))
    simulator = FMUSimulator(spring, Final("travel"), course=Course(stop_time=1.0, step=0.5))
    run = Runner(simulator, table, ["stiffness"])
    assert run([0, 1, 1], [[4.0], [4.0], [8.0]]).tolist() == [0.25, 0.75, 0.375]
    with pytest.raises(SimulatorError, match=r"experiment 'b' with stiffness=2000") as raised:
        run([0, 1], [[5.0], [2000.0]])
    assert "the spring broke at 2000 N/mm" in str(raised.value)
    assert run.completed.outcome[:, 0].tolist() == [0.25, 0.75, 0.375, 0.2]


def test_the_fingerprint_sees_whatever_changes_the_outcome(
    fmus: dict[int, Path], tmp_path: Path
) -> None:
    (tmp_path / "post.py").write_text("def last(t):\n    return t['T'][-1]\n")
    first = Hook("post.py:last", ("T",), str(tmp_path))
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "post.py").write_text("def last(t):\n    return t['T'][-2]\n")
    second = Hook("post.py:last", ("T",), str(tmp_path / "other"))
    made = [
        FMUSimulator(fmus[2], Final("T")),
        FMUSimulator(fmus[3], Final("T")),
        FMUSimulator(fmus[2], Final("T - 1")),
        FMUSimulator(fmus[2], Extreme("T")),
        FMUSimulator(fmus[2], first),
        FMUSimulator(fmus[2], second),
        FMUSimulator(fmus[2], Final("T"), course=Course(step=0.05)),
        FMUSimulator(fmus[2], Final("T"), course=Course(kind="model_exchange")),
        FMUSimulator(fmus[2], Final("T"), variables=K),
        FMUSimulator(fmus[2], Final("T"), constants={"level": 340.0}),
        FMUSimulator(fmus[2], Final("T"), inputs={"ambient": RAMP}),
        FMUSimulator(fmus[2], Final("T"), inputs={"ambient": JUMP}),
        FMUSimulator(fmus[2], Final("T"), version="2"),
    ]
    assert len({simulator.fingerprint() for simulator in made}) == len(made)
    # How it is run changes no outcome.
    same = FMUSimulator(fmus[2], Final("T"), operation=Operation(recycle=5, timeout=9.0))
    assert same.fingerprint() == made[0].fingerprint()


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which temporary folders are made."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def cooled(k: float) -> float:
    return 300.0 + 100.0 * np.exp(-2.0 * k)


FAULTS = [
    (2, "co_simulation", "error", r"fmi2DoStep failed .*\(error\)", "the body cracked (k = 2)"),
    (3, "co_simulation", "error", r"fmi3DoStep failed .*\(error\)", "the body cracked"),
    (2, "model_exchange", "error", r"fmi2GetDerivatives failed", "the body cracked (k = 2)"),
    (3, "model_exchange", "error", r"fmi3GetContinuousStateDerivatives", "the body cracked"),
    (2, "co_simulation", "terminate", r"stopped at time 0.6 s instead of 2 s", ""),
    (3, "co_simulation", "terminate", r"stopped at time 0.7 s instead of 2 s", ""),
    (2, "model_exchange", "terminate", r"stopped at time 0.5\d* s instead of 2 s", ""),
    (2, "co_simulation", "discard", r"does not advance beyond time 0.6 s", ""),
    (2, "co_simulation", "not_a_number", r"the outcome is nan", ""),
    (2, "model_exchange", "not_a_number", r"CVode", ""),
    (2, "co_simulation", "crash", r"process ended with signal SIGABRT", ""),
]


@pytest.mark.parametrize(("version", "kind", "trap", "message", "log"), FAULTS)
def test_a_fault_is_a_failed_run_and_the_next_run_is_sound(
    fmus: dict[int, Path], version: int, kind: str, trap: str, message: str, log: str
) -> None:
    simulator = FMUSimulator(fmus[version], Final("T"), course=Course(kind=kind), variables=K)
    with pytest.raises(RunFailed, match=message) as raised:
        simulator.run_one({"trap": trap}, {"k": 2.0})
    assert log in raised.value.log
    assert simulator.run_one({"trap": "none"}, {"k": 1.0}) == pytest.approx(cooled(1.0))


@pytest.mark.parametrize("isolated", [True, False])
def test_an_instance_that_cannot_be_made_is_no_failed_run(
    fmus: dict[int, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, isolated: bool
) -> None:
    """None at the start is a misuse; none later stops the study, and nothing is stored of it."""
    ways = Operation(reuse="recreate", isolated=isolated)
    for most, error in (("0", SimulatorError), ("1", SurroundingsError)):
        monkeypatch.setenv("COOLING_LICENSES", most)
        simulator = FMUSimulator(fmus[2], Final("T"), variables=K, operation=ways)
        table = Conditions(("A",), pd.DataFrame(index=[0]))
        with Store(tmp_path / f"{most}.sqlite") as store:
            run = Runner(simulator, table, ["k"], store=store)
            with pytest.raises(error, match="cannot be instantiated"):
                run.attempt([0, 0, 0], [[1.0], [2.0], [3.0]])
            assert [kept.failure for kept in stored_runs(store)] == [None] * int(most)


@pytest.mark.parametrize("kind", ["co_simulation", "model_exchange"])
@pytest.mark.parametrize("trap", ["reset_fails", "reset_forgets"])
@pytest.mark.parametrize("version", [2, 3])
def test_a_reset_that_does_not_work_is_given_up(
    fmus: dict[int, Path], version: int, trap: str, kind: str
) -> None:
    def made(reuse: str) -> FMUSimulator:
        return FMUSimulator(
            fmus[version],
            Final("T"),
            course=Course(kind=kind),
            variables=K,
            constants={"trap": trap},
            operation=Operation(reuse=reuse, isolated=False),
        )

    reset, recreated = made("reset"), made("recreate")
    for k in (2.0, 2.0, 1.0, 0.5):
        found = reset.run_one({}, {"k": k})
        assert found == recreated.run_one({}, {"k": k}) == pytest.approx(cooled(k), abs=1e-4)
    assert "every run gets a new instance" in reset.notes[0]
    assert recreated.notes == ()


def test_an_exception_in_a_python_fmu_is_told(spring: Path) -> None:
    simulator = FMUSimulator(spring, Final("travel"), course=Course(stop_time=1.0, step=0.5))
    with pytest.raises(RunFailed, match="fatal") as raised:
        simulator.run_one({}, {"stiffness": 2000.0})
    assert "the spring broke at 2000 N/mm" in raised.value.log
    with pytest.raises(RunFailed, match="stopped at time 0 s instead of 1 s") as raised:
        simulator.run_one({}, {"stiffness": 200.0})
    assert "the spring gives up" in raised.value.log
    assert simulator.run_one({}, {"stiffness": 4.0}) == 0.25
    course, refused = Course(stop_time=1.0, step=0.5), Operation(stop_on="spring (broke|gives up)")
    simulator = FMUSimulator(spring, Final("travel"), course=course, operation=refused)
    with pytest.raises(SurroundingsError, match="the spring gives up"):
        simulator.run_one({}, {"stiffness": 200.0})


def test_a_hang_is_killed_at_its_time_limit(spring: Path, temporary: Path) -> None:
    simulator = FMUSimulator(
        spring,
        Final("travel"),
        course=Course(stop_time=1.0, step=0.5),
        operation=Operation(timeout=1.0),
    )
    assert simulator.run_one({"nap": 0.0}, {"stiffness": 4.0}) == 0.25
    begin = time.monotonic()
    with pytest.raises(RunFailed, match="did not end within 1 s"):
        simulator.run_one({"nap": 600.0}, {"stiffness": 4.0})
    assert time.monotonic() - begin < 60.0  # and not the 1200 s that it wanted to sleep
    assert list(temporary.glob("aleator_fmu_*")) == []
    assert simulator.run_one({"nap": 0.0}, {"stiffness": 8.0}) == 0.125


def test_no_crossing_is_a_failed_run_with_the_range(fmus: dict[int, Path]) -> None:
    for outcome in (
        Crossing("T", 450.0),
        Crossing("T", 350.0, "up"),
        Crossing("T", 350.0, after=1),
    ):
        simulator = FMUSimulator(fmus[2], outcome, operation=Operation(isolated=False))
        with pytest.raises(RunFailed, match=r"does not cross .* between 313.534 and 400"):
            simulator.run_one({}, {})


@pytest.mark.parametrize(
    ("conditions", "message"),
    [
        ({"T0": -3.0}, r"T0 = -3.0 is beyond the minimum 0 of the FMU's 'T0' .* in K"),
        ({"T0": float("nan")}, "not finite"),
        ({"T0": "warm"}, "does not fit"),
        ({"cycles": 1.5}, "not a whole number"),
        ({"insulated": "maybe"}, "neither true nor false"),
        ({"trap": "nothing"}, "whose items are none, error"),
    ],
)
def test_a_cell_that_does_not_fit_its_variable_fails_the_run(
    fmus: dict[int, Path], conditions: dict[str, object], message: str
) -> None:
    simulator = FMUSimulator(fmus[2], Final("T"), variables=K, operation=Operation(isolated=False))
    with pytest.raises(RunFailed, match=message):
        simulator.run_one(conditions, {"k": 1.0})


def test_processes_are_recycled_and_nothing_is_left(fmus: dict[int, Path], temporary: Path) -> None:
    simulator = FMUSimulator(fmus[2], Final("T"), variables=K, operation=Operation(recycle=2))
    folders = set()
    for k in (1.0, 2.0, 3.0, 4.0, 5.0):
        assert simulator.run_one({}, {"k": k}) == pytest.approx(cooled(k))
        (folder,) = temporary.glob("aleator_fmu_*")
        folders.add(folder.name)
    assert len(folders) == 3
    simulator.close()
    simulator.close()
    assert list(temporary.iterdir()) == []
    assert simulator.run_one({}, {"k": 1.0}) == pytest.approx(cooled(1.0))
    del simulator
    assert list(temporary.iterdir()) == []


ENDS = """
import sys, time
from aleator.simulators.fmu import Final, FMUSimulator, Operation
simulator = FMUSimulator(sys.argv[1], Final("T"), operation=Operation(isolated=sys.argv[2] == "1"))
print(simulator.run_one({}, {}), flush=True)
if sys.argv[3] == "wait":
    time.sleep(600.0)
"""


@pytest.mark.parametrize(("isolated", "ending"), [("0", "end"), ("1", "wait")])
def test_nothing_is_left_of_a_program_that_ends_or_is_killed(
    fmus: dict[int, Path], tmp_path: Path, isolated: str, ending: str
) -> None:
    program = subprocess.Popen(
        [sys.executable, "-c", ENDS, str(fmus[2]), isolated, ending],
        env={**os.environ, "TMPDIR": str(tmp_path)},
        stdout=subprocess.PIPE,
    )
    assert program.stdout is not None
    assert float(program.stdout.readline()) == pytest.approx(cooled(1.0))
    if ending == "wait":
        assert len(list(tmp_path.glob("aleator_fmu_*"))) == 1
        program.send_signal(signal.SIGKILL)
    program.wait()
    program.stdout.close()
    assert emptied(tmp_path, "aleator_fmu_*")


BUSY = """
import sys
from aleator.simulators.fmu import Course, Final, FMUSimulator
simulator = FMUSimulator(sys.argv[1], Final("travel"), course=Course(stop_time=1.0, step=0.5))
print(simulator.run_one({}, {"nap": 0.0}), flush=True)
simulator.run_one({}, {"nap": 600.0})
"""


def test_nothing_is_left_of_a_program_that_is_killed_while_the_fmu_hangs(
    spring: Path, tmp_path: Path
) -> None:
    program = subprocess.Popen(
        [sys.executable, "-c", BUSY, str(spring)],
        env={**os.environ, "TMPDIR": str(tmp_path)},
        stdout=subprocess.PIPE,
    )
    assert program.stdout is not None
    assert float(program.stdout.readline()) == 0.5
    time.sleep(0.2)
    program.send_signal(signal.SIGKILL)
    program.wait()
    program.stdout.close()
    assert emptied(tmp_path, "aleator_fmu_*")


def test_a_hook_that_raises_is_a_failed_run(fmus: dict[int, Path], tmp_path: Path) -> None:
    (tmp_path / "post.py").write_text("def none(t):\n    return t['pressure']\n")
    hook = Hook("post.py:none", (), str(tmp_path))
    simulator = FMUSimulator(fmus[2], hook, operation=Operation(isolated=False))
    with pytest.raises(RunFailed, match=r"'post.py:none' raised KeyError: 'pressure'"):
        simulator.run_one({}, {})
    simulator.close()
