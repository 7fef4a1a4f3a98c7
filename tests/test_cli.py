"""Every command does its work, says what it does, and can be interrupted."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import pandas as pd
import pytest
from click.testing import CliRunner, Result

from aleator import cli
from aleator.simulators.runs import Repeatability

pytestmark = pytest.mark.usefixtures("unreported")

STUDY = """\
title = "Springs"
[experiments]
file = "springs.csv"
outcome = "length"
[simulator]
function = "model.py:length"
[parameters.softness]
law = "truncated_normal"
box = [0.5, 1.5]
sd = {lower = 0.01, upper = 0.4}
[search]
starts = 2
[verification]
samples = 64
"""
MODEL = "def length(load, softness): return load * softness\n"


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli.main, [str(argument) for argument in arguments])


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "springs"
    folder.mkdir()
    lengths = [0.93, 2.1, 3.2, 3.7, 5.4, 5.8, 7.9, 7.6]
    rows = [f"{chr(65 + k)},{k + 1},{length}" for k, length in enumerate(lengths)]
    (folder / "springs.csv").write_text("\n".join(["id,load,length", *rows]) + "\n")
    (folder / "model.py").write_text(MODEL)
    (folder / "study.toml").write_text(STUDY)
    monkeypatch.chdir(tmp_path)
    return Path("springs/study.toml")


def commands(group: click.Group, name: str = "aleator") -> Iterator[tuple[str, click.Command]]:
    yield name, group
    context = click.Context(group)
    for key in group.list_commands(context):
        command = group.get_command(context, key)
        assert command is not None
        if isinstance(command, click.Group):
            yield from commands(command, f"{name} {key}")
        else:
            yield f"{name} {key}", command


def test_every_command_and_option_is_documented() -> None:
    found = dict(commands(cli.main))
    assert set(found) == {
        "aleator", "aleator identify", "aleator predict", "aleator recover",
        "aleator ceiling",
        "aleator sensitivity", "aleator box", "aleator compare",
        "aleator bootstrap", "aleator posterior", "aleator next", "aleator report",
        "aleator runs", "aleator runs list", "aleator runs show", "aleator runs export",
        "aleator runs import", "aleator new",
        "aleator check", "aleator schema", "aleator runs retry", "aleator runs forget",
    }  # fmt: skip
    for name, command in found.items():
        assert command.help, name
        for parameter in command.params:
            if isinstance(parameter, click.Option):
                assert parameter.help, f"{name} {parameter.name}"
            else:
                assert isinstance(parameter.metavar, str), f"{name} {parameter.name}"
        shown = run(*name.split()[1:], "--help")
        assert shown.exit_code == 0
        assert max(map(len, shown.output.splitlines())) <= 90


def test_identify_writes_and_prints_the_answer(study: Path) -> None:
    done = run("identify", study, "--output", "result")
    assert done.exit_code == 0, done.output
    document = json.loads(Path("result/identification.json").read_text())
    assert document["title"] == "Springs"
    assert document["study"]["file"] == "../springs/study.toml"
    assert set(document["alpha"]) == {"softness.mean", "softness.sd"}
    assert document["alpha"]["softness.mean"]["estimate"] == pytest.approx(1.02, abs=0.05)
    assert document["log_likelihood"]["verified"] is not None
    assert [entry["id"] for entry in document["experiments"]] == [*"ABCDEFGH"]
    assert "softness.mean" in done.stdout
    assert "Written: result/identification.json" in done.stdout
    assert "search ..." in done.stderr
    assert Path("springs/runs.sqlite").exists()


def test_the_same_seed_gives_the_same_file_but_for_the_seconds(study: Path) -> None:
    texts = []
    for folder in ("one", "two"):
        run("identify", study, "--output", folder, "--seed", 5)
        document = json.loads(Path(folder, "identification.json").read_text())
        del document["seconds"]
        texts.append(json.dumps(document))
    assert texts[0] == texts[1]
    assert json.loads(texts[0])["seed"] == 5


@pytest.mark.usefixtures("unjudged_commands")
def test_completed_runs_survive_and_are_taken_up(study: Path) -> None:
    model, counter = study.with_name("model.py"), Path("count.txt")
    model.write_text(
        "from pathlib import Path\n"
        "calls = 0\n"
        "def length(load, softness):\n"
        "    global calls\n"
        "    calls += 1\n"
        f"    Path({str(counter.resolve())!r}).write_text(str(calls))\n"
        "    if calls == 50 and Path('stops').exists(): raise KeyboardInterrupt\n"
        "    return load * softness\n"
    )
    whole = run("identify", study, "--no-figures", "--output", "whole", "--no-store")
    assert not Path("springs/runs.sqlite").exists()
    calls = int(counter.read_text())
    Path("stops").touch()
    stopped = run("identify", study, "--no-figures", "--output", "result")
    assert stopped.exit_code == 130
    assert "aleator: stopped by Ctrl-C" in stopped.stderr
    # The first run was repeated, and a few of the others, to see whether they can be.
    kept = int(re.findall(r"(\d+) new runs are kept in springs/runs.sqlite", stopped.stderr)[0])
    assert 49 - 8 <= kept <= 48
    assert "Traceback" not in stopped.output
    assert not Path("result/identification.json").exists()
    Path("stops").unlink()
    done = run("identify", study, "--no-figures", "--output", "result")
    assert done.exit_code == 0
    assert f"springs/runs.sqlite has {kept} runs of this simulator" in done.stderr
    assert abs(int(counter.read_text()) - (calls - kept)) <= Repeatability().most
    # Resumed or not, the answer is the same, and so is the number of runs that it rests on.
    one, two = (json.loads(Path(f, "identification.json").read_text()) for f in ("whole", "result"))
    del one["seconds"], two["seconds"]
    assert one == two
    assert whole.exit_code == 0


@pytest.mark.usefixtures("unjudged_commands")
def test_the_store_may_lie_anywhere_or_nowhere(study: Path) -> None:
    study.write_text(STUDY.replace("[simulator]", '[simulator]\nstore = "kept/a.sqlite"'))
    Path("springs/kept").mkdir()
    for arguments, file in (((), "springs/kept/a.sqlite"), (("--store", "b.sqlite"), "b.sqlite")):
        assert run("identify", study, "--no-figures", "--no-verify", *arguments).exit_code == 0
        assert Path(file).exists()
    assert not Path("springs/runs.sqlite").exists()
    both = run("identify", study, "--no-figures", "--no-store", "--store", "b.sqlite")
    assert both.exit_code == 2
    assert "contradict" in both.stderr


@pytest.mark.usefixtures("unjudged_commands")
def test_predict_prints_or_writes_new_conditions(study: Path) -> None:
    run("identify", study, "--output", "result", "--quiet", "--no-verify")
    Path("new.csv").write_text("id,load\nten,10\ntwenty,20\n")
    law = "result/identification.json"
    shown = run("predict", law, "--conditions", "new.csv")
    assert shown.exit_code == 0, shown.output
    assert "Predicted distribution of length" in shown.stdout
    assert "twenty" in shown.stdout
    written = run("predict", law, "--conditions", "new.csv", "--output", "p.csv", "--quiet")
    assert written.output == "Written: p.csv\n"
    table = pd.read_csv("p.csv")
    mean = json.loads(Path(law).read_text())["alpha"]["softness.mean"]["estimate"]
    assert table["id"].tolist() == ["ten", "twenty"]
    assert table["load"].tolist() == [10, 20]
    assert table["mean"].to_numpy() == pytest.approx([10 * mean, 20 * mean], rel=0.02)
    assert (table["q0.025"] < table["q0.5"]).all()


@pytest.mark.usefixtures("unjudged_commands")
def test_predict_finds_a_study_that_was_moved_or_changed(study: Path) -> None:
    run("identify", study, "--output", "result", "--quiet", "--no-verify")
    Path("new.csv").write_text("load\n10\n")
    study.parent.rename("moved")
    law = "result/identification.json"
    lost = run("predict", law, "--conditions", "new.csv")
    assert lost.exit_code == 2
    assert "--study" in lost.stderr
    moved = Path("moved/study.toml")
    found = run("predict", law, "--conditions", "new.csv", "--study", moved)
    assert found.exit_code == 0
    assert "has changed" not in found.stderr
    moved.write_text(STUDY + "\n")
    changed = run("predict", law, "--conditions", "new.csv", "--study", moved)
    assert changed.exit_code == 0
    assert "moved/study.toml has changed since the identification" in changed.stderr


def recovered(*arguments: object) -> dict[str, Any]:
    done = run("recover", *arguments, "--output", "out", "--workers", 1, "--replicates", 3)
    assert done.exit_code == 0, done.output
    assert "3 virtual data sets" in done.stdout
    found: dict[str, Any] = json.loads(Path("out/recovery.json").read_text())
    return found["hyperparameters"]


def test_recover_at_a_given_law(study: Path) -> None:
    found = recovered(study, "--truth", "softness.mean=1.1", "--truth", "softness.sd=0.05")
    assert found["softness.mean"]["truth"] == 1.1
    assert found["softness.mean"]["mean"] == pytest.approx(1.1, abs=0.06)


@pytest.mark.parametrize(
    ("truth", "name"),
    [
        ("softness.mena=1", "'softness.mean'"),
        ("softness.mean", "''"),
        ("softness.mean=high", "'high'"),
    ],
)
def test_a_truth_that_is_none_is_told(study: Path, truth: str, name: str) -> None:
    done = run("recover", study, "--truth", truth)
    assert done.exit_code == 2
    assert name in done.stderr
