"""docs/architecture.md and docs/extending.md: the files that they name are there, and the code."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from aleator.study.kinds import LAWS
from aleator.study.sections import DENSITIES, OBSERVATIONS, PROPAGATIONS, RULES, SEARCHES
from aleator.study.simulators import SIMULATORS

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src" / "aleator"
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
EXTENDING = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
PLUGINS = [
    path.read_text(encoding="utf-8") for path in (ROOT / "tests/extensions/plugins").glob("*.py")
]
ALL = (LAWS, DENSITIES, OBSERVATIONS, SIMULATORS, SEARCHES, PROPAGATIONS, RULES)


@pytest.mark.parametrize(
    "file", sorted({*re.findall(r"`([\w/]+\.(?:py|toml|md))`", PAGE + EXTENDING)})
)
def test_a_file_that_a_page_names_is_there(file: str) -> None:
    assert (ROOT / file).is_file() or (PACKAGE / file).is_file()


def test_the_rooms_of_the_page_are_those_of_the_package() -> None:
    rooms = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").is_file()}
    modules = {path.stem for path in PACKAGE.glob("*.py") if not path.stem.startswith("_")}
    named = {*re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (`.*?) \|", PAGE, re.M)))}
    assert named == (rooms - {"clutch"}) | modules


def test_the_code_of_the_page_is_that_of_a_plugin() -> None:
    blocks = re.findall(r"^```python\n(.*?)^```$", EXTENDING, re.S | re.M)
    assert len(blocks) == 5
    assert [block for block in blocks if block not in PLUGINS] == []


def test_every_group_of_entry_points_is_named() -> None:
    assert [kinds.group for kinds in ALL if f"`{kinds.group}`" not in EXTENDING] == []
