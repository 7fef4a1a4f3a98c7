"""Whether a simulator counts as fast does not depend on what else the machine does."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from aleator import Free, Inputs, Normal
from aleator.observations.experiments import Experiments
from aleator.simulators import Runner
from aleator.simulators.function import FunctionSimulator
from aleator.tasks.individual import cost

Array = NDArray[np.float64]
LAW = Inputs({"a": Normal(Free(0.0, 2.0), Free(0.01, 0.6))})
TABLE = Experiments.from_frame(pd.DataFrame({"c": [1.0, 2.0], "y": [1.0, 2.0]}), outcome="y")


def is_cheap(monkeypatch: pytest.MonkeyPatch, processor: float, clock: float) -> bool:
    """Of a simulator whose call takes so many seconds of the processor, and by the clock."""
    spent = SimpleNamespace(processor=0.0, clock=0.0)

    def product(c: Array, a: Array) -> Array:
        spent.processor += processor
        spent.clock += clock
        return c * a

    times = SimpleNamespace(perf_counter=lambda: spent.clock, thread_time=lambda: spent.processor)
    monkeypatch.setattr(cost, "time", times)
    runner = Runner(FunctionSimulator(product, vectorized=True), TABLE, LAW.names)
    return cost.cheap(runner, LAW, np.array([1.0]), LAW.box)


def test_a_fast_one_is_fast_on_a_machine_that_is_busy(monkeypatch: pytest.MonkeyPatch) -> None:
    assert is_cheap(monkeypatch, processor=0.001, clock=0.001)
    assert is_cheap(monkeypatch, processor=0.001, clock=0.004)


def test_a_slow_one_is_slow(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not is_cheap(monkeypatch, processor=0.004, clock=0.004)


def test_one_that_waits_for_another_program_is_as_slow_as_that(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert not is_cheap(monkeypatch, processor=0.0001, clock=0.004)


def test_processors_that_work_side_by_side_are_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    assert is_cheap(monkeypatch, processor=0.004, clock=0.001)
