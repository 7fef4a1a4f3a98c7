"""Formulas, derived parameters and correlations of study.toml, and what is said of wrong ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from aleator.errors import AleatorError
from aleator.laws import By, Free, Normal
from aleator.study import Study, load_study

TABLE = """\
id,supplier,heat,time,length
1,a,20,1,1.1
1,a,20,2,1.2
2,b,30,1,1.9
2,b,30,2,2.4
3,a,25,1,1.4
4,b,35,1,1.5
"""
STUDY = """\
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
    path.write_text((STUDY + more).replace(old, new) if old else STUDY + more)
    return load_study(path)


DERIVED = '[derived]\nc = "b/2 + 0*heat"\n'


def test_a_formula_with_limits_by_term_is_a_law_of_each_experiment(tmp_path: Path) -> None:
    study = load(tmp_path, DERIVED)
    mean = By("1 + heat + C(supplier)", 0.0, 5.0, terms={"heat": Free(0.0)})
    assert study.inputs.laws["k"] == Normal(mean, Free(0.0, 2.0))
    assert study.inputs.covariates == ("heat", "supplier")


def test_a_derived_parameter_reaches_the_function(tmp_path: Path) -> None:
    run = load(tmp_path, DERIVED).runner()
    found = run.values([0, 1], np.array([[1.5, 3.0], [1.5, 3.0]]))
    np.testing.assert_allclose(found[:, 0], [3.0, 4.5])


def test_all_pairs_of_a_list_are_tied_but_for_those_with_a_key_of_their_own(
    tmp_path: Path,
) -> None:
    third = '[parameters.d]\nlaw = "normal"\nmean = 1\nsd = 0.1\n'
    ties = '[correlation]\nall = ["k", "b", "d"]\nd.b = 0.25\n'
    text = "def length(time, k, b, d): return b + k * time + d\n"
    (tmp_path / "model.py").write_text(text)
    study = load(tmp_path, third + ties + DERIVED.replace("b/2", "b/2 + d"))
    found = {h.name: h.free for h in study.inputs.correlation.hyperparameters}
    assert found == {
        "correlation.k.b": True,
        "correlation.k.d": True,
        "correlation.b.d.given.k": False,
    }


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("1 + heat", "1 + haet", ["'haet'", "mean 'heat'"]),
        ("1 + heat", "1 + time", ["'time'", "'1'", "row 2", "row 3"]),
        ("1 + heat", "1 + (heat", ["parameters", "k.mean"]),
        ("heat = {lower", "hete = {lower", ["parameters", "'hete'", "mean 'heat'"]),
        ('formula = "1 + heat + C(supplier)", ', "", ["parameters.k.mean", "formula"]),
        ("sd = {lower = 0, upper = 2}", 'sd = "0.5"', ["parameters.k.sd", "without quotes"]),
        ('"b/2', '"bb/2', ["'derived'", "derived.c", "'bb'"]),
        ('c = "b/2 + 0*heat"', "c = 3", ["derived.c"]),
        ("c = ", "d = ", ["'d'", "length"]),
    ],
)
def test_mistakes_are_told_with_their_key(
    tmp_path: Path, old: str, new: str, told: list[str]
) -> None:
    with pytest.raises(AleatorError) as caught:
        load(tmp_path, DERIVED, old, new)
    assert caught.value.remedy
    assert all(part in str(caught.value) for part in told), str(caught.value)
