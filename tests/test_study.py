import math
import re
from pathlib import Path

import pytest

from aleator.errors import AleatorError, ExperimentsError, SimulatorError, StudyError
from aleator.laws import Constant, Free, Normal, TruncatedNormal
from aleator.laws.quadrature import Smolyak, SobolPoints, TensorGauss
from aleator.moments.densities import Gaussian
from aleator.moments.expansion import Hyperbolic, TotalDegree
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.moments.projection import Projection, Regression
from aleator.moments.propagation import Collocation
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
    assert study.simulator.vectorized is False
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


def test_a_box_may_be_open(folder: Path) -> None:
    study = loaded(folder, changed(r"\[0.5, 1.5\]", "[0.01, inf]"))
    law = study.inputs.laws["stiffness"]
    assert isinstance(law, TruncatedNormal)
    assert law.box_limits == (0.01, math.inf)


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


BAD = {
    "unknown key": ("outcome", "outcom", ["'experiments.outcom'", "'outcome'"]),
    "unknown section": (r"\[noise\]", "[noize]", ["'noize'", "'noise'"]),
    "key of the wrong section": ("order = 4", "starts = 4", ["'density.starts'", "kind, order"]),
    "missing key": (r'^outcome = "length"\n', "", ["'experiments.outcome'"]),
    "missing box": (r"\nbox = .*", "", ["'parameters.stiffness.box'", "[LOWER, UPPER]"]),
    "missing section": (r"\[simulator\]\nfunction = .*", "", ["'simulator'"]),
    "text for a number": ("seed = 3", 'seed = "3"', ["'seed' = \"3\"", "without quotes"]),
    "negative seed": ("seed = 3", "seed = -3", ["'seed' = -3", " 0"]),
    "number for a text": ('"springs.csv"', "5", ["'experiments.file' = 5", "in quotes"]),
    "bool for a number": ("starts = 7", "starts = true", ["'search.starts' = true"]),
    "bounds in disorder": ("lower = 0.6", "lower = 1.6", [".stiffness.mean'", "1.6 >= upper 1.4"]),
    "start below": ("start = 1.0", "start = 0.1", ["stiffness.mean'", "0.1", "0.6"]),
    "start above": ("start = 1.0", "start = 3", ["stiffness.mean'", "3", "1.4"]),
    "box in disorder": (r"\[0.5, 1.5\]", "[1.5, 0.5]", ["stiffness'", "lower 1.5 >= upper 0.5"]),
    "half a box": (r"\[0.5, 1.5\]", "[1.5]", ["'parameters.stiffness.box' = [1.5]", "2 items"]),
    "unknown law": ('"constant"', '"constnt"', ["offset.law'", "'constant'"]),
    "no law": ('law = "constant"', "", ["'parameters.offset.law'"]),
    "key of a law": ("value = ", "vlue = ", ["'parameters.offset.vlue'", "mean 'value'"]),
    "sd below zero": ("lower = 0.005", "lower = -1", ["parameters.stiffness", "sd", "-1.0"]),
    "nan": ("lower = 0.6", "lower = nan", ["stiffness.mean.lower' = nan", "finite"]),
    "noise without bounds": (
        r"lower = 0.01, upper = 2.0",
        "",
        ["'noise.sd'", "lower", "upper"],
    ),
    "unknown density": ('"maximum_entropy"', '"maximum"', ["'density.kind' = \"maximum\""]),
    "order": ("order = 4", "order = 99", ["'density'", "99"]),
    "no starts": ("starts = 7", "starts = 0", ["'search'", "starts 0"]),
    "samples": ("samples = 100", "samples = -1", ["'verification'", "-1"]),
    "transform": ('"length"\n', '"length"\ntransform = "ln"\n', ['transform\' = "ln"', "log"]),
    "method": (r"\[search\]", '[propagation]\nmethod="x"\n[search]', ["propagation.method' = \"x"]),
    "parameter name": (r"parameters\.offset", 'parameters."off set"', ["off set"]),
    "no file": ("springs.csv", "spring.csv", ["spring.csv", "'springs.csv'"]),
    "no column": ('"length"', '"lenght"', ["springs.csv", "'lenght'", "'length'"]),
    "no module": ("model.py", "modle.py", ["'simulator.function'", "'model.py'"]),
    "no function": (":length", ":lenth", ["'simulator.function'", "'length'"]),
    "no argument": (
        r"parameters\.offset",
        "parameters.ofset",
        ["'ofset'", "'offset'"],
    ),
    "toml": ("seed = 3", "seed = ", ["not TOML", "line 2", "'seed ='"]),
    "twice": ("seed = 3", "seed = 3\nseed = 4", ["not TOML", "line 3"]),
}


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
