"""First studies of tables as papers and programs for reliability print them."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from scipy import optimize

from aleator import cli
from aleator.study import load_study
from aleator.study.proposal import noise_limits
from aleator.views.identification import shrinkage

pytestmark = pytest.mark.usefixtures("folder")


def run(*arguments: str) -> Result:
    return CliRunner().invoke(cli.main, [*arguments])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("model.py").write_text("def life(rate):\n    return rate\n")
    return tmp_path


def new(head: str, rows: list[str], *arguments: str) -> str:
    Path("table.csv").write_text("\n".join([head, *rows, ""]))
    done = run("new", "table.csv", "--function", "model.py:life", "--yes", *arguments)
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.parametrize(
    ("failed", "runs"), [("failed", "running"), ("F", "S"), ("F", "C"), ("broken", "in service")]
)
def test_what_still_runs_is_a_bound(failed: str, runs: str) -> None:
    new(
        "km,status",
        [f"6000,{failed}", f"7000,{runs}", f"9000,{failed}", f"9500,{runs}"],
        "--parameter=rate=1e3:1e5",
    )
    seen = load_study("study.toml").experiments.observations
    assert np.isinf(seen.upper).tolist() == [False, True, False, True]


def test_a_column_of_standard_errors_is_the_noise() -> None:
    """A study of studies, made up: an effect of each trial with its standard error."""
    new(
        "trial,log_rr,se",
        ["1,-0.9,0.5", "2,-1.6,0.4", "3,-1.3,0.6", "4,-1.4,0.1"],
        "--outcome=log_rr",
        "--parameter=rate=-4:4",
    )
    assert tomllib.loads(Path("study.toml").read_text())["noise"] == {"sd": "se"}


def test_the_column_that_names_experiments_is_no_slip_of_a_parameter() -> None:
    told = new(
        "rat,weight",
        ["1,150", "1,200", "2,140", "2,190"],
        "--id=rat",
        "--outcome=weight",
        "--parameter=rate=100:400",
    )
    assert "not used; if it is" not in told


@pytest.mark.parametrize("count", [5, 12, 100])
def test_the_noise_may_be_all_of_the_scatter_and_its_interval_more(count: int) -> None:
    """The upper end of the profile interval of an sd lies within the limits that are proposed."""
    spread = 3.7
    estimate = spread * np.sqrt((count - 1) / count)
    end = optimize.brentq(
        lambda ratio: count * (np.log(ratio) + 0.5 / ratio**2 - 0.5) - 1.92, 1.0, 10.0
    )
    limits = noise_limits(spread)
    assert limits is not None
    assert limits[0] < 0.01 * estimate < estimate * end < limits[1]


def test_the_first_look_refuses_what_could_not_be_identified() -> None:
    new("y", ["1.1", "2.3", "2.9"], "--parameter=rate=0:4")
    text = Path("study.toml").read_text().replace("box =", "# box =")
    Path("study.toml").write_text(
        text.replace('law = "truncated_normal"', 'value = {lower = 0, upper = 4}\nlaw = "constant"')
    )
    refused = run("check", "study.toml", "--quiet")
    assert refused.exit_code == 2
    assert "scatters" in refused.output
    assert not Path("runs.sqlite").exists()


def test_a_calibration_has_no_table_of_individual_parameters() -> None:
    assert not [*shrinkage({"shrinkage": {}, "experiments": [{"mean": {}, "sd": {}}]})]
