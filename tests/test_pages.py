"""The commands of the pages run as printed, in a copy of what the pages speak of."""

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

import pytest

import aleator
from aleator.study.sections import StudyFile

ROOT = Path(__file__).parents[1]
PAGES = [
    path.relative_to(ROOT)
    for path in (ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *ROOT.glob("examples/*/*.md"))
    if "```bash" in path.read_text(encoding="utf-8")
]
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


def test_a_study_whose_worker_is_killed_gives_the_same_answer(copy: Path) -> None:
    printed = run_page(Path("docs/clusters.md"), copy)
    assert "its runs go to another" in printed[1]
    assert "the same\n" in printed


OTHERS = [page for page in PAGES if page.stem not in {"three_ways", "clusters"}]


@pytest.mark.parametrize("page", OTHERS, ids=str)
def test_the_commands_of_a_page_run(page: Path, copy: Path) -> None:
    assert run_page(page, copy)


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
    assert all(answer["accepted"] for answer in found.values())
    for answer in found.values():
        del answer["seconds"]
    assert found["resumed"] == found["command"]
    assert printed[-1] == "the same\n"


def test_the_studies_for_other_tools_have_keys_that_exist() -> None:
    page = (ROOT / "docs" / "tools.md").read_text(encoding="utf-8")
    studies = [StudyFile.model_validate(tomllib.loads(text)) for text in blocks(page, "toml")]
    assert {study.simulator.kind for study in studies} <= {"command", "fmu"}
    assert len(studies) == 6
