"""`aleator demo`: from an empty folder to a report, also from an installed wheel."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from studies import done, read, refused

from aleator.cli.demo import WRITTEN

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "aleator" / "cli" / "battery"


def test_the_example_is_written_and_identified_and_replaces_nothing_of_the_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shown = done("demo")
    folder = Path("aleator-demo")
    for name in WRITTEN:
        assert (folder / name).read_bytes() == (SOURCE / name).read_bytes()
    document = read(folder / "out" / "identification.json")
    assert document["sound"]
    assert document["consistent"]
    assert (folder / "out" / "report.html").stat().st_size > 100_000
    (next_command,) = (line for line in shown.stdout.splitlines() if "aleator predict" in line)
    _, *words = shlex.split(next_command)
    printed = done(*words, "--no-uncertainty").stdout
    assert "at 25" in printed
    done(*words, "--no-uncertainty", "--output", "predicted.json")
    assert done("show", "predicted.json").stdout == printed
    (folder / "study.toml").write_text("title = 'mine'\n")
    (folder / "cells.csv").unlink()
    assert "study.toml" in refused("demo")
    assert (folder / "study.toml").read_text() == "title = 'mine'\n"
    assert not (folder / "cells.csv").exists()


@pytest.mark.long
def test_the_wheel_in_an_environment_of_its_own_runs_the_demo(tmp_path: Path) -> None:
    """The dependencies are those of this environment; the package is that of the wheel."""
    built = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(built, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    new = tmp_path / "new"
    subprocess.run([sys.executable, "-m", "venv", str(new)], check=True)
    (packages,) = new.glob("lib/python*/site-packages")
    python = new / "bin" / "python"
    subprocess.run(
        [python, "-m", "pip", "install", "--no-deps", "--no-index", "--quiet", wheel], check=True
    )
    # Added after the environment's own packages: its aleator, that of the wheel, comes first.
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    empty = tmp_path / "empty"
    empty.mkdir()
    alone = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

    def said(*command: str | Path) -> str:
        ended = subprocess.run(command, cwd=empty, env=alone, capture_output=True, text=True)
        assert ended.returncode == 0, ended.stderr
        return ended.stdout

    assert said(python, "-c", "import aleator; print(aleator.__file__)").startswith(str(packages))
    assert "Computed soundly" in said(new / "bin" / "aleator", "demo")
    assert (empty / "aleator-demo" / "out" / "report.html").exists()
    for file in ("py.typed", "views/page.css", "views/page.js", "views/progress.css"):
        assert (packages / "aleator" / file).exists()
