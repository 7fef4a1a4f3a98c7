"""The rules of the house that no other tool checks. pyproject.toml has the one list of layers."""

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

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
