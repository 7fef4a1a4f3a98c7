"""A column that is the outcome once more is no condition; a condition is no copy."""

import numpy as np
import pandas as pd
import pytest

from aleator import (
    Censoring,
    Experiments,
    Free,
    Identification,
    Inputs,
    MonteCarlo,
    Noise,
    Normal,
    identify,
)
from aleator.inference.consistency.columns import columns_of
from aleator.inference.consistency.copies import copies_of
from aleator.types import Array

RNG = np.random.default_rng(8)


def copies(table: Experiments, *asked: str) -> list[str]:
    return [c.name for c in copies_of(columns_of(table), table.observations, asked)]


def loaded(count: int = 40) -> pd.DataFrame:
    load = np.tile([1.0, 2.0], count // 2)
    return pd.DataFrame({"load": load, "y": 10.0 * load * (1.0 + 0.1 * RNG.standard_normal(count))})


@pytest.mark.parametrize(
    "copied",
    [
        lambda y: y / 25.4,
        lambda y: -np.exp(0.1 * y),
        lambda y: np.round(y, 1),
        lambda y: y.rank(),
    ],
)
def test_another_unit_a_rounded_value_and_a_rank_are_copies(copied) -> None:  # type: ignore[no-untyped-def]
    frame = loaded().assign(other=lambda t: copied(t["y"]))
    assert copies(Experiments.from_frame(frame, outcome="y")) == ["other"]


def test_a_condition_is_no_copy_though_the_outcome_follows_it_closely() -> None:
    close = loaded().assign(hot=lambda t: t["y"] + 0.1 * RNG.standard_normal(len(t)))
    assert np.corrcoef(close["hot"], close["y"])[0, 1] > 0.99
    assert copies(Experiments.from_frame(close, outcome="y")) == []
    # few levels that no outcomes overlap, and a condition that the simulator takes
    apart = pd.DataFrame({"load": np.repeat([1.0, 2.0, 3.0], 20), "force": np.arange(60.0)})
    apart["y"] = apart["load"] + 0.001 * apart["force"]
    assert copies(Experiments.from_frame(apart, outcome="y"), "force") == []


def test_what_is_known_of_bounds_is_not_compared() -> None:
    frame = loaded().sort_values("y").assign(number=np.arange(40.0))
    frame["y"] = np.where(np.arange(40) % 4 == 0, 0.5 * frame["y"], frame["y"])
    frame["status"] = np.where(np.arange(40) % 4 == 0, "above", "seen")
    told = Censoring("status", right="above", measured="seen")
    table = Experiments.from_frame(frame, outcome="y", censored=told)
    assert copies(table) == ["number"]


def spring(force: Array, softness: Array) -> Array:
    return force * softness


def identified(frame: pd.DataFrame) -> Identification:
    return identify(
        spring, frame, Inputs({"softness": Normal(Free(0.0, 1.0), Free(0.01, 0.5))}),
        outcome="travel", noise=Noise(0.2), vectorized=True, verification=MonteCarlo(0),
        best_law=False,
    )  # fmt: skip


def test_a_copy_is_left_out_and_told_and_a_dependence_beside_it_is_found() -> None:
    force, hot = np.tile([10.0, 20.0, 30.0], 16), np.repeat([20.0, 60.0], 24)
    softness = 0.5 + 0.04 * RNG.standard_normal(48)
    frame = pd.DataFrame({"force": force, "hot": hot, "travel": force * softness})
    frame["inches"] = frame["travel"] / 25.4
    right = identified(frame)
    assert (right.consistent, right.consistency.copies) == (True, ("inches",))
    assert "`inches` left out" in str(right)
    assert "inches" not in {test.column for test in right.consistency.tests}
    wrong = frame.assign(travel=frame["travel"] + 0.06 * force * (hot > 40.0))
    found = identified(wrong.assign(inches=wrong["travel"] / 25.4))
    assert not found.consistent
    assert found.consistency.discrepancies[0].test.column == "hot"


def test_forces_that_the_simulator_takes_are_conditions_whatever_their_order() -> None:
    force = np.linspace(10.0, 50.0, 12)
    frame = pd.DataFrame({"force": force, "travel": force * (0.5 + 0.01 * np.sin(force))})
    assert np.all(np.diff(frame["travel"]) > 0.0)
    found = identified(frame)
    assert found.consistency.copies == ()
    assert "force" in {test.column for test in found.consistency.tests}
