"""Sections of study.toml: laws, priors, covariates and correlation, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from aleator.errors import AleatorError, StudyError
from aleator.laws import (
    Beta,
    By,
    Free,
    Gamma,
    Law,
    LogNormal,
    Normal,
    ScipyLaw,
    TruncatedNormal,
    Uniform,
)
from aleator.study import Study, load_study

STUDY = """\
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
    path.write_text(STUDY + section)
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


def test_a_prior_may_be_lognormal(tmp_path: Path) -> None:
    prior = 'prior = {law = "lognormal", mean = 0.5, sd = 0.1}'
    found = prior_study(tmp_path, noise=f"{{lower = 0.1, upper = 2, {prior}}}")
    assert found.hyperparameters[-1].prior is not None
    assert found.hyperparameters[-1].prior.law == LogNormal(0.5, 0.1)


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


def test_all_pairs_of_a_list_are_tied_but_for_those_with_a_key_of_their_own(
    tmp_path: Path,
) -> None:
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
