"""Stored runs with which Gaussian processes begin: another law, an interruption, workers."""

import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aleator import (
    Beta,
    Experiments,
    Free,
    Identification,
    Inputs,
    Noise,
    Normal,
    ResponseSurface,
    StudentError,
    TruncatedNormal,
    identify,
)
from aleator.fit.earlier_runs import fingerprint
from aleator.fit.question import Choices
from aleator.simulators import FunctionSimulator, Runner, Store

RNG = np.random.default_rng(5)
COUNT, SD, BOX = 32, 0.05, (1.0, 3.0)
LOAD = RNG.uniform(1.0, 4.0, COUNT)
TRAVEL = LOAD / np.clip(RNG.normal(1.8, 0.25, COUNT), *BOX) + SD * RNG.standard_normal(COUNT)
TABLE = Experiments.from_frame(pd.DataFrame({"load": LOAD, "y": TRAVEL}), outcome="y")
NORMAL = Inputs({"k": TruncatedNormal(BOX)})
BETA = Inputs({"k": Beta(BOX, Free(1.3, 2.7), Free(0.02, 0.4))})
NARROW = Inputs({"k": TruncatedNormal(BOX, Free(1.4, 2.6), Free(0.02, 0.4))})


def travel(load: float, k: float) -> float:
    return load / k


def answer(
    inputs: Inputs,
    store: Store | None,
    simulator: Callable[[float, float], float] = travel,
    executor: ThreadPoolExecutor | None = None,
    together: int | None = None,
) -> tuple[Identification, Runner]:
    runner = Runner(named(simulator), TABLE, inputs.names, store=store, executor=executor)
    found = identify(
        runner, TABLE, inputs, noise=Noise(SD), consistency=False, best_law=False,
        propagation=ResponseSurface(together=together),
    )  # fmt: skip
    return found, runner


def named(function: Callable[[float, float], float]) -> FunctionSimulator:
    """A function as a simulator with one fingerprint, whatever it does beside."""
    simulator = FunctionSimulator(function, vectorized=False, version="1")
    simulator.name = "travel"
    return simulator


def stopping(calls: int) -> Callable[[float, float], float]:
    left = iter(range(calls))

    def run(load: float, k: float) -> float:
        if next(left, None) is None:
            raise KeyboardInterrupt
        return travel(load, k)

    return run


def same(one: Identification, other: Identification) -> bool:
    parts = [found.to_dict() for found in (one, other)]
    for part in parts:
        del part["seconds"]
    return bool(parts[0] == parts[1])


@pytest.fixture(scope="module")
def alone() -> Identification:
    """The answer of the study with normal laws, without a store and by one process."""
    return answer(NORMAL, None)[0]


@pytest.fixture(scope="module")
def after_one_law(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with the runs of the study with normal laws."""
    path = tmp_path_factory.mktemp("earlier") / "runs.sqlite"
    with Store(path) as store:
        answer(NORMAL, store)
    return path


def test_a_second_law_begins_with_all_stored_runs_and_makes_few(after_one_law: Path) -> None:
    with Store(after_one_law) as store:
        known = store.counts(Runner(named(travel), TABLE, ("k",), store=store).cache.identity).runs
        found, runner = answer(BETA, store)
        again, repeated = answer(BETA, store)
    assert 0.9 * known < found.surface["stored"] <= known
    assert runner.fresh < 0.1 * found.runs
    assert repeated.fresh == 0
    assert same(found, again)
    alone, _ = answer(BETA, None)
    assert alone.surface["stored"] == 0
    off = np.abs(found.values - alone.values) / alone.errors
    assert off.max() < 2.0 * max(0.05, found.emulator_error + alone.emulator_error)


def test_an_interrupted_study_makes_the_same_decisions_when_it_goes_on(
    after_one_law: Path, tmp_path: Path
) -> None:
    shutil.copy(after_one_law, tmp_path / "whole.sqlite")
    with Store(tmp_path / "whole.sqlite") as store:
        whole, _ = answer(NARROW, store)
    for calls, others in ((2, False), (8, True)):
        parts = tmp_path / f"parts{calls}.sqlite"
        shutil.copy(after_one_law, parts)
        with Store(parts) as store:
            with pytest.raises(KeyboardInterrupt):
                answer(NARROW, store, stopping(calls))
            if others:
                answer(NORMAL, store)  # what other studies add changes nothing
            found, _ = answer(NARROW, store)
        assert same(found, whole)


def asked(
    inputs: Inputs = NORMAL, noise: Noise | None = None, table: Experiments = TABLE, seed: int = 0
) -> str:
    runner = Runner(named(travel), table, inputs.names)
    choices = Choices.of(table, inputs, noise or Noise(SD))
    return fingerprint(choices.question(runner, table.observations, seed), 0)


def test_a_question_is_another_if_anything_is_that_decides_where_runs_are_made() -> None:
    frame = pd.DataFrame({"load": LOAD, "y": TRAVEL})
    moved, longer = frame.copy(), frame.copy()
    moved.loc[3, "load"] += 1e-9
    longer.loc[3, "y"] += 1e-9
    others = [
        asked(BETA),
        asked(Inputs({"k": TruncatedNormal((1.0, 3.1))})),
        asked(Inputs({"k": TruncatedNormal(BOX, sd=Free(0.01, 0.5))})),
        asked(Inputs({"k": TruncatedNormal(BOX, mean=Free(1.0, 3.0, prior=Normal(2.0, 0.5)))})),
        asked(noise=Noise(2.0 * SD)),
        asked(noise=Noise(SD, StudentError(4.0))),
        asked(table=Experiments.from_frame(moved, outcome="y")),
        asked(table=Experiments.from_frame(longer, outcome="y")),
        asked(seed=1),
    ]
    again = asked(Inputs({"k": TruncatedNormal(BOX)}), Noise(SD))
    assert asked() == again
    assert len({again, *others}) == 1 + len(others)


def test_a_study_without_earlier_runs_is_the_same_with_a_store_and_without(
    alone: Identification, tmp_path: Path
) -> None:
    with Store(tmp_path / "runs.sqlite") as store:
        first, _ = answer(NORMAL, store)
    assert same(first, alone)


def test_failed_runs_are_no_beginning(tmp_path: Path) -> None:
    def breaks(load: float, k: float) -> float:
        return load / k if k > 1.2 else np.nan

    with Store(tmp_path / "runs.sqlite") as store:
        answer(NORMAL, store, breaks)
        found, runner = answer(NARROW, store, breaks)
    worked = len(runner.completed)
    assert found.surface["stored"] <= worked


@pytest.mark.parametrize("workers", [3, 12])
def test_rounds_are_enlarged_for_many_workers_only(alone: Identification, workers: int) -> None:
    with ThreadPoolExecutor(workers) as executor:
        found, _ = answer(NORMAL, None, executor=executor)
    assert same(found, answer(NORMAL, None, together=2 * workers)[0])
    runs = [one["runs"] for one in found.surface["rounds"]]
    usual = COUNT // 2
    assert found.surface["together"] == (2 * workers if 2 * workers > usual else 0)
    assert min(np.diff(runs)) == max(2 * workers, usual)
    assert same(found, alone) == (2 * workers <= usual)
