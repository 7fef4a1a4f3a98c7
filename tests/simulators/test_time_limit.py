"""A function that hangs costs its time limit, and one failed run."""

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
import pytest

from aleator.errors import SimulatorError
from aleator.observations.experiments import Conditions
from aleator.simulators import FunctionSimulator, ProcessPool, Runner
from aleator.simulators.derived import derived

TABLE = Conditions(("A",), pd.DataFrame({"load": [2.0]}))
X = np.array([[1.0], [2.0], [3.0], [4.0]])


def hangs_at_three(load: float, x: float) -> float:
    while x == 3.0:
        pass
    return load * x


def deaf_at_three(load: float, x: float) -> float:
    """What swallows the first word of its end, as a loop that tries again does."""
    while x == 3.0:
        try:
            time.sleep(10.0)
        except Exception:
            time.sleep(10.0)
    return load * x


def compiled_at_three(load: float, x: float) -> float:
    """Compiled code that holds the interpreter."""
    if x == 3.0:
        return float(sum(range(10**12)))  # hours, and no signal is heard
    return load * x


@pytest.mark.parametrize("function", [hangs_at_three, deaf_at_three])
@pytest.mark.parametrize("vectorized", [False, True])
def test_a_hanging_run_fails_and_the_others_do_not(function, vectorized: bool) -> None:  # type: ignore[no-untyped-def]
    def called(load: np.ndarray, x: np.ndarray) -> np.ndarray:
        return np.array([function(*one) for one in zip(load, x, strict=True)])

    simulator = FunctionSimulator(called if vectorized else function, vectorized, timeout=0.1)
    run = Runner(simulator, TABLE, ["x"], max_failed=1.0)
    np.testing.assert_array_equal(run.attempt([0] * 4, X), [2.0, 4.0, np.nan, 8.0])
    (failure,) = run.failures.failures.values()
    assert failure.message == "it was stopped after its 0.1 s"


def test_so_it_does_with_derived_parameters() -> None:
    simulator = derived(FunctionSimulator(hangs_at_three, timeout=0.1), {"x": "2.0 * z"})
    run = Runner(simulator, TABLE, ["z"], max_failed=1.0)
    np.testing.assert_array_equal(run.attempt([0] * 2, [[1.0], [1.5]]), [4.0, np.nan])


@pytest.mark.slow
def test_compiled_code_that_hangs_ends_its_worker_alone() -> None:
    began = time.perf_counter()
    with ProcessPool(2) as pool:
        simulator = FunctionSimulator(compiled_at_three, timeout=0.2)
        run = Runner(simulator, TABLE, ["x"], executor=pool, max_failed=1.0)
        np.testing.assert_array_equal(run.attempt([0] * 4, X), [2.0, 4.0, np.nan, 8.0])
    (failure,) = run.failures.failures.values()
    assert "died" in failure.message
    assert time.perf_counter() - began < 50.0


def test_a_time_that_is_none_is_refused_and_another_thread_has_no_limit() -> None:
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(SimulatorError, match="no time"):
            FunctionSimulator(hangs_at_three, timeout=wrong)
    simulator = FunctionSimulator(hangs_at_three, timeout=1e-9)
    with ThreadPoolExecutor(1) as thread:
        run = Runner(simulator, TABLE, ["x"], executor=thread)
        assert run([0], [[1.0]]).tolist() == [2.0]


def test_the_limit_is_no_part_of_what_the_function_is() -> None:
    plain, timed = (FunctionSimulator(hangs_at_three, timeout=t) for t in (None, 5.0))
    assert plain.fingerprint() == timed.fingerprint()
