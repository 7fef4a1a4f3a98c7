import numpy as np
import pandas as pd

from aleator import Experiments
from aleator.inference.consistency.battery import contrasts_of, shared
from aleator.inference.consistency.columns import ORDER, columns_of

RNG = np.random.default_rng(1)


def simple(**columns: object) -> Experiments:
    return Experiments.from_frame(pd.DataFrame(columns), outcome="y", conditions=["load"])


def test_every_column_is_looked_at_and_constants_are_not() -> None:
    table = simple(
        load=[1.0, 2.0, 1.0, 2.0], speed=[3.0] * 4, supplier=["a", "a", "b", "b"],
        hot=[1.0, 2.0, 4.0, 3.0], y=[0.0] * 4,
    )  # fmt: skip
    assert [column.name for column in columns_of(table)] == ["load", "supplier", "hot", ORDER]


def test_columns_that_order_the_rows_alike_count_once() -> None:
    load = RNG.random(12)
    table = simple(load=load, log=np.log(load), falling=1.0 / load, y=np.zeros(12))
    first, _ = columns_of(table)
    assert (first.name, first.alike) == ("load", ("log", "falling"))


def test_columns_of_experiments_and_of_observations_are_told_apart() -> None:
    frame = pd.DataFrame(
        {
            "id": ["a", "a", "b", "b"],
            "time": [0.0, 1.0, 0.0, 1.0],
            "hot": [1.0, 1.0, 2.0, 2.0],
            "y": [0.0] * 4,
        }
    )
    found = {c.name: c.own for c in columns_of(Experiments.from_frame(frame, outcome="y"))}
    assert (found["time"], found["hot"]) == (False, True)


def test_contrasts_have_mean_zero_and_length_one() -> None:
    table = simple(
        load=RNG.random(40), level=RNG.integers(0, 3, 40), kind=RNG.choice(["a", "b"], 40),
        y=np.zeros(40),
    )  # fmt: skip
    found = contrasts_of(columns_of(table), len(table))
    assert np.allclose(found.weights.sum(axis=1), 0.0, atol=1e-12)
    assert np.allclose(np.linalg.norm(found.weights, axis=1), 1.0)
    named = [(c.name, w) for c, w in zip(found.column, found.where, strict=True)]
    assert ("level", None) in named
    assert ("level", "level = 1") in named
    assert [where for name, where in named if name == "kind"] == ["kind = b"]


def test_likeness_within_groups_has_variance_one_and_sees_what_is_shared() -> None:
    group = np.repeat(np.arange(20), 3)
    right = [shared(group, RNG.standard_normal(60)) for _ in range(4000)]
    assert abs(np.mean(right)) < 0.05
    assert abs(np.std(right) - 1.0) < 0.05
    assert shared(group, RNG.standard_normal(20)[group]) > 4.0
