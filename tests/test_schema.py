"""The schema of study.toml: it takes every study that is read, and refuses what is mistyped."""

import json
import re
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner
from jsonschema import Draft202012Validator

from aleator import cli
from aleator.study.schema import study_schema

ROOT = Path(__file__).parents[1]
STUDIES = sorted(path for folder in ("examples", "src") for path in (ROOT / folder).rglob("*.toml"))
VALIDATOR = Draft202012Validator(study_schema())
STUDY = """\
[experiments]
file = "springs.csv"
outcome = "travel"
[simulator]
function = "model.py:spring"
[parameters.stiffness]
law = "truncated_normal"
box = [1.0, 3.0]
[noise]
sd = {lower = 0.001, upper = 1.0}
[verification]
samples = 100
"""


def faults(text: str) -> list[list[str]]:
    found = VALIDATOR.iter_errors(tomllib.loads(text))
    return [[str(part) for part in error.absolute_path] for error in found]


def test_it_is_a_schema_without_what_json_does_not_have() -> None:
    Draft202012Validator.check_schema(study_schema())
    json.dumps(study_schema(), allow_nan=False)


@pytest.mark.parametrize("study", STUDIES, ids=lambda path: str(path.relative_to(ROOT)))
def test_it_takes_every_example(study: Path) -> None:
    assert faults(study.read_text()) == []


def test_it_takes_the_studies_of_the_pages() -> None:
    pages = [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md"]
    whole = [
        text
        for page in pages
        for text in re.findall(
            r"^```toml\n(.*?)^```$", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
        )
        if all(f"\n[{section}" in f"\n{text}" for section in ("exp", "sim", "parameters"))
    ]
    assert len(whole) > 5
    assert {text: faults(text) for text in whole if faults(text)} == {}


@pytest.mark.parametrize(
    "addition",
    [
        "[parameters.b]\nlaw = 'constant'\nvalue = {formula = '1 + t', lower = 0, upper = 1}",
        "[parameters.b]\nlaw = 'mixture'\ncomponents = [{law = 'normal', mean = {}, sd = 1},"
        " {law = 'gamma', mean = {upper = 1, prior = {law = 'normal', mean = 0, sd = 1}}}]",
        "[correlation]\na.b = {}\nall = ['a', 'b']",
        "[search]\nmethod = 'cmaes'",
        "[propagation]\nmethod = 'collocation'\nnodes = {rule = 'sobol', points = 64}",
        "[density]\nkind = 'maximum_entropy'\norder = 6",
        "[derived]\nc = 'a + 1'",
        "[[questions]]\nprobability = 'travel > 26'\nat = {force = 50, oil = 'a'}\nnoise = false",
        "[[questions]]\ntolerance = [0.95, 0.9]\nside = 'upper'\noutcome = 'travel'",
    ],
)
def test_it_takes_what_the_other_sections_may_have(addition: str) -> None:
    assert faults(STUDY + addition) == []


MISTAKES = {
    "an unknown key": ('outcome = "travel"', 'outcom = "travel"', "experiments"),
    "a missing table": ('file = "springs.csv"\n', "", "experiments"),
    "a law that is none": ('"truncated_normal"', '"truncated_norml"', "parameters"),
    "a key of another law": ("box = [1.0, 3.0]", "box = [1.0, 3.0]\nvalue = 2.0", "parameters"),
    "a box of one number": ("[1.0, 3.0]", "[1.0]", "parameters"),
    "a number as a text": ("samples = 100", 'samples = "100"', "verification"),
    "limits that are misspelt": ("lower = 0.001", "lowr = 0.001", "noise"),
    "no simulator": ('function = "model.py:spring"', "", "simulator"),
    "a section that is none": ("[verification]", "[verify]", ""),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_it_refuses_a_mistake_where_it_is(mistake: str) -> None:
    right, wrong, section = MISTAKES[mistake]
    assert right in STUDY
    found = faults(STUDY.replace(right, wrong))
    assert found
    assert all(path[:1] == ([section] if section else []) for path in found)


def test_the_command_prints_it_and_new_names_it_in_the_study(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    printed = CliRunner().invoke(cli.main, ["schema"])
    assert json.loads(printed.stdout) == study_schema()
    Path("a.csv").write_text("force,travel\n1,2\n2,4\n")
    Path("model.py").write_text("def spring(force, stiffness=1.0): return force * stiffness\n")
    assert CliRunner().invoke(cli.main, ["new", "--schema"]).exit_code == 0
    first = Path("study.toml").read_text().splitlines()[0]
    assert first == "#:schema study.schema.json"
    assert json.loads(Path("study.schema.json").read_text()) == study_schema()
