"""A command has the defaults of its function."""

import inspect
from collections.abc import Callable
from typing import Any

import click
import pytest
from click.testing import CliRunner

import aleator
from aleator import (
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
