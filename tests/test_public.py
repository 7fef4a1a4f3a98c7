"""The public names: imported when they are used, and in nobody's way."""

import ast
import builtins
import pkgutil
import subprocess
import sys
from pathlib import Path

import click
import pytest

import aleator
from aleator.cli.program import COMMANDS, main

HEAVY = {"numpy", "scipy", "pandas", "pydantic", "rich", "matplotlib", "fmpy", "dask", "sklearn"}


def imported_by(*command: str) -> set[str]:
    """The packages that a fresh Python has imported after a command."""
    done = subprocess.run(
        [sys.executable, "-X", "importtime", *command], capture_output=True, text=True, check=True
    )
    lines = [line for line in done.stderr.splitlines() if line.startswith("import time:")]
    return {line.rpartition("|")[2].strip().partition(".")[0] for line in lines}


@pytest.mark.parametrize("command", [["-c", "import aleator"], ["-m", "aleator", "--help"]])
def test_nothing_heavy_is_imported_before_it_is_used(command: list[str]) -> None:
    found = imported_by(*command)
    assert "aleator" in found
    assert found & HEAVY == set()


def test_what_editors_and_type_checkers_see_is_what_there_is() -> None:
    tree = ast.parse(Path(aleator.__file__).read_text(encoding="utf-8"))
    seen = {
        (node.module, name.name, name.asname)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("aleator")
        for name in node.names
    }
    homes = aleator._HOMES.items()
    assert seen == {(f"aleator.{home}", name, name) for home, names in homes for name in names}


def test_every_public_name_is_there_once() -> None:
    assert len(set(aleator.__all__)) == len(aleator.__all__)
    for name in aleator.__all__:
        assert getattr(aleator, name).__name__ == name
    assert set(aleator.__all__) <= set(dir(aleator))
    with pytest.raises(AttributeError, match="no attribute 'identfy'"):
        _ = aleator.identfy  # type: ignore[attr-defined]


def test_no_public_name_hides_a_module_or_a_builtin() -> None:
    modules = {module.name for module in pkgutil.iter_modules(aleator.__path__)}
    assert "laws" in modules
    assert modules & set(aleator.__all__) == set()
    assert set(dir(builtins)) & set(aleator.__all__) == set()


def test_no_class_of_the_package_has_the_name_of_a_builtin() -> None:
    classes = {
        node.name: path.name
        for path in Path(aleator.__file__).parent.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    }
    assert "Identification" in classes
    assert set(dir(builtins)) & set(classes) == set()


def test_every_public_name_has_an_example() -> None:
    documented = [name for name in aleator.__all__ if name != "FMUSimulator"]  # it needs a file
    lacking = [name for name in documented if ">>>" not in (getattr(aleator, name).__doc__ or "")]
    assert lacking == []


def test_the_help_lists_each_command_with_its_own_first_sentence() -> None:
    context = click.Context(main)
    for name, told in COMMANDS.items():
        command = main.get_command(context, name)
        assert command is not None
        assert " ".join((command.help or "").split("\n\n")[0].split()) == told
