"""Sections of a study about what was measured: several observations, censoring, noise."""

from pathlib import Path

import numpy as np
import pytest

from aleator.errors import AleatorError
from aleator.laws import Free
from aleator.observations.errors import MeasurementErrors, Noise
from aleator.observations.model import StudentError
from aleator.study import Study, load_study

REST = """
[simulator]
function = "model.py:growth"

[parameters.rate]
law = "normal"
mean = {lower = 0.1, upper = 2}
sd = {lower = 0.01, upper = 1}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "model.py").write_text("def growth(time, rate): return time * rate\n")
    (tmp_path / "wide.csv").write_text(
        "plant,time,height,height_max,status,mass,mass_sd,spare\n"
        "B,1,1.1,,,5.0,0.1,0.1\n"
        "A,1,0.9,1.0,,,,\n"
        "B,2,2.2,,Cut,6.0,0.2,0.1\n"
        "A,2,2.0,,,7.0,0.1,0\n"
    )
    (tmp_path / "long.csv").write_text(
        "plant,time,what,value\nB,1,height,1.1\nB,1,mass,5\nA,2,mass,7\nA,2,height,2\n"
    )
    return tmp_path


def loaded(folder: Path, experiments: str, noise: str) -> Study:
    (folder / "study.toml").write_text(f"[experiments]\n{experiments}\n{REST}\n{noise}\n")
    return load_study(folder / "study.toml")


WIDE = """file = "wide.csv"
id = "plant"
outcomes = ["height", "mass"]
conditions = ["time"]
transform = {mass = "log"}
censored = {height = {column = "status", right = "Cut", upper = "height_max"}}
"""
NOISES = """[noise.height]
sd = {lower = 0.01, upper = 1}
relative = 0.05
[noise.mass]
kind = "student_t"
df = {lower = 2, upper = 30}
sd = "mass_sd"
"""


def test_a_study_with_everything_that_can_be_measured(folder: Path) -> None:
    study = loaded(folder, WIDE, NOISES)
    seen = study.experiments.observations
    assert study.experiments.ids == ("B", "A")
    assert seen.names == ("height", "mass")
    np.testing.assert_allclose(seen.lower, [1.1, np.log(5), 2.2, np.log(6), 0.9, 2.0, np.log(7)])
    np.testing.assert_allclose(seen.upper[[2, 4, 5]], [np.inf, 1.0, 2.0])
    assert study.noise == {
        "height": Noise(Free(0.01, 1.0), relative=0.05),
        "mass": Noise("mass_sd", StudentError(Free(2.0, 30.0))),
    }
    assert study.noise is not None
    errors = MeasurementErrors.of(study.noise, study.experiments)
    assert [h.name for h in errors.hyperparameters] == [
        "noise.height.sd",
        "noise.height.relative",
        "noise.mass.df",
    ]


def test_a_column_that_names_the_response(folder: Path) -> None:
    study = loaded(
        folder,
        'file = "long.csv"\nid = "plant"\noutcome = "value"\nresponse = "what"',
        "[noise.height]\nsd = 1\n[noise.mass]\nsd = 2",
    )
    seen = study.experiments.observations
    assert seen.names == ("height", "mass")
    assert seen.lower.tolist() == [1.1, 5.0, 7.0, 2.0]
    assert list(study.experiments.conditions) == ["time"]


def test_a_column_of_known_sds_is_no_condition(folder: Path) -> None:
    (folder / "known.csv").write_text("time,y,error,remark\n1,1.1,0.1,a\n2,2.2,0.2,b\n")
    study = loaded(folder, 'file = "known.csv"\noutcome = "y"', '[noise]\nsd = "error"')
    assert list(study.experiments.conditions) == ["time", "remark"]
    assert list(study.experiments.table) == ["time", "error", "remark"]
    assert study.noise == Noise("error")


def test_new_conditions_may_be_series(folder: Path) -> None:
    study = loaded(folder, WIDE, NOISES)
    (folder / "new.csv").write_text("plant,time\nX,1\nY,1\nX,2\n")
    new = study.read_conditions(folder / "new.csv")
    assert new.ids == ("X", "Y")
    assert new.experiment.tolist() == [0, 1, 0]
    assert new.observations.names == ("height", "mass")
    assert len(new.observations) == 6
    assert new.responses == study.experiments.observations.responses


PLAIN = 'file = "wide.csv"\nid = "plant"\noutcome = "height"\nconditions = ["time"]'
SD = "[noise]\nsd = 1"
BAD = {
    "no outcome": ('file = "wide.csv"', SD, ["'experiments.outcome' is missing", "outcomes"]),
    "two kinds of outcome": (PLAIN + '\noutcomes = ["mass"]', SD, ["'experiments.outcomes'"]),
    "outcomes that are a text": (
        'file = "wide.csv"\noutcomes = "height"', SD, ["'experiments.outcomes' = \"height\""],
    ),
    "transform of a response": (
        WIDE.replace('"log"', '"ln"'), NOISES, ["'experiments.transform.mass' = \"ln\"", "log"],
    ),
    "transform of nothing": (
        WIDE.replace('{mass = "log"}', '{mess = "log"}'), NOISES, ["'mess'", "'mass'"],
    ),
    "key of censored": (
        WIDE.replace("right", "rigth"), NOISES,
        ["'experiments.censored.height.rigth'", "'right'"],
    ),
    "key of one censored": (
        PLAIN + '\ncensored = {column = "status", rigth = "Cut"}', SD,
        ["'experiments.censored.rigth'", "'right'"],
    ),
    "censored without a column": (
        PLAIN + '\ncensored = {right = "Cut"}', SD, ["'experiments.censored'", "column"],
    ),
    "a word that is not there": (
        PLAIN + '\ncensored = {column = "status", right = "cut"}', SD, ["wide.csv", "'Cut'"],
    ),
    "no sd": (PLAIN, "[noise]\nkind = \"normal\"", ["'noise.sd' is missing", "relative"]),
    "no noise at all": (PLAIN, "[noise]", ["'noise.sd' is missing"]),
    "no sd of a response": (
        WIDE, NOISES.replace('sd = "mass_sd"', ""), ["'noise.mass.sd' is missing"],
    ),
    "sd without limits": (PLAIN, "[noise]\nsd = {}", ["'noise.sd'", "limit"]),
    "relative without limits": (
        WIDE, NOISES.replace("relative = 0.05", "relative = {lower = 0.1}"),
        ["'noise.height.relative'", "limit"],
    ),
    "a response without noise": (
        WIDE, "[noise.height]\nsd = 1", ["'noise'", "'mass'"],
    ),
    "one noise for two responses": (WIDE, SD, ["'noise'", "[noise.height]"]),
    "noise of nothing": (WIDE, NOISES + "[noise.mess]\nsd = 1", ["'mess'", "'mass'"]),
    "no such column of sds": (
        WIDE, NOISES.replace('"mass_sd"', '"mass_ds"'), ["'mass_ds'", "'mass_sd'"],
    ),
    "a known sd of zero": (
        WIDE, NOISES.replace('"mass_sd"', '"spare"'),
        ["wide.csv: row 5, column 'spare'", "experiment 'A'"],
    ),
    "kind of a response": (
        WIDE, NOISES.replace('"student_t"', '"student"'), ["'noise.mass.kind'", "'student_t'"],
    ),
    "df of a normal error": (PLAIN, "[noise]\nsd = 1\ndf = 4", ["'noise.df'", "student_t"]),
    "no df": (PLAIN, '[noise]\nkind = "student_t"\nsd = 1', ["'noise.df' is missing"]),
    "negative df": (PLAIN, '[noise]\nkind = "student_t"\nsd = 1\ndf = -4', ["'noise'", "-4"]),
}  # fmt: skip


@pytest.mark.parametrize(("experiments", "noise", "expected"), BAD.values(), ids=BAD)
def test_mistakes_are_told_with_file_key_and_remedy(
    folder: Path, experiments: str, noise: str, expected: list[str]
) -> None:
    with pytest.raises(AleatorError) as caught:
        loaded(folder, experiments, noise)
    assert caught.value.remedy
    for words in expected:
        assert words in str(caught.value)
