"""The runs that a store keeps, by commands; programs and FMUs, what is told of them."""

import shutil
from pathlib import Path

import pandas as pd
import pytest
from click.testing import Result
from fmus.build import compiled, python_fmu
from studies import done, read, refused, run, springs

from aleator.simulators import Store, records
from aleator.simulators.fmu import FMUSimulator

pytestmark = pytest.mark.usefixtures("unreported", "unjudged_commands")
MODEL = """\
def length(load, bench, softness):
    if softness > 1.45 and load > 3:
        raise ValueError("the spring broke")
    return load * softness
"""
TABLE = "id,load,bench,length\nA,1,007,0.93\nB,2,007,2.1\nC,3,b,3.2\nD,4,c,3.7\nE,5,c,5.4\n"
STORE = Path("springs/runs.sqlite")


def runs(*arguments: object) -> Result:
    return run("runs", *arguments)


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A study of text conditions whose runs are those of its feasible box, some of them failed."""
    study = springs(tmp_path / "springs", model=MODEL)
    study.with_name("springs.csv").write_text(TABLE)
    monkeypatch.chdir(tmp_path)
    done("box", "springs/study.toml", "--quiet")
    return Path("springs/study.toml")


def contents(path: Path = STORE) -> list[records.StoredRun]:
    with Store(path) as store:
        return [*records.stored_runs(store)]


def test_list_tells_runs_and_failures_of_every_simulator(study: Path) -> None:
    kept = contents()
    failed = sum(run.failure is not None for run in kept)
    assert failed
    for target in (study, STORE):
        shown = done("runs", "list", target)
        assert f"{len(kept)}" in shown.output
        assert f"{failed}" in shown.output
        assert ("study's" in shown.output) == (target == study)
    study.with_name("model.py").write_text(MODEL + "# changed\n")
    assert "study's" not in runs("list", study).output


def test_show_has_the_last_runs_the_failures_and_all_of_one(study: Path) -> None:
    failure = next(run for run in contents() if run.failure)
    shown = runs("show", study, "--failures").output
    assert "the spring broke" in " ".join(shown.split())
    assert "load=1" not in shown
    one = runs("show", study, failure.number).output
    assert "model.py, line 3" in " ".join(one.split())
    assert repr(failure.parameters["softness"]) in one
    absent = runs("show", study, 10**9)
    assert absent.exit_code == 2
    assert f"{10**9}" in absent.stderr


def test_an_import_does_not_change_what_is_there(study: Path) -> None:
    runs("export", study, "runs.csv")
    frame = pd.read_csv("runs.csv", dtype=str)
    good = frame.index[frame["outcome"].notna()][0]
    before = contents()
    frame.loc[good, "outcome"] = "123.5"
    frame.to_csv("other.csv", index=False)
    told = runs("import", study, "other.csv")
    assert told.exit_code == 0
    assert "1 of these" in told.output
    assert contents() == before


def test_retry_forgets_the_failures_alone(study: Path) -> None:
    before = contents()
    failed = [run for run in before if run.failure]
    assert f"{len(failed)} failures" in runs("retry", study).output
    assert contents() == [run for run in before if not run.failure]


def test_forget_asks_and_then_forgets_old_fingerprints_or_all(study: Path) -> None:
    first = contents()
    study.with_name("model.py").write_text(MODEL + "# changed\n")
    done("box", study, "--quiet")
    asked = runs("forget", study, "--old")
    assert asked.exit_code == 2
    assert f"{len(first)} runs" in asked.stderr
    assert "--yes" in asked.stderr
    assert len(contents()) == 2 * len(first)
    assert f"{len(first)} runs" in runs("forget", study, "--old", "--yes").output
    left = contents()
    assert len(left) == len(first)
    assert {run.simulator.fingerprint for run in left}.isdisjoint(
        run.simulator.fingerprint for run in first
    )
    assert runs("forget", study, "--fingerprint", "zz", "--yes").exit_code == 0
    assert contents() == left
    assert runs("forget", STORE, "--all", "--yes").exit_code == 0
    assert contents() == []
    for arguments in ((study,), (study, "--old", "--all"), (STORE, "--old")):
        assert runs("forget", *arguments).exit_code == 2


def test_what_cannot_be_done_is_told(study: Path) -> None:
    nowhere = runs("list", "nowhere.sqlite")
    assert nowhere.exit_code == 2
    assert "nowhere.sqlite" in nowhere.stderr
    assert ".xlsx" in runs("export", study, "runs.xlsx").stderr
    Path("runs.csv").touch()
    for wrong in (runs("export", study, "runs.csv"), runs("import", study, "absent.csv")):
        assert wrong.exit_code == 2
        assert wrong.stderr.count("aleator: error: ") == 1
    assert Path("runs.csv").read_text() == ""  # what is there already stays


def test_a_budget_ends_with_a_larger_error_and_the_same_command_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bent = "import math\ndef length(load, softness):\n"
    bent += "    return load * (softness + math.sin(25 * softness) / 12)\n"
    springs(tmp_path / "springs", model=bent)
    monkeypatch.chdir(tmp_path)
    asked = ("identify", "springs/study.toml", "--quiet", "--no-figures", "--output")
    whole = (done(*asked, "whole", "--no-store"), read("whole/identification.json"))[1]
    done(*asked, "few", "--max-runs", 33)
    few = read("few/identification.json")
    assert few["runs"] <= 34
    assert few["surface"]["estimates_error"] > whole["surface"]["estimates_error"]
    off = [
        abs(few["alpha"][name]["estimate"] - one["estimate"]) / one["standard_error"]
        for name, one in whole["alpha"].items()
    ]
    assert max(off) < 2.0 * few["surface"]["estimates_error"]
    done(*asked, "more")
    more = read("more/identification.json")
    assert more.pop("seconds").keys() == whole.pop("seconds").keys()
    assert more == whole


# ------------------------------------------------------------------------------ programs and FMUs

STUDY = """\
[experiments]
file = "springs.csv"
outcome = "travel"
[simulator]
{simulator}
[parameters.stiffness]
law = "truncated_normal"
box = [1.0, 3.0]
[search]
starts = 1
[verification]
samples = 0
"""
SPRING = Path(__file__).parents[1] / "examples" / "command_springs"
COMMAND = """\
command = ["./spring.sh", "{input}"]
template = "spring.tpl"
input = "spring.dat"
delimiters = ["{{", "}}"]
output = {file = "result.txt", regex = 'travel = (\\S+)'}
"""
FMU = """\
fmu = "Spring.fmu"
stop_time = 1.0
outcome = {variable = "travel"}
"""


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return python_fmu(
        Path(__file__).parent / "fmus" / "spring.py", tmp_path_factory.mktemp("spring")
    )


@pytest.fixture
def folder(fmu: Path, tmp_path: Path) -> Path:
    for name in ("springs.csv", "spring.sh", "spring.tpl"):
        shutil.copy(SPRING / name, tmp_path)
    shutil.copy(fmu, tmp_path)
    return tmp_path


def asked(folder: Path, simulator: str) -> tuple[str, ...]:
    (folder / "study.toml").write_text(STUDY.replace("{simulator}", simulator))
    return "identify", str(folder / "study.toml"), "--output", str(folder / "out"), "--no-figures"


MISTAKES = {
    "a program that is missing": (COMMAND, "./spring.sh", "./sprng.sh", "'spring.sh'"),
    "a placeholder for nothing": (COMMAND, "{input}", "{force} {stifness}", "'stiffness'"),
    "a template without an input": (COMMAND, 'input = "spring.dat"\n', "", "input"),
    "no time": (COMMAND, "output", "timeout = -1\noutput", "timeout"),
    "an FMU that is not there": (FMU, "Spring.fmu", "Sprng.fmu", "'Spring.fmu'"),
    "an outcome that the FMU lacks": (FMU, '"travel"', '"travl"', "'travel'"),
    "no outcome": (FMU, 'outcome = {variable = "travel"}', "", "outcome"),
    "a name that is not mapped right": (FMU, "stop_time",
                                        'variables = {stifness = "stiffness"}\nstop_time',
                                        "'stifness'"),
}  # fmt: skip


@pytest.mark.parametrize(("simulator", "old", "new", "name"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_one_message_with_file_key_and_remedy(
    folder: Path, simulator: str, old: str, new: str, name: str
) -> None:
    assert old in simulator
    said = refused(*asked(folder, simulator.replace(old, new, 1)))
    assert f"{folder / 'study.toml'}: key 'simulator" in said
    assert "Remedy: " in said
    assert name in said
    assert not (folder / "runs.sqlite").exists()


def test_what_an_fmu_is_given_is_told_with_units(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed: list[str] = []
    close = FMUSimulator.close
    monkeypatch.setattr(FMUSimulator, "close", lambda self: (closed.append(self.name), close(self)))
    shutil.copy(compiled(2, tmp_path), tmp_path / "cooling.fmu")
    (tmp_path / "springs.csv").write_text("T0,bench,travel\n400,1,313\n400,2,315\n450,1,321\n")
    simulator = """
        fmu = "cooling.fmu"
        stop_time = 1.0
        variables = {stiffness = "surface.k"}
        outcome = {variable = "T"}
    """
    shown = done(*asked(tmp_path, simulator))
    document = read(tmp_path / "out" / "identification.json")
    assert document["simulator"].pop("fingerprint")
    assert document["simulator"] == {
        "name": "cooling.fmu",
        "defaults": {},
        "notes": [
            "FMI 2.0, co-simulation from 0 to 1 s in steps of 0.1 s, recorded: T [K]",
            "conditions: T0 [K]",
            "parameters: stiffness = surface.k [1/s]",
            "no variables of the FMU, hence not passed: bench",
        ],
    }
    for note in document["simulator"]["notes"]:
        assert f"aleator: cooling.fmu, {note}\n" in shown.stderr
        assert note in " ".join(shown.stdout.split())
    assert document["units"] == {"T0": "K", "travel": "K", "stiffness": "1/s"}
    assert "stiffness.mean [1/s]" in shown.stdout
    assert "cooling.fmu" in closed  # its process ended with the command
