"""Every table fits its terminal, and cuts no word of what it shows."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reports import experiment, printed, result
from rich.console import RenderableType

from aleator.report import box, recovery, runs, terminal
from aleator.results.printed import Column, laid_out
from aleator.simulators import Identity
from aleator.simulators.records import Holding, StoredRun
from aleator.tasks.box import FeasibleBox, Side
from aleator.tasks.recover import Recovery

LONG = "correlation.friction_coefficient.stiffness"
BENCH = "engagement_2021-03-14_bench_B"


def identified() -> RenderableType:
    document = result()
    some = document["alpha"]["c2_scale.mean"]
    large = {"estimate": 123456.7, "standard_error": 1234.5, "interval": [121000.12, 125000.7]}
    document["alpha"] |= {LONG: some, "modulus.mean": {**some, **large}}
    lost = {"status": "not_realizable", "outcome": -123456.7, "log_density": None}
    document["experiments"].append(experiment(BENCH, None, **lost))
    return terminal.render(document)


def predicted() -> RenderableType:
    columns = {
        "id": [BENCH, "2"], "mean": [123456.7, 1.2], "standard_deviation": [1234.5, 0.1],
        "q0.025": [1.0, -1.2345e-7], "q0.25": [1.1, 1.1], "q0.5": [-123456.2, 1.2],
        "q0.75": [1.3, 1.3], "q0.975": [123456.4, 1.4], "status": ["solved", "not_realizable"],
    }  # fmt: skip
    return terminal.render_predictions(columns, "time")


def recovered() -> RenderableType:
    truth = np.array([0.5, 123456.7])
    alpha = truth * (1.3 + 0.01 * np.random.default_rng(0).standard_normal((40, 2)))
    ends = np.stack([alpha - 0.05, alpha + 0.05], axis=-1)
    found = Recovery((LONG, "x.sd"), truth, alpha, ends, np.zeros(40), np.ones(40, dtype=bool))
    return recovery.render(recovery.document(found))


def boxed() -> RenderableType:
    names = ("friction_coefficient", "stiffness")
    limits = np.array([[0.1, 0.2], [1.0, 2.0]])
    sides = (
        Side(names[0], False, 0.123456, BENCH, np.array([0.1234, 1.5])),
        Side(names[0], True, 0.2, None, None),
    )
    return box.render(
        FeasibleBox(names, limits, limits, sides, 0.03, 12345, 2345, False, {BENCH: 0.8})
    )


SIMULATOR = Identity("3f2a91c0" * 8, "shifting_time_of_the_engagement", "model:f", "version 12")
RUN = StoredRun(
    123456, SIMULATOR, {"load": 1.0, "bench": BENCH}, {"friction_coefficient": 0.123456}, None,
    "ValueError: the spring broke at its second coil", None, 0.1, "host", 1.7e9, 1,
)  # fmt: skip
TABLES = {
    "identify": identified(),
    "predict": predicted(),
    "recover": recovered(),
    "box": boxed(),
    "runs list": runs.holdings([Holding(SIMULATOR, 123456, 12, 9.9, 1.7e9, 1.7e9)], "", "a.sqlite"),
    "runs show": runs.runs([RUN], 12),
    "one run": runs.one(RUN),
}


def words(text: str) -> set[str]:
    return {word for word in text.split() if word.strip("─")}


@pytest.mark.parametrize("name", TABLES)
def test_no_table_cuts_a_word_at_80_columns(name: str) -> None:
    narrow, wide = printed(TABLES[name], 80), printed(TABLES[name], 1000)
    assert words(wide) - words(narrow) == set()
    assert max(map(len, narrow.splitlines())) <= 80


@pytest.mark.parametrize("name", TABLES)
def test_a_terminal_of_40_columns_is_not_overrun(name: str) -> None:
    assert max(map(len, printed(TABLES[name], 40).splitlines())) <= 40


SIDES = st.sampled_from(["left", "right"])
CELLS = st.text("abc ", max_size=30).map(str.strip)


@given(
    st.lists(SIDES, min_size=1, max_size=4),
    st.booleans(),
    st.integers(30, 100),
    st.data(),
)
def test_whatever_a_table_holds_is_whole_and_fits(
    sides: list[Any], folds: bool, width: int, data: st.DataObject
) -> None:
    columns: list[Column] = [("head", side) for side in sides]
    columns += [("note", "fold")] if folds else []
    rows = data.draw(st.lists(st.tuples(*[CELLS] * len(columns)), min_size=1, max_size=5))
    head, body = laid_out(columns, rows, width)
    assert all(len(line) <= width for line in head + body)
    shown = sorted(word for line in body for word in line.split() if word not in ("head:", "note:"))
    assert shown == sorted(word for row in rows for cell in row for word in cell.split())


def test_a_column_of_notes_that_holds_none_is_left_out() -> None:
    columns: list[Column] = [("name", "left"), ("note", "fold")]
    assert laid_out(columns, [("a", ""), ("b", "")]) == (["name"], ["a", "b"])
    assert laid_out(columns, [("a", ""), ("b", "odd")]) == (["name  note"], ["a", "b     odd"])
