"""What a table says is a value, never a command of a shell."""

from pathlib import Path

import pytest

from aleator.errors import SimulatorError, SurroundingsError
from aleator.simulators.command import CommandSimulator, Keep
from aleator.simulators.command.inputs import Text, filled

HERE_DOCUMENT = """cat <<END
{label}
END
echo 1"""


@pytest.mark.parametrize("value", ["$(touch X)", "`touch X`", "';touch X;'", '";touch X;"', "A B"])
@pytest.mark.parametrize(
    "command",
    [
        'echo "label: {label}" > /dev/null; echo 1',
        "echo '{label}' > /dev/null; echo 1",
        HERE_DOCUMENT,
        'echo "$(echo "a {label}")" > /dev/null; echo 1',
        "echo `echo {label}` > /dev/null; echo 1",
        "eval echo {label} > /dev/null; echo 1",
        "bash -c 'echo '{label} > /dev/null; echo 1",
        "ssh host echo {label} > /dev/null; echo 1",
        "# it's\necho '{label}' > /dev/null; echo 1",
    ],
)
def test_a_shell_never_reads_what_a_cell_says(tmp_path: Path, command: str, value: str) -> None:
    simulator = CommandSimulator(command, shell=True, base=tmp_path, keep=Keep.ALL)
    with pytest.raises(SimulatorError, match=r"LABEL = \"\{label\}\"") as told:
        simulator.run_one({"label": value}, {})
    assert not isinstance(told.value, SurroundingsError)
    assert not list(tmp_path.rglob("X"))


@pytest.mark.parametrize("program", [["sh", "-c"], ["bash", "-e", "-uc"]])
def test_a_shell_that_is_the_program_itself_does_not_either(
    tmp_path: Path, program: list[str]
) -> None:
    quoted = CommandSimulator([*program, 'echo "{label}"; echo 1'], base=tmp_path, keep=Keep.ALL)
    with pytest.raises(SimulatorError, match="a shell would read"):
        quoted.run_one({"label": "$(touch X)"}, {})
    for command in (
        [*program, "printf %s {label} | wc -c"],
        [*program, 'printf %s "$1" | wc -c', "sh", "{label}"],
    ):
        simulator = CommandSimulator(command, base=tmp_path, keep=Keep.ALL)
        assert simulator.run_one({"label": "$(touch X)"}, {}) == len("$(touch X)")
    assert not list(tmp_path.rglob("X"))


@pytest.mark.parametrize("value", ["B-2.1", "Prüfstand", "a/b,c=d:e%f@g+h_i"])
def test_a_plain_cell_may_stand_in_quotes_of_a_shell(tmp_path: Path, value: str) -> None:
    same = """test "{label}" = '{label}' && test {x:.2f} = '{x:.2f}'"""
    command = f"{same} && echo {{label}} > n && wc -c < n"
    length = CommandSimulator(command, shell=True, base=tmp_path).run_one(
        {"label": value}, {"x": 2.0}
    )
    assert length == len(value.encode()) + 1


def test_a_cell_of_any_text_reaches_a_shell_by_its_environment(tmp_path: Path) -> None:
    value = "$(touch X)`touch X`';\" touch X"
    command = 'printf %s "$LABEL" | wc -c'
    simulator = CommandSimulator(
        command, shell=True, base=tmp_path, environment={"LABEL": "{label}"}, keep=Keep.ALL
    )
    assert simulator.run_one({"label": value}, {}) == len(value)
    assert not list(tmp_path.rglob("X"))


@pytest.mark.parametrize(
    "command", ["echo {label} | sh", "echo {label}|/bin/bash", "trap {label} EXIT"]
)
def test_a_shell_that_reads_a_pipe_and_a_trap_read_a_cell_twice(command: str) -> None:
    text = Text.parse(command)
    assert filled(text, {"label": "B2"}).replace("B2", "{label}") == command
    with pytest.raises(SimulatorError, match="a shell would read"):
        filled(text, {"label": "touch X"})
    assert "'touch X'" in filled(Text.parse("run.sh {label} | tee x"), {"label": "touch X"})
