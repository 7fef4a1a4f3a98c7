"""Each finding names its cause: heavy tails, a scale, a column, or a group, and not another."""

import numpy as np
import pandas as pd
import pytest

from aleator import Censoring, Check, Experiments, Free, Inputs, Normal, identify
from aleator.inference.table_columns import columns_of, copies_of
from aleator.results.values import Consistency
from benchmarks.findings import CASES, judge


@pytest.mark.parametrize(
    "name",
    [
        "a mean known wrongly", "noise known wrongly", "a lognormal law", "another curve",
        "an sd of its own on one bench", "noise that grows", "errors that depend on each other",
    ],
)  # fmt: skip
def test_a_wrong_model_is_found_and_the_cause_is_named_first(name: str) -> None:
    entries = [judge(name, seed) for seed in range(7000, 7005)]
    told = [e["wrong"]["told"][0] for e in entries if e["wrong"]["consistent"] is False]
    assert len(told) >= 4
    assert sum((kind, column) in CASES[name].named for kind, _, column, _ in told) >= 3
    assert sum(e["mended"]["consistent"] is False for e in entries) <= 2


def test_noise_three_times_as_large_in_a_third_of_the_experiments_is_found() -> None:
    entries = [judge("loud by hot, plain, 1, 0.3", seed) for seed in range(7000, 7010)]
    assert sum(e["wrong"]["consistent"] is False for e in entries) >= 8


def test_heavy_tails_under_free_means_are_not_called_likeness_of_groups() -> None:
    name = "Student's noise, free means"
    for seed in range(7000, 7003):
        rng = np.random.default_rng([seed, *name.encode()])
        found = CASES[name].wrong(CASES[name].draw(rng), seed)
        alike = [t for t in found.tests if (t.kind, t.column) == ("groups", "load")]
        assert all(t.corrected > 0.05 for t in alike)


def test_a_second_column_of_the_censoring_is_no_condition() -> None:
    rng = np.random.default_rng(3)
    y = rng.standard_normal(40)
    frame = pd.DataFrame({"y": np.minimum(y, 0.5), "seen": y <= 0.5, "rig": np.arange(40) % 2})
    frame["status"] = np.where(y > 0.5, "above", "ok")
    frame["cut"] = np.where(y > 0.5, 1, 0)
    table = Experiments.from_frame(
        frame.drop(columns="seen"), outcome="y",
        censored=Censoring("status", right="above", measured="ok"),
    )  # fmt: skip
    left = {c.name for c in copies_of(columns_of(table), table, (), table.observations.lower)}
    assert left == {"cut"}


def batches(between: float, seed: int, level: str | None) -> Consistency:
    """The second verdict of 40 experiments of 8 batches, with or without a shift of each batch."""
    rng = np.random.default_rng(seed)
    batch = np.repeat(np.arange(8), 5)
    mean = rng.normal(0.0, between, 8)[batch] + rng.normal(1.0, 0.2, 40)
    t = np.tile(np.arange(4.0), 40)
    rows = pd.DataFrame({"unit": np.repeat(np.arange(40), 4), "t": t})
    rows["batch"] = [f"batch {k}" for k in np.repeat(batch, 4)]
    rows["y"] = np.repeat(mean, 4) + 0.5 * t + rng.normal(0.0, 0.1, 160)
    laws = {"a": Normal(Free(-2.0, 4.0), Free(0.01, 2.0))}
    shift = {"shift": Normal(0.0, Free(0.0, 2.0))} if level else {}
    found = identify(
        lambda t, a, shift=0.0: a + shift + 0.5 * t, rows,
        Inputs({**laws, **shift}, levels={"shift": level} if level else None), outcome="y",
        id="unit", noise=Free(0.01, 1.0), vectorized=True, best_law=False, verification=Check(0),
    )  # fmt: skip
    assert found.consistency is not None
    return found.consistency


def test_experiments_of_a_batch_that_are_alike_are_found_until_the_batch_is_a_level() -> None:
    wrong = batches(0.2, 2, None)
    assert wrong.consistent is False
    first = wrong.discrepancies[0].test
    assert (first.kind, first.of, first.column) == ("alike", "a", "batch")
    assert batches(0.2, 2, "batch").consistent
    assert batches(0.0, 2, None).consistent
