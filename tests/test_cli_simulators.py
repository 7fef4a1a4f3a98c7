"""Programs and FMUs on the command line: what is told of them, and one message for a mistake."""

import json
import re
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from fmus.build import compiled, python_fmu

from aleator.cli import main
from aleator.simulators.fmu import FMUSimulator

pytestmark = pytest.mark.usefixtures("unreported")

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


def identify(folder: Path, simulator: str, *options: str) -> Result:
    (folder / "study.toml").write_text(STUDY.replace("{simulator}", simulator))
    where = [str(folder / "study.toml"), "--output", str(folder / "out"), "--no-figures"]
    return CliRunner().invoke(main, ["identify", *where, *options])


MISTAKES = {
    "a program that is missing": (COMMAND, "./spring.sh", "./sprng.sh", "'spring.sh'"),
    "one not on the PATH": (COMMAND, "./spring.sh", "spring.sh", "'./spring.sh'"),
    "a file that is no program": (COMMAND, "./spring.sh", "./spring.tpl", "spring.tpl"),
    "a placeholder for nothing": (COMMAND, "{input}", "{force} {stifness}", "'stiffness'"),
    "a format for no number": (COMMAND, "{input}", "{stiffness:3q}", "3q"),
    "a parameter that is not told": (COMMAND, 'template = "spring.tpl"', 'template = "plain.tpl"',
                                     "'stiffness'"),
    "a template that is not there": (COMMAND, '"spring.tpl"', '"spring.tlp"', "spring.tlp"),
    "a template without an input": (COMMAND, 'input = "spring.dat"\n', "", "input"),
    "a regex without a group": (COMMAND, r"(\S+)", r"\S+", "regex"),
    "no time": (COMMAND, "output", "timeout = -1\noutput", "timeout"),
    "a misspelt key": (COMMAND, "template", "templte", "'template'"),
    "an FMU that is not there": (FMU, "Spring.fmu", "Sprng.fmu", "'Spring.fmu'"),
    "a file that is no FMU": (FMU, "Spring.fmu", "spring.tpl", "spring.tpl"),
    "an outcome that the FMU lacks": (FMU, '"travel"', '"travl"', "'travel'"),
    "no outcome": (FMU, 'outcome = {variable = "travel"}', "", "outcome"),
    "no way to reduce": (FMU, '"travel"}', '"travel", reduce = "last"}', "outcome.reduce"),
    "an interface that is not offered": (FMU, "stop_time", 'kind = "model_exchange"\nstop_time',
                                         "model_exchange"),
    "a step beyond the end": (FMU, "stop_time", "step = 2.0\nstop_time", "step"),
    "an output that is set": (FMU, "stop_time", "constants = {travel = 1.0}\nstop_time",
                              "travel"),
    "a name that is not mapped right": (FMU, "stop_time",
                                        'variables = {stifness = "stiffness"}\nstop_time',
                                        "'stifness'"),
}  # fmt: skip


@pytest.mark.parametrize(("simulator", "old", "new", "name"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_one_message_with_file_key_and_remedy(
    folder: Path, simulator: str, old: str, new: str, name: str
) -> None:
    (folder / "plain.tpl").write_text("force = {{force}}\n")
    assert old in simulator
    done = identify(folder, simulator.replace(old, new, 1))
    assert done.exit_code == 2, done.output
    assert done.stderr.count("aleator: error: ") == 1
    assert f"{folder / 'study.toml'}: key 'simulator" in done.stderr
    assert "Remedy: " in done.stderr
    assert name in done.stderr
    assert not (folder / "runs.sqlite").exists()


def test_a_program_that_fails_is_told_by_its_script_and_its_log(folder: Path) -> None:
    (folder / "model.py").write_text("import sys\nsys.exit('the license is gone')\n")
    simulator = 'command = ["python3", "{study}/model.py", "{force}", "{stiffness}"]\nkeep = "none"'
    done = identify(folder, simulator)
    assert done.exit_code == 2
    assert "'python3 model.py'" in done.stderr
    # ten that fail are enough; what is being made beside them ends first
    assert re.search(r"\b(1[0-9]) of \1 runs failed", done.stderr)
    assert "the license is gone" in done.stderr


def test_what_an_fmu_is_given_is_told_with_units(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed: list[str] = []
    close = FMUSimulator.close

    def watched(self: FMUSimulator) -> None:
        if self._engine is not None:
            closed.append(self.name)
        close(self)

    monkeypatch.setattr(FMUSimulator, "close", watched)
    shutil.copy(compiled(2, tmp_path), tmp_path / "cooling.fmu")
    (tmp_path / "springs.csv").write_text("T0,bench,travel\n400,1,313\n400,2,315\n450,1,321\n")
    simulator = """
        fmu = "cooling.fmu"
        stop_time = 1.0
        variables = {stiffness = "surface.k"}
        outcome = {variable = "T"}
    """
    done = identify(tmp_path, simulator)
    assert done.exit_code == 0, done.output
    document = json.loads((tmp_path / "out" / "identification.json").read_text())
    assert document["simulator"].pop("fingerprint")
    assert document["simulator"] == {
        "name": "cooling.fmu",
        "notes": [
            "FMI 2.0, co-simulation from 0 to 1 s in steps of 0.1 s, recorded: T [K]",
            "conditions: T0 [K]",
            "parameters: stiffness = surface.k [1/s]",
            "no variables of the FMU, hence not passed: bench",
        ],
    }
    for note in document["simulator"]["notes"]:
        assert f"aleator: cooling.fmu, {note}\n" in done.stderr
        assert note in " ".join(done.stdout.split())
    assert document["units"] == {"T0": "K", "travel": "K", "stiffness": "1/s"}
    assert "stiffness.mean [1/s]" in done.stdout
    assert closed == ["cooling.fmu"]  # its process ended with the command
