"""A simulator that changes the current folder moves nothing of what a command reads and writes."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from aleator.cli import main

STUDY = """\
[experiments]
file = "springs.csv"
outcome = "length"
[simulator]
SIMULATOR
[parameters.softness]
law = "truncated_normal"
box = [0.5, 1.5]
sd = {lower = 0.01, upper = 0.4}
[search]
starts = 1
[verification]
samples = 0
"""
FUNCTION = """\
import os, pathlib
IMPORTED
def length(load, softness):
    os.chdir(pathlib.Path(__file__).with_name("elsewhere"))
    return load * softness
"""
HOOK = """\
import os, pathlib
def read(folder, stdout):
    os.chdir(pathlib.Path(__file__).with_name("elsewhere"))
    return float(stdout)
"""
COMMAND = """\
command = ["cat", "out.txt"]
template = "t.txt"
input = "out.txt"
output = {hook = "hook.py:read"}
keep = "all"
"""
LENGTHS = [0.93, 2.1, 3.2, 3.7]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "springs" / "elsewhere").mkdir(parents=True)
    rows = [f"{chr(65 + k)},{k + 1},{length}" for k, length in enumerate(LENGTHS)]
    (tmp_path / "springs" / "springs.csv").write_text("\n".join(["id,load,length", *rows]) + "\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


@pytest.mark.usefixtures("unjudged_commands")
@pytest.mark.parametrize("imported", ["", "os.chdir('/')"])
def test_results_and_runs_lie_where_they_were_wanted(folder: Path, imported: str) -> None:
    (folder / "springs" / "model.py").write_text(FUNCTION.replace("IMPORTED", imported))
    study = STUDY.replace("SIMULATOR", 'function = "model.py:length"')
    (folder / "springs" / "study.toml").write_text(study)
    before = files(folder)
    where = ["--output", "results", "--store", "kept.sqlite"]
    done = CliRunner().invoke(main, ["identify", "springs/study.toml", "--no-figures", *where])
    assert done.exit_code == 0, done.output
    assert Path.cwd() == folder
    assert files(folder) - before == {"results/identification.json", "kept.sqlite"}
    document = json.loads((folder / "results" / "identification.json").read_text())
    assert document["study"]["file"] == "../springs/study.toml"

    (folder / "new.csv").write_text("load\n2\n")
    law = ["results/identification.json", "--conditions", "new.csv", "--output", "new_lengths.csv"]
    done = CliRunner().invoke(main, ["predict", *law, "--quiet"])
    assert done.exit_code == 0, done.output
    assert {"new_lengths.csv", "springs/runs.sqlite"} <= files(folder)
    assert files(folder / "springs" / "elsewhere") == set()


def test_a_hook_moves_no_run(folder: Path) -> None:
    (folder / "springs" / "hook.py").write_text(HOOK)
    (folder / "springs" / "t.txt").write_text("{softness}")
    study = STUDY.replace("SIMULATOR", COMMAND).replace('"length"', '"length"\nconditions = []')
    (folder / "springs" / "study.toml").write_text(study)
    done = CliRunner().invoke(main, ["box", "springs/study.toml", "--output", "found"])
    assert done.exit_code == 0, done.output
    made = files(folder)
    assert {"found/box.json", "springs/runs.sqlite"} <= made
    assert any(name.startswith("springs/completed_runs/") for name in made)
    assert files(folder / "springs" / "elsewhere") == set()
