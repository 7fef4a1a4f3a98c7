"""A first study from a table and a simulator: what is recognized, asked and written."""

import importlib.util
import re
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fmus.build import compiled
from scipy import optimize
from studies import done, read, refused, run

from aleator.cli import new as command
from aleator.study import load_study
from aleator.study.proposal import noise_limits

EXAMPLES = Path(__file__).parents[1] / "examples"
pytestmark = pytest.mark.usefixtures("unjudged_commands")


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


def identified() -> dict[str, float]:
    done("identify", "study.toml", "--output", "out", "--no-figures", "--no-verify", "--quiet")
    alpha = read("out/identification.json")["alpha"]
    return {name: value["estimate"] for name, value in alpha.items()}


def test_a_table_and_a_function_with_a_default_are_a_study_that_finds_the_law(folder: Path) -> None:
    springs(folder)
    done("new")
    found = identified()
    assert found["stiffness.mean"] == pytest.approx(2.2, abs=4 * 0.15 / np.sqrt(20))
    assert found["stiffness.sd"] == pytest.approx(0.15, abs=4 * 0.15 / np.sqrt(40))


def test_a_table_of_a_european_spreadsheet_is_read(folder: Path) -> None:
    springs(folder, mark=";")
    done("new")
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
    shown = done("new").output
    assert "48 rows of 12 experiments, named by the column tank" in shown
    found = identified()
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
    shown = done("new", table, "--function", function, "--output", "new.toml").output
    text = Path("new.toml").read_text()
    written = tomllib.loads(text)
    own = tomllib.loads(next(iter(sorted(folder.glob("[!n]*.toml")))).read_text())
    assert written["experiments"]["outcome"] == own["experiments"]["outcome"]
    assert written["experiments"].get("id") == id
    assert written["parameters"].keys() == names
    assert ("sd" in written.get("noise", {})) == (
        "id" in own["experiments"] or "fission" in example
    )
    said = refused("identify", "new.toml")
    for name in names:
        assert f"parameters.{name}.box' is missing" in said
        assert f"parameters.{name}" in shown
    (folder / "new.toml").unlink()
    limits = [f"--parameter={name}=0.2:0.8" for name in names]
    done("new", table, "--function", function, "--output", "new.toml", *limits)
    assert set(load_study("new.toml").inputs.names) == names


def test_a_program_is_found_from_its_placeholders(folder: Path) -> None:
    springs(folder)
    (folder / "spring.py").write_text(
        "import sys\nprint('Springs 2.0')\n"
        "print('travel', float(sys.argv[1]) / float(sys.argv[2]))\n"
    )
    line = "python3 spring.py {force} {stiffness}"
    done("new", "springs.csv", "--command", line, "--parameter", "stiffness=1:3")
    study = load_study("study.toml")
    outcome = study.runner()([0], [[2.0]])
    assert outcome.tolist() == [5.0]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("out.csv", "mode,travel\n1,5.0\n"),
        ("out.json", '{"mode": 1, "travel": 5.0}'),
        ("out.txt", "mode 1\ntravel 5.0\n"),
    ],
)
def test_a_file_that_the_command_names_is_read(folder: Path, name: str, text: str) -> None:
    springs(folder)
    (folder / "spring.sh").write_text(f"cat > $3 <<'END'\n{text}\nEND\n")
    line = f"sh spring.sh {{force}} {{stiffness}} {name}"
    done("new", "springs.csv", "--command", line, "--parameter", "stiffness=1:3")
    assert load_study("study.toml").runner()([0], [[2.0]]).tolist() == [5.0]


@pytest.mark.parametrize(("wrong", "place"), [("-5.1", "line 3"), ("51", "line 3"), ("5.1", "")])
def test_a_wrong_sign_and_a_misplaced_point_are_named(folder: Path, wrong: str, place: str) -> None:
    rows = "".join(f"{force},{force / 2}\n" for force in range(11, 20))
    (folder / "springs.csv").write_text(f"force,travel\n10,5.0\n10.2,{wrong}\n{rows}")
    (folder / "model.py").write_text("def spring(force, stiffness=2.0):\n    return force\n")
    asked = ("--function", "model.py:spring", "--parameter", "stiffness=1:4", "--noise", "0.01")
    said = done("new", "springs.csv", *asked).output
    (folder / "model.py").write_text("def spring(force, stiffness):\n    raise ValueError\n")
    # The command says it before the first run, which fails here.
    for told in (said, refused("identify", "study.toml", "--no-figures")):
        assert ("5.1 would" in told, bool(place) and place in told) == (bool(place), bool(place))


def test_a_mistyped_heading_and_a_copied_name_are_told(folder: Path) -> None:
    springs(folder, "stiffness")
    rows = (folder / "springs.csv").read_text().replace("force", "forse").splitlines()
    named = ["part", *(f"S{k}" for k in range(1, 21))]
    named[5] = "S4"
    lines = [f"{name},{row}" for name, row in zip(named, rows, strict=True)]
    (folder / "springs.csv").write_text("\n".join([*lines, ""]))
    asked = ("new", "springs.csv", "--function", "model.py:spring", "--id", "part")
    told = done(*asked, "--outcome", "travel").output.splitlines()
    assert "'forse' is not used" in told[0]
    (folder / "springs.csv").write_text("\n".join([*lines, ""]).replace("forse", "force"))
    told = done(*asked, "--parameter", "stiffness=1:4", "--noise", "3%", "--force").output
    assert "S4 has 2 rows (line 5, line 6)" in told
    text = Path("study.toml").read_text()
    assert "S4 has 2 rows" in done("check", "study.toml", "--no-figures").output

    # The other law beside the box is ready to be used.
    taken = [one for one in text.splitlines() if not one.startswith(("law = ", "box = "))]
    other = [one.removeprefix("# ") if one.startswith(("# law = ", "# mean = {")) else one
             for one in taken]  # fmt: skip
    Path("study.toml").write_text("\n".join(other))
    (law,) = load_study("study.toml").inputs.hyperparameters[:1]
    assert (law.name, law.lower, law.upper) == ("stiffness.mean", 1.0, 4.0)
    Path("study.toml").write_text(text.replace("relative = 0.03", 'relative = "3%"'))
    assert "relative = 0.03" in refused("check", "study.toml")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(("decades", "log"), [(2.5, False), (4.0, True)])
def test_the_logarithm_is_taken_of_what_spans_many_decades(decades: float, log: bool) -> None:
    count = 10 ** np.linspace(1.0, 1.0 + decades, 12)
    rows = [f"{minutes},{one:.6g},2{minutes}.5" for minutes, one in enumerate(count)]
    Path("counts.csv").write_text("\n".join(["minutes,count,room", *rows, "12,<10,20.0", ""]))
    Path("kill.py").write_text("def survivors(minutes, rate=0.8):\n    return 1e6 * 10**-rate\n")
    done("new", "counts.csv", "--function", "kill.py:survivors")
    found = tomllib.loads(Path("study.toml").read_text())
    assert found["experiments"]["outcome"] == "count"  # it has a bound, the room has none
    assert found["experiments"].get("transform") == ("log" if log else None)


@pytest.mark.usefixtures("folder")
def test_a_censored_value_an_experiment_needs_no_noise() -> None:
    lengths = (0.93, 2.1, 3.2, 3.7, 5.4, 5.8, ">6", 7.6)
    rows = [f"{k},{length}" for k, length in enumerate(lengths, 1)]
    Path("springs.csv").write_text("\n".join(["load,length", *rows, ""]))
    Path("model.py").write_text("def length(load, softness=1.0):\n    return load * softness\n")
    done("new", "springs.csv", "--function", "model.py:length", "--outcome", "length")
    text = Path("study.toml").read_text()
    assert "noise" not in tomllib.loads(text)
    assert '# transform = "log"' in text
    assert "noise.sd" not in identified()
    Path("springs.csv").write_text(Path("springs.csv").read_text().replace(">6", "6+"))
    told = done("new", "springs.csv", "--function", "model.py:length", "--outcome", "length",
                "--force").output  # fmt: skip
    assert "'6+' in line 8" in told


def test_the_variables_of_an_fmu_are_found_by_their_last_name(folder: Path) -> None:
    shutil.copy(compiled(2, folder), folder / "cooling.fmu")
    (folder / "cups.csv").write_text("K;bench;T [K]\n1,0;1;313\n1,0;2;315\n2,0;1;321\n")
    done("new", "--fmu", "cooling.fmu", "--outcome", "T")
    written = tomllib.loads(Path("study.toml").read_text())
    assert written["simulator"]["variables"] == {"K": "surface.k"}
    assert written["experiments"]["conditions"] == ["K"]
    assert "id" not in written["experiments"]  # two benches are not two experiments
    assert written["simulator"]["outcome"] == "T"
    assert "stop_time" not in written["simulator"]
    assert load_study("study.toml").units["K"] == "1/s"
    (folder / "cups.csv").write_text("T0,T\n400,313\n410,314\n420,315\n")
    asked = ["--fmu", "cooling.fmu", "--outcome", "T", "--parameter", "surface.k=0.5:2"]
    done("new", *asked, "--force")
    study = load_study("study.toml")  # names of laws are identifiers
    assert study.inputs.names == ("k",)
    assert study.units == {"T0": "K", "T": "K", "k": "1/s"}
    assert np.isfinite(study.runner()([0], [[1.0]])).all()
    study.close()


@pytest.mark.usefixtures("asked")
def test_what_is_typed_is_taken(folder: Path) -> None:
    springs(folder, "stiffness, mass=1.0")
    answers = ["springs.csv", "model.py:spring", "stiffness=3:1.5", "", "stiffness=1.5-3",
               "stiffness=1.5:3", "-1", "0.3"]  # fmt: skip
    ended = run("new", typed="\n".join([*answers[:5], ""]))
    assert ended.exit_code == 2  # The input ended: nobody pressed Ctrl-C.
    assert "--parameter" not in ended.output
    assert "write stiffness=1.5:3 for limits" in ended.output
    assert ended.output.count("LOW and HIGH") == 1
    assert run("new", typed="\n".join([*answers, ""])).exit_code == 0
    study = load_study("study.toml")
    assert study.inputs.box.tolist() == [[1.5, 3.0]]
    noise = tomllib.loads(Path("study.toml").read_text())["noise"]
    assert noise == {"sd": 0.3}
    words = "new springs.csv --function model.py --parameter stiffness=1.5:3 --yes --force"
    done(*words.split(), "--noise", "0.2")
    assert tomllib.loads(Path("study.toml").read_text())["noise"] == {"sd": 0.2}


def test_a_study_that_is_there_stays_unless_the_user_says_otherwise(folder: Path) -> None:
    springs(folder)
    Path("study.toml").write_text("mine")
    said = refused("new")
    assert "--force" in said
    assert Path("study.toml").read_text() == "mine"
    done("new", "--force")
    assert Path("study.toml").read_text() != "mine"


def spring_table() -> pd.DataFrame:
    """20 springs of the function above, with the heads of a test engineer."""
    rng = np.random.default_rng(4)
    force = np.repeat([10.0, 20.0, 30.0, 40.0], 5)
    travel = (force / rng.normal(2.2, 0.15, force.size)).round(4)
    return pd.DataFrame({"Part": np.arange(1, 21), "Force (N)": force, "Travel [mm]": travel})


@pytest.mark.parametrize("kind", ["xlsx", "parquet"])
def test_a_workbook_and_a_parquet_file_are_read(folder: Path, kind: str) -> None:
    springs(folder)
    frame = spring_table()
    if kind == "xlsx":
        frame.to_excel("springs.xlsx", index=False)
    else:
        frame.to_parquet("springs.parquet")
    (folder / "springs.csv").unlink()
    done("new", "--function", "model.py:spring", "--outcome", "Travel")
    study = load_study("study.toml")
    assert study.experiments.observations.lower.tolist() == frame["Travel [mm]"].tolist()
    assert study.units == {"Travel": "mm", "Force": "N"}
    assert study.runner().values([0], np.array([[2.0]])).ravel().tolist() == [5.0]
    frame["Travel [mm]"] = frame["Travel [mm]"].astype(object)
    frame.loc[3, "Travel [mm]"] = "broken"
    written = frame.to_excel if kind == "xlsx" else frame.astype({"Travel [mm]": str}).to_parquet
    written(f"springs.{kind}", index=False)
    assert "row 5, column 'Travel'" in refused("check", "study.toml")


@pytest.mark.parametrize("kind", ["xlsx", "parquet"])
def test_a_file_without_its_reader_names_the_reader(
    folder: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    springs(folder)
    Path(f"springs.{kind}").write_bytes(b"PK")
    assert "cannot be read" in refused("new", f"springs.{kind}", "--function", "model.py:spring")
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    said = refused("new", f"springs.{kind}", "--function", "model.py:spring")
    assert {"xlsx": "openpyxl", "parquet": "pyarrow"}[kind] in said


def test_columns_of_other_names_reach_the_simulator(folder: Path) -> None:
    springs(folder)
    frame = spring_table().rename(columns={"Force (N)": "Force_N", "Travel [mm]": "way"})
    frame.to_csv("springs.csv", index=False)
    done("new")
    study = load_study("study.toml")
    assert tomllib.loads(Path("study.toml").read_text())["derived"] == {"force": "Force_N"}
    assert study.runner().values([0], np.array([[2.0]])).ravel().tolist() == [5.0]


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("marks", ["{}", "{{}}", "<>"])
def test_the_template_of_an_input_file_is_found_with_its_names(marks: str) -> None:
    """With < and > braces hold an expression of the program itself, as in SPICE."""
    opening, closing = marks[: len(marks) // 2], marks[len(marks) // 2 :]
    beam = f"force {opening}force{closing} modulus {opening}modulus:.9g{closing}"
    Path("beam.tpl").write_text(beam + (" {2 * c}\n" if marks == "<>" else "\n"))
    Path("beam.sh").write_text('#!/bin/sh\nawk \'{print "deflection = " $2 / $4 " mm"}\' "$1"\n')
    Path("beam.sh").chmod(0o755)
    table("force,deflection", [1.0, 2.0, 3.0], [0.5, 0.9, 1.6])
    done("new", "parts.csv", "--command", "./beam.sh {input}", "--parameter", "modulus=1:4")
    study = load_study("study.toml")
    assert study.runner().values([1], np.array([[4.0]])).ravel().tolist() == [0.5]


@pytest.mark.usefixtures("folder")
def test_braces_that_hold_expressions_only_are_no_placeholders() -> None:
    Path("deck.tpl").write_text("R1 in a {2.2n * c}\nC1 a b {c}\n")
    table("force,deflection", [1.0, 2.0, 3.0], [0.5, 0.9, 1.6])
    told = refused("new", "parts.csv", "--command", "ngspice -b {input}")
    assert "2.2n * c" in told
    assert "<NAME>" in told


@pytest.mark.usefixtures("folder")
def test_a_server_is_asked_with_its_inputs_in_their_order() -> None:
    table("load,travel", [1.0, 2.0], [0.5, 0.9])
    address = ["--umbridge", "http://localhost:4242/forward", "--parameter", "k=1:4"]
    done("new", "parts.csv", *address, "--inputs", "load; k, 9.81")
    found = tomllib.loads(Path("study.toml").read_text())["simulator"]
    assert found["inputs"] == [["load"], ["k", 9.81]]
    assert (found["umbridge"], found["model"]) == ("http://localhost:4242", "forward")
    assert load_study("study.toml").experiments.conditions.columns.tolist() == ["load"]
    assert "--inputs" in refused("new", "parts.csv", *address, "--force")


GROUPS = {
    "experiments of a batch": ("batch,load,travel", "none", ("batch",)),
    "a bioreactor of a batch": ("batch,time,travel", "batch", ()),
    "specimens of a batch": ("specimen,batch,load,travel", "specimen", ("batch",)),
    "repeats of a cup": ("cup,warm,travel", "cup", ()),
    "rows that are counted, of cups": ("row,subject,load,travel", "subject", ()),
}


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("case", GROUPS)
def test_experiments_and_their_groups_are_told_apart(case: str) -> None:
    head, id, levels = GROUPS[case]
    k = np.arange(36)
    columns = {
        "batch": k // 6, "specimen": [f"s{one}" for one in k], "cup": [f"c{one // 3}" for one in k],
        "row": k + 1, "subject": [f"p{one // 4}" for one in k], "load": k % 3, "time": k % 6,
        "warm": 20 + k // 18, "travel": (0.1 * (k * 7 % 11) + 1.0).round(3),
    }  # fmt: skip
    table(head, *(columns[name] for name in head.split(",")))
    condition = next(name for name in ("load", "time", "warm") if name in head)
    Path("model.py").write_text(f"def travel({condition}, k=1.0):\n    return k\n")
    done("new", "parts.csv", "--function", "model.py")
    text = Path("study.toml").read_text()
    found = tomllib.loads(text)
    assert found["experiments"].get("id", "none") == id
    assert [name for name in ("batch",) if f'# level = "{name}"' in text] == [*levels]
    assert ("noise" in found) == (id in ("batch", "cup", "subject"))


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("laws", [1, 2])
def test_noise_is_proposed_for_two_outcomes_only_if_one_law_cannot_give_both(laws: int) -> None:
    load = np.arange(1.0, 21.0)
    table("load,way,heat", load, (load / 2.0).round(3), (1.0 + load % 3).round(3))
    Path("model.py").write_text(
        "def stop(load, drag=2.0, loss=1.0):\n    return {'way': load / drag, 'heat': loss}\n"
    )
    chosen = ["--parameter=drag=1:4"] * (laws == 1)
    done("new", "parts.csv", "--function", "model.py", *chosen)
    written = tomllib.loads(Path("study.toml").read_text())
    assert len(written["parameters"]) == laws
    assert ("noise" in written) == (laws == 1)


@pytest.mark.usefixtures("folder")
def test_a_bound_among_two_outcomes_needs_noise_which_is_guessed() -> None:
    load = np.arange(1.0, 21.0)
    way = [f"{x:.3f}" for x in (load / 2.0).tolist()]
    table("load,way,heat", load, [*way[:-1], ">9"], (1.0 + load % 3).round(3))
    Path("model.py").write_text(
        "def stop(load, drag=2.0, loss=1.0):\n    return {'way': load / drag, 'heat': loss}\n"
    )
    shown = done("new", "parts.csv", "--function", "model.py").output
    noise = tomllib.loads(Path("study.toml").read_text())["noise"]
    assert noise["heat"]["sd"] == pytest.approx(0.008)  # 1 % of the scatter
    assert "sd = 0.008 is a guess" in shown


@pytest.mark.usefixtures("folder")
def test_of_four_defaults_one_value_an_experiment_tells_of_one() -> None:
    table("speed,distance", [1.0, 2.0, 3.0], [0.5, 0.9, 1.6])
    Path("model.py").write_text(
        "def distance(speed, friction=0.8, delay=0.2, g=9.81, slope=0.0):\n    return speed\n"
    )
    done("new", "parts.csv", "--function", "model.py")
    assert {*tomllib.loads(Path("study.toml").read_text())["parameters"]} == {"friction"}


@pytest.mark.usefixtures("folder")
def test_rows_without_a_measured_value_are_left_out_and_told() -> None:
    table("load,travel", [1.0, 2.0, 3.0, 4.0], [0.5, "NA", "", 1.6])
    Path("model.py").write_text("def travel(load, k=1.0):\n    return load * k\n")
    shown = done("new", "parts.csv", "--function", "model.py").output
    assert "line 3, line 4" in shown
    assert load_study("study.toml").experiments.observations.lower.tolist() == [0.5, 1.6]


@pytest.mark.usefixtures("asked")
@pytest.mark.parametrize(("answer", "experiments"), [("", 12), ("batch", 3)])
def test_whether_a_batch_is_one_experiment_is_asked(
    folder: Path, answer: str, experiments: int
) -> None:
    springs(folder)
    load = np.arange(12.0)
    table("load,batch,travel", load, np.repeat(["a", "b", "c"], 4), (0.3 + load / 2.0).round(2))
    typed = ["model.py:spring", answer, "force=1:3", *([] if answer else [""])]
    Path("model.py").write_text("def spring(load, force):\n    return load / force\n")
    assert run("new", "parts.csv", typed="\n".join([*typed, ""])).exit_code == 0
    study = load_study("study.toml")
    assert len(study.experiments.ids) == experiments
    assert (study.noise is not None) == (answer == "batch")


SPRINGS = ["springs.csv", "--function", "model.py"]
WRONG = {
    "no table": (["--function", "model.py"], "TABLE.csv"),
    "no simulator": (["springs.csv"], "--function"),
    "two simulators": ([*SPRINGS, "--command", "x {a}"], "contradict"),
    "two outcomes": (["two.csv", "--function", "model.py"], "--outcome"),
    "no such outcome": ([*SPRINGS, "--outcome", "tavel"], "travel"),
    "no such function": (["springs.csv", "--function", "model.py:sprong"], "spring"),
    "no such parameter": ([*SPRINGS, "--parameter", "stifness=1:2"], "stiffness"),
    "limits in the wrong order": ([*SPRINGS, "--parameter", "stiffness=3:1"], "stiffness=1:3"),
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
    said = refused("new", *arguments)
    assert told in said
    assert not Path("study.toml").exists()


@pytest.mark.usefixtures("folder")
def test_a_share_is_the_error_of_each_outcome_and_an_sd_that_of_one() -> None:
    table("force,lower end,upper", *np.arange(1.0, 19.0).reshape(3, 6))
    Path("model.py").write_text("def spring(force, give): return [force * give, force + give]\n")
    asked = ["new", "parts.csv", "--function", "model.py", "--parameter", "give=1:3"]
    asked += ["--outcome", "lower end", "--outcome", "upper"]
    remedy = refused(*asked, "--noise", "0.4")
    for name in ("lower end", "upper"):
        (head,) = re.findall(rf"\[noise\.\"?{name}\"?\]", remedy)
        assert tomllib.loads(head) == {"noise": {name: {}}}
    done(*asked, "--noise", "0.4%")
    noise = tomllib.loads(Path("study.toml").read_text())["noise"]
    assert noise == {name: {"relative": 0.004} for name in ("lower end", "upper")}


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
    shown = done("new").output
    assert "outcome: hours" in shown
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
    shown = done("new").output
    assert "outcome: wear" in shown  # the other numbers are one for each part
    text = Path("study.toml").read_text()
    assert 'mean = "1 + C(maker) + center(warm)"' in text
    Path("study.toml").write_text(text.replace('# mean = "', 'mean = "'))
    found = identified()
    assert found["rate.mean[maker=B]"] == pytest.approx(0.5, abs=0.2)


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
    done("new")
    study = load_study("study.toml")
    assert study.runner().values([0], np.array([[0.3]]))[0] == pytest.approx(
        10.0 * np.exp(-0.3 * times), rel=1e-2
    )
    Path("model.py").write_text("def level(time, rate=0.3):\n    return 10.0 - rate * time\n")
    done("new", "--force")
    assert not tomllib.loads(Path("study.toml").read_text())["simulator"].get("series")
    done("new", "--force", "--series")
    assert tomllib.loads(Path("study.toml").read_text())["simulator"]["series"]


def new(head: str, rows: list[str], *arguments: str) -> None:
    Path("model.py").write_text("def life(rate):\n    return rate\n")
    Path("table.csv").write_text("\n".join([head, *rows, ""]))
    done("new", "table.csv", "--function", "model.py:life", "--yes", *arguments)


@pytest.mark.usefixtures("folder")
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


@pytest.mark.usefixtures("folder")
def test_a_column_of_standard_errors_is_the_noise() -> None:
    """A study of studies, made up: an effect of each trial with its standard error."""
    new(
        "trial,log_rr,se",
        ["1,-0.9,0.5", "2,-1.6,0.4", "3,-1.3,0.6", "4,-1.4,0.1"],
        "--outcome=log_rr",
        "--parameter=rate=-4:4",
    )
    assert tomllib.loads(Path("study.toml").read_text())["noise"] == {"sd": "se"}


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


@pytest.mark.usefixtures("folder")
def test_the_first_look_refuses_what_could_not_be_identified() -> None:
    new("y", ["1.1", "2.3", "2.9"], "--parameter=rate=0:4")
    text = Path("study.toml").read_text().replace("box =", "# box =")
    Path("study.toml").write_text(
        text.replace('law = "truncated_normal"', 'value = {lower = 0, upper = 4}\nlaw = "constant"')
    )
    said = refused("check", "study.toml", "--quiet")
    assert "scatters" in said
    assert not Path("runs.sqlite").exists()
