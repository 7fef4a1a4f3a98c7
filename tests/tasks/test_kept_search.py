"""A study that was killed after a search does not search again, and ends with the same digits."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from aleator import Budget, Free, Identification, Inputs, Noise, Normal, Store, identify
from aleator.core.progress import Silent
from aleator.observations.experiments import Experiments
from aleator.search import GradientMultistart, SearchResult
from aleator.simulators import Runner
from aleator.simulators.function import FunctionSimulator
from aleator.simulators.records import forget, runs_by_simulator
from aleator.simulators.store import keep, kept

LAW = Inputs({"a": Normal(Free(0.0, 2.0), Free(0.01, 1.0))})
SOME_NOISE = Noise(Free(0.01, 1.0))


def bent(c, a):
    return np.exp(0.4 * a) * c + a


def table(seed: int = 1) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    c = rng.uniform(1.0, 2.0, 12)
    return pd.DataFrame({"c": c, "y": bent(c, rng.normal(1.0, 0.2, 12))})


MADE: list[int] = []
"""The seeds of the searches that were made, but for those of baselines."""


@dataclass(frozen=True)
class Counted:
    """A search that is noted."""

    own: GradientMultistart = field(default_factory=lambda: GradientMultistart(4))
    name: str = "counted"

    def maximize(self, *args: Any, seed: int, **choices: Any) -> SearchResult:
        if "progress" in choices:  # baselines have none
            MADE.append(seed)
        return self.own.maximize(*args, seed=seed, **choices)


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    MADE.clear()
    with Store(tmp_path / "runs.sqlite") as one:
        yield one


def answer(store: Store | None, noise: Noise | None, **choices: Any) -> Identification:
    experiments = Experiments.from_frame(choices.pop("rows", table()), outcome="y")
    runner = Runner(FunctionSimulator(bent, vectorized=True), experiments, LAW.names, store=store)
    # with a budget a fast simulator gets surfaces too
    given = {"search": Counted(), "consistency": False, "best_law": False}
    chosen = {**given, "budget": Budget(runs=10**9), **choices}
    return identify(runner, experiments, LAW, noise=noise, **chosen)


@pytest.mark.parametrize("noise", [None, SOME_NOISE])
def test_no_search_is_made_twice_and_every_digit_is_the_same(
    store: Store, noise: Noise | None
) -> None:
    first = answer(store, noise)
    searches = len(MADE)
    assert searches > 0
    again = answer(store, noise)
    assert len(MADE) == searches
    alone = answer(None, noise)
    assert len(MADE) == 2 * searches
    for other in (again, alone):
        assert other.alpha == first.alpha
        assert other.log_likelihood == first.log_likelihood


class Killed(Silent):
    """A study that is killed when the check begins."""

    def stage(self, name: str) -> None:
        if name == "verification":
            raise KeyboardInterrupt


def test_a_study_that_is_killed_after_its_searches_does_not_search_again(store: Store) -> None:
    with pytest.raises(KeyboardInterrupt):
        answer(store, None, progress=Killed())
    searches = len(MADE)
    answer(store, None)
    assert len(MADE) == searches > 0


@pytest.mark.parametrize(
    "choices",
    [{"rows": table(2)}, {"seed": 1}, {"search": Counted(GradientMultistart(5))}],
    ids=["outcomes", "seed", "search"],
)
def test_another_question_is_searched_for(store: Store, choices: dict[str, Any]) -> None:
    answer(store, None)
    searches = len(MADE)
    answer(store, None, **choices)
    assert len(MADE) > searches


def test_a_damaged_result_is_no_result(store: Store) -> None:
    keep(store, "f", "one", "[1.0]")
    assert kept(store, "f", "one") == "[1.0]"
    assert kept(store, "f", "other") is None
    assert kept(store, "g", "one") is None
    store.connection.execute("UPDATE searches SET text = '[2.0]'")
    assert kept(store, "f", "one") is None


def test_searches_are_forgotten_with_their_simulator(store: Store) -> None:
    answer(store, None)
    forget(store, [one.simulator.fingerprint for one in runs_by_simulator(store)])
    assert store.connection.execute("SELECT count(*) FROM searches").fetchone() == (0,)


def test_a_store_from_before_there_were_any_keeps_them_from_now_on(tmp_path: Path) -> None:
    path = tmp_path / "old.sqlite"
    Store(path).close()
    with sqlite3.connect(path) as old:
        old.execute("DROP TABLE searches")
    with Store(path) as store:
        keep(store, "f", "one", "[1.0]")
        assert kept(store, "f", "one") == "[1.0]"
