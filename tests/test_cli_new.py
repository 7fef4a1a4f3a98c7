"""A first study from a table and a simulator: what is recognized, asked and written."""

import json
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from fmus.build import compiled

from aleator import cli
from aleator.cli import new as command
from aleator.study import load_study

EXAMPLES = Path(__file__).parents[1] / "examples"
pytestmark = pytest.mark.usefixtures("unjudged_commands")


def run(*arguments: object, typed: str = "") -> Result:
    return CliRunner().invoke(cli.main, [str(a) for a in arguments], input=typed)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "at_terminal", lambda: True)


def springs(folder: Path, stiffness: str = "stiffness=2.0", mark: str = ",") -> None:
    """20 springs, whose stiffnesses have mean 2.2 and standard deviation 0.15."""
    rng = np.random.default_rng(4)
    force = np.repeat([10.0, 20.0, 30.0, 40.0], 5)
    travel = force / rng.normal(2.2, 0.15, force.size)
    rows = [f"{f:.0f}{mark}{t:.4f}" for f, t in zip(force, travel, strict=True)]
    text = "\n".join([f"force{mark}travel", *rows, ""])
    (folder / "springs.csv").write_text(text if mark == "," else text.replace(".", ","))
    model = f"def spring(force, {stiffness}):\n    return force / stiffness\n"
    (folder / "model.py").write_text(model)


def identified(study: Path) -> dict[str, float]:
    done = run("identify", study, "--output", "out", "--no-figures", "--no-verify", "--quiet")
    assert done.exit_code == 0, done.output
    alpha = json.loads(Path("out/identification.json").read_text())["alpha"]
    return {name: value["estimate"] for name, value in alpha.items()}


def test_a_table_and_a_function_with_a_default_are_a_study_that_finds_the_law(
    folder: Path,
) -> None:
    springs(folder)
    done = run("new")
    assert done.exit_code == 0, done.output
    found = identified(Path("study.toml"))
    assert found["stiffness.mean"] == pytest.approx(2.2, abs=4 * 0.15 / np.sqrt(20))
    assert found["stiffness.sd"] == pytest.approx(0.15, abs=4 * 0.15 / np.sqrt(40))


def test_a_table_of_a_european_spreadsheet_is_read(folder: Path) -> None:
    springs(folder, mark=";")
    done = run("new")
    assert done.exit_code == 0, done.output
    study = load_study("study.toml")
    assert study.experiments.outcome_name == "travel"
    assert study.experiments.conditions["force"].tolist()[::5] == [10.0, 20.0, 30.0, 40.0]
    assert study.inputs.box.tolist() == [[0.67, 6.0]]


@pytest.mark.usefixtures("folder")
def test_rows_of_one_experiment_are_seen_and_get_noise() -> None:
    rng = np.random.default_rng(1)
    rate, times = rng.lognormal(-1.2, 0.3, 12), np.array([1.0, 2.0, 4.0, 8.0])
    level = 10.0 * np.exp(-rate[:, None] * times) + 0.05 * rng.standard_normal((12, 4))
    rows = [f"T{k},{t:g},{level[k, j]:.3f}" for k in range(12) for j, t in enumerate(times)]
    Path("tanks.csv").write_text("\n".join(["tank,time,level", *rows, ""]))
    Path("model.py").write_text(
        "import numpy as np\n"
        "def draining(time, rate=0.3):\n    return 10.0 * np.exp(-rate * time)\n"
    )
    done = run("new")
    assert done.exit_code == 0, done.output
    assert "48 rows of 12 experiments, named by the column tank" in done.output
    found = identified(Path("study.toml"))
    assert found["rate.mean"] == pytest.approx(np.mean(rate), abs=0.01)
    assert found["noise.sd"] == pytest.approx(0.05, abs=0.02)


CASES = {
    "crack_growth": ("cracks.csv", "model.py:relative_length", {"rate", "exponent"}, "specimen"),
    "fatigue_limit": ("experiments.csv", "model.py", {"v", "b0", "b1"}, None),
    "fission_gas": ("experiments.csv", "model.py:release", {"diff", "crack"}, "id"),
    "run_outs": ("experiments.csv", "model.py", {"v", "b0", "b1"}, None),
    "sleep_study": ("reactions.csv", "model.py", {"start", "slope"}, "unit"),
    "repeated/wear": ("wear.csv", "model.py", {"rate", "run_in"}, "pad"),
    "wet_clutch": ("experiments.csv", "model.py:shifting_time", {"c2_scale", "zp_scale"}, "id"),
}  # fmt: skip


@pytest.mark.parametrize("example", CASES)
def test_the_columns_and_parameters_of_the_examples_are_recognized(
    example: str, folder: Path
) -> None:
    table, function, names, id = CASES[example]
    shutil.copytree(EXAMPLES / example, folder, dirs_exist_ok=True)
    done = run("new", table, "--function", function, "--output", "new.toml")
    assert done.exit_code == 0, done.output
    text = Path("new.toml").read_text()
    written = tomllib.loads(text)
    own = tomllib.loads(next(iter(sorted(folder.glob("[!n]*.toml")))).read_text())
    assert written["experiments"]["outcome"] == own["experiments"]["outcome"]
    assert written["experiments"].get("id") == id
    assert written["parameters"].keys() == names
    assert ("sd" in written.get("noise", {})) == (
        bool({"id", "censored"} & {*own["experiments"]}) or "fission" in example
    )
    refused = run("identify", "new.toml")
    assert refused.exit_code == 2
    for name in names:
        assert f"parameters.{name}.box' is missing" in refused.output
        assert f"parameters.{name}" in done.output
    (folder / "new.toml").unlink()
    limits = [f"--parameter={name}=0.2:0.8" for name in names]
    assert run("new", table, "--function", function, "--output", "new.toml", *limits).exit_code == 0
    assert set(load_study("new.toml").inputs.names) == names


def test_a_program_is_found_from_its_placeholders(folder: Path) -> None:
    springs(folder)
    (folder / "spring.py").write_text(
        "import sys\nprint('Springs 2.0')\n"
        "print('travel', float(sys.argv[1]) / float(sys.argv[2]))\n"
    )
    line = "python3 spring.py {force} {stiffness}"
    done = run("new", "springs.csv", "--command", line, "--parameter", "stiffness=1:3")
    assert done.exit_code == 0, done.output
    study = load_study("study.toml")
    outcome = study.runner()([0], [[2.0]])
    assert outcome.tolist() == [5.0]


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(("decades", "log"), [(2.5, False), (4.0, True)])
def test_the_logarithm_is_taken_of_what_spans_many_decades(decades: float, log: bool) -> None:
    count = 10 ** np.linspace(1.0, 1.0 + decades, 12)
    rows = [f"{minutes},{one:.6g},2{minutes}.5" for minutes, one in enumerate(count)]
    Path("counts.csv").write_text("\n".join(["minutes,count,room", *rows, "12,<10,20.0", ""]))
    Path("kill.py").write_text("def survivors(minutes, rate=0.8):\n    return 1e6 * 10**-rate\n")
    assert run("new", "counts.csv", "--function", "kill.py:survivors").exit_code == 0
    found = tomllib.loads(Path("study.toml").read_text())
    assert found["experiments"]["outcome"] == "count"  # it has a bound, the room has none
    assert found["experiments"].get("transform") == ("log" if log else None)


@pytest.mark.usefixtures("folder")
def test_noise_that_one_value_an_experiment_does_not_tell_must_be_known() -> None:
    lengths = (0.93, 2.1, 3.2, 3.7, 5.4, 5.8, ">6", 7.6)
    rows = [f"{k},{length}" for k, length in enumerate(lengths, 1)]
    Path("springs.csv").write_text("\n".join(["load,length", *rows, ""]))
    Path("model.py").write_text("def length(load, softness=1.0):\n    return load * softness\n")
    done = run("new", "springs.csv", "--function", "model.py:length", "--outcome", "length")
    assert done.exit_code == 0, done.output
    sd = tomllib.loads(Path("study.toml").read_text())["noise"]["sd"]
    assert sd == pytest.approx(0.02)  # 1 % of the scatter
    assert "noise: 0.02 is assumed" in done.output
    assert identified(Path("study.toml"))["noise.sd"] == sd


def test_the_variables_of_an_fmu_are_found_by_their_last_name(folder: Path) -> None:
    shutil.copy(compiled(2, folder), folder / "cooling.fmu")
    (folder / "cups.csv").write_text("K;bench;T [K]\n1,0;1;313\n1,0;2;315\n2,0;1;321\n")
    done = run("new", "--fmu", "cooling.fmu", "--outcome", "T")
    assert done.exit_code == 0, done.output
    written = tomllib.loads(Path("study.toml").read_text())
    assert written["simulator"]["variables"] == {"K": "surface.k"}
    assert written["experiments"]["conditions"] == ["K"]
    assert "id" not in written["experiments"]  # two benches are not two experiments
    assert written["simulator"]["outcome"] == "T"
    assert "stop_time" not in written["simulator"]
    assert load_study("study.toml").units["K"] == "1/s"
    (folder / "cups.csv").write_text("T0,T\n400,313\n410,314\n420,315\n")
    asked = ["--fmu", "cooling.fmu", "--outcome", "T", "--parameter", "surface.k=0.5:2"]
    assert run("new", *asked, "--force").exit_code == 0
    study = load_study("study.toml")  # names of laws are identifiers
    assert study.inputs.names == ("k",)
    assert study.units == {"T0": "K", "T": "K", "k": "1/s"}
    assert np.isfinite(study.runner()([0], [[1.0]])).all()
    study.close()


def test_a_study_in_a_folder_that_is_made_finds_its_files(folder: Path) -> None:
    springs(folder)
    assert run("new", "--output", "studies/first/study.toml").exit_code == 0
    assert load_study("studies/first/study.toml").runner()([0], [[2.0]]).tolist() == [5.0]


@pytest.mark.usefixtures("asked")
def test_what_is_typed_is_taken(folder: Path) -> None:
    springs(folder, "stiffness, mass=1.0")
    answers = ["springs.csv", "model.py:spring", "travel", "stiffness", "1.5 3"]
    done = run("new", typed="\n".join([*answers, ""]))
    assert done.exit_code == 0, done.output
    assert load_study("study.toml").inputs.box.tolist() == [[1.5, 3.0]]


def test_a_study_that_is_there_stays_unless_the_user_says_otherwise(folder: Path) -> None:
    springs(folder)
    Path("study.toml").write_text("mine")
    refused = run("new")
    assert refused.exit_code == 2
    assert "--force" in refused.output
    assert Path("study.toml").read_text() == "mine"
    assert run("new", "--force").exit_code == 0
    assert Path("study.toml").read_text() != "mine"


SPRINGS = ["springs.csv", "--function", "model.py"]
WRONG = {
    "no table": (["--function", "model.py"], "TABLE.csv"),
    "no simulator": (["springs.csv"], "--function"),
    "two simulators": ([*SPRINGS, "--command", "x {a}"], "contradict"),
    "two outcomes": (["two.csv", "--function", "model.py"], "--outcome"),
    "no such outcome": ([*SPRINGS, "--outcome", "tavel"], "travel"),
    "no such function": (["springs.csv", "--function", "model.py:sprong"], "spring"),
    "no such parameter": ([*SPRINGS, "--parameter", "stifness=1:2"], "stiffness"),
    "limits in the wrong order": ([*SPRINGS, "--parameter", "stiffness=3:1"], "1.0:3.0"),
    "no such id": ([*SPRINGS, "--id", "sprng"], "'sprng' is not a column"),
    "no such file": (["springs.csv", "--function", "modle.py"], "did you mean 'model.py'"),
    "an argument as outcome": ([*SPRINGS, "--outcome", "force"], "cannot be the outcome"),
    "a command without places": (["springs.csv", "--command", "./spring"], "{force}"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_missing_or_wrong_is_told_with_its_option(folder: Path, case: str) -> None:
    arguments, told = WRONG[case]
    springs(folder)
    (folder / "other.py").write_text("def one(): ...\ndef two(): ...\n")
    (folder / "two.csv").write_text("force,a,b\n1,2.5,3.5\n2,3.5,4.5\n")
    refused = run("new", *arguments)
    assert refused.exit_code == 2, refused.output
    assert told in refused.output
    assert not Path("study.toml").exists()


def table(head: str, *columns: object) -> None:
    rows = [",".join(map(str, row)) for row in zip(*columns, strict=True)]  # type: ignore[call-overload]
    Path("parts.csv").write_text("\n".join([head, *rows, ""]))


LIFE = "import numpy as np\ndef life(load, strength=3.0):\n    return np.exp(strength - load)\n"


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("told", ["signs", "words", "event", "upper"])
def test_bounds_are_seen_and_judged_as_bounds(told: str) -> None:
    rng = np.random.default_rng(3)
    load = np.tile([0.5, 1.0, 1.5, 2.0], 15)
    life = np.round(np.exp(rng.normal(3.0, 0.3, 60) - load + rng.normal(0.0, 0.05, 60)), 3)
    over, cut = life > 8.0, np.minimum(life, 8.0)
    Path("model.py").write_text(LIFE)
    if told == "signs":
        table("load,hours", load, np.where(over, "> 8", cut.astype(str)))
    elif told == "words":
        table("load,hours,status", load, cut, np.where(over, "run-out", "failure"))
    elif told == "event":
        table("load,hours,failed", load, cut, 1 - over)
    else:
        table("load,hours,hours_upper", load, cut, np.where(over, "500", ""))
    done = run("new")
    assert done.exit_code == 0, done.output
    assert "outcome: hours" in done.output
    study = load_study("study.toml")
    seen = study.experiments.observations
    assert np.flatnonzero(seen.upper > seen.lower).tolist() == np.flatnonzero(over).tolist()
    assert seen.lower[over] == pytest.approx(8.0)


@pytest.mark.usefixtures("folder")
def test_what_a_law_may_follow_is_proposed_and_holds() -> None:
    rng = np.random.default_rng(5)
    maker, warm = np.tile(["A", "B"], 10), np.linspace(20.0, 39.5, 20).round(1)
    rate = 1.0 + 0.5 * (maker == "B") + 0.1 * rng.standard_normal(20)
    time = np.array([1.0, 2.0, 3.0])
    wear = rate[:, None] * time + 0.02 * rng.standard_normal((20, 3))
    each = [np.repeat(column, 3) for column in (range(20), maker, warm)]
    table("part,maker,warm,time,wear", *each, np.tile(time, 20), wear.ravel().round(4))
    Path("model.py").write_text("def worn(time, rate=1.0):\n    return rate * time\n")
    done = run("new")
    assert done.exit_code == 0, done.output
    assert "outcome: wear" in done.output  # the other numbers are one for each part
    text = Path("study.toml").read_text()
    assert 'mean = "1 + C(maker) + center(warm)"' in text
    Path("study.toml").write_text(text.replace("# mean =", "mean ="))
    found = identified(Path("study.toml"))
    assert found["rate.mean[maker=B]"] == pytest.approx(0.5, abs=0.2)


@pytest.mark.usefixtures("folder")
def test_several_responses_are_the_columns_that_the_function_returns() -> None:
    shutil.copytree(EXAMPLES / "repeated" / "coasting", ".", dirs_exist_ok=True)
    done = run("new", "coasting.csv", "--parameter", "drag=0.05:1", "--force")
    assert done.exit_code == 0, done.output
    study = load_study("study.toml")
    assert study.experiments.observations.names == ("speed", "way")
    assert set(tomllib.loads(Path("study.toml").read_text())["noise"]) == {"speed", "way"}


SERIES = {
    "annotated": "import numpy as np\n"
    "def level(time: np.ndarray, rate: float = 0.3) -> np.ndarray:\n"
    "    return 10.0 * np.exp(-rate * time)\n",
    "integrated": "from scipy.integrate import solve_ivp\n"
    "def level(time, rate=0.3):\n"
    "    return solve_ivp(lambda t, y: -rate * y, (0, time[-1]), [10.0], t_eval=time).y[0]\n",
}


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("kind", SERIES)
def test_a_function_of_a_whole_series_is_seen(kind: str) -> None:
    times = np.array([1.0, 2.0, 4.0])
    tank, time = np.repeat(["a", "b", "c"], 3), np.tile(times, 3)
    table("tank,time,level", tank, time, 10.0 * np.exp(-0.3 * time))
    Path("model.py").write_text(SERIES[kind])
    assert run("new").exit_code == 0
    study = load_study("study.toml")
    assert study.runner().values([0], np.array([[0.3]]))[0] == pytest.approx(
        10.0 * np.exp(-0.3 * times), rel=1e-2
    )
    Path("model.py").write_text("def level(time, rate=0.3):\n    return 10.0 - rate * time\n")
    assert run("new", "--force").exit_code == 0
    assert not tomllib.loads(Path("study.toml").read_text())["simulator"].get("series")
    assert run("new", "--force", "--series").exit_code == 0
    assert tomllib.loads(Path("study.toml").read_text())["simulator"]["series"]
