"""`aleator check`: the first runs are told, kept, drawn, and lead to the next command."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from aleator import cli
from aleator.views.figures import check_figure

STUDY = """\
[experiments]
file = "springs.csv"
outcome = "travel"
[simulator]
function = "model.py:spring"
[parameters.stiffness]
law = "truncated_normal"
box = [2.0, 6.0]
[parameters.idle]
law = "constant"
value = {lower = 0, upper = 1}
"""


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli.main, [str(a) for a in arguments])


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    rows = ["id,force,travel", "A,10,4.9", "B,20,10.2", "C,30,15.4", "D,40,12", "E,50,8"]
    (tmp_path / "springs.csv").write_text("\n".join([*rows, ""]))
    (tmp_path / "model.py").write_text(
        "def spring(force, stiffness, idle):\n    return force / stiffness\n"
    )
    (tmp_path / "study.toml").write_text(STUDY)
    monkeypatch.chdir(tmp_path)
    return Path("study.toml")


def test_what_is_out_of_reach_idle_and_to_come_is_told(study: Path) -> None:
    done = run("check", study, "--output", "out")
    assert done.exit_code == 0, done.output
    result = json.loads(Path("out/check.json").read_text())
    assert result["out_of_reach"] == ["C", "E", "B"]
    assert [row["influence"] for row in result["parameters"]] == [True, False]
    assert result["runs"] == 5 * 13
    assert result["seconds_a_run"] > 0.0
    assert "65 runs: 13 points under 5 of 5" in done.stderr
    assert "aleator identify study.toml" in done.stdout
    figure = check_figure(result)
    labels = [axes.get_xlabel() for axes in figure.axes if axes.get_visible()]
    assert labels == ["stiffness", "idle"]
    assert len(figure.axes[0].lines) == 5
    assert Path("out/check.png").stat().st_size > 10_000


def test_its_runs_are_kept_and_none_is_made_twice(study: Path) -> None:
    assert run("check", study, "--output", "out", "--no-figures").exit_code == 0
    first = json.loads(Path("out/check.json").read_text())
    Path("model.py").touch()
    again = run("check", study, "--output", "out", "--no-figures", "--quiet")
    assert again.exit_code == 0
    assert "3 of 5 measured values are out of reach" in again.stdout
    second = json.loads(Path("out/check.json").read_text())
    assert second["observations"] == first["observations"]
    listed = run("runs", "list", study).output
    assert "65" in listed


def test_a_function_that_wants_arrays_is_told_how_to_say_so(study: Path) -> None:
    Path("model.py").write_text(
        "def spring(force, stiffness, idle):\n    return force.astype(float) / stiffness\n"
    )
    refused = run("check", study)
    assert refused.exit_code == 2
    assert "vectorized = true" in refused.output


@pytest.mark.parametrize("least", [0.0, -1.6e308])
def test_outcomes_at_the_end_of_the_numbers_are_drawn(study: Path, least: float) -> None:
    Path("model.py").write_text(
        "def spring(force, stiffness, idle):\n"
        f"    return {least} if stiffness < 4 else 1.6e308 + 0 * force * stiffness\n"
    )
    done = run("check", study, "--output", "out")
    assert done.exit_code == 0, done.output
    assert Path("out/check.png").exists()
