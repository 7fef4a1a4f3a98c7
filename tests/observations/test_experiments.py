"""The table of experiments: ids, conditions, covariates, outcomes, and what is wrong with them."""

from __future__ import annotations

import codecs
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aleator.errors import ExperimentsError
from aleator.observations.experiments import Conditions, Experiments, covariates


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "experiments.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_a_table_becomes_ids_conditions_and_outcomes(tmp_path: Path) -> None:
    path = written(tmp_path, "id,load,bench,time\nA,1,old,0.5\nB,2e0, new ,0.75\n")
    experiments = Experiments.from_csv(path, outcome="time")
    assert experiments.ids == ("A", "B")
    assert experiments.conditions["load"].tolist() == [1.0, 2.0]
    assert experiments.conditions["bench"].tolist() == ["old", "new"]
    assert experiments.outcomes.tolist() == [0.5, 0.75]
    assert experiments.outcome_name == "time"
    assert len(experiments) == 2


def test_conditions_and_id_can_be_chosen(tmp_path: Path) -> None:
    path = written(tmp_path, "nr,v,remark,y\n7,1,,2\n8,3,wet,4\n")
    experiments = Experiments.from_csv(path, outcome="y", id="nr", conditions=["v"])
    assert experiments.ids == ("7", "8")
    assert list(experiments.conditions) == ["v"]


def test_log_transforms_the_outcome_and_keeps_the_measured_one(tmp_path: Path) -> None:
    path = written(tmp_path, "v,y\n1,1\n2,10\n")
    experiments = Experiments.from_csv(path, outcome="y", transform="log")
    np.testing.assert_allclose(experiments.outcomes, [0.0, np.log(10.0)])
    np.testing.assert_allclose(experiments.measured, [1.0, 10.0])


@pytest.mark.parametrize(
    "raw",
    [
        b"v,y\r\n1,2\r\n",
        codecs.BOM_UTF8 + b"v,y\n1,2\n",
        "v,y\n1,2\n".encode("utf-16"),
        b"v,y\n1,2",
        b'"v","y"\n"1","2"\n',
        b"\nv,y\n\n1,2\n,\n",
        b"v,y,\n1,2,\n",
    ],
)
def test_the_same_table_in_many_spellings(tmp_path: Path, raw: bytes) -> None:
    experiments = Experiments.from_csv(written(tmp_path, raw), outcome="y")
    assert experiments.conditions["v"].tolist() == [1.0]
    assert experiments.outcomes.tolist() == [2.0]


BAD = {
    "text": ("v,y\n1,2\n3,high\n", ["line 3", "column 'y'", "'high'"]),
    "blank": ("v,y\n1,2\n3,\n", ["line 3", "column 'y'"]),
    "nan": ("v,y\n1,2\n3,NaN\n", ["line 3", "column 'y'", "'NaN'"]),
    "infinity": ("v,y\n1,2\n3,-inf\n", ["line 3", "column 'y'", "'-inf'"]),
    "underscore": ("v,y\n1,1_000\n", ["line 2", "column 'y'", "'1_000'"]),
    "condition": ("v,y\n1,2\nx,3\n4,5\n", ["line 3", "column 'v'", "'x'"]),
    "blank rows count": ("v,y\n1,2\n\n3,high\n", ["line 4", "column 'y'"]),
    "blank id": ("id,v,y\nA,1,2\n,1,2\n", ["line 3", "'id'"]),
    "missing outcome": ("v,Y\n1,2\n", ["'y'", "'v', 'Y'"]),
    "empty": ("", []),
    "only a header": ("v,y\n", []),
    "semicolons": ("v;y\n1;2\n", ['delimiter = ";"']),
    "tabs": ("v\ty\n1\t2\n", [r'delimiter = "\t"']),
    "decimal comma": ("v,y\n1,2\n0,5,3\n", ["line 3", "decimal"]),
    "short row": ("v,w,y\n1,2,3\n1,2\n", ["line 3", "2", "3"]),
    "duplicate header": ("v,v,y\n1,2,3\n", ["'v'", "1 and 2"]),
    "unnamed column": ("v,,y\n1,2,3\n", ["column 2"]),
    "open quotes": ('v,y\n1,"2\n3,4\n', ["line 3"]),
    "latin-1": ("v,y\n1,2\n\u00e9,3\n".encode("latin-1"), ["line 3", "UTF-8", "0xe9"]),
    "workbook": (b"PK\x03\x04rest", ["CSV UTF-8"]),
    "binary": (b"v,y\n\x00\x01", ["line 2"]),
}


@pytest.mark.parametrize(("raw", "expected"), BAD.values(), ids=BAD)
def test_bad_tables_are_told_with_their_place(
    tmp_path: Path, raw: str | bytes, expected: list[str]
) -> None:
    path = written(tmp_path, raw)
    with pytest.raises(ExperimentsError) as caught:
        Experiments.from_csv(path, outcome="y")
    assert str(path) in caught.value.problem
    assert caught.value.remedy
    for name in expected:
        assert name in str(caught.value)


@pytest.mark.parametrize("delimiter", ["", ",,"])
def test_a_delimiter_is_one_character(tmp_path: Path, delimiter: str) -> None:
    with pytest.raises(ExperimentsError, match=r"experiments\.csv"):
        Experiments.from_csv(written(tmp_path, "y\n1\n"), outcome="y", delimiter=delimiter)


@pytest.mark.parametrize("outcome", ["0", "-1"])
def test_no_logarithm_of_an_outcome_that_is_not_positive(tmp_path: Path, outcome: str) -> None:
    path = written(tmp_path, f"v,y\n1,2\n1,{outcome}\n")
    with pytest.raises(ExperimentsError, match=rf"line 3, column 'y'.*{outcome}"):
        Experiments.from_csv(path, outcome="y", transform="log")


def test_columns_of_text_stay_text_and_slips_do_not_turn_numbers_into_text(tmp_path: Path) -> None:
    path = written(tmp_path, "site,v,y\nA1,1,2\n7,2,3\nB,3,4\n")
    experiments = Experiments.from_csv(path, outcome="y")
    assert experiments.conditions["site"].tolist() == ["A1", "7", "B"]
    with pytest.raises(ExperimentsError, match=r"line 2, column 'site'.*'A1'"):
        Experiments.from_csv(path, outcome="y", conditions=["site"])


def test_unknown_names_are_told(tmp_path: Path) -> None:
    path = written(tmp_path, "load,y\n1,2\n")
    with pytest.raises(ExperimentsError, match=r"'laod'.*'load'"):
        Experiments.from_csv(path, outcome="y", conditions=["laod"])
    with pytest.raises(ExperimentsError, match="'nr'"):
        Experiments.from_csv(path, outcome="y", id="nr")
    with pytest.raises(ExperimentsError, match="'y'"):
        Experiments.from_csv(path, outcome="y", conditions=["load", "y"])


def test_frames_are_told_by_position_and_label() -> None:
    frame = pd.DataFrame({"v": [1, 2], "y": [1.0, np.nan]}, index=["first", "second"])
    with pytest.raises(ExperimentsError, match=r"row 2 .*'second'.*column 'y'"):
        Experiments.from_frame(frame, outcome="y")
    with pytest.raises(ExperimentsError):
        Experiments.from_frame(frame.iloc[:0], outcome="y")
    with pytest.raises(ExperimentsError):
        Experiments.from_frame(frame[[]], outcome="y")


def test_values_that_do_not_fit_together_are_refused() -> None:
    table = pd.DataFrame({"v": [1.0, 2.0]})
    with pytest.raises(ExperimentsError, match=r"1 .* 2 "):
        Conditions(("a",), table)
    with pytest.raises(ExperimentsError, match="'a'"):
        Conditions(("a", "a"), table)
    with pytest.raises(ExperimentsError):
        Experiments(("a", "b"), table, np.array([1.0]))
    with pytest.raises(ExperimentsError):
        Experiments(("a", "b"), table, np.array([1.0, np.inf]))
    with pytest.raises(ExperimentsError, match="'ln'"):
        Conditions(("a", "b"), table, "ln")  # type: ignore[arg-type]


def test_rows_with_the_same_id_are_one_experiment_wherever_they_stand(tmp_path: Path) -> None:
    path = written(tmp_path, "id,t,y\nB,1,5\nA,1,6\nB,2,7\nA,2,8\n")
    experiments = Experiments.from_csv(path, outcome="y")
    seen = experiments.observations
    assert experiments.ids == ("B", "A")
    assert experiments.experiment.tolist() == [0, 1, 0, 1]
    assert experiments.conditions["t"].tolist() == [1.0, 1.0, 2.0, 2.0]
    assert seen.experiment.tolist() == [0, 0, 1, 1]
    assert seen.row.tolist() == [0, 2, 1, 3]
    assert seen.lower.tolist() == seen.upper.tolist() == [5.0, 7.0, 6.0, 8.0]
    assert not experiments.simple
    with pytest.raises(ExperimentsError, match="observations"):
        _ = experiments.outcomes


def test_conditions_need_no_outcome(tmp_path: Path) -> None:
    path = written(tmp_path, "id,load,remark\nX,3,\nY,4,hot\n")
    conditions = Conditions.from_csv(path, conditions=["load"], transform="log")
    assert conditions.ids == ("X", "Y")
    assert conditions.conditions["load"].tolist() == [3.0, 4.0]
    assert conditions.transform == "log"
    frame = pd.DataFrame({"id": ["X"], "load": [3]})
    assert Conditions.from_frame(frame).conditions["load"].tolist() == [3.0]


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
