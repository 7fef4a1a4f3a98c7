"""The rules of the house: what is imported where, what is public, what the wheel has."""

import ast
import builtins
import pkgutil
import re
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from graphlib import TopologicalSorter
from importlib.metadata import version
from pathlib import Path

import click
import pytest

import aleator
from aleator.cli.program import COMMANDS, main
from aleator.study.sections import StudyFile

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "aleator"
BESIDE = (ROOT / "reproduction", ROOT / "benchmarks", ROOT / "hardening")
LONGEST_FILE = 700
EMPTY_NAMES = {"utils", "util", "helpers", "helper", "manager", "process", "data", "common", "misc"}


def floors() -> list[set[str]]:
    """The rooms of each layer, the highest first, as lint-imports is told them."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    (order,) = [contract for contract in contracts if contract["type"] == "layers"]
    return [set(re.findall(r"\w+", layer)) for layer in order["layers"]]


def floor(name: str) -> int:
    return next(k for k, rooms in enumerate(floors()) if name in rooms)


NUMERICS = set().union(*floors()[floor("observations") + 1 : -1], {"moments"})


def every_file() -> dict[str, str]:
    """The text of every file of the package and of what stands beside it, by its path."""
    found = [path for place in (PACKAGE, *BESIDE) for path in sorted(place.rglob("*.py"))]
    return {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in found}


def sources() -> Iterator[tuple[str, Path]]:
    """Every module with its dotted name inside the package, "" for the package itself."""
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        yield ".".join(part for part in parts if part != "__init__"), path


def imports(name: str, path: Path) -> Iterator[str]:
    """Absolute dotted names that a module imports, in any place of the file.

    `from aleator import x` gives `aleator.x`: a module and a name look the same here.
    """
    dotted = f"aleator.{name}" if name else "aleator"
    package = dotted.split(".") if path.name == "__init__.py" else dotted.split(".")[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            origin = ".".join([*above, *([node.module] if node.module else [])])
            yield from (f"{origin}.{alias.name}" for alias in node.names)


def room(name: str) -> str:
    """The part of the package that a module lies in: `moments` for `moments.densities`."""
    return name.partition(".")[0]


def inside(imported: str, module: str) -> bool:
    return imported == module or imported.startswith(f"{module}.")


def test_every_room_has_a_layer() -> None:
    rooms = {room(name) for name, _ in sources()} - {"", "__main__"}
    assert rooms == set().union(*floors())


def test_numerics_import_numpy_and_scipy_only() -> None:
    allowed = sys.stdlib_module_names | {"numpy", "scipy"}
    # formulas of covariates become columns of numbers in one place
    of_formulas = {"laws.covariates": {"formulaic", "pandas"}}
    strangers = [
        f"{name} imports {imported}"
        for name, path in sources()
        if room(name) in NUMERICS
        for imported in imports(name, path)
        if room(imported) not in allowed | {"aleator"} | of_formulas.get(name, set())
    ]
    assert strangers == []


def test_no_module_reaches_the_public_names_from_below() -> None:
    """`from aleator import Name` inside the package would go around the layers."""
    modules = {room(name) for name, _ in sources() if name} | {"__version__"}
    detours = [
        f"{name} imports {imported}"
        for name, path in sources()
        for imported in imports(name, path)
        if name and inside(imported, "aleator")
        if room(imported.removeprefix("aleator").lstrip(".")) not in modules
    ]
    assert detours == []


def test_files_are_short() -> None:
    lengths = {name: len(text.splitlines()) for name, text in every_file().items()}
    assert {name: length for name, length in lengths.items() if length > LONGEST_FILE} == {}


def test_module_names_say_what_is_inside() -> None:
    empty = [name for name in every_file() if EMPTY_NAMES & set(re.split(r"[/._]", name))]
    assert empty == []


def test_nothing_is_left_to_do() -> None:
    left = [
        f"{name}: {line.strip()}"
        for name, text in every_file().items()
        for line in text.splitlines()
        if re.search(r"\b(TODO|FIXME|XXX)\b", line)
    ]
    assert left == []


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


def test_an_identification_needs_no_library_that_only_reads_files_or_draws() -> None:
    found = imported_by("-c", "from aleator import identify; identify")
    assert "scipy" in found
    assert found & {"pydantic", "rich", "matplotlib", "bokeh"} == set()


def test_all_commands_can_be_imported_without_the_packages_that_draw() -> None:
    code = """
import importlib, pkgutil, sys
sys.modules |= dict.fromkeys(["bokeh", "contourpy", "matplotlib"])
import aleator.cli
for module in pkgutil.iter_modules(aleator.cli.__path__):
    importlib.import_module(f"aleator.cli.{module.name}")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr


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


def test_the_wheel_holds_the_package_and_nothing_else(tmp_path: Path) -> None:
    made = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(made, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        about = f"aleator-{version('aleator')}.dist-info"
        entries = archive.read(f"{about}/entry_points.txt")
        licence = archive.read(f"{about}/licenses/LICENSE")
        metadata = archive.read(f"{about}/METADATA").decode()
    source = ROOT / "src"
    package = {
        str(path.relative_to(source).as_posix())
        for path in (source / "aleator").rglob("*")
        if path.suffix in {".py", ".css", ".js", ".typed", ".csv", ".toml"}
    }
    assert {name for name in names if ".dist-info/" not in name} == package
    assert len(package) > 100
    assert "aleator/py.typed" in package  # type checkers of users read the annotations
    assert b"aleator = aleator.cli:main" in entries
    assert licence == (ROOT / "LICENSE").read_bytes()
    assert "\nLicense-Expression: BSD-3-Clause\n" in metadata


# What these say a statistician or an engineer cannot know; docs/words.md has the field's words.
STEMS = {
    "told", "asked", "wanted", "held", "found", "around", "nearer", "toward", "few", "many", "own",
    "likely", "given", "known", "about",
}  # fmt: skip
# keys of stored answers, and a documented attribute
KEPT = {"results.values: about", "tasks.ceiling: held", "tasks.next_experiment: about"}


def public_names(body: list[ast.stmt]) -> Iterator[str]:
    """Classes, functions, methods, fields and constants that another file may use."""
    for node in body:
        match node:
            case ast.ClassDef(name=name, body=members):
                yield name
                yield from public_names(members)
            case ast.FunctionDef(name=name):
                yield name
            case ast.AnnAssign(target=ast.Name(id=name)):
                yield name
            case ast.Assign(targets=targets):
                yield from (target.id for target in targets if isinstance(target, ast.Name))


def test_names_are_words_of_the_field() -> None:
    """Modules and what they share; names that begin with an underscore stay in their file."""
    empty = [
        f"{name}: {word}"
        for name, path in sources()
        for word in [path.stem, *public_names(ast.parse(path.read_text(encoding="utf-8")).body)]
        if not word.startswith("_") and STEMS & set(word.lower().split("_"))
    ]
    assert set(empty) == KEPT


def test_a_class_name_means_one_thing() -> None:
    classes: dict[str, list[str]] = {}
    for name, path in sources():
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef):
                classes.setdefault(node.name.lstrip("_"), []).append(name)
    assert {name: places for name, places in classes.items() if len(places) > 1} == {}


def test_files_import_no_file_that_imports_them() -> None:
    """No circle between two files or among more, names for types included."""
    modules = {name for name, _ in sources()}
    graph: dict[str, set[str]] = {}
    for name, path in sources():
        reached = (imported.removeprefix("aleator.") for imported in imports(name, path))
        graph[name] = {
            next(m for m in (one, one.rpartition(".")[0]) if m in modules)
            for one in reached
            if {one, one.rpartition(".")[0]} & modules
        } - {name, ""}
    TopologicalSorter(graph).prepare()


def test_a_remedy_that_names_a_key_of_study_toml_names_the_argument_in_python_too() -> None:
    """Remedies reach users of both: keys stand in `setting` alone, beside what Python takes."""
    sections = "|".join(StudyFile.model_fields)
    key = re.compile(rf"\[({sections})\]")
    for name, path in sources():
        if name.split(".")[0] in ("study", "cli") or name == "views.planning":
            continue  # Their readers write study.toml.
        tree = ast.parse(path.read_text(encoding="utf-8"))
        told = {
            id(part)
            for node in ast.walk(tree)
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "setting"
            for part in ast.walk(node)
        }
        texts = {
            id(node.body[0].value)
            for node in ast.walk(tree)
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
            and node.body and isinstance(node.body[0], ast.Expr)
        }  # fmt: skip
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and id(node) not in told | texts:
                assert not key.search(str(node.value)), f"{path}, line {node.lineno}"
