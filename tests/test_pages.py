"""The pages tell the truth: their commands run as printed, what they link to and name is there."""

import importlib
import inspect
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any

import click
import pytest

import aleator
from aleator.cli import main
from aleator.study.kinds import LAWS, Kinds, Section
from aleator.study.sections import (
    CORRELATIONS,
    DENSITIES,
    OBSERVATIONS,
    PROPAGATIONS,
    RULES,
    SEARCHES,
    VARIANCES,
    ExperimentsSection,
    StudyFile,
    VerificationSection,
)
from aleator.study.simulators import SIMULATORS
from website import gallery, settings

ROOT = Path(__file__).parents[1]
EVERY = [
    path.relative_to(ROOT)
    for path in (*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *ROOT.glob("examples/*/*.md"))
]
PAGES = [page for page in EVERY if "```bash" in (ROOT / page).read_text(encoding="utf-8")]
LIMIT = 300.0  # s, of a block that hangs


def blocks(text: str, kind: str = "bash") -> list[str]:
    """What stands between ```bash and ```, in the order of the page."""
    return re.findall(rf"^```{kind}\n(.*?)^```$", text, flags=re.DOTALL | re.MULTILINE)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The pages and the examples, without what studies wrote there."""
    left = shutil.ignore_patterns("runs.sqlite*", "*.fmu", "__pycache__", "*_runs", "out")
    for name in ("docs", "examples"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=left)
    shutil.copy(ROOT / "README.md", tmp_path)
    return tmp_path


def run_page(page: Path, folder: Path) -> list[str]:
    """What each block of a page prints; fails with the block that ends with an error."""
    environment = {
        **os.environ,
        # This interpreter's commands, and the package that is tested.
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(Path(aleator.__file__).parents[1]),
        "COLUMNS": "120",
    }
    printed: list[str] = []
    started: list[int] = []
    try:
        for block in blocks((folder / page).read_text(encoding="utf-8")):
            shell = subprocess.Popen(
                ["bash", "-euo", "pipefail", "-c", block], cwd=folder, env=environment, text=True,
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
            )  # fmt: skip
            started.append(shell.pid)
            said = shell.communicate(timeout=LIMIT)
            told = f"{page}:\n{block}\n{said[0][-2000:]}\n{said[1][-2000:]}"
            assert shell.returncode == 0, told
            printed.append(said[0])
    except BaseException:
        for group in started:  # what a block left at work for a later one
            with suppress(ProcessLookupError):
                os.killpg(group, signal.SIGKILL)
        raise
    return printed


@pytest.mark.long
def test_a_study_whose_worker_is_killed_gives_the_same_answer(copy: Path) -> None:
    printed = run_page(Path("docs/clusters.md"), copy)
    assert "its runs go to another" in printed[1]
    assert any(text.endswith("the same\n") for text in printed)


OTHERS = [
    pytest.param(
        page,
        marks=[pytest.mark.long]
        if page.stem
        in {"repeated", "runs", "posterior", "censored", "bootstrap", "compare", "p_box"}
        else [],
    )
    for page in PAGES
    if page.stem not in {"three_ways", "clusters"}
]


@pytest.mark.slow
@pytest.mark.parametrize("page", OTHERS, ids=str)
def test_the_commands_of_a_page_run(page: Path, copy: Path) -> None:
    assert run_page(page, copy)


@pytest.mark.long
def test_three_simulators_lead_to_one_answer_and_so_does_a_killed_study(copy: Path) -> None:
    printed = run_page(Path("docs/three_ways.md"), copy)
    found = {
        way: json.loads((copy / "out" / way / "identification.json").read_text(encoding="utf-8"))
        for way in ("function", "command", "fmu", "resumed")
    }
    for name, value in found["function"]["alpha"].items():
        for way, other in found.items():
            apart = abs(other["alpha"][name]["estimate"] - value["estimate"])
            assert value["fixed"] or apart < 1e-4 * value["standard_error"], (name, way)
    assert {way: answer["runs_by_stage"] for way, answer in found.items()} == dict.fromkeys(
        found, found["function"]["runs_by_stage"]
    )
    assert all(answer["sound"] for answer in found.values())
    for answer in found.values():
        del answer["seconds"]
    assert found["resumed"] == found["command"]
    assert printed[-1] == "the same\n"


def test_the_studies_for_other_tools_have_keys_that_exist() -> None:
    page = (ROOT / "docs" / "tools.md").read_text(encoding="utf-8")
    studies = [StudyFile.model_validate(tomllib.loads(text)) for text in blocks(page, "toml")]
    assert {study.simulator.kind for study in studies} <= {"command", "fmu"}
    assert len(studies) == 4


@pytest.mark.parametrize("name", ["repeated.md", "howto/censored.md"])
def test_the_studies_of_a_page_are_those_that_it_runs(name: str) -> None:
    page = (ROOT / "docs" / name).read_text(encoding="utf-8")
    folders = [Path(path).parent for path in re.findall(r"identify (\S+)", "".join(blocks(page)))]
    assert blocks(page, "toml") == [(ROOT / f / "study.toml").read_text() for f in folders]
    models = [(ROOT / folder / "model.py").read_text() for folder in folders]
    assert blocks(page, "python") == models


OF_NOISE: tuple[Kinds[Any], ...] = (OBSERVATIONS, CORRELATIONS, VARIANCES)
KEYED = [
    ("study.md", kinds, kind)
    for kinds in (*OF_NOISE, LAWS, DENSITIES, SEARCHES, PROPAGATIONS, RULES)
    for kind in kinds.built_in
] + [
    ("study.md" if kind == "function" else "simulators.md", SIMULATORS, kind)
    for kind in SIMULATORS.built_in
]


@pytest.mark.parametrize(
    ("page", "kinds", "kind"), KEYED, ids=[f"{kinds.group}.{kind}" for _, kinds, kind in KEYED]
)
def test_every_kind_is_there_with_its_keys_and_their_defaults(
    page: str, kinds: Kinds[object], kind: str
) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    maker = kinds.built_in[kind]
    parts = inspect.signature(resolved(maker) if isinstance(maker, str) else maker).parameters
    for key in parts.keys() - {"folder"}:
        assert re.search(rf"`{key}\b", text), key
    if kinds.key:
        row = re.search(rf"^\|.*`\"{kind}\"`.*$", text, re.M)
        assert row, kind
        for key, value in re.findall(r"`(\w+) = ([\w.-]+)`", row[0]):
            assert parts[key].default == tomllib.loads(f"x = {value}")["x"], key


@pytest.mark.parametrize("section", [ExperimentsSection, VerificationSection])
def test_every_key_of_the_other_sections_is_there(section: type[Section]) -> None:
    text = (ROOT / "docs" / "study.md").read_text(encoding="utf-8")
    for key in section.model_fields:
        assert re.search(rf"`{key}\b", text), key


def anchor(heading: str) -> str:
    """The name by which a link within a page finds a heading, as the usual renderers make it."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@pytest.mark.parametrize("page", EVERY, ids=str)
def test_what_a_page_links_to_is_there(page: Path) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if link.startswith(("http://", "https://")):
            continue
        name, _, place = link.partition("#")
        target = (ROOT / page).parent / name if name else ROOT / page
        assert target.exists(), link
        headings = (
            re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.M) if place else []
        )
        assert not place or place in map(anchor, headings), link


NO_MODULES = {"aleator.stdout", "aleator.stderr", "aleator.run"} | {
    kinds.group for kinds in (*OF_NOISE, LAWS, DENSITIES, SEARCHES, PROPAGATIONS, RULES, SIMULATORS)
}
"""Files of a run, and groups of entry points."""


@pytest.mark.parametrize("page", EVERY, ids=str)
def test_modules_tests_and_examples_that_a_page_names_are_there(page: Path) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    quoted = "".join(re.findall(r"`[^`]+`", text))
    named = set(re.findall(r"\b(aleator(?:\.[A-Za-z_]\w*)+)", quoted))
    for name in {".".join(name.split(".")[:3]) for name in named}:
        assert any(map(name.startswith, NO_MODULES)) or resolved(name) is not None, name
    for path in set(re.findall(r"\b((?:tests|examples|src)/[\w/]+\.(?:py|toml|csv|md))\b", text)):
        assert (ROOT / path).exists(), path


@pytest.mark.parametrize("page", EVERY, ids=str)
def test_what_the_python_of_a_page_imports_is_there(page: Path) -> None:
    for block in blocks((ROOT / page).read_text(encoding="utf-8"), "python"):
        lines = re.findall(r"^(?:>>> )?from (aleator[\w.]*) import (.*?)(?:#.*)?$", block, re.M)
        for module, names in lines:
            for name in re.findall(r"\w+", names):
                assert resolved(f"{module}.{name}") is not None, (module, name)


def resolved(name: str) -> Any:
    """The module that a dotted name leads to, or what is in one; None where it leads nowhere."""
    parts = name.replace(":", ".").split(".")
    for last in range(len(parts), 0, -1):
        with suppress(ImportError):
            found = importlib.import_module(".".join(parts[:last]))
            try:
                for part in parts[last:]:
                    found = getattr(found, part)
            except AttributeError:
                return None
            return found
    return None


TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
EXAMPLE = ROOT / "examples" / "braking"


def printed() -> list[str]:
    """The lines that the page says a command prints: indented, without what was left out."""
    text = TUTORIAL[TUTORIAL.index("## 4.") :]
    lines = re.findall(r"^    (\S.*|  +\S.*)$", text, re.MULTILINE)
    return [line.strip() for line in lines if line.strip() != "..."]


def test_the_page_quotes_the_files_of_its_example() -> None:
    assert blocks(TUTORIAL, "python") == [(EXAMPLE / "model.py").read_text(encoding="utf-8")]
    assert blocks(TUTORIAL, "toml") == [(EXAMPLE / "study.toml").read_text(encoding="utf-8")]
    rows = (EXAMPLE / "stops.csv").read_text(encoding="utf-8").splitlines()
    quoted = re.findall(r"^    (id,speed.*|S\d\d,.*)$", TUTORIAL, re.MULTILINE)
    assert quoted == [*rows[:3], rows[-1]]
    for file in re.findall(r"examples/braking/[\w.]+", "".join(blocks(TUTORIAL, "shell"))):
        assert (ROOT / file).exists(), file


@pytest.mark.long
def test_the_commands_of_the_page_print_what_it_says(tmp_path: Path) -> None:
    copy = tmp_path / "examples" / "braking"
    shutil.copytree(EXAMPLE, copy, ignore=shutil.ignore_patterns("runs.sqlite*", "__pycache__"))
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(Path(aleator.__file__).parents[1]),
        "COLUMNS": "80",
    }
    seen = ""
    for block in blocks(TUTORIAL, "shell"):
        done = subprocess.run(
            block, shell=True, cwd=tmp_path, env=environment, text=True, capture_output=True
        )
        assert done.returncode == 0, done.stderr
        seen += done.stdout
    words = " ".join(seen.split())
    line = (EXAMPLE / "road.toml").read_text(encoding="utf-8")
    assert [
        told for told in printed() if " ".join(told.split()) not in words and told not in line
    ] == []
    assert (tmp_path / "out" / "road" / "report.html").exists()


DOCS = ROOT / "docs"


def contents(page: Path) -> set[Path]:
    """The pages that the contents of a page lead to, and their contents."""
    found: set[Path] = set()
    for block in re.findall(r"^```\{toctree\}\n(.*?)^```$", page.read_text("utf-8"), re.M | re.S):
        lines = [line for line in block.splitlines() if line and not line.startswith(":")]
        names = [re.sub(r".*<(.*)>", r"\1", line) for line in lines]
        pages = {path.resolve() for name in names for path in page.parent.glob(f"{name}.md")}
        pages |= {(page.parent / f"{name}.md").resolve() for name in names if name != "*"}
        for inner in pages - {page.resolve()}:
            found |= {inner} | contents(inner)
    return found


def test_every_page_is_in_the_contents_of_the_site_and_every_entry_is_there() -> None:
    written = {path.resolve() for path in DOCS.rglob("*.md")}
    written |= {path.resolve() for path in ROOT.glob("*.md")}
    written |= {path.resolve() for path in ROOT.glob("examples/*/README.md")}
    assert contents(DOCS / "index.md") == written - {(DOCS / "index.md").resolve()}


def test_every_public_name_is_in_the_reference_once() -> None:
    pages = "".join(path.read_text("utf-8") for path in (DOCS / "api").glob("*.md"))
    told = re.findall(r"^\.\. auto(?:class|function|exception):: aleator\.(\w+)$", pages, re.M)
    told += re.findall(r"^\.\. autoexception:: aleator\.errors\.(AleatorError)$", pages, re.M)
    assert sorted(told) == sorted(aleator.__all__)


def test_the_gallery_shows_every_example_once_below_a_question() -> None:
    page = (DOCS / "gallery.md").read_text("utf-8")
    assert sorted(re.findall(r"\(images/gallery/(\w+)\.png\)", page)) == sorted(gallery.SHOWN)
    for question in page.split("\n## ")[1:]:
        heading, *cards = question.split("\n### ")
        assert re.search(r"`[^`\n]+`.*\]\(", heading), heading  # what answers it, and its page
        assert cards, heading
        assert all(card.count("![") == 1 for card in cards), heading


def test_a_number_of_a_page_that_differs_from_the_answer_is_named() -> None:
    row = "| `a.mean`, mm | 1.0 | 1.05 | 0.10 | [0.85, 1.25] |\n"
    alpha = {"a.mean": {"estimate": 1.048, "standard_error": 0.1, "interval": [0.853, 1.266]}}
    assert list(gallery.differences(row, alpha)) == []
    alpha["a.mean"]["interval"] = [0.853, 1.31]
    assert list(gallery.differences(row, alpha)) == [
        "a.mean: 1.25 in the table, 1.31 in the answer"
    ]


def test_every_command_on_a_page_exists_with_its_options() -> None:
    context = click.Context(main)
    wrong = []
    for page in (*DOCS.rglob("*.md"), *ROOT.glob("*.md"), *ROOT.glob("examples/*/README.md")):
        text = page.read_text("utf-8").replace("\\\n", " ")
        for line in re.findall(r"(?:^    |^|`)aleator ([a-z][^\n`#]*)", text, re.MULTILINE):
            name, *words = line.split()
            command = main.get_command(context, name)
            if isinstance(command, click.Group) and words:
                command = command.get_command(context, words[0])
            if command is None:
                wrong.append((page.name, line))
                continue
            known = {o for p in command.get_params(context) for o in (*p.opts, *p.secondary_opts)}
            given = {word.strip("[],.;:)").split("=")[0] for word in words if "--" in word}
            wrong += [(page.name, line, option) for option in given - known]
    assert wrong == []


def test_the_page_of_settings_is_that_of_the_package() -> None:
    assert settings.PAGE.read_text(encoding="utf-8") == settings.page()
