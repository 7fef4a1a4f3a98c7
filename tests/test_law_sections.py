"""`[parameters.NAME]`: every law of the study file, and what is said of a wrong one."""

from __future__ import annotations

from pathlib import Path

import pytest
from scipy import stats

from aleator.errors import StudyError
from aleator.laws import Beta, Free, Gamma, Law, LogNormal, ScipyLaw, Uniform
from aleator.study import load_study

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
        ('law = "scipy"\ndistribution = "weibull_min"\nargs = {c = 0.3}', "weibull_min needs c"),
        ('law = "scipy"\ndistribution = "lognorm"\nargs = {s = 1}', "LogNormal"),
        ('law = "scipy"\ndistribution = "norm"\nargs = {scale = -1}', "'norm'"),
    ],
)
def test_a_wrong_section_is_told_with_its_remedy(tmp_path: Path, section: str, told: str) -> None:
    with pytest.raises(StudyError, match=told) as refused:
        law(tmp_path, section)
    assert "parameters.stiffness" in str(refused.value)
