"""What is wrong with an FMU is told before it runs; the wet clutch as an FMU is its function."""

import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fmus.build import compiled, python_fmu, rewritten

from aleator.errors import SimulatorError
from aleator.simulators import RunFailed
from aleator.simulators.derived import parse
from aleator.simulators.fmu import (
    Course,
    Crossing,
    Extreme,
    Final,
    FMUSimulator,
    Hook,
    Operation,
    Signal,
    read_signal,
)
from aleator.simulators.fmu.description import read_description
from aleator.study import load_study
from aleator.study.simulators import signals
from examples.wet_clutch.model import shifting_time

K = {"k": "surface.k"}
RAMP = Signal(np.array([0.0, 2.0]), np.array([300.0, 400.0]))


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(2, tmp_path_factory.mktemp("fmus"))


def test_a_file_that_is_no_fmu_is_told(fmu: Path, tmp_path: Path) -> None:
    (tmp_path / "clutch.fmu").write_text("no zip file")
    with pytest.raises(SimulatorError, match=r"'clutch\.fmu'"):
        FMUSimulator(tmp_path / "cluth.fmu", Final("T"))
    with pytest.raises(SimulatorError, match="is not an FMU"):
        FMUSimulator(tmp_path / "clutch.fmu", Final("T"))
    with zipfile.ZipFile(tmp_path / "empty.fmu", "w") as archive:
        archive.writestr("readme.txt", "")
    with pytest.raises(SimulatorError, match="is not an FMU"):
        FMUSimulator(tmp_path / "empty.fmu", Final("T"))
    broken = rewritten(fmu, tmp_path / "broken.fmu", "<ModelVariables>", "<ModelVariables")
    with pytest.raises(SimulatorError, match="model description of this FMU cannot be read"):
        FMUSimulator(broken, Final("T"))


def test_an_fmu_that_cannot_run_here_is_told(fmu: Path, tmp_path: Path) -> None:
    old = rewritten(fmu, tmp_path / "old.fmu", 'fmiVersion="2.0"', 'fmiVersion="1.0"')
    with pytest.raises(SimulatorError, match=r"FMI 1\.0"):
        FMUSimulator(old, Final("T"))
    here = read_platform()
    elsewhere = {"linux64": ("win64", ".dll"), "win64": ("linux64", ".so")}.get(here)
    if elsewhere is not None:
        other, suffix = elsewhere
        moved = rewritten(fmu, tmp_path / "step.fmu", f"binaries/{here}/", f"binaries/{other}/")
        moved = rewritten(moved, tmp_path / "moved.fmu", "cooling.so", f"cooling{suffix}")
        with pytest.raises(SimulatorError, match=f"no binaries for {here}, only for {other}"):
            FMUSimulator(moved, Final("T"))
    source = rewritten(
        fmu, tmp_path / "source.fmu", f"binaries/{here}/cooling.so", "sources/cooling.c"
    )
    with pytest.raises(SimulatorError, match="C sources, but no binaries"):
        FMUSimulator(source, Final("T"))


def read_platform() -> str:
    import fmpy

    return str(fmpy.platform)


def test_a_library_that_cannot_be_loaded_is_told_at_the_first_run(
    fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    here = Path.cwd()
    bad = tmp_path / "bad.fmu"
    with zipfile.ZipFile(fmu) as archive, zipfile.ZipFile(bad, "w") as copy:
        for name in archive.namelist():
            copy.writestr(name, b"junk" if name.endswith(".so") else archive.read(name))
    for isolated in (True, False):
        simulator = FMUSimulator(bad, Final("T"), operation=Operation(isolated=isolated))
        with pytest.raises(SimulatorError, match=r"bad.fmu cannot be instantiated: .*library"):
            simulator.run_one({}, {})
        assert list(tmp_path.glob("aleator_fmu_*")) == []
        assert Path.cwd() == here


def test_without_fmpy_the_package_is_named(fmu: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(SimulatorError, match="pip install fmpy"):
        FMUSimulator(fmu, Final("T"))


@pytest.mark.parametrize(
    ("conditions", "parameters", "variables", "message"),
    [
        ([], ["surfac.k"], {}, r"'surfac\.k'.*'surface\.k'"),
        ([], ["level"], {"k": "surface.k"}, "'k'"),
        (["T"], ["level"], {}, r"'T'.*output.*in K"),
        (["gas"], ["level"], {}, "'gas'"),
        (["der(T)"], ["level"], {}, r"'der\(T\)'"),
        ([], ["cycles"], {}, "'cycles'"),
        ([], ["level"], {}, None),
        (["level"], ["level"], {}, "'level'"),
        (["T0"], ["k"], {"k": "T0"}, "given already"),
        (["ambient"], ["level"], {}, "given already"),
    ],
)
def test_names_are_checked(
    fmu: Path,
    conditions: list[str],
    parameters: list[str],
    variables: dict[str, str],
    message: str | None,
) -> None:
    simulator = FMUSimulator(fmu, Final("T"), variables=variables, inputs={"ambient": RAMP})
    if message is None:
        assert simulator.asks(conditions, parameters) == ()
        return
    with pytest.raises(SimulatorError, match=message):
        simulator.asks(conditions, parameters)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"variables": {"k": "surface.q"}}, r"'surface\.q'.*'surface\.k'"),
        ({"variables": {"temperature": "T"}}, "'T'"),
        ({"variables": {"a": "gas"}}, "'gas'"),
        ({"variables": {"a": "T0", "b": "T0"}}, "'T0'"),
        ({"variables": {"a": "T0"}, "constants": {"T0": 1.0}}, "'T0'"),
        ({"constants": {"levl": 1.0}}, r"'levl'.*'level'"),
        ({"constants": {"T": 1.0}}, "'T'"),
        ({"constants": {"cycles": 1.5}}, "'cycles'"),
        ({"constants": {"T0": -1.0}}, "'T0'"),
        ({"inputs": {"T0": RAMP}}, "'T0'"),
        ({"inputs": {"ambient": RAMP}, "constants": {"ambient": 1.0}}, "'ambient'"),
        ({"course": Course(stop_time=-1.0)}, "-1"),
        ({"course": Course(step=3.0)}, "2 s"),
        ({"course": Course(tolerance=2.0)}, "tolerance"),
    ],
)
def test_settings_are_checked(fmu: Path, given: dict[str, object], message: str) -> None:
    with pytest.raises(SimulatorError, match=message):
        FMUSimulator(fmu, Final("T"), **given)  # type: ignore[arg-type]


def test_what_the_fmu_cannot_do_is_told(fmu: Path, tmp_path: Path) -> None:
    only = rewritten(fmu, tmp_path / "only.fmu", '<ModelExchange modelIdentifier="cooling"/>', "")
    with pytest.raises(SimulatorError, match="does not offer model_exchange, only co_simulation"):
        FMUSimulator(only, Final("T"), course=Course(kind="model_exchange"))
    fixed = compiled(2, tmp_path, step_sizes=False)
    with pytest.raises(SimulatorError, match=r"steps of one length only.*3.33333 steps of 0.6 s"):
        FMUSimulator(fixed, Final("T"), course=Course(step=0.6))
    FMUSimulator(fixed, Final("T"), course=Course(step=0.5))
    endless = rewritten(fmu, tmp_path / "endless.fmu", 'stopTime="2"', "")
    with pytest.raises(SimulatorError, match="does not say how long"):
        FMUSimulator(endless, Final("T"))
    for bad in ({"recycle": 0}, {"timeout": 0.0}, {"timeout": 1.0, "isolated": False}):
        with pytest.raises(SimulatorError):
            Operation(**bad)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("outcome", "message"),
    [
        (Final("temperature"), "'temperature'"),
        (Final("level +"), r"level \+"),
        (Final("T @ level"), "T @ level"),
        (Final("T if below else level"), "T if below else level"),
        (Final("levle - T"), r"'levle'.*'level'"),
        (Final("label"), "label"),
        (Hook("absent.py:f"), r"absent\.py"),
        (Hook("numpy:ptp", ("temp",)), "'temp'"),
        (Hook("numpy:ptp", ("label",)), "label"),
    ],
)
def test_outcomes_are_checked(fmu: Path, outcome: Final, message: str) -> None:
    with pytest.raises(SimulatorError, match=message):
        FMUSimulator(fmu, outcome)


def test_expressions_have_the_precedence_of_arithmetic() -> None:
    values = {"a.b[1]": np.array([2.0, 3.0]), "der(x)": np.array([5.0, 7.0]), "my name": np.ones(2)}
    known = list(values)
    a, d = values["a.b[1]"], values["der(x)"]
    for text, expected in (
        ("a.b[ 1 ] + 2*der(x)**2", a + 2 * d**2),
        ("-(a.b[1] - der(x)) / 4", -(a - d) / 4),
        ("my name", values["my name"]),
        ("2**-a.b[1]", 2.0**-a),
    ):
        assert np.array_equal(parse(text, known)(values), expected)
    assert parse("3.0", known)(values) == 3.0


def test_a_crossing_takes_the_first_one_in_its_direction() -> None:
    time = np.linspace(0.0, 10.0, 201)
    wave = {"time": time, "y": np.sin(time)}
    for crossing, expected in (
        (Crossing("y", 0.0), np.pi),  # it begins at 0, and has not crossed it there
        (Crossing("y", 0.0, "down"), np.pi),
        (Crossing("y", 0.0, "up"), 2.0 * np.pi),
        (Crossing("y", 0.0, "any", after=4.0), 2.0 * np.pi),
        (Crossing("y", 0.5, "up"), np.pi / 6.0),
        (Crossing("y", 0.5, "down", after=3.0), 5.0 * np.pi / 6.0 + 2.0 * np.pi),
        (Crossing("-2*y", 1.0, "up"), 7.0 * np.pi / 6.0),
    ):
        assert crossing(wave) == pytest.approx(expected, abs=1e-6)
    jump = {"time": np.array([0.0, 1.0, 1.0, 2.0, 3.0]), "y": np.array([0.0, 0.0, 1.0, 1.0, 1.0])}
    assert Crossing("y", 0.5)(jump) == 1.0
    with pytest.raises(RunFailed, match="goes from 0 to 1"):
        Crossing("y", 0.5, "down")(jump)
    with pytest.raises(RunFailed):
        Crossing("y", 0.0)({"time": time, "y": np.full_like(time, np.nan)})
    assert np.isnan(Extreme("y")({"time": time, "y": np.full_like(time, np.nan)}))


def test_signals_are_read_from_csv(fmu: Path, tmp_path: Path) -> None:
    (tmp_path / "drive.csv").write_text("time,ambient,other\n0,300,1\n1,310,2\n1,320,2\n")
    signal = read_signal("drive.csv:other", tmp_path, "ambient")
    assert signal.values.tolist() == [1.0, 2.0, 2.0]
    description = read_description(fmu)
    (only,) = signals({"*": "drive.csv"}, tmp_path, description).items()
    assert only[0] == "ambient"
    assert only[1].values.tolist() == [300.0, 310.0, 320.0]
    for text, reference, message in (
        ("time,ambient\n0,1\n", "drive.csv:ambiant", "no column 'ambiant' .did you mean"),
        ("t,ambient\n0,1\n", "drive.csv:ambient", "no column 'time'"),
        ("time,ambient\n0,1\n1,x\n", "drive.csv:ambient", "line 3, column 'ambient' is not"),
        ("time,ambient\n1,1\n0,1\n", "drive.csv", "is empty or decreases"),
        ("", "drive.csv", "cannot be read as a CSV"),
        ("", "drive2.csv", "does not exist"),
    ):
        (tmp_path / "drive.csv").write_text(text)
        with pytest.raises(SimulatorError, match=message):
            read_signal(reference, tmp_path, "ambient")
    (tmp_path / "drive.csv").write_text("time,x\n0,1\n")
    with pytest.raises(SimulatorError, match="no column has the name of an input"):
        signals({"*": "drive.csv"}, tmp_path, description)


STUDY = """
[experiments]
file = "table.csv"
outcome = "cooled"
[simulator]
fmu = "cooling2.fmu"
{keys}
[parameters.k]
law = "truncated_normal"
box = [0.5, 2.0]
"""


def study(fmu: Path, keys: str) -> Path:
    pd.DataFrame({"T0": [400.0, 500.0], "cooled": [1.0, 2.0]}).to_csv(
        fmu.parent / "table.csv", index=False
    )
    path = fmu.parent / "study.toml"
    path.write_text(STUDY.format(keys=keys))
    return path


def test_a_study_names_an_fmu(fmu: Path) -> None:
    keys = """
    stop_time = 1.0
    kind = "model_exchange"
    variables = {k = "surface.k"}
    constants = {insulated = false, label = "plain", trap = "none"}
    outcome = {variable = "T - ambient", reduce = "crossing", value = 50.0, direction = "down"}
    """
    loaded = load_study(study(fmu, keys))
    found = loaded.runner()([0, 1], [[1.0], [2.0]])
    assert found == pytest.approx([np.log(2.0), np.log(4.0) / 2.0], abs=1e-6)
    loaded.simulator.close()  # type: ignore[attr-defined]


EXAMPLE = Path(__file__).parents[2] / "examples" / "wet_clutch"


@pytest.fixture(scope="module")
def clutch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clutch")
    return python_fmu(EXAMPLE / "fmu" / "wet_clutch.py", folder, EXAMPLE / "command" / "clutch.py")


@pytest.fixture(scope="module")
def clutch_table() -> pd.DataFrame:
    return pd.read_csv(EXAMPLE / "experiments.csv", dtype={"id": str})


@pytest.fixture(scope="module")
def clutch_simulator(clutch: Path) -> Iterator[FMUSimulator]:
    clutch_simulator = FMUSimulator(
        clutch, Crossing("slip", 0.0, "down"), course=Course(step=0.005)
    )
    yield clutch_simulator
    clutch_simulator.close()


def test_the_fmu_has_the_shifting_times_of_the_function(
    clutch_simulator: FMUSimulator, clutch_table: pd.DataFrame
) -> None:
    random = np.random.default_rng(0)
    rows = random.integers(0, len(clutch_table), 20)
    conditions = {name: clutch_table[name].to_numpy()[rows] for name in clutch_table.columns[1:6]}
    parameters = {
        "c2_scale": random.uniform(0.5, 1.4, 20),
        "zp_scale": random.uniform(0.3, 1.2, 20),
    }
    expected = shifting_time(**conditions, **parameters)
    assert clutch_simulator.asks([*clutch_table.columns], [*parameters]) == tuple(conditions)
    found = clutch_simulator(conditions, parameters)
    assert np.max(np.abs(found - expected)) < 1e-5
    assert np.median(np.abs(found - expected)) < 1e-7
    assert clutch_simulator.notes == ()
