"""Units are shown beside names wherever numbers are, and change no number."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from studies import done, read

import aleator
from aleator import Check, Free, Identification, Inputs, Noise, Normal, plot
from aleator.errors import AleatorError
from aleator.results.units import label, seen_label
from aleator.study import load_study
from aleator.views.figures import experiments_figure, parameters_figure
from aleator.views.page import page

UNITS = {"travel": "mm", "force": "N", "softness": "mm/N"}


def springs() -> pd.DataFrame:
    rng = np.random.default_rng(2)
    force = np.tile([10.0, 20.0, 30.0], 8)
    spring = np.repeat(np.arange(8), 3)
    softness = rng.normal(0.5, 0.05, 8)[spring]
    travel = force * softness + rng.normal(0.0, 0.1, force.size)
    return pd.DataFrame({"id": spring, "force": force, "travel": travel})


def identified(units: dict[str, str] | None = None) -> Identification:
    law = Inputs({"softness": Normal(Free(0.2, 0.8), Free(0.001, 0.3))})
    return aleator.identify(
        lambda force, softness: force * softness, springs(), law, outcome="travel",
        noise=Noise(Free(0.01, 1.0)), vectorized=True, verification=Check(0),
        consistency=False, best_law=False, units=units,
    )  # fmt: skip


@pytest.fixture(scope="module")
def found() -> Identification:
    return identified(UNITS)


def test_they_stand_in_the_text_the_notebook_and_the_file(
    found: Identification, tmp_path: Path
) -> None:
    for text in (repr(found), found._repr_html_()):
        for name in ("softness.mean [mm/N]", "softness.sd [mm/N]", "noise.sd [mm]"):
            assert name in text
    found.save(tmp_path / "found.json")
    again = aleator.load(tmp_path / "found.json")
    assert again.units == UNITS
    assert repr(again) == repr(found)


def test_they_stand_on_every_axis_of_the_figures(found: Identification) -> None:
    document = found.to_dict()
    labels = {
        text
        for figure in (experiments_figure(document), parameters_figure(document))
        for axes in figure.axes
        for text in (axes.get_xlabel(), axes.get_ylabel(), axes.get_title(loc="left"))
    }
    assert {"travel [mm]", "force [N]"} <= labels
    assert any(text.startswith("softness [mm/N]") for text in labels)
    assert plot.law(found, "softness").get_xlabel() == "softness [mm/N]"
    assert plot.profile(found, "softness.mean").get_xlabel() == "softness.mean [mm/N]"
    quantiles = {"0.025": 0.0, "0.25": 0.7, "0.5": 1.0, "0.75": 1.3, "0.975": 2.0}
    one = {"id": "7", "outcome": 1.2, "quantiles": quantiles, "pit": 0.65}
    simple = {"experiments": [one], "outcome": "travel", "units": UNITS}
    assert experiments_figure(simple).axes[0].get_ylabel() == "travel [mm]"


def test_they_stand_on_the_axes_and_in_the_tables_of_the_page(found: Identification) -> None:
    text = page(found.to_dict(), None, None)
    for name in ("travel [mm]", "force [N]", "softness [mm/N]", "softness.sd [mm/N]"):
        assert name in text


@pytest.mark.parametrize(
    ("name", "shown"),
    {
        "k": "k [N/mm]",
        "k.2.mean": "k.2.mean [N/mm]",
        "k.value": "k.value [N/mm]",
        "k.1.share": "k.1.share",
        "k.mean[Intercept]": "k.mean[Intercept] [N/mm]",
        "k.mean[supplier=B]": "k.mean[supplier=B] [N/mm]",
        "k.mean[temperature]": "k.mean[temperature]",
        "noise.way.sd": "noise.way.sd [m]",
        "noise.life.sd": "noise.life.sd",
        "noise.way.relative": "noise.way.relative",
        "correlation.k.c": "correlation.k.c",
        "m": "m",
    }.items(),
)
def test_a_hyperparameter_has_the_unit_of_what_it_is_of(name: str, shown: str) -> None:
    document = {
        "units": {"k": "N/mm", "way": "m", "life": "h"},
        "responses": {"way": "none", "life": "log"},
    }
    assert label(document, name) == shown
    assert seen_label(document, "life") == "log(life / h)"


def test_a_unit_of_nothing_is_an_error() -> None:
    with pytest.raises(AleatorError, match="did you mean 'travel'"):
        identified({"travl": "mm"})


STUDY = """\
[experiments]
file = "springs.csv"
outcome = "travel"
units = {travel = "mm", force = "N"}
[simulator]
function = "model.py:spring"
[parameters.stiffness]
unit = "N/mm"
law = "truncated_normal"
box = [1.0, 3.0]
"""


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "springs.csv").write_text("force,travel\n10,4.9\n20,10.2\n30,15.4\n40,19.0\n")
    (tmp_path / "model.py").write_text("def spring(force, stiffness): return force / stiffness\n")
    (tmp_path / "study.toml").write_text(STUDY)
    monkeypatch.chdir(tmp_path)
    return Path("study.toml")


def test_a_study_states_them_and_commands_show_them(study: Path) -> None:
    assert load_study(study).units == {"travel": "mm", "force": "N", "stiffness": "N/mm"}
    for command in ("check", "box"):
        assert "stiffness [N/mm]" in done(command, study, "--output", "out").output
    assert read("out/check.json")["study"]["outcome"] == "travel [mm]"
    assert read("out/box.json")["units"]["force"] == "N"
    study.write_text(STUDY.replace("force =", "forse ="))
    with pytest.raises(AleatorError, match=r"experiments\.units.*forse.*did you mean 'force'"):
        load_study(study)


def test_units_in_the_heads_of_a_table_are_no_part_of_the_names(study: Path) -> None:
    rows = Path("springs.csv").read_text().replace("force,travel", "force [kN],travel [cm]")
    Path("springs.csv").write_text(rows)
    study.write_text(STUDY.replace('units = {travel = "mm", force = "N"}', ""))
    value = load_study(study)
    assert value.units == {"travel": "cm", "force": "kN", "stiffness": "N/mm"}
    assert value.experiments.conditions.columns.tolist() == ["force"]
    study.write_text(STUDY.replace(', force = "N"', ""))  # what the study says comes first
    assert load_study(study).units["travel"] == "mm"
    assert load_study(study).units["force"] == "kN"
