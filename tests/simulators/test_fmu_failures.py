"""What FMUs do wrong, each a failed run with a message, and none in the way of the next run."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aleator.errors import SimulatorError, SurroundingsError
from aleator.observations.experiments import Conditions
from aleator.simulators import RunFailed, Runner, Store
from aleator.simulators.fmu import Course, Crossing, Final, FMUSimulator, Hook, Operation
from aleator.simulators.records import stored_runs

K = {"k": "surface.k"}


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which temporary folders are made."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def cooled(k: float) -> float:
    return 300.0 + 100.0 * np.exp(-2.0 * k)


CASES = [
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


@pytest.mark.parametrize(("version", "kind", "trap", "message", "log"), CASES)
def test_a_fault_is_a_failed_run_and_the_next_run_is_sound(
    fmus: dict[int, Path], version: int, kind: str, trap: str, message: str, log: str
) -> None:
    simulator = FMUSimulator(fmus[version], Final("T"), course=Course(kind=kind), variables=K)
    for _ in range(2):
        with pytest.raises(RunFailed, match=message) as raised:
            simulator.run_one({"trap": trap}, {"k": 2.0})
        assert log in raised.value.log
        assert simulator.run_one({"trap": "none"}, {"k": 1.0}) == pytest.approx(cooled(1.0))
    simulator.close()


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
        simulator.close()


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
    reset.close()
    recreated.close()


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
    simulator.close()


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
    simulator.close()


def test_no_crossing_is_a_failed_run_with_the_range(fmus: dict[int, Path]) -> None:
    for outcome in (
        Crossing("T", 450.0),
        Crossing("T", 350.0, "up"),
        Crossing("T", 350.0, after=1),
    ):
        simulator = FMUSimulator(fmus[2], outcome, operation=Operation(isolated=False))
        with pytest.raises(RunFailed, match=r"does not cross .* between 313.534 and 400"):
            simulator.run_one({}, {})
        simulator.close()


def test_a_hook_that_raises_is_a_failed_run(fmus: dict[int, Path], tmp_path: Path) -> None:
    (tmp_path / "post.py").write_text("def none(t):\n    return t['pressure']\n")
    hook = Hook("post.py:none", (), str(tmp_path))
    simulator = FMUSimulator(fmus[2], hook, operation=Operation(isolated=False))
    with pytest.raises(RunFailed, match=r"'post.py:none' raised KeyError: 'pressure'"):
        simulator.run_one({}, {})
    simulator.close()


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


PROGRAM = """
import sys, time
from aleator.simulators.fmu import Final, FMUSimulator, Operation
simulator = FMUSimulator(sys.argv[1], Final("T"), operation=Operation(isolated=sys.argv[2] == "1"))
print(simulator.run_one({}, {}), flush=True)
if sys.argv[3] == "wait":
    time.sleep(600.0)
"""


def assert_nothing_is_left(folder: Path) -> None:
    deadline = time.monotonic() + 30.0
    while list(folder.glob("aleator_fmu_*")) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert list(folder.glob("aleator_fmu_*")) == []


@pytest.mark.parametrize(("isolated", "ending"), [("0", "end"), ("1", "wait")])
def test_nothing_is_left_of_a_program_that_ends_or_is_killed(
    fmus: dict[int, Path], tmp_path: Path, isolated: str, ending: str
) -> None:
    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(fmus[2]), isolated, ending],
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
    assert_nothing_is_left(tmp_path)


BUSY = """
import sys
from aleator.simulators.fmu import Course, Final, FMUSimulator
simulator = FMUSimulator(sys.argv[1], Final("travel"), course=Course(stop_time=1.0, step=0.5))
print(simulator.run_one({}, {"nap": 0.0}), flush=True)
simulator.run_one({}, {"nap": float(sys.argv[2])})
"""


@pytest.mark.parametrize("nap", ["0.5", "600"])  # it ends by itself, or hangs
def test_nothing_is_left_of_a_program_that_is_killed_while_the_fmu_runs(
    spring: Path, tmp_path: Path, nap: str
) -> None:
    program = subprocess.Popen(
        [sys.executable, "-c", BUSY, str(spring), nap],
        env={**os.environ, "TMPDIR": str(tmp_path)},
        stdout=subprocess.PIPE,
    )
    assert program.stdout is not None
    assert float(program.stdout.readline()) == 0.5
    time.sleep(0.2)
    program.send_signal(signal.SIGKILL)
    program.wait()
    program.stdout.close()
    assert_nothing_is_left(tmp_path)
