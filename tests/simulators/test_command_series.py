"""A program that reads a table of rows, and writes a column for each response."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from pydantic import ValidationError

from aleator.errors import AleatorError, SimulatorError
from aleator.observations.experiments import Conditions
from aleator.observations.responses import Response
from aleator.simulators import Runner, Simulator, Store
from aleator.simulators.command import (
    CommandSimulator,
    CsvFeed,
    CsvOutput,
    HookOutput,
    InputFile,
    JsonFeed,
    JsonOutput,
    OutputFile,
    RegexOutput,
)
from aleator.study.simulators import SIMULATORS

LOAD, TIME = [2.0, 2.0, 2.0, 3.0, 3.0], [0.5, 1.0, 1.5, 1.0, 2.0]
ROWS = pd.DataFrame({"load": LOAD, "time": TIME})
# Reads rows.csv; writes way = load x time and speed = load x, row by row.
AWK = 'NR == 1 {{print "way,speed"}} NR > 1 {{print {load} * {x} * $1 "," {load} * {x}}}'
COMMAND = ["sh", "-c", f"awk '{AWK}' rows.csv > out.csv"]


def table(*names: str) -> Conditions:
    responses = [Response(name) for name in names]
    return Conditions(("A", "B"), ROWS, responses=responses, experiment=np.array([0, 0, 0, 1, 1]))


def column(name: str) -> CsvOutput:
    return CsvOutput("out.csv", name)


@pytest.fixture
def both(tmp_path: Path) -> CommandSimulator:
    outputs = {"speed": column("speed"), "way": column("way")}
    return CommandSimulator(COMMAND, outputs, tmp_path, series=True)


def test_one_start_serves_an_experiment_of_several_responses(
    both: CommandSimulator, tmp_path: Path
) -> None:
    for fresh in (2, 0):
        with Store(tmp_path / "runs.sqlite") as store:
            run = Runner(both, table("way", "speed"), ["x"], store=store)
            values = run.values([0, 1], [[1.0], [2.0]])
        assert run.fresh == fresh
        np.testing.assert_allclose(values[0], [1, 2, 2, 2, 3, 2])
        np.testing.assert_allclose(values[1], [6, 6, 12, 6, np.nan, np.nan])


def test_rows_one_by_one_have_several_responses_too(tmp_path: Path) -> None:
    outputs = {"way": CsvOutput("stdout", 0), "speed": CsvOutput("stdout", 1)}
    command = ["awk", 'BEGIN {{print {load} * {x} * {time} "," {load} * {x}}}']
    run = Runner(CommandSimulator(command, outputs, tmp_path), table("speed", "way"), ["x"])
    values = run.values(np.arange(5), np.full((5, 1), 2.0))
    np.testing.assert_allclose(values, np.c_[2 * ROWS["load"], 2 * ROWS["load"] * ROWS["time"]])


@pytest.mark.parametrize(
    ("written", "output"),
    [
        ("1 2\n3\n", OutputFile()),
        ("t = 1\nt = 2\nt = 3D0\n", RegexOutput(regex=r"t = (\S+)")),
        ("# by solver\na;b\n9;1\n9;2\n9;3\n", CsvOutput(column="b", delimiter=";", skip=1)),
        ('{"a": [1, 2, 3.0]}', JsonOutput(path="a")),
    ],
)
def test_a_column_is_read_whole(tmp_path: Path, written: str, output: OutputFile) -> None:
    (tmp_path / "answer.txt").write_text(written)
    command = ["sh", "-c", "cat answer.txt; : {x} {load}"]
    simulator = CommandSimulator(command, output, tmp_path, files=("answer.txt",), series=True)
    values = Runner(simulator, table("way"), ["x"]).values([0], [[1.0]])
    assert values.tolist() == [[1.0, 2.0, 3.0]]


def test_a_hook_and_feeds_have_arrays(tmp_path: Path) -> None:
    (tmp_path / "reading.py").write_text(
        "import json, csv\n"
        "def outcome(folder, stdout):\n"
        "    given = json.loads((folder / 'in.json').read_text())\n"
        "    rows = list(csv.DictReader((folder / 'aleator.stdin').read_text().splitlines()))\n"
        "    assert [float(r['time']) for r in rows] == given['time']\n"
        "    assert {float(r['load']) for r in rows} == {given['load']}\n"
        "    return [given['x'] * time for time in given['time']]\n"
    )
    hook = HookOutput("reading.py:outcome", tmp_path)
    given = (InputFile("in.json", JsonFeed()),)
    simulator = CommandSimulator(
        ["true"], hook, tmp_path, inputs=given, stdin=CsvFeed(), series=True
    )
    values = Runner(simulator, table("way"), ["x"]).values([1], [[2.0]])
    np.testing.assert_array_equal(values, [[2.0, 4.0, np.nan]])


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (["echo", "1 2 {x}"], ""),
        (["echo", "1 2 {x} {x}"], "it gave 4 numbers for an experiment of 3 rows in 'stdout'"),
        (["echo", "1 nan {x}"], "it returned nan in row 2 of 3"),
        (["echo", "1 so {x}"], "the outcome in 'stdout' is 'so', not a number"),
    ],
)
def test_what_is_no_column_of_the_rows_is_a_failed_run(
    tmp_path: Path, command: list[str], words: str
) -> None:
    run = Runner(CommandSimulator(command, base=tmp_path, series=True), table("way"), ["x"])
    values = run.values([0], [[1.0]])
    assert bool(np.isnan(values).all()) is bool(words)
    assert all(words in failure.message for failure in run.failures.failures.values())


def test_a_placeholder_of_what_varies_is_told(tmp_path: Path) -> None:
    simulator = CommandSimulator(["echo", "{time}", "{x}"], base=tmp_path, series=True)
    with pytest.raises(SimulatorError, match=r"'time' varies within an experiment") as told:
        Runner(simulator, table("way"), ["x"]).values([0], [[1.0]])
    assert "rows.csv" in told.value.remedy


SECTION = """
command = ["sh", "-c", "awk -F, -v x={x} -v load={load} -f model.awk {rows} > out.csv"]
files = "model.awk"
series = true
rows = "times.csv"
output = {way = {file = "out.csv", column = "way"}, speed = {file = "out.csv", column = "speed"}}
"""


def made(folder: Path, section: str) -> Simulator:
    awk = 'NR == 1 {print "way,speed"}\nNR > 1 {print load * x * $1 "," load * x}\n'
    (folder / "model.awk").write_text(awk)
    return SIMULATORS.read(tomllib.loads(section)).build(folder)


def test_a_study_names_the_columns(tmp_path: Path) -> None:
    run = Runner(made(tmp_path, SECTION), table("way", "speed"), ["x"])
    np.testing.assert_allclose(run.values([1], [[2.0]])[0, :4], [6, 6, 12, 6])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('column = "speed"}', 'column = "speed", row = 3}', "row has no meaning beside series"),
        ('speed = {file = "out.csv"', 'speed = {fil = "out.csv"', "fil: there is no such key"),
        ('"out.csv", column = "speed"}', '"out.csv", column = true}', "column"),
        ('"times.csv"', '"model.awk"', "'model.awk' is written for every run"),
    ],
)
def test_a_mistake_is_one_message(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in SECTION
    with pytest.raises((AleatorError, ValidationError)) as told:
        made(tmp_path, SECTION.replace(old, new))
    assert words in str(told.value)


def test_a_response_that_no_output_has_is_told(both: CommandSimulator) -> None:
    run: Any = Runner(both, table("way", "sped"), ["x"])
    with pytest.raises(AleatorError, match=r"no 'sped'.*did you mean 'speed'"):
        run.values([0], [[1.0]])
