"""A study file becomes the values of the library; what is wrong with it is told with its key."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from aleator.errors import AleatorError, ExperimentsError, SimulatorError, StudyError
from aleator.inference.outcome_question import Tolerance
from aleator.laws import (
    Beta,
    By,
    Constant,
    Free,
    Gamma,
    Law,
    LogNormal,
    Normal,
    ScipyLaw,
    TruncatedNormal,
    Uniform,
)
from aleator.laws.quadrature import Smolyak, SobolPoints, TensorGauss
from aleator.moments.densities import Gaussian
from aleator.moments.expansion import Hyperbolic, TotalDegree
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.moments.projection import Projection, Regression
from aleator.moments.propagation import Collocation
from aleator.observations.correlated import AR1, CAR1, CompoundSymmetry
from aleator.observations.errors import MeasurementErrors
from aleator.observations.experiments import Conditions
from aleator.observations.model import StudentError
from aleator.observations.noise import Noise
from aleator.observations.state_space import GaussianProcess
from aleator.observations.variance import ExponentialVariance, PowerVariance
from aleator.search import GradientMultistart
from aleator.study import Study, load_study
from aleator.surrogates import ResponseSurface

STUDY = """\
title = "Springs"
seed = 3

[experiments]
file = "springs.csv"
outcome = "length"

[simulator]
function = "model.py:length"

[parameters.stiffness]
law = "truncated_normal"
box = [0.5, 1.5]
mean = {lower = 0.6, upper = 1.4, start = 1.0}
sd = {lower = 0.005, upper = 0.3}

[parameters.offset]
law = "constant"
value = {lower = -2, upper = 2, start = 0}

[noise]
sd = {lower = 0.01, upper = 2.0}

[density]
kind = "maximum_entropy"
order = 4

[search]
starts = 7

[verification]
samples = 100
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "springs.csv").write_text(
        "id,load,length\nA,1,1.1\nB,2,1.9\nC,3,3.2\nD,4,4.1\nE,5,4.8\nF,6,6.3\n"
    )
    (tmp_path / "model.py").write_text(
        "def length(load, stiffness, offset): return offset + load / stiffness\n"
    )
    return tmp_path


def loaded(folder: Path, text: str = STUDY) -> Study:
    path = folder / "study.toml"
    path.write_text(text)
    return load_study(path)


def changed(old: str, new: str) -> str:
    assert re.search(old, STUDY, re.MULTILINE), old
    return re.sub(old, new, STUDY, count=1, flags=re.MULTILINE)


def test_a_study_becomes_the_library_values(folder: Path) -> None:
    study = loaded(folder)
    assert (study.title, study.seed, len(study.sha256)) == ("Springs", 3, 64)
    assert study.experiments.ids == (*"ABCDEF",)
    assert study.inputs.laws == {
        "stiffness": TruncatedNormal((0.5, 1.5), Free(0.6, 1.4, 1.0), Free(0.005, 0.3)),
        "offset": Constant(Free(-2.0, 2.0, 0.0)),
    }
    assert study.noise is not None
    assert study.noise.sd == Free(0.01, 2.0)
    assert study.density == MaximumEntropy(4)
    assert study.search == GradientMultistart(7)
    assert study.verification.samples == 100
    assert isinstance(study.propagation, ResponseSurface)
    assert study.simulator.vectorized is None  # one trial decides
    assert [h.name for h in study.model.hyperparameters] == [
        "stiffness.mean", "stiffness.sd", "offset.value",
    ]  # fmt: skip


def test_the_least_study_has_defaults_for_the_rest(folder: Path) -> None:
    text = STUDY[STUDY.index("[experiments]") : STUDY.index("mean =")]
    text += '[parameters.offset]\nlaw = "constant"\nvalue = 0\n'
    study = loaded(folder, text)
    assert (study.title, study.seed, study.noise) == ("", 0, None)
    assert study.inputs.laws["offset"] == Constant(0.0)
    assert study.density is None
    assert study.model.density is None
    assert study.search.starts == 10
    assert study.verification.samples is None


def test_other_choices(folder: Path) -> None:
    text = changed(r'"maximum_entropy"\norder = 4', '"gaussian"')
    text = text.replace("[search]", '[propagation]\nmethod = "collocation"\nnodes = 5\n[search]')
    text = text.replace('law = "truncated_normal"\nbox = [0.5, 1.5]', 'law = "normal"')
    study = loaded(folder, text)
    assert study.density == Gaussian()
    assert study.propagation == Collocation(nodes=5)
    assert study.inputs.laws["stiffness"] == Normal(Free(0.6, 1.4, 1.0), Free(0.005, 0.3))


def test_questions_are_about_one_new_experiment_each(folder: Path) -> None:
    text = changed(r"\[search\]", asking("probability = '3 < length <= 4'\nnoise = false"))
    text += "[[questions]]\ntolerance = [0.95, 0.9]\nside = 'lower'\nat = {load = 2.5}\n"
    event, limits = loaded(folder, text).questions
    assert (event.probability, event.noise, event.limits) == ("3 < length <= 4", False, None)
    assert limits.limits == Tolerance(0.95, 0.9, "lower")
    assert isinstance(limits.at, Conditions)
    assert limits.at.conditions["load"].tolist() == [2.5]
    assert loaded(folder).questions == ()
    text = changed(r"\[search\]", asking("probability = 'stiffness > 1'", ""))
    (share,) = loaded(folder, text).questions
    assert isinstance(share.at, Conditions)
    assert share.at.table.shape == (1, 0)


def test_the_command_line_overrides(folder: Path) -> None:
    study = loaded(folder).overridden(seed=9, starts=2, verified=False)
    assert (study.seed, study.search.starts, study.verification.samples) == (9, 2, 0)
    same = loaded(folder).overridden()
    assert (same.seed, same.search.starts, same.verification.samples) == (3, 7, 100)


def test_new_conditions_are_read_as_the_table_was(folder: Path) -> None:
    study = loaded(folder)
    new = folder / "new.csv"
    new.write_text("load,remark,id\n10,,X\n")
    assert study.read_conditions(new).ids == ("X",)
    assert study.runner(study.read_conditions(new))([0], [[2.0, 1.0]]).tolist() == [6.0]
    new.write_text("laod\n10\n")
    with pytest.raises(ExperimentsError, match=r"'load'.*'laod'"):
        study.read_conditions(new)


def asking(what: str, at: str = "load = 1") -> str:
    """A question in front of the section `[search]`."""
    return f"[[questions]]\n{what}\nat = {{{at}}}\n[search]"


BAD = {
    "unknown key": ("outcome", "outcom", ["'experiments.outcom'", "'outcome'"]),
    "unknown section": (r"\[noise\]", "[noize]", ["'noize'", "'noise'"]),
    "missing key": (r'^outcome = "length"\n', "", ["'experiments.outcome'"]),
    "missing box": (r"\nbox = .*", "", ["'parameters.stiffness.box'", "[LOWER, UPPER]"]),
    "text for a number": ("seed = 3", 'seed = "3"', ["'seed' = \"3\"", "without quotes"]),
    "bounds in disorder": ("lower = 0.6", "lower = 1.6", [".stiffness.mean'", "1.4, 1.6"]),
    "start above": ("start = 1.0", "start = 3", ["stiffness.mean'", "3", "1.4"]),
    "box in disorder": (r"\[0.5, 1.5\]", "[1.5, 0.5]", ["stiffness'", "1.5", "0.5, 1.5"]),
    "unknown law": ('"constant"', '"constnt"', ["offset.law'", "'constant'"]),
    "limits of a constant": ("value = ", "limits = ", [".offset.limits'", "value = {lower ="]),
    "a list for limits": (r"\{lower = 0.6.*\}", "[0.6, 1.4]", ["mean = {lower"]),
    "key of a law": ("value = ", "vlue = ", ["'parameters.offset.vlue'", "mean 'value'"]),
    "sd below zero": ("lower = 0.005", "lower = -1", ["parameters.stiffness", "sd", "-1.0"]),
    "noise without bounds": (r"lower = 0.01, upper = 2.0", "", ["'noise.sd'", "lower", "upper"]),
    "order": ("order = 4", "order = 99", ["'density'", "99"]),
    "transform": ('"length"\n', '"length"\ntransform = "ln"\n', ['transform\' = "ln"', "log"]),
    "method": (r"\[search\]", '[propagation]\nmethod="x"\n[search]', ["propagation.method' = \"x"]),
    "parameter name": (r"parameters\.offset", 'parameters."off set"', ["off set"]),
    "no file": ("springs.csv", "spring.csv", ["spring.csv", "'springs.csv'"]),
    "no module": ("model.py", "modle.py", ["'simulator.function'", "'model.py'"]),
    "no function": (":length", ":lenth", ["'simulator.function'", "'length'"]),
    "no argument": (r"parameters\.offset", "parameters.ofset", ["'ofset'", "'offset'"]),
    "toml": ("seed = 3", "seed = ", ["not TOML", "line 2", "'seed ='"]),
    "no such event": (r"\[search\]", asking("probability = 'lenth > 3'"), ["s[0]'", "'length'"]),
    "no such limits": (r"\[search\]", asking("tolerance = [95, 0.9]"), ["questions[0]'", "95"]),
    "one table of questions": (r"\[search\]", "[questions]\ntolerance = [0.95, 0.9]\n[search]",
                               ["'questions'", "write [[questions]]"]),
    "no table of conditions": (r"\[search\]", asking("tolerance = [0.9, 0.9]").replace("{", "1#"),
                               ["questions[0].at'", "write at = {"]),
    "a table as a condition": (r"\[search\]", asking("tolerance = [0.9, 0.9]", "load = {a = 1}"),
                               ["questions[0].at.load'", "is a table", "write a number"]),
    "nothing asked": (r"\[search\]", asking("noise = false"), ["questions[0]'", "> 26"]),
    "both asked": (r"\[search\]", asking("probability = 'length > 3'\ntolerance = [0.9, 0.9]"),
                   ["questions[0]'", "both"]),
    "no condition": (r"\[search\]", asking("probability = 'length > 3'", "laod = 1"),
                     ["questions[0].at'", "'load'"]),
    "a condition lacks": (r"\[search\]", asking("probability = 'length > 3'", ""),
                          ["questions[0].at'", "load=..."]),
    "a text for a condition": (r"\[search\]", asking("probability = 'length > 3'", "load = 'x'"),
                               ["questions[0].at'", "'x'"]),
    "two values": (r"\[search\]", asking("probability = 'length > 3'", "load = [1, 2]"),
                   ["questions[0].at.load'", "is a list"]),
    "a key of a question": (r"\[search\]", asking("event = 'length > 3'"),
                            ["questions[0].event'", "probability"]),
}  # fmt: skip


@pytest.mark.parametrize(("old", "new", "expected"), BAD.values(), ids=BAD)
def test_mistakes_are_told_with_file_key_and_remedy(
    folder: Path, old: str, new: str, expected: list[str]
) -> None:
    with pytest.raises(AleatorError) as caught:
        loaded(folder, changed(old, new))
    assert isinstance(caught.value, (StudyError, ExperimentsError, SimulatorError))
    assert caught.value.remedy
    message = str(caught.value)
    for words in expected:
        assert words in message
    assert "\n\n" not in message
    assert "pydantic" not in message.lower()


PROPAGATIONS = {
    'method = "collocation"\nnodes = {rule = "sobol", points = 64, seed = 3}': Collocation(
        nodes=SobolPoints(64, 3)
    ),
    'method = "collocation"\nnodes = {rule = "smolyak", level = 2}': Collocation(nodes=Smolyak(2)),
    'method = "collocation"\nfit = "regression"\ndegree = 2': Collocation(
        fit=Regression(TotalDegree(2), adaptive=False)
    ),
    'method = "collocation"\nfit = "projection"\ndegree = 3\nterms = "hyperbolic"': Collocation(
        fit=Projection(Hyperbolic(3))
    ),
    'nodes = {rule = "gauss", per_dimension = 9}': ResponseSurface(nodes=TensorGauss(9)),
    "nodes = 7": ResponseSurface(nodes=7),
}


@pytest.mark.parametrize("keys", PROPAGATIONS)
def test_the_study_chooses_nodes_and_expansions(folder: Path, keys: str) -> None:
    text = STUDY.replace("[search]", f"[propagation]\n{keys}\n[search]")
    (folder / "study.toml").write_text(text)
    assert load_study(folder / "study.toml").propagation == PROPAGATIONS[keys]


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ('nodes = {rule = "sobol", level = 2}', r"nodes\.level'.*no meaning"),
        ('nodes = {rule = "sobol"}', r"nodes\.points' is missing"),
        ('nodes = {rule = "sobol", points = 100}', "powers of two"),
        ('method = "collocation"\nfit = "regression"', "lacks degree"),
        ('method = "collocation"\nterms = "hyperbolic"', "no meaning without fit"),
        ('method = "collocation"\nnodes = 5\nfit = "regression"\ndegree = 2', "of its own"),
    ],
)
def test_nodes_and_expansions_that_do_not_fit_are_one_message(
    folder: Path, keys: str, words: str
) -> None:
    text = STUDY.replace("[search]", f"[propagation]\n{keys}\n[search]")
    (folder / "study.toml").write_text(text)
    with pytest.raises(StudyError, match=words):
        load_study(folder / "study.toml")


@pytest.mark.parametrize("line", ["noise = 0.1", "parameters = 3", "propagation = [1]"])
def test_a_section_is_a_table(folder: Path, line: str) -> None:
    name = line.partition(" ")[0]
    text = re.sub(rf"\[{name}[^\]]*\]\n([^\[\n].*\n)*", "", STUDY)
    with pytest.raises(StudyError, match=f"'{name}' = "):
        loaded(folder, f"{line}\n{text}")


def test_several_mistakes_are_told_at_once(folder: Path) -> None:
    text = changed("starts = 7", 'starts = "7"').replace("samples = 100", "sample = 100")
    with pytest.raises(StudyError) as caught:
        loaded(folder, text)
    assert "'search.starts'" in str(caught.value)
    assert "'verification.sample'" in str(caught.value)


def test_files_that_cannot_be_read(folder: Path) -> None:
    loaded(folder)
    with pytest.raises(StudyError, match=r"studdy\.toml.*'study\.toml'"):
        load_study(folder / "studdy.toml")
    with pytest.raises(StudyError, match=r"study\.toml"):
        load_study(folder)
    with pytest.raises(StudyError, match=r"nowhere"):
        load_study(folder / "nowhere" / "study.toml")
    (folder / "latin.toml").write_bytes(b'seed = 1\ntitle = "\xe9"\n')
    with pytest.raises(StudyError, match=r"latin\.toml.*line 2.*UTF-8"):
        load_study(folder / "latin.toml")


GROWTH = """
[simulator]
function = "model.py:growth"

[parameters.rate]
law = "normal"
mean = {lower = 0.1, upper = 2}
sd = {lower = 0.01, upper = 1}
"""


@pytest.fixture
def tables(tmp_path: Path) -> Path:
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


def with_noise(tables: Path, experiments: str, noise: str) -> Study:
    (tables / "study.toml").write_text(f"[experiments]\n{experiments}\n{GROWTH}\n{noise}\n")
    return load_study(tables / "study.toml")


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


def test_a_study_with_everything_that_can_be_measured(tables: Path) -> None:
    study = with_noise(tables, WIDE, NOISES)
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


def test_a_column_that_names_the_response(tables: Path) -> None:
    study = with_noise(
        tables,
        'file = "long.csv"\nid = "plant"\noutcome = "value"\nresponse = "what"',
        "[noise.height]\nsd = 1\n[noise.mass]\nsd = 2",
    )
    seen = study.experiments.observations
    assert seen.names == ("height", "mass")
    assert seen.lower.tolist() == [1.1, 5.0, 7.0, 2.0]
    assert list(study.experiments.conditions) == ["time"]


def test_a_column_of_known_sds_is_no_condition(tables: Path) -> None:
    (tables / "known.csv").write_text("time,y,error,remark\n1,1.1,0.1,a\n2,2.2,0.2,b\n")
    study = with_noise(tables, 'file = "known.csv"\noutcome = "y"', '[noise]\nsd = "error"')
    assert list(study.experiments.conditions) == ["time", "remark"]
    assert list(study.experiments.table) == ["time", "error", "remark"]
    assert study.noise == Noise("error")


def test_errors_that_hang_together_and_variance_functions(tables: Path) -> None:
    noise = """[noise.height]
sd = {lower = 0.01, upper = 1}
correlation = "ar1"
variance = "power"
[noise.mass]
sd = 0.1
correlation = {kind = "gaussian_process", along = "time", sd = 0.1, length = {lower = 1, upper = 9}}
variance = {kind = "exponential", of = "time", rate = 0.5}
"""
    wide = WIDE[: WIDE.index("censored")]
    study = with_noise(tables, wide, noise)
    assert study.noise == {
        "height": Noise(Free(0.01, 1.0), variance=PowerVariance(), correlation=AR1()),
        "mass": Noise(
            0.1,
            variance=ExponentialVariance(0.5, of="time"),
            correlation=GaussianProcess("time", 0.1, Free(1.0, 9.0)),
        ),
    }
    assert [h.name for h in study.hyperparameters[2:]] == [
        "noise.height.sd", "noise.height.exponent", "noise.height.rho", "noise.mass.sd",
        "noise.mass.rate", "noise.mass.process_sd", "noise.mass.length",
    ]  # fmt: skip
    one = "[noise]\nsd = 1\ncorrelation = {kind = 'compound_symmetry', rho = 0.5}"
    assert with_noise(tables, PLAIN, one).noise == Noise(1, correlation=CompoundSymmetry(0.5))
    one = "[noise]\nsd = 1\ncorrelation = {kind = 'car1', along = 'time', length = 2.0}"
    assert with_noise(tables, PLAIN, one).noise == Noise(1, correlation=CAR1("time", 2.0))


def test_new_conditions_may_be_series(tables: Path) -> None:
    study = with_noise(tables, WIDE, NOISES)
    (tables / "new.csv").write_text("plant,time\nX,1\nY,1\nX,2\n")
    new = study.read_conditions(tables / "new.csv")
    assert new.ids == ("X", "Y")
    assert new.experiment.tolist() == [0, 1, 0]
    assert new.observations.names == ("height", "mass")
    assert len(new.observations) == 6
    assert new.responses == study.experiments.observations.responses


PLAIN = 'file = "wide.csv"\nid = "plant"\noutcome = "height"\nconditions = ["time"]'
SD = "[noise]\nsd = 1"
WRONG_TABLES = {
    "no outcome": ('file = "wide.csv"', SD, ["'experiments.outcome' is missing", "outcomes"]),
    "transform of a response": (
        WIDE.replace('"log"', '"ln"'), NOISES, ["'experiments.transform.mass' = \"ln\"", "log"],
    ),
    "key of censored": (
        WIDE.replace("right", "rigth"), NOISES,
        ["'experiments.censored.height.rigth'", "'right'"],
    ),
    "censored without a column": (
        PLAIN + '\ncensored = {right = "Cut"}', SD, ["'experiments.censored'", "column"],
    ),
    "a word that is not there": (
        PLAIN + '\ncensored = {column = "status", right = "cut"}', SD, ["wide.csv", "'Cut'"],
    ),
    "no sd": (PLAIN, "[noise]\nkind = \"normal\"", ["'noise.sd' is missing", "relative"]),
    "no sd of a response": (
        WIDE, NOISES.replace('sd = "mass_sd"', ""), ["'noise.mass.sd' is missing"],
    ),
    "sd without limits": (PLAIN, "[noise]\nsd = {}", ["'noise.sd'", "limit"]),
    "a response without noise": (
        WIDE, "[noise.height]\nsd = 1", ["'noise'", "'mass'"],
    ),
    "one noise for two responses": (WIDE, SD, ["'noise'", "[noise.height]"]),
    "no such column of sds": (
        WIDE, NOISES.replace('"mass_sd"', '"mass_ds"'), ["'mass_ds'", "'mass_sd'"],
    ),
    "a known sd of zero": (
        WIDE, NOISES.replace('"mass_sd"', '"spare"'),
        ["wide.csv: line 5, column 'spare'", "experiment 'A'"],
    ),
    "df of a normal error": (PLAIN, "[noise]\nsd = 1\ndf = 4", ["'noise.df'", "student_t"]),
    "no such correlation": (
        PLAIN, '[noise]\nsd = 1\ncorrelation = "ar2"', ["'noise.correlation", '"ar2"', "ar1"],
    ),
    "no length": (
        PLAIN, '[noise]\nsd = 1\ncorrelation = "car1"', ["noise.correlation", "along", "length"],
    ),
    "a key of another correlation": (
        PLAIN, '[noise]\nsd = 1\ncorrelation = {kind = "ar1", length = 1}',
        ["noise.correlation", "length", "car1"],
    ),
    "a correlation of one": (
        PLAIN, '[noise]\nsd = 1\ncorrelation = {kind = "ar1", rho = 1}',
        ["'noise.correlation': rho is 1", "(-1, 1)"],
    ),
    "a formula of rho": (
        PLAIN, '[noise]\nsd = 1\ncorrelation = {kind = "ar1", rho = "1 + time"}',
        ["noise", "rho", "formula"],
    ),
    "correlated bounds": (
        WIDE, NOISES.replace("relative = 0.05", 'correlation = "ar1"'),
        ["wide.csv: line 4", "experiment 'B'", "only a bound"],
    ),
    "a variance without an sd": (
        PLAIN, '[noise]\nrelative = 0.1\nvariance = "power"', ["noise", "sd", "relative"],
    ),
    "no df": (PLAIN, '[noise]\nkind = "student_t"\nsd = 1', ["'noise.df' is missing"]),
}  # fmt: skip


@pytest.mark.parametrize(
    ("experiments", "noise", "expected"), WRONG_TABLES.values(), ids=WRONG_TABLES
)
def test_mistakes_of_tables_and_noise_are_told(
    tables: Path, experiments: str, noise: str, expected: list[str]
) -> None:
    with pytest.raises(AleatorError) as caught:
        with_noise(tables, experiments, noise)
    assert caught.value.remedy
    for words in expected:
        assert words in str(caught.value)


LAW_STUDY = """\
[experiments]
file = "springs.csv"
outcome = "length"

[simulator]
function = "model.py:length"

[parameters.stiffness]
"""


def law(folder: Path, section: str) -> Law:
    (folder / "springs.csv").write_text("load,length\n1,1.1\n2,1.9\n3,3.2\n")
    (folder / "model.py").write_text("def length(load, stiffness): return load / stiffness\n")
    path = folder / "study.toml"
    path.write_text(LAW_STUDY + section)
    return load_study(path).inputs.laws["stiffness"]


@pytest.mark.parametrize(
    ("section", "expected"),
    [
        ('law = "uniform"\nmean = {lower = 1, upper = 2}', Uniform(Free(1.0, 2.0))),
        ('law = "uniform"\nbox = [1, 2]', Uniform.between(1.0, 2.0)),
        ('law = "beta"\nbox = [0.0, 2.0]', Beta((0.0, 2.0))),
        ('law = "beta"\nbox = [0.0, 2.0]\nmean = 1.0\nsd = 0.3', Beta((0.0, 2.0), 1.0, 0.3)),
        (
            'law = "gamma"\nmean = {lower = 1, upper = 2}\nsd = 0.5\nlower = 0.5',
            Gamma(Free(1.0, 2.0), 0.5, 0.5),
        ),
        ('law = "lognormal"\nmean = {lower = 1, upper = 2}', LogNormal(Free(1.0, 2.0))),
    ],
)
def test_a_section_becomes_the_law(tmp_path: Path, section: str, expected: Law) -> None:
    assert law(tmp_path, section) == expected


def test_a_scipy_law_is_known_or_moved(tmp_path: Path) -> None:
    known = law(tmp_path, 'law = "scipy"\ndistribution = "weibull_min"\nargs = {c = 2, scale = 3}')
    assert isinstance(known, ScipyLaw)
    assert known.hyperparameters == ()
    own = known.mean_and_sd(known.filling(0.0))
    truth = stats.weibull_min(2.0, scale=3.0)
    assert (own.mean, own.sd) == pytest.approx((truth.mean(), truth.std()), rel=1e-10)
    moved = law(
        tmp_path,
        'law = "scipy"\ndistribution = "gumbel_r"\nmean = {lower = 1, upper = 3}\nsd = 0.1',
    )
    assert [(h.name, h.free) for h in moved.hyperparameters] == [("mean", True), ("sd", False)]


@pytest.mark.parametrize(
    ("section", "told"),
    [
        ('law = "uniform"\nbox = [2, 1]', "between 2.0 and 1.0"),
        ('law = "uniform"\nbox = [1, 2]\nmean = 1.5', "either a box"),
        ('law = "uniform"', "lower.*upper"),
        ('law = "beta"', "parameters.stiffness.box'"),
        ('law = "beta"\nbox = [1, 0]', "box: 1.0 to 0.0"),
        ('law = "beta"\nbox = [0, 1]\nmean = 0.5\nsd = 0.6', "sd: .*0.6"),
        ('law = "gamma"\nmean = {lower = -1, upper = 2}', "mean: -1.0 "),
        ('law = "lognormal"\nmean = 0\nsd = 1', "mean: 0.0 "),
        ('law = "log_normal"', "'lognormal'"),
        ('law = "scipy"', "distribution'"),
        ('law = "scipy"\ndistribution = "weibul_min"', "'weibull_min'"),
        ('law = "scipy"\ndistribution = "poisson"', "poisson"),
        ('law = "scipy"\ndistribution = "weibull_min"', "args.c"),
        ('law = "scipy"\ndistribution = "norm"\nargs = {c = 1}', "loc, scale"),
        ('law = "scipy"\ndistribution = "norm"\nargs = {scale = -1}', "'norm'"),
    ],
)
def test_a_wrong_section_is_told_with_its_remedy(tmp_path: Path, section: str, told: str) -> None:
    with pytest.raises(StudyError, match=told) as refused:
        law(tmp_path, section)
    assert "parameters.stiffness" in str(refused.value)


PRIOR_STUDY = """\
[experiments]
file = "springs.csv"
outcome = "length"
[simulator]
function = "model.py:length"
[parameters.k]
law = "normal"
mean = {mean}
sd = 0.5
[parameters.c]
law = "normal"
mean = 0
sd = 1
[correlation]
k.c = {correlation}
[noise]
sd = {noise}
"""
NORMAL = 'prior = {law = "normal", mean = 1.0, sd = 0.1}'


def prior_study(
    folder: Path,
    mean: str = f"{{lower = 0.5, upper = 1.5, {NORMAL}}}",
    correlation: str = "0.2",
    noise: str = "0.1",
) -> Study:
    (folder / "springs.csv").write_text("id,load,length\na,1,1.1\nb,2,1.9\nc,3,3.2\n")
    (folder / "model.py").write_text("def length(load, k, c): return load / k + c\n")
    path = folder / "study.toml"
    path.write_text(PRIOR_STUDY.format(mean=mean, correlation=correlation, noise=noise))
    return load_study(path)


def test_a_table_of_a_hyperparameter_takes_a_law_as_prior(tmp_path: Path) -> None:
    found = prior_study(tmp_path).inputs.laws["k"]
    assert found == Normal(Free(0.5, 1.5, prior=Normal(1.0, 0.1)), 0.5)


def test_noise_correlation_and_coefficients_take_one(tmp_path: Path) -> None:
    half = 'prior = {law = "truncated_normal", box = [0.0, 5.0], mean = 0.0, sd = 1.0}'
    found = prior_study(
        tmp_path,
        '{formula = "1 + load", lower = 0, upper = 9, terms = {load = {lower = -1, upper = 1, '
        'prior = {law = "normal", mean = 0.0, sd = 0.1}}}}',
        '{lower = -0.9, upper = 0.9, prior = {law = "normal", mean = 0.0, sd = 0.3}}',
        f"{{lower = 0.01, upper = 3.0, {half}}}",
    )
    priors = {h.name: h.prior.law for h in found.hyperparameters if h.prior is not None}
    assert priors == {
        "k.mean[load]": Normal(0.0, 0.1),
        "correlation.k.c": Normal(0.0, 0.3),
        "noise.sd": TruncatedNormal((0.0, 5.0), 0.0, 1.0),
    }


@pytest.mark.parametrize(
    ("mean", "key", "says"),
    [
        (
            '{lower = 0, upper = 2, prior = {law = "norml", mean = 1, sd = 0.1}}',
            "parameters.k.mean.prior.law",
            "did you mean 'normal'",
        ),
        (
            '{lower = 0, upper = 2, prior = {law = "normal", mean = 1, sdd = 0.1}}',
            "parameters.k.mean.prior.sdd",
            "no such key",
        ),
        ("{lower = 0, upper = 2, prior = 3}", "parameters.k.mean.prior", "not a table"),
        (
            '{lower = 0, upper = 2, prior = {law = "normal", mean = 50, sd = 0.1}}',
            "parameters.k",
            "hold 0 of the prior",
        ),
        (
            '{lower = -1, upper = 2, prior = {law = "gamma", mean = 1, sd = 0.1}}',
            "parameters.k",
            "no finite density at the lower limit -1",
        ),
        (
            '{lower = 0, upper = 2, prior = {law = "normal", mean = {lower = 0, upper = 1}, '
            "sd = 0.1}}",
            "parameters.k",
            "to be identified",
        ),
        (
            f'{{formula = "1 + load", lower = 0, upper = 2, {NORMAL}}}',
            "parameters.k.mean.prior",
            "a formula has no prior",
        ),
    ],
)
def test_a_wrong_prior_is_told_with_its_key(tmp_path: Path, mean: str, key: str, says: str) -> None:
    with pytest.raises(AleatorError, match=says) as told:
        prior_study(tmp_path, mean)
    assert f"'{key}'" in told.value.problem
    assert told.value.remedy


TABLE = """\
id,supplier,heat,time,length
1,a,20,1,1.1
1,a,20,2,1.2
2,b,30,1,1.9
2,b,30,2,2.4
3,a,25,1,1.4
4,b,35,1,1.5
"""
COVARIATE_STUDY = """\
[experiments]
file = "bars.csv"
outcome = "length"

[simulator]
function = "model.py:length"

[noise]
sd = 0.1

[parameters.k]
law = "normal"
mean = {formula = "1 + heat + C(supplier)", lower = 0, upper = 5, terms = {heat = {lower = 0}}}
sd = {lower = 0, upper = 2}

[parameters.b]
law = "normal"
mean = {lower = 0, upper = 4}
"""


def load(folder: Path, more: str = "", old: str = "", new: str = "") -> Study:
    (folder / "bars.csv").write_text(TABLE)
    (folder / "model.py").write_text("def length(time, k, c): return c + k * time\n")
    path = folder / "study.toml"
    path.write_text((COVARIATE_STUDY + more).replace(old, new) if old else COVARIATE_STUDY + more)
    return load_study(path)


DERIVED = '[derived]\nc = "b/2 + 0*heat"\n'


def test_a_formula_with_limits_by_term_is_a_law_of_each_experiment(tmp_path: Path) -> None:
    covariate_study = load(tmp_path, DERIVED)
    mean = By("1 + heat + C(supplier)", 0.0, 5.0, terms={"heat": Free(0.0)})
    assert covariate_study.inputs.laws["k"] == Normal(mean, Free(0.0, 2.0))
    assert covariate_study.inputs.covariates == ("heat", "supplier")


def test_a_derived_parameter_reaches_the_function(tmp_path: Path) -> None:
    run = load(tmp_path, DERIVED).runner()
    found = run.values([0, 1], np.array([[1.5, 3.0], [1.5, 3.0]]))
    np.testing.assert_allclose(found[:, 0], [3.0, 4.5])


def test_all_pairs_of_a_list_are_tied_but_for_those_with_a_key_of_their_own(tmp_path: Path) -> None:
    third = '[parameters.d]\nlaw = "normal"\nmean = 1\nsd = 0.1\n'
    ties = '[correlation]\nall = ["k", "b", "d"]\nd.b = 0.25\n'
    text = "def length(time, k, b, d): return b + k * time + d\n"
    (tmp_path / "model.py").write_text(text)
    covariate_study = load(tmp_path, third + ties + DERIVED.replace("b/2", "b/2 + d"))
    found = {h.name: h.free for h in covariate_study.inputs.correlation.hyperparameters}
    assert found == {
        "correlation.k.b": True,
        "correlation.k.d": True,
        "correlation.b.d.given.k": False,
    }


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("1 + heat", "1 + haet", ["'haet'", "mean 'heat'"]),
        ("1 + heat", "1 + time", ["'time'", "'1'", "line 2", "line 3"]),
        ("1 + heat", "1 + (heat", ["parameters", "k.mean"]),
        ("heat = {lower", "hete = {lower", ["parameters", "'hete'", "mean 'heat'"]),
        ('formula = "1 + heat + C(supplier)", ', "", ["parameters.k.mean", "formula"]),
        ("sd = {lower = 0, upper = 2}", 'sd = "0.5"', ["parameters.k.sd", "without quotes"]),
        ('"b/2', '"bb/2', ["'derived'", "derived.c", "'bb'"]),
        ('c = "b/2 + 0*heat"', "c = 3", ["derived.c"]),
        ("c = ", "d = ", ["'d'", "length"]),
    ],
)
def test_mistakes_of_covariates_are_told_with_their_key(
    tmp_path: Path, old: str, new: str, told: list[str]
) -> None:
    with pytest.raises(AleatorError) as caught:
        load(tmp_path, DERIVED, old, new)
    assert caught.value.remedy
    assert all(part in str(caught.value) for part in told), str(caught.value)
