"""The first help fits a screen, and the shell completes commands, options, choices and files."""

import inspect
import re
from collections.abc import Callable
from typing import Any

import click
import pytest
from click.testing import CliRunner

import aleator
from aleator import (
    GradientMultistart,
    ResponseSurface,
    cli,
)


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
