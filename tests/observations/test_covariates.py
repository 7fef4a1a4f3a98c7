"""Columns that laws follow: one row for each experiment, and every slip told with its place."""

from __future__ import annotations

import pandas as pd
import pytest

from aleator import Experiments
from aleator.errors import ExperimentsError
from aleator.observations.experiments import covariates

FRAME = pd.DataFrame(
    {
        "id": ["b", "a", "b", "a", "c"],
        "supplier": ["x", "y", "x", "y", "y"],
        "heat": [20, 30, 20, 30, 40],
        "time": [1.0, 1.0, 2.0, 2.0, 1.0],
        "length": [1.0, 1.1, 1.2, 1.3, 1.4],
    }
)


def experiments(frame: pd.DataFrame = FRAME) -> Experiments:
    return Experiments.from_frame(frame, outcome="length")


def test_each_experiment_has_a_row_in_the_order_of_the_ids() -> None:
    found = covariates(experiments(), ["heat", "supplier"])
    assert found.index.tolist() == ["b", "a", "c"]
    assert found["heat"].tolist() == [20.0, 30.0, 40.0]
    assert found["supplier"].tolist() == ["x", "y", "y"]


def test_what_varies_within_an_experiment_is_told_with_both_rows() -> None:
    with pytest.raises(ExperimentsError) as caught:
        covariates(experiments(), ["time"])
    assert all(part in str(caught.value) for part in ("'time'", "'b'", "1.0", "2.0"))


def test_an_unknown_column_is_told_with_the_nearest() -> None:
    with pytest.raises(ExperimentsError, match="did you mean 'heat'"):
        covariates(experiments(), ["heta"])


@pytest.mark.parametrize("blank", [None, ""])
def test_a_blank_is_told_with_its_experiment(blank: str | None) -> None:
    frame = FRAME.assign(supplier=["x", "y", "x", "y", blank])
    with pytest.raises(ExperimentsError, match="experiment 'c' is blank"):
        covariates(experiments(frame), ["supplier"])
