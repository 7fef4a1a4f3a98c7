from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from aleator.errors import ExperimentsError
from aleator.observations.experiments import Experiments
from aleator.observations.outcomes import Censoring

INF = np.inf


def read(rows: list[list[object]], columns: str, **how: Any) -> Experiments:
    return Experiments.from_frame(pd.DataFrame(rows, columns=columns.split()), **how)


def ends(experiments: Experiments) -> list[tuple[float, float]]:
    seen = experiments.observations
    return list(zip(seen.lower.tolist(), seen.upper.tolist(), strict=True))


def test_several_columns_are_several_responses_and_a_cell_may_be_blank() -> None:
    rows: list[list[object]] = [
        ["A", 1.0, 0.5, 20.0],
        ["B", 2.0, None, 30.0],
        ["A", 3.0, 0.7, None],
    ]
    found = read(rows, "id load time torque", outcome=["time", "torque"],
                 transform={"torque": "log"})  # fmt: skip
    seen = found.observations
    assert seen.names == ("time", "torque")
    assert seen.experiment.tolist() == [0, 0, 0, 1]
    assert seen.row.tolist() == [0, 0, 2, 1]
    assert seen.response.tolist() == [0, 1, 0, 1]
    np.testing.assert_allclose(seen.lower, [0.5, np.log(20.0), 0.7, np.log(30.0)])
    assert list(found.conditions) == list(found.table) == ["load"]
    assert not found.simple


def test_a_long_table_says_the_same_as_a_wide_one() -> None:
    wide = read(
        [["A", 1, 0.5, 20.0], ["B", 2, 0.6, 30.0]], "id load time torque",
        outcome=["time", "torque"], transform={"torque": "log"},
    )  # fmt: skip
    long = read(
        [["A", 1, "time", 0.5], ["B", 2, "time", 0.6], ["A", 1, "torque", 20.0],
         ["B", 2, "torque", 30.0]], "id load quantity value",
        outcome="value", response="quantity", transform={"torque": "log"},
    )  # fmt: skip
    for name in ("experiment", "response", "lower", "upper"):
        one, other = (getattr(t.observations, name) for t in (wide, long))
        np.testing.assert_array_equal(one, other)
    assert wide.ids == long.ids
    assert wide.observations.responses == long.observations.responses
    assert list(long.conditions) == ["load"]


def test_words_of_a_column_tell_what_is_censored() -> None:
    rows: list[list[object]] = [
        [1.0, "Failure"], [10.0, "Runout"], [0.1, "<LOD"], [0.2, "below"], [2.0, ""],
    ]  # fmt: skip
    how = Censoring("status", right="Runout", left=["<LOD", "below"])
    found = read(rows, "life status", outcome="life", censored=how)
    assert ends(found) == [(1.0, 1.0), (10.0, INF), (-INF, 0.1), (-INF, 0.2), (2.0, 2.0)]
    assert found.observations.censored.tolist() == [False, True, True, True, False]
    assert list(found.conditions) == list(found.table) == []
    logged = read(rows, "life status", outcome="life", censored=how, transform="log")
    np.testing.assert_allclose(logged.observations.upper, np.log([1.0, INF, 0.1, 0.2, 2.0]))


@pytest.mark.parametrize("cells", [[0, 1], [0.0, 1.0], ["0", "1"]])
def test_a_number_may_be_a_word(cells: list[object]) -> None:
    rows: list[list[object]] = [[1.0, cells[0]], [2.0, cells[1]]]
    found = read(rows, "y cens", outcome="y", censored=Censoring("cens", left=1))
    assert ends(found) == [(1.0, 1.0), (-INF, 2.0)]


def test_a_second_column_makes_intervals() -> None:
    rows: list[list[object]] = [[1.0, 1.5, ""], [2.0, None, ""], [3.0, 3.0, ""], [4.0, None, "out"]]
    how = Censoring("status", right="out", upper="y_max")
    found = read(rows, "y y_max status", outcome="y", censored=how)
    assert ends(found) == [(1.0, 1.5), (2.0, 2.0), (3.0, 3.0), (4.0, INF)]
    alone = read(rows[:3], "y y_max status", outcome="y", censored=Censoring(upper="y_max"))
    assert ends(alone) == ends(found)[:3]


def test_each_response_is_censored_for_itself() -> None:
    rows: list[list[object]] = [["1", 5.0, "out", 3.0, ""], ["2", 6.0, "", 4.0, "low"]]
    found = read(
        rows, "id a a_status b b_status", outcome=["a", "b"],
        censored={"a": Censoring("a_status", right="out"), "b": Censoring("b_status", left="low")},
    )  # fmt: skip
    assert ends(found) == [(5.0, INF), (3.0, 3.0), (6.0, 6.0), (-INF, 4.0)]
    assert not list(found.conditions)


def test_signs_in_the_cells_tell_it_without_a_column(tmp_path: Path) -> None:
    rows: list[list[object]] = [
        ["A", "> 20", 1.0], ["B", "<=0.5", 2.0], ["C", 3.0, 3.0], ["D", "≥7", None],
    ]  # fmt: skip
    signs = Censoring(signs=True)
    found = read(rows, "id y z", outcome=["y", "z"], censored={"y": signs})
    assert ends(found) == [
        (20.0, INF), (1.0, 1.0), (-INF, 0.5), (2.0, 2.0), (3.0, 3.0), (3.0, 3.0), (7.0, INF),
    ]  # fmt: skip
    (tmp_path / "a.csv").write_text("id;y\nA;> 2,5\nB;1,5\n")
    comma = Experiments.from_csv(
        tmp_path / "a.csv", outcome="y", censored=signs, delimiter=";", decimal=","
    )
    assert ends(comma) == [(2.5, INF), (1.5, 1.5)]
    logs = read([["A", "> 1"]], "id y", outcome="y", censored=signs, transform="log")
    assert ends(logs) == [(0.0, INF)]
    with pytest.raises(ExperimentsError, match=r"row 2 .*column 'y'.*'> abc'"):
        read([["A", "> 1"], ["B", "> abc"]], "id y", outcome="y", censored=signs)
    with pytest.raises(ExperimentsError, match="column 's' as well"):
        Censoring("s", right="out", signs=True)


STATUS = Censoring("s", right="Runout")
BAD: dict[str, tuple[list[list[object]], str, dict[str, Any], str]] = {
    "no bound": (
        [["A", 1.0, ""], ["B", None, "Runout"]], "id y s",
        {"outcome": "y", "censored": STATUS}, r"row 2 .*column 'y' of experiment 'B'.*bound",
    ),
    "a slip in a word": (
        [["A", 1.0, "Failure"], ["B", 2.0, "Runout"], ["C", 3.0, "Run-out"]], "id y s",
        {"outcome": "y", "censored": STATUS}, r"row 3 .*column 's'.*'C'.*'Run-out'.*'Runout'",
    ),
    "a word that never occurs": (
        [["A", 1.0, ""], ["B", 2.0, "runout"]], "id y s",
        {"outcome": "y", "censored": STATUS}, r"column 's'.*'Runout'.*'runout'",
    ),
    "a word beside the measured ones": (
        [["A", 1.0, "ok"], ["B", 2.0, "Runout"], ["C", 2.0, "bad"]], "id y s",
        {"outcome": "y", "censored": Censoring("s", right="Runout", measured="ok")},
        r"row 3 .*'bad'",
    ),
    "swapped ends": (
        [["A", 1.0, 2.0], ["B", 3.0, 2.0]], "id y u",
        {"outcome": "y", "censored": Censoring(upper="u")}, r"row 2 .*column 'u'.*'B'.* 2 .* 3 ",
    ),
    "no lower end": (
        [["A", 1.0, 2.0], ["B", None, 2.0]], "id y u",
        {"outcome": "y", "censored": Censoring(upper="u")}, r"row 2 .*column 'y'.*'B'.*lower",
    ),
    "logarithm of a bound": (
        [["A", 1.0, 2.0], ["B", 0.0, 2.0]], "id y u",
        {"outcome": "y", "censored": Censoring(upper="u"), "transform": "log"},
        r"row 2 .*column 'y'.*'B'.*logarithm",
    ),
    "no such column": (
        [["A", 1.0, ""]], "id y S", {"outcome": "y", "censored": STATUS}, r"'s'.*'S'",
    ),
    "whose censoring": (
        [["A", 1.0, 2.0, ""]], "id y z s", {"outcome": ["y", "z"], "censored": STATUS}, r"y, z",
    ),
    "unknown response": (
        [["A", 1.0, 2.0, ""]], "id y z s", {"outcome": ["y", "z"], "censored": {"Z": STATUS}},
        r"'Z'(.|\n)*y, z",
    ),
    "transform of an unknown response": (
        [["A", 1.0, 2.0]], "id y z", {"outcome": ["y", "z"], "transform": {"Z": "log"}}, r"'Z'",
    ),
    "a row without any value": (
        [["A", 1.0, 2.0], ["B", None, None]], "id y z", {"outcome": ["y", "z"]},
        r"row 2 .*'B'.*blank",
    ),
    "a blank response": (
        [["A", "y", 2.0], ["A", "", 2.0]], "id r v", {"outcome": "v", "response": "r"},
        r"row 2 .*column 'r'.*'A'",
    ),
    "a blank value of a response": (
        [["A", "y", 2.0], ["A", "z", None]], "id r v", {"outcome": "v", "response": "r"},
        r"row 2 .*column 'v'.*'A'",
    ),
    "two columns of values": (
        [["A", "y", 2.0, 3.0]], "id r v w", {"outcome": ["v", "w"], "response": "r"}, r"'r'",
    ),
    "the same outcome twice": ([["A", 2.0]], "id v", {"outcome": ["v", "v"]}, r"'v'"),
    "a status that is a condition": (
        [["A", 2.0, "Runout"]], "id y s",
        {"outcome": "y", "censored": STATUS, "conditions": ["s"]}, r"'s'.*condition",
    ),
    "a blank id": ([["A", 2.0], ["", 2.0]], "id y", {"outcome": "y"}, r"row 2 .*column 'id'"),
}  # fmt: skip


@pytest.mark.parametrize(("rows", "columns", "how", "told"), BAD.values(), ids=BAD)
def test_what_cannot_be_read_is_told_with_its_place(
    rows: list[list[object]], columns: str, how: dict[str, Any], told: str
) -> None:
    with pytest.raises(ExperimentsError, match=told) as caught:
        read(rows, columns, **how)
    assert caught.value.remedy


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"column": "s"},
        {"right": "out"},
        {"column": "s", "right": "out", "left": ["low", "out"]},
    ],
)
def test_censoring_that_says_nothing_is_refused(how: dict[str, Any]) -> None:
    with pytest.raises(ExperimentsError):
        Censoring(**how)


def test_a_million_rows_are_read_fast() -> None:
    frame = pd.DataFrame({"id": np.arange(200_000) // 10, "t": 1.0, "y": 2.0})
    found = Experiments.from_frame(frame, outcome="y")
    assert len(found) == 20_000
    assert found.places[7] == "the data frame: row 8 (index 7)"
