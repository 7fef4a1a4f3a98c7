"""The first help fits a screen, and the shell completes commands, options, choices and files."""

import inspect
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pandas as pd
import pytest
from click.shell_completion import BashComplete
from click.testing import CliRunner

import aleator
from aleator import (
    Check,
    Experiments,
    Free,
    GradientMultistart,
    Inputs,
    Normal,
    ResponseSurface,
    cli,
)
from aleator.cli.program import COMMANDS
from aleator.simulators import as_runner
from aleator.tasks.first_look import planned_look


def test_the_first_help_fits_a_screen() -> None:
    shown = CliRunner().invoke(cli.main, ["--help"]).output.splitlines()
    assert len(shown) <= 24
    assert max(map(len, shown)) <= 80
    assert all(any(name in line.split() for line in shown) for name in COMMANDS)


def completed(*words: str) -> list[tuple[str, str]]:
    *before, last = words
    found = BashComplete(cli.main, {}, "aleator", "_ALEATOR_COMPLETE").get_completions(before, last)
    return [(item.type, item.value) for item in found]


def test_words_are_completed(tmp_path: Path) -> None:
    assert completed("ident") == [("plain", "identify")]
    assert completed("new", "--par") == [("plain", "--parameter")]
    assert completed("runs", "ex") == [("plain", "export")]
    assert completed("identify", str(tmp_path)) == [("file", str(tmp_path))]
    assert completed("report", str(tmp_path)) == [("dir", str(tmp_path))]


def test_the_shell_is_given_its_lines_and_asks_with_them() -> None:
    def asked(**more: str) -> str:
        program = "from aleator.cli import main; main(prog_name='aleator')"
        return subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, **more}, text=True, capture_output=True, check=True,
        ).stdout  # fmt: skip

    assert "_ALEATOR_COMPLETE=bash_complete" in asked(_ALEATOR_COMPLETE="bash_source")
    answer = asked(_ALEATOR_COMPLETE="bash_complete", COMP_WORDS="aleator sch", COMP_CWORD="1")
    assert answer == "plain,schema\n"


def shown(*command: str) -> str:
    """The help of a command, its lines joined."""
    return " ".join(CliRunner().invoke(cli.main, [*command, "--help"]).output.split())


TAKEN: list[tuple[str, Callable[..., Any], dict[str, str]]] = [
    ("bootstrap", aleator.bootstrap, {"replicates": "replicates"}),
    ("ceiling", aleator.ceiling, {"replicates": "replicates"}),
    ("compare", aleator.compare, {"bootstrap": "bootstrap"}),
    ("next", aleator.next_experiments, {"count": "count", "repeat": "repeat", "laws": "laws"}),
    ("posterior", aleator.posterior, {"draws": "draws", "chains": "chains"}),
    ("predict", aleator.Identification.probability, {"checks": "checks"}),
    ("predict", aleator.Identification.tolerance, {"confidence": "confidence"}),
    ("recover", aleator.recover, {"replicates": "replicates"}),
]


@pytest.mark.parametrize(("command", "function", "options"), TAKEN)
def test_a_command_and_its_function_have_the_same_defaults_and_the_help_tells_them(
    command: str, function: Callable[..., Any], options: dict[str, str]
) -> None:
    known = inspect.signature(function).parameters
    one = cli.main.get_command(click.Context(cli.main), command)
    assert one is not None
    given = {p.name: p for p in one.params}
    for option, name in options.items():
        assert given[option].default == known[name].default
        assert f"[default: {known[name].default}" in shown(command)


def test_the_defaults_of_a_study_file_are_those_of_the_library() -> None:
    """Every `key = value` of a kind that `identify --help` names, against what is built of it."""
    text = shown("identify")
    choices = {
        "propagation": ResponseSurface(),
        "gradient": GradientMultistart(),
    }
    for kind, choice in choices.items():
        part = text[text.index(f"[{kind}]" if kind == "propagation" else f'"{kind}" (') :]
        keys = re.findall(r"(\w+) = ([\d.e-]+)", part[: part.index(")")])
        assert keys, kind
        for key, value in keys:
            assert float(value) == getattr(choice, key), f"{kind} {key}"


def test_the_runs_of_the_check_are_as_the_help_of_identify_tells() -> None:
    text = shown("identify")
    part = text[text.index("[verification]") :]
    runs = [int(n.replace(",", "")) for n in re.findall(r"[\d,]*\d", part[: part.index("docs/")])]
    assert runs == [0, Check().most]


def test_the_first_runs_are_as_many_as_the_help_of_check_tells() -> None:
    found = re.search(r"(\d+) runs an experiment for one parameter, (\d+) for two, (\d+) for three",
                      shown("check"))  # fmt: skip
    assert found is not None
    table = Experiments.from_frame(pd.DataFrame({"z": [1.0], "y": [1.0]}), outcome="y")
    for names, told in zip(("a", "ab", "abc"), found.groups(), strict=True):
        inputs = Inputs({name: Normal(Free(0.0, 1.0), Free(0.1, 1.0)) for name in names})
        runner = as_runner(lambda z, **x: z + sum(x.values()), table, inputs.names)
        assert planned_look(runner, table, inputs).runs == int(told)
