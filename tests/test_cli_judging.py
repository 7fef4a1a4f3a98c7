"""`aleator bootstrap`, `ceiling` and `compare`: what is printed and written, and misuse."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result

from aleator import cli
from aleator.cli import main
from aleator.views.models import ceiling_verdict

STUDY = """
title = "Levels"
[experiments]
file = "table.csv"
outcome = "y"
[simulator]
function = "model.py:model"
vectorized = true
[parameters.x]
law = "normal"
mean = {lower = 0, upper = 5}
sd = {lower = 0, upper = 2}
[noise]
sd = 0.2
[verification]
samples = 0
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    y = np.random.default_rng(0).normal(2.0, 0.5, 30)
    pd.DataFrame({"y": y}).to_csv(tmp_path / "table.csv", index=False)
    (tmp_path / "model.py").write_text("def model(x):\n    return x\n")
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path / "study.toml"


def called(study: Path, *arguments: str) -> Result:
    output = str(study.parent / "out")
    return CliRunner().invoke(main, ["bootstrap", str(study), "--output", output, *arguments])


def test_replicates_are_told_and_written_and_gone_on_from(study: Path) -> None:
    result = called(study, "--replicates", "20", "--experiments")
    assert result.exit_code == 0, result.output
    assert "20 climbs arrived" in " ".join(result.output.split())
    out = study.parent / "out"
    document = json.loads((out / "bootstrap.json").read_text())
    row = document["hyperparameters"]["x.mean"]
    assert row["standard_error"] == pytest.approx(0.1, rel=0.5)
    assert document["statuses"] == {"arrived": 20}
    first = pd.read_csv(out / "bootstrap.csv")
    assert called(study, "--replicates", "22", "--experiments", "--quiet").exit_code == 0
    assert pd.read_csv(out / "bootstrap.csv").iloc[:20].equals(first)


def test_another_kind_in_the_same_folder_is_refused(study: Path) -> None:
    assert called(study, "--replicates", "2", "--quiet").output.count("\n") == 1
    result = called(study, "--replicates", "2", "--experiments")
    assert result.exit_code == 2
    assert "bootstrap.jsonl: its replicates are those of another study, seed or kind" in (
        result.output
    )


CEILING_STUDY = """\
title = "Springs"
[experiments]
file = "springs.csv"
outcome = "length"
[simulator]
function = "model.py:length"
vectorized = true
[parameters.softness]
law = "truncated_normal"
box = [0.5, 1.5]
[noise]
sd = 0.1
"""
MODEL = "def length(load, softness, creep=0.0): return load * softness + creep * load**2\n"


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli.main, [str(argument) for argument in arguments])


@pytest.fixture
def ceiling_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    rng = np.random.default_rng(0)
    load = rng.uniform(1.0, 4.0, 24)
    length = load * rng.choice([0.7, 1.3], 24) + rng.normal(0.0, 0.1, 24)
    rows = [f"{k},{a:.4f},{b:.4f}" for k, (a, b) in enumerate(zip(load, length, strict=True))]
    (tmp_path / "springs.csv").write_text("\n".join(["id,load,length", *rows]) + "\n")
    (tmp_path / "model.py").write_text(MODEL)
    (tmp_path / "study.toml").write_text(CEILING_STUDY)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "study.toml"


def test_it_tells_both_log_likelihoods_and_writes_all(ceiling_study: Path) -> None:
    result = run("ceiling", ceiling_study, "--output", "found", "--replicates", 19)
    assert result.exit_code == 0, result.output
    document = json.loads(Path("found/ceiling.json").read_text(encoding="utf-8"))
    value = document["log_likelihood"]
    assert value["ceiling"] == pytest.approx(value["estimated"] + value["gap"])
    assert document["bootstrap"]["p_value"] == pytest.approx(0.05)
    assert sum(point["probability"] for point in document["points"]) == pytest.approx(1.0)
    assert document["title"] == "Springs"
    for text in ("best possible law", "chosen law", f"{value['ceiling']:.3f}", "p = 0.05"):
        assert text in result.stdout
    assert Path("found/ceiling.png").read_bytes().startswith(b"\x89PNG")


def test_quiet_says_one_line_and_the_same_seed_gives_the_same_file(ceiling_study: Path) -> None:
    texts = []
    for folder in ("one", "two"):
        result = run("ceiling", ceiling_study, "--output", folder, "--replicates", 3, "--quiet")
        assert result.exit_code == 0, result.output
        assert result.stdout.count("\n") == 1
        document = json.loads(Path(folder, "ceiling.json").read_text(encoding="utf-8"))
        assert result.stdout.strip() == ceiling_verdict(document)
        texts.append(Path(folder, "ceiling.json").read_text(encoding="utf-8"))
    assert texts[0] == texts[1]


def test_laws_that_follow_a_column_are_refused_before_any_run(ceiling_study: Path) -> None:
    law = 'law = "normal"\nmean = {formula = "1 + load", lower = -5, upper = 5}\nsd = 0.2\n'
    ceiling_study.write_text(
        CEILING_STUDY.replace('law = "truncated_normal"\nbox = [0.5, 1.5]\n', law)
    )
    ceiling_study.with_name("model.py").write_text(
        "def length(**_): raise RuntimeError('it was run')\n"
    )
    result = run("ceiling", ceiling_study)
    assert result.exit_code == 2
    assert "follow load" in result.stderr
    assert "it was run" not in result.output


COMPARED_STUDY = """
[experiments]
file = "table.csv"
id = "unit"
outcome = "y"
{transform}
[simulator]
function = "model.py:model"
vectorized = true
[parameters.x]
{law}
[noise]
sd = {{lower = 0.01, upper = 2}}
[verification]
samples = 0
"""
CONSTANT = 'law = "constant"\nvalue = {lower = 0, upper = 5}'
NORMAL = 'law = "normal"\nmean = {lower = 0, upper = 5}\nsd = {lower = 0, upper = 2}'


@pytest.fixture
def studies(tmp_path: Path) -> Path:
    """Twelve units of three values about levels that differ, and three studies of them."""
    rng = np.random.default_rng(0)
    unit = np.repeat(np.arange(12), 3)
    y = rng.normal(2.0, 0.3, 12)[unit] + rng.normal(0.0, 0.1, 36)
    pd.DataFrame({"unit": unit, "y": y}).to_csv(tmp_path / "table.csv", index=False)
    (tmp_path / "model.py").write_text("def model(x):\n    return x\n")
    for name, law, transform in [
        ("alike", CONSTANT, ""), ("differing", NORMAL, ""), ("logged", NORMAL, 'transform = "log"')
    ]:  # fmt: skip
        (tmp_path / f"{name}.toml").write_text(COMPARED_STUDY.format(law=law, transform=transform))
    return tmp_path


def compared(folder: Path, *arguments: str) -> Result:
    paths = [str(folder / a) if a.endswith(".toml") else a for a in arguments]
    return CliRunner().invoke(main, ["compare", *paths, "--output", str(folder / "out")])


def test_two_models_are_compared(studies: Path) -> None:
    result = compared(studies, "alike.toml", "differing.toml", "--bootstrap", "2")
    assert result.exit_code == 0, result.output
    document = json.loads((studies / "out" / "compare.json").read_text())
    best, other = document["models"]
    assert (best["name"], best["free"], best["of_law"]) == ("differing", 3, 2)
    assert other["difference"] < -3.0 * other["difference_error"]
    (ratio,) = document["nested"]
    assert ratio["p"] < 1e-4
    assert ratio["replicates"] == 2
    assert len(document["left_out"]) == document["experiments"] == 12
    assert "alike does worse by more than chance explains" in " ".join(result.output.split())
    assert max(map(len, result.output.splitlines()[:-2])) <= 80
    assert (studies / "out" / "compare.png").stat().st_size > 5000


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("alike.toml",), "name two or more"),
        (("alike.toml", "alike.toml"), "another study is called 'alike' too"),
        (("differing.toml", "logged.toml"), "apart by the Jacobian"),
        (("alike.toml", "differing.toml", "--nested", "alike", "diferring"), "did you mean"),
    ],
    ids=["one", "twice", "transforms", "name"],
)
def test_misuse_is_one_message(studies: Path, arguments: tuple[str, ...], told: str) -> None:
    result = compared(studies, *arguments)
    assert result.exit_code == 2
    assert told in result.output
    assert "Remedy:" in result.output
