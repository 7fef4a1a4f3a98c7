"""`aleator ceiling` tells, writes and draws the best possible law, and makes no run twice."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from aleator import cli
from aleator.views.figures import ceiling_figure
from aleator.views.models import ceiling_verdict

STUDY = """\
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
CREEP = '[parameters.creep]\nlaw = "normal"\nmean = 0.0\nsd = 0.02\n'


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli.main, [str(argument) for argument in arguments])


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    rng = np.random.default_rng(0)
    load = rng.uniform(1.0, 4.0, 24)
    length = load * rng.choice([0.7, 1.3], 24) + rng.normal(0.0, 0.1, 24)
    rows = [f"{k},{a:.4f},{b:.4f}" for k, (a, b) in enumerate(zip(load, length, strict=True))]
    (tmp_path / "springs.csv").write_text("\n".join(["id,load,length", *rows]) + "\n")
    (tmp_path / "model.py").write_text(MODEL)
    (tmp_path / "study.toml").write_text(STUDY)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "study.toml"


def test_it_tells_both_log_likelihoods_and_writes_all(study: Path) -> None:
    result = run("ceiling", study, "--output", "found", "--replicates", 19)
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


def test_quiet_says_one_line_and_the_same_seed_gives_the_same_file(study: Path) -> None:
    texts = []
    for folder in ("one", "two"):
        result = run("ceiling", study, "--output", folder, "--replicates", 3, "--quiet")
        assert result.exit_code == 0, result.output
        assert result.stdout.count("\n") == 1
        document = json.loads(Path(folder, "ceiling.json").read_text(encoding="utf-8"))
        assert result.stdout.strip() == ceiling_verdict(document)
        texts.append(Path(folder, "ceiling.json").read_text(encoding="utf-8"))
    assert texts[0] == texts[1]


def test_without_noise_it_ends_with_the_remedy(study: Path) -> None:
    study.write_text(STUDY.partition("[noise]")[0])
    result = run("ceiling", study)
    assert result.exit_code == 2
    assert "[noise] sd" in result.stderr


def test_two_parameters_have_a_map_with_every_point(study: Path) -> None:
    study.write_text(STUDY + CREEP)
    result = run("ceiling", study, "--output", "found", "--replicates", 0, "--no-figures")
    assert result.exit_code == 0, result.output
    document = json.loads(Path("found/ceiling.json").read_text(encoding="utf-8"))
    assert document["bootstrap"] is None
    gradient = np.array(document["map"]["gradient"])
    assert gradient.shape == (len(document["map"]["second"]), len(document["map"]["first"]))
    # axes[-2] is the map, axes[-1] its scale
    drawn = ceiling_figure(document).axes[-2].collections[-1].get_offsets()
    expected = [[point["softness"], point["creep"]] for point in document["points"]]
    assert np.asarray(drawn) == pytest.approx(np.array(expected))


def test_laws_that_follow_a_column_are_refused_before_any_run(study: Path) -> None:
    law = 'law = "normal"\nmean = {formula = "1 + load", lower = -5, upper = 5}\nsd = 0.2\n'
    study.write_text(STUDY.replace('law = "truncated_normal"\nbox = [0.5, 1.5]\n', law))
    study.with_name("model.py").write_text("def length(**_): raise RuntimeError('it was run')\n")
    result = run("ceiling", study)
    assert result.exit_code == 2
    assert "follow load" in result.stderr
    assert "it was run" not in result.output


def test_of_parameters_that_points_cannot_cover_a_lower_bound_is_told() -> None:
    value = {"ceiling": 6.8, "estimated": -37.2, "verified": None, "error": 0.0, "gap": 44.0}
    told = {"log_likelihood": value, "bootstrap": None, "covered": False}
    assert "at least 6.800" in ceiling_verdict(told)
    assert "at least" not in ceiling_verdict({**told, "covered": True})
