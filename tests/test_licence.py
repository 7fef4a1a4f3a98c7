"""The licence is said alike everywhere, data have a source and terms, no dependency forbids it."""

import re
import tomllib
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
NAME = "BSD-3-Clause"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
DATA = {".csv", ".tsv", ".dat", ".txt", ".json", ".xlsx", ".parquet", ".npy", ".npz"}
FOLDERS = ("examples", "tests", "docs", "benchmarks", "hardening", "reproduction", "website", "src")
PERMISSIVE = re.compile(
    r"\b(MIT|0?BSD|Apache|ISC|PSF|Python Software Foundation)\b"
    r"|Permission is hereby granted, free\s+of\s+charge"  # the MIT licence itself
)
FORBIDDEN = re.compile(r"\b(A?GPL|Affero|GNU General|SSPL|proprietary)", re.IGNORECASE)
WEAK = {"moocore": "LGPL-2.1-or-later"}
"""Libraries that are installed beside, and may be exchanged: what the LGPL asks for."""
NOT_SHIPPED = {"dev", "docs", "peers"}


def test_the_licence_is_the_same_wherever_it_is_named() -> None:
    text = (ROOT / "LICENSE").read_text()
    assert text.startswith("BSD 3-Clause License")
    assert "the Aleator developers" in text
    assert "Neither the name" in text  # the third clause
    assert PROJECT["license"] == NAME
    assert PROJECT["license-files"] == ["LICENSE"]
    assert f"license: {NAME}" in (ROOT / "CITATION.cff").read_text()
    for page in ("README.md", "CONTRIBUTING.md", "docs/data.md"):
        assert NAME in (ROOT / page).read_text()


def test_every_file_of_data_has_a_source_and_terms() -> None:
    rows = {}
    for line in (ROOT / "docs" / "data.md").read_text().splitlines():
        if found := re.match(r"\| `([^`]+)` \|(.+)\|$", line):
            rows[found[1]] = [cell.strip() for cell in found[2].split("|")]
    files = {
        path.relative_to(ROOT).as_posix()
        for folder in FOLDERS
        for path in (ROOT / folder).rglob("*")
        if path.suffix in DATA and "out" not in path.relative_to(ROOT).parts
    }
    assert len(files) > 20
    assert files == set(rows)
    assert all(all(cells) and len(cells) in (2, 3) for cells in rows.values())
    for cells in rows.values():  # what a script is said to have made has that script
        for script in re.findall(r"`(\S+\.py)`", cells[1]):
            assert (ROOT / script).is_file()


def shipped() -> Iterator[tuple[str, str]]:
    """What the package needs with its extras, and what that needs in turn: name and licence."""
    extras = PROJECT["optional-dependencies"]
    asked = [*PROJECT["dependencies"]]
    asked += [line for name, lines in extras.items() if name not in NOT_SHIPPED for line in lines]
    open_, seen = [(Requirement(line), "") for line in asked], set[tuple[str, str]]()
    while open_:
        needed, extra = open_.pop()
        if needed.marker and not needed.marker.evaluate({"extra": extra}):
            continue
        for own in ("", *needed.extras):
            if (needed.name, own) in seen:
                continue
            seen.add((needed.name, own))
            try:
                found = distribution(needed.name)
            except PackageNotFoundError:
                continue
            open_ += [(Requirement(line), own) for line in found.requires or ()]
    for name in sorted({name for name, _ in seen}):
        try:
            yield name, licence(name)
        except PackageNotFoundError:
            continue


def licence(name: str) -> str:
    """What the metadata say: an expression, classifiers, or the beginning of a text."""
    found = distribution(name)
    about = found.metadata
    if expression := about.get("License-Expression"):
        return str(expression)
    kinds = [c for c in about.get_all("Classifier") or () if c.startswith("License ::")]
    kinds = [kind.removeprefix("License :: ") for kind in kinds]
    if text := " ".join([*kinds, (about.get("License") or "")[:400]]).strip():
        return text
    named = about.get_all("License-File") or ()
    return "".join((found.read_text(f"licenses/{file}") or "")[:400] for file in named)


def test_no_dependency_forbids_the_licence() -> None:
    found = dict(shipped())
    assert len(found) > 40  # those behind the direct ones too
    for name, text in found.items():
        if name in WEAK:
            assert text == WEAK[name]
            continue
        assert PERMISSIVE.search(text), f"{name}: {text or 'no licence'}"
        assert not FORBIDDEN.search(text), f"{name}: {text}"


@pytest.mark.parametrize(
    "text",
    ["GPL-3.0-or-later", "GNU General Public License v2", "AGPL-3.0-only", "LGPL", "", "UNKNOWN"],
)
def test_licences_that_are_not_permissive_are_seen(text: str) -> None:
    assert FORBIDDEN.search(text) or not PERMISSIVE.search(text)
