"""A program named in study.toml, and one that reads a table of rows."""

import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged

from aleator import Check, Identification
from aleator.errors import AleatorError, SimulatorError
from aleator.observations.experiments import Conditions
from aleator.observations.responses import Response
from aleator.search import GradientMultistart
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
from aleator.study import load_study
from aleator.study.simulators import SIMULATORS

EXAMPLE = Path(__file__).parents[2] / "examples" / "command_springs"
STUDY = """\
[experiments]
file = "springs.csv"
outcome = "travel"

[simulator]
{}

[parameters.stiffness]
law = "truncated_normal"
box = [1.0, 3.0]
"""
COMMAND = """\
command = ["./spring.sh", "{input}"]
template = "spring.tpl"
input = "spring.dat"
delimiters = ["{{", "}}"]
output = {file = "result.txt", regex = 'travel = (\\S+)'}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("springs.csv", "spring.sh", "spring.tpl"):
        shutil.copy(EXAMPLE / name, tmp_path)
    (tmp_path / "model.py").write_text(
        "def travel(force, stiffness):\n    return force / stiffness\n\n"
        "def outcome(folder, stdout):\n    return float(stdout)\n"
    )
    return tmp_path


def study(folder: Path, simulator: str) -> Path:
    path = folder / "study.toml"
    path.write_text(STUDY.replace("{}", simulator))
    return path


def identified(path: Path) -> Identification:
    study = load_study(path)
    return unjudged(
        study.runner(),
        study.experiments,
        study.inputs,
        search=GradientMultistart(starts=2),
        verification=Check(0),
    )


def test_a_program_gives_the_answer_of_the_function(folder: Path) -> None:
    by_command = identified(study(folder, COMMAND))
    by_function = identified(study(folder, 'function = "model.py:travel"\nvectorized = false'))
    assert by_command.log_likelihood == by_function.log_likelihood
    for name, quantity in by_function.alpha.items():
        assert by_command.alpha[name].estimate == quantity.estimate
        assert by_command.alpha[name].standard_error == quantity.standard_error
    assert by_command.runs == by_function.runs


@pytest.mark.parametrize(
    ("written", "output"),
    [
        ('output = "result.txt"', OutputFile("result.txt")),
        ("output = {regex = '(.*)', match = 0}", RegexOutput("stdout", "(.*)", 0)),
        ("output = {column = 2}", CsvOutput("stdout", 2)),
        ('output = {file = "r.json", path = "a.0"}', JsonOutput("r.json", "a.0")),
        ('output = {hook = "model.py:outcome"}', None),
    ],
)
def test_outputs_and_what_is_fed(folder: Path, written: str, output: OutputFile | None) -> None:
    for word, feed in (("json", JsonFeed()), ("csv", CsvFeed())):
        text = f'command = "./spring.sh {{stiffness}}"\nstdin = "{word}"\n{written}'
        simulator = load_study(study(folder, text)).simulator
        assert simulator.stdin == feed
        assert simulator.output == (output or HookOutput("model.py:outcome", folder))


LOAD, TIME = [2.0, 2.0, 2.0, 3.0, 3.0], [0.5, 1.0, 1.5, 1.0, 2.0]
ROWS = pd.DataFrame({"load": LOAD, "time": TIME})


# Reads rows.csv; writes way = load x time and speed = load x, row by row.
AWK = 'NR == 1 {{print "way,speed"}} NR > 1 {{print {load} * {x} * $1 "," {load} * {x}}}'
BY_ROWS = ["sh", "-c", f"awk '{AWK}' rows.csv > out.csv"]


def table(*names: str) -> Conditions:
    responses = [Response(name) for name in names]
    return Conditions(("A", "B"), ROWS, responses=responses, experiment=np.array([0, 0, 0, 1, 1]))


def column(name: str) -> CsvOutput:
    return CsvOutput("out.csv", name)


@pytest.fixture
def both(tmp_path: Path) -> CommandSimulator:
    outputs = {"speed": column("speed"), "way": column("way")}
    return CommandSimulator(BY_ROWS, outputs, tmp_path, series=True)


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


def simulator_of(folder: Path, section: str) -> Simulator:
    awk = 'NR == 1 {print "way,speed"}\nNR > 1 {print load * x * $1 "," load * x}\n'
    (folder / "model.awk").write_text(awk)
    return SIMULATORS.read(tomllib.loads(section)).build(folder)


def test_a_study_names_the_columns(tmp_path: Path) -> None:
    run = Runner(simulator_of(tmp_path, SECTION), table("way", "speed"), ["x"])
    np.testing.assert_allclose(run.values([1], [[2.0]])[0, :4], [6, 6, 12, 6])


def test_a_response_that_no_output_has_is_told(both: CommandSimulator) -> None:
    run: Any = Runner(both, table("way", "sped"), ["x"])
    with pytest.raises(AleatorError, match=r"no 'sped'.*did you mean 'speed'"):
        run.values([0], [[1.0]])


def test_rows_one_by_one_have_several_responses_too(tmp_path: Path) -> None:
    outputs = {"way": CsvOutput("stdout", 0), "speed": CsvOutput("stdout", 1)}
    command = ["awk", 'BEGIN {{print {load} * {x} * {time} "," {load} * {x}}}']
    run = Runner(CommandSimulator(command, outputs, tmp_path), table("speed", "way"), ["x"])
    values = run.values(np.arange(5), np.full((5, 1), 2.0))
    np.testing.assert_allclose(values, np.c_[2 * ROWS["load"], 2 * ROWS["load"] * ROWS["time"]])
