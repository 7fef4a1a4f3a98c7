"""`[search]` in the study file, and `--starts`."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from aleator import CMAES, DifferentialEvolution, GeneticAlgorithm, GradientMultistart
from aleator.cli import main
from aleator.errors import InputsError, StudyError
from aleator.study import load_study

pytestmark = pytest.mark.usefixtures("unreported")

STUDY = """\
[experiments]
file = "springs.csv"
outcome = "length"
[simulator]
function = "model.py:length"
vectorized = true
[parameters.stiffness]
law = "truncated_normal"
box = [0.5, 1.5]
[density]
kind = "gaussian"
[propagation]
method = "collocation"
nodes = 5
"""


@pytest.fixture
def write(tmp_path: Path):
    (tmp_path / "springs.csv").write_text(
        "load,length\n1,1.1\n2,1.8\n3,3.5\n4,4.3\n5,4.6\n6,6.9\n7,6.6\n8,8.9\n"
    )
    (tmp_path / "model.py").write_text("def length(load, stiffness): return load * stiffness\n")

    def written(search: str) -> Path:
        (tmp_path / "study.toml").write_text(f"{STUDY}[search]\n{search}\n")
        return tmp_path / "study.toml"

    return written


@pytest.mark.parametrize(
    ("text", "search"),
    [
        ("", GradientMultistart()),
        ("starts = 3\nevaluations = 20", GradientMultistart(3, 20)),
        ('method = "gradient"\nstarts = 3', GradientMultistart(3)),
        ('method = "genetic"', GeneticAlgorithm()),
        (
            'method = "genetic"\npopulation = 20\ngenerations = 9\npatience = 4\npolish = false',
            GeneticAlgorithm(20, 9, 4, polish=False),
        ),
        ('method = "differential_evolution"', DifferentialEvolution()),
        (
            'method = "differential_evolution"\npopulation = 20\ngenerations = 9\npolish = false',
            DifferentialEvolution(20, 9, polish=False),
        ),
        ('method = "cmaes"', CMAES()),
        (
            'method = "cmaes"\nruns = 2\nevaluations = 90\npopulation = 9\nstep = 0.3\n'
            "polish = false",
            CMAES(2, 90, 9, 0.3, polish=False),
        ),
    ],
)
def test_each_method_has_its_own_keys(write, text, search) -> None:
    assert load_study(write(text)).search == search


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ('method = "genetics"', ["search.method", "'genetic'"]),
        ('method = "genetic"\nstarts = 3', ["search.starts", "population"]),
        ("population = 3", ["search.population", "starts"]),
        ('method = "genetic"\npopulation = 3', ["'search'", "population 3"]),
        ('method = "cmaes"\nstep = 2.0', ["'search'", "step 2.0"]),
        ('method = "genetic"\npolish = 1', ["search.polish"]),
    ],
)
def test_what_is_wrong_is_named(write, text, names) -> None:
    with pytest.raises(StudyError) as caught:
        load_study(write(text))
    for name in names:
        assert name in str(caught.value)


def test_starts_are_of_the_gradient_search_only(write) -> None:
    assert load_study(write("")).overridden(starts=4).search == GradientMultistart(4)
    study = load_study(write('method = "genetic"'))
    assert study.overridden(seed=4).search == GeneticAlgorithm()
    with pytest.raises(InputsError, match="genetic") as caught:
        study.overridden(starts=4)
    assert 'method = "gradient"' in caught.value.remedy


def test_the_command_line_says_so_too(write) -> None:
    path = write('method = "differential_evolution"')
    done = CliRunner().invoke(main, ["identify", str(path), "--starts", "4"])
    assert done.exit_code == 2
    assert "--starts 4" in done.output


@pytest.mark.slow
@pytest.mark.usefixtures("unjudged_commands")
def test_a_study_is_identified_by_each_method_alike(write, tmp_path) -> None:
    import json

    values = {}
    for text in (
        "starts = 3",
        'method = "genetic"\npopulation = 12\ngenerations = 15',
        'method = "differential_evolution"\npopulation = 12\ngenerations = 15',
        'method = "cmaes"\nruns = 1',
    ):
        arguments = [str(write(text)), "--no-verify", "--no-figures", "--quiet"]
        done = CliRunner().invoke(main, ["identify", *arguments, "--output", str(tmp_path / "out")])
        assert done.exit_code == 0, done.output
        document = json.loads((tmp_path / "out" / "identification.json").read_text())
        values[text] = document["log_likelihood"]["estimated"]
        assert document["sound"]
        assert document["search"]["converged"]
        assert (
            sum(o["starts"] for o in document["search"]["optima"]) == document["search"]["starts"]
        )
    assert max(values.values()) - min(values.values()) < 0.01
