"""A column that is the outcome once more is no condition; a condition is no copy."""

import numpy as np
import pandas as pd
import pytest

from aleator import (
    Censoring,
    Check,
    Experiments,
    Free,
    Identification,
    Inputs,
    Noise,
    Normal,
    identify,
)
from aleator.core.types import Array
from aleator.inference.table_columns import columns_of, copies_of

RNG = np.random.default_rng(8)


def copies(table: Experiments, *asked: str) -> list[str]:
    """Of a model that knows the mean under each of the asked conditions."""
    seen = table.observations
    frame = table.table.iloc[seen.row].assign(w=seen.lower)
    known = frame.groupby([*asked])["w"] if asked else None
    w = (
        frame["w"]
        if known is None
        else (frame["w"] - known.transform("mean")) / known.transform("std")
    )
    found = copies_of(columns_of(table), table, asked, w.to_numpy())
    return [c.name for c in found]


def loaded(count: int = 40) -> pd.DataFrame:
    load = np.tile([1.0, 2.0], count // 2)
    return pd.DataFrame({"load": load, "y": 10.0 * load * (1.0 + 0.1 * RNG.standard_normal(count))})


@pytest.mark.parametrize(
    "copied",
    [lambda y: y / 25.4, lambda y: -np.exp(0.1 * y), lambda y: np.round(y, 1), lambda y: y.rank()],
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
    apart["y"] = apart["load"] + 0.001 * apart["force"] + 0.05 * RNG.standard_normal(60)
    table = Experiments.from_frame(apart, outcome="y")
    assert copies_of(columns_of(table), table, ("force",), apart["y"].to_numpy()) == ()


@pytest.mark.parametrize(
    "made",
    [
        lambda t: t["y"] > 18.0,
        lambda t: np.where(t["y"] > 18.0, "pass", "fail"),
        lambda t: pd.cut(t["y"], [-99.0, 11.0, 16.0, 21.0, 99.0], labels=[1, 2, 3, 4]).astype(int),
        lambda t: t["y"] / t["load"],
        lambda t: np.round(t["load"] / t["y"], 5),
        lambda t: t["y"] - 3.0 * t["load"],
    ],
)
def test_classes_ratios_and_differences_of_the_outcome_are_left_out(made) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(5)
    for load in (np.tile([1.0, 2.0], 30), rng.uniform(1.0, 2.0, 60)):
        frame = pd.DataFrame({"load": load, "rig": rng.permutation(60) % 3})
        frame["batch"] = rng.permutation(60) // 12
        frame["y"] = 10.0 * load * (1.0 + 0.2 * rng.standard_normal(60))
        frame["made"] = made(frame)
        table = Experiments.from_frame(frame, outcome="y")
        found = copies_of(columns_of(table), table, ("load",), frame["y"] / load)
        assert [c.name for c in found] == ["made"]


def test_a_rank_under_each_load_and_a_condition_of_the_load_alone() -> None:
    frame = loaded().assign(rank=lambda t: t["y"].groupby(t["load"]).rank())
    frame["heavy"] = np.where(frame["load"] > 1.5, "heavy", "light")
    frame["y"] = np.where(frame["load"] > 1.5, 50.0, 0.0) + frame["y"]
    table = Experiments.from_frame(frame, outcome="y")
    found = copies_of(columns_of(table), table, ("load",), RNG.standard_normal(40))
    assert [c.name for c in found] == ["rank"]


def test_the_largest_and_the_mean_of_a_series_are_left_out() -> None:
    rng = np.random.default_rng(6)
    frame = pd.DataFrame({"id": np.repeat(np.arange(30), 4), "t": np.tile(np.arange(4.0), 30)})
    frame["hot"] = np.repeat(rng.standard_normal(30), 4)
    frame["y"] = np.repeat(rng.standard_normal(30), 4) * frame["t"] + rng.standard_normal(120)
    whole = frame.groupby("id")["y"]
    frame["peak"], frame["average"] = whole.transform("max"), whole.transform("mean")
    table = Experiments.from_frame(frame, outcome="y", id="id")
    found = copies_of(columns_of(table), table, ("t",), rng.standard_normal(120))
    assert [c.name for c in found] == ["peak", "average"]


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
        outcome="travel", noise=Noise(0.2), vectorized=True, verification=Check(0),
        best_law=False,
    )  # fmt: skip


def test_a_copy_is_left_out_and_told_and_a_dependence_beside_it_is_found() -> None:
    force, hot = np.tile([10.0, 20.0, 30.0], 16), np.repeat([20.0, 60.0], 24)
    softness = 0.5 + 0.04 * RNG.standard_normal(48)
    frame = pd.DataFrame({"force": force, "hot": hot, "travel": force * softness})
    frame["inches"] = frame["travel"] / 25.4
    right = identified(frame)
    assert (right.consistent, right.consistency.copies) == (True, ("inches",))
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
