"""`prior` beside the limits of a hyperparameter in study.toml, and what is said of a wrong one."""

from __future__ import annotations

from pathlib import Path

import pytest

from aleator.errors import AleatorError
from aleator.laws import Free, LogNormal, Normal, TruncatedNormal
from aleator.study import Study, load_study

STUDY = """\
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


def study(
    folder: Path,
    mean: str = f"{{lower = 0.5, upper = 1.5, {NORMAL}}}",
    correlation: str = "0.2",
    noise: str = "0.1",
) -> Study:
    (folder / "springs.csv").write_text("id,load,length\na,1,1.1\nb,2,1.9\nc,3,3.2\n")
    (folder / "model.py").write_text("def length(load, k, c): return load / k + c\n")
    path = folder / "study.toml"
    path.write_text(STUDY.format(mean=mean, correlation=correlation, noise=noise))
    return load_study(path)


def test_a_table_of_a_hyperparameter_takes_a_law_as_prior(tmp_path: Path) -> None:
    found = study(tmp_path).inputs.laws["k"]
    assert found == Normal(Free(0.5, 1.5, prior=Normal(1.0, 0.1)), 0.5)


def test_noise_correlation_and_coefficients_take_one(tmp_path: Path) -> None:
    half = 'prior = {law = "truncated_normal", box = [0.0, 5.0], mean = 0.0, sd = 1.0}'
    found = study(
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
    found = study(tmp_path, noise=f"{{lower = 0.1, upper = 2, {prior}}}")
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
        study(tmp_path, mean)
    assert f"'{key}'" in told.value.problem
    assert told.value.remedy
