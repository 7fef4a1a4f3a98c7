"""The tutorial quotes the files that it runs, and its commands print what it says."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import aleator

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
EXAMPLE = ROOT / "examples" / "braking"


def blocks(kind: str) -> list[str]:
    return re.findall(rf"^```{kind}\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)


def printed() -> list[str]:
    """The lines that the page says a command prints: indented, without what was left out."""
    text = PAGE[PAGE.index("## 4.") :]
    lines = re.findall(r"^    (\S.*|  +\S.*)$", text, re.MULTILINE)
    return [line.strip() for line in lines if line.strip() != "..."]


def test_the_page_quotes_the_files_of_its_example() -> None:
    assert blocks("python") == [(EXAMPLE / "model.py").read_text(encoding="utf-8")]
    assert blocks("toml") == [(EXAMPLE / "study.toml").read_text(encoding="utf-8")]
    rows = (EXAMPLE / "stops.csv").read_text(encoding="utf-8").splitlines()
    quoted = re.findall(r"^    (id,speed.*|S\d\d,.*)$", PAGE, re.MULTILINE)
    assert quoted == [*rows[:3], rows[-1]]
    for file in re.findall(r"examples/braking/[\w.]+", "".join(blocks("shell"))):
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
    for block in blocks("shell"):
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
