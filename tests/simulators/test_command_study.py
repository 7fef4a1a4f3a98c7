"""A program named in study.toml: the answer of the same function, and one message a mistake."""

import re
import shutil
from pathlib import Path

import pytest
from identifications import unjudged

from aleator import Check, Identification
from aleator.errors import AleatorError, SimulatorError, StudyError
from aleator.search import GradientMultistart
from aleator.simulators.command import (
    CommandSimulator,
    CsvFeed,
    CsvOutput,
    Delimiters,
    HookOutput,
    InputFile,
    JsonFeed,
    JsonOutput,
    Keep,
    OutputFile,
    RegexOutput,
    Template,
)
from aleator.study import load_study

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
    by_function = identified(study(folder, 'function = "model.py:travel"'))
    assert by_command.log_likelihood == by_function.log_likelihood
    for name, quantity in by_function.alpha.items():
        assert by_command.alpha[name].estimate == quantity.estimate
        assert by_command.alpha[name].standard_error == quantity.standard_error
    assert by_command.runs == by_function.runs


def test_the_example_is_read_and_runs() -> None:
    run = load_study(EXAMPLE / "study.toml").runner()
    assert run([0, 8], [[2.0], [1.6]]).tolist() == [5.0, 25.0]


def test_every_key(folder: Path) -> None:
    (folder / "in.tpl").write_text("<force> <stiffness>")
    simulator = load_study(
        study(
            folder,
            'command = "./spring.sh {stiffness:.3f}"\n'
            'template = ["in.tpl", "spring.tpl"]\ninput = ["a.dat", "b.dat"]\n'
            'delimiters = ["<", ">"]\nstdin = "in.tpl"\nenvironment = {FORCE = "{force}"}\n'
            'output = {file = "o.csv", column = "t", row = 1, delimiter = ";", skip = 2}\n'
            'files = ["model.py"]\nlink = true\nsuccess_codes = [0, 4]\ntimeout = 5\n'
            'keep = "all"\nversion = "2.1"\nallow_unused = true\n',
        )
    ).simulator
    marks = Delimiters("<", ">")
    assert simulator == CommandSimulator(
        "./spring.sh {stiffness:.3f}",
        output=CsvOutput("o.csv", "t", 1, ";", 2),
        base=folder,
        inputs=(
            InputFile("a.dat", Template(folder / "in.tpl", marks)),
            InputFile("b.dat", Template(folder / "spring.tpl", marks)),
        ),
        stdin=Template(folder / "in.tpl", marks),
        environment={"FORCE": "{force}"},
        files=("model.py",),
        link=True,
        success_codes=(0, 4),
        timeout=5.0,
        keep=Keep.ALL,
        version="2.1",
        allow_unused=True,
    )
    assert simulator.description.startswith("./spring.sh {stiffness:.3f}: CsvOutput(file='o.csv'")


@pytest.mark.parametrize(
    ("written", "output"),
    [
        ('output = "result.txt"', OutputFile("result.txt")),
        ("output = {regex = '(.*)', match = 0}", RegexOutput("stdout", "(.*)", 0)),
        ("output = {column = 2}", CsvOutput("stdout", 2)),
        ('output = {file = "r.json", path = "a.0"}', JsonOutput("r.json", "a.0")),
    ],
)
def test_outputs(folder: Path, written: str, output: OutputFile) -> None:
    path = study(folder, f'command = "./spring.sh {{stiffness}}"\n{written}')
    assert load_study(path).simulator.output == output


def test_standard_input_and_hook(folder: Path) -> None:
    command = 'command = "awk {{print}}"\nstdin = "json"\noutput = {hook = "model.py:outcome"}'
    simulator = load_study(study(folder, command)).simulator
    assert (simulator.stdin, simulator.output) == (
        JsonFeed(),
        HookOutput("model.py:outcome", folder),
    )
    simulator = load_study(study(folder, command.replace('"json"', '"csv"'))).simulator
    assert simulator.stdin == CsvFeed()


@pytest.mark.parametrize(
    ("simulator", "message"),
    [
        ('function = "model.py:travel"\ncommand = "true"', r"function and command are both given"),
        ("vectorized = true", r"key 'simulator': it names none of the simulators"),
        ('comand = "true"', r"names none of the simulators.*'command'"),
        ('command = "true"\ntimout = 3', r"key 'simulator.timout'.*mean 'timeout'"),
        ('command = ["true", 3]', r"key 'simulator.command\[1\]' = 3: .*string"),
        ('command = "true"\ntemplate = "spring.tpl"', "1 of template, 0 of input"),
        ('command = "true"\ndelimiters = ["$"]', r"'simulator.delimiters' = \[\"\$\"\]: .*2 items"),
        ('command = "true"\nkeep = "al"', r"'simulator.keep' = \"al\" is not known .*mean 'all'"),
        ('command = "true"\noutput = {regex = "(a)", path = "a"}', "regex and path are both"),
        ('command = "true"\noutput = {row = 3}', r"row has no meaning by itself\n.*write column"),
        ('command = "true"\noutput = {regex = "(a)", row = 3}', "row has no meaning beside regex"),
        ('command = "true"', r"simulator 'true' is never told the parameter 'stiffness'"),
        ('command = "./spring {stiffness}"', r"key 'simulator.command': the program"),
        ('command = "echo {stifness}"', r"'stifness' is neither.*\(did you mean 'stiffness'\?\)"),
    ],
)
def test_a_mistake_is_one_message(folder: Path, simulator: str, message: str) -> None:
    with pytest.raises(AleatorError) as error:
        load_study(study(folder, simulator))
    assert isinstance(error.value, (StudyError, SimulatorError))
    assert re.search(message, str(error.value)), str(error.value)
