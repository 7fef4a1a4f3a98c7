"""Identification of correlations, against the exact likelihood of a random coefficients model."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from rich.console import Console
from scipy import optimize, stats

from aleator import (
    Check,
    Collocation,
    Free,
    Gaussian,
    GradientMultistart,
    Identification,
    Inputs,
    MaximumEntropy,
    Normal,
    predict,
)
from aleator.core.types import Array
from aleator.errors import StudyError
from aleator.study import load_study
from aleator.views.identification import render

COEFFICIENTS = "abc"


def conditions(n: int, count: int) -> Array:
    """Regressors (N, n): 1, z along [-1.5, 2], and t, which is not a function of z.

    With t = z^2 the covariance of a and c and the variance of b would both go with z^2.
    """
    z = np.linspace(-1.5, 2.0, count)
    t = np.random.default_rng(0).uniform(-1.0, 2.0, count)
    return np.stack([np.ones(count), z, t][:n], axis=1)


def simulator(n: int) -> Callable[..., Array]:
    """y = a + b z + c t with the first n terms, as a user writes it."""
    return (lambda z, a, b: a + b * z) if n == 2 else (lambda z, t, a, b, c: a + b * z + c * t)


def outcomes(mean: Array, covariance: Array, regressors: Array, seed: int) -> Array:
    x = np.random.default_rng(seed).multivariate_normal(mean, covariance, regressors.shape[0])
    return np.asarray(np.sum(x * regressors, axis=1))


def log_likelihood(p: Array, regressors: Array, y: Array) -> float:
    """Exact: y ~ Normal(g mean, g S g'), from means, sds and plain correlations."""
    n = regressors.shape[1]
    mean, sd = p[:n], p[n : 2 * n]
    matrix = np.eye(n)
    matrix[np.tril_indices(n, -1)] = p[2 * n :]
    matrix = matrix + matrix.T - np.eye(n)
    if np.any(sd <= 0.0) or np.linalg.eigvalsh(matrix)[0] <= 0.0:
        return -1e10
    scaled = regressors * sd
    spread = np.sqrt(np.sum(scaled @ matrix * scaled, axis=1))
    return float(stats.norm.logpdf(y, regressors @ mean, spread).sum())


def maximum(regressors: Array, y: Array, start: Array) -> tuple[Array, float, Array]:
    """The exact estimates, their log-likelihood, and standard errors from its curvature."""

    def loss(p: Array) -> float:
        return -log_likelihood(p, regressors, y)

    options = {"xatol": 1e-7, "fatol": 1e-10, "maxiter": 40_000, "maxfev": 40_000}
    best = optimize.minimize(loss, start, method="BFGS")
    best = optimize.minimize(loss, best.x, method="Nelder-Mead", options=options)
    size, h = start.size, 1e-4
    hessian = np.zeros((size, size))
    for i in range(size):
        for j in range(size):
            e, f = h * np.eye(size)[i], h * np.eye(size)[j]
            ends = [loss(best.x + s * e + t * f) for s, t in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
            hessian[i, j] = (ends[0] - ends[1] - ends[2] + ends[3]) / (4 * h * h)
    return best.x, -best.fun, np.sqrt(np.diag(np.linalg.inv(hessian)))


def found_for(
    regressors: Array, y: Array, density: Gaussian | MaximumEntropy, nodes: int = 4
) -> Identification:
    n = regressors.shape[1]
    laws = {name: Normal(Free(-2.0, 4.0), Free(0.05, 3.0)) for name in COEFFICIENTS[:n]}
    return unjudged(
        simulator(n),
        pd.DataFrame({"y": y} | dict(zip("zt", regressors.T[1:], strict=False))),
        Inputs(laws, dict.fromkeys(combinations(COEFFICIENTS[:n], 2), Free(-0.98, 0.98))),
        outcome="y",
        vectorized=True,
        propagation=Collocation(nodes=nodes),
        density=density,
        search=GradientMultistart(4),
        verification=Check(0),
    )


@pytest.mark.parametrize("density", [Gaussian(), MaximumEntropy(4)], ids=lambda d: d.name)
def test_two_correlated_coefficients(density: Gaussian | MaximumEntropy) -> None:
    mean, sd, rho = np.array([1.0, 2.0]), np.array([0.5, 0.4]), -0.6
    covariance = np.outer(sd, sd) * np.array([[1.0, rho], [rho, 1.0]])
    regressors = conditions(2, 60)
    y = outcomes(mean, covariance, regressors, 3)
    exact, value, error = maximum(regressors, y, np.array([*mean, *sd, rho]))
    found = found_for(regressors, y, density)
    names = ["a.mean", "b.mean", "a.sd", "b.sd", "correlation.a.b"]
    estimates = np.array([found.alpha[name].estimate for name in names])
    # a hundredth of a standard error
    assert np.all(np.abs(estimates - exact) < 0.01 * error)
    assert found.log_likelihood.estimated == pytest.approx(value, abs=1e-4)
    told = np.array([found.alpha[name].standard_error for name in names], dtype=float)
    np.testing.assert_allclose(told, error, rtol=0.01)
    # of two parameters the partial correlation is the correlation
    (plain,) = found.parameter_correlations
    assert plain.between == ("a", "b")
    assert plain.estimate == pytest.approx(estimates[-1], abs=1e-12)
    assert plain.standard_error == pytest.approx(told[-1], rel=1e-6)
    # the linear-Gaussian law is the same model
    assert found.baselines["circe"]["log_likelihood"] == pytest.approx(value, abs=1e-4)


@pytest.mark.slow
def test_three_correlated_coefficients_and_their_delta_method() -> None:
    """The maximum in plain correlations, another parametrization, and its errors are the same."""
    mean, sd = np.array([1.0, 2.0, 0.5]), np.array([0.6, 0.5, 0.4])
    matrix = np.array([[1.0, 0.5, -0.3], [0.5, 1.0, 0.2], [-0.3, 0.2, 1.0]])
    regressors = conditions(3, 120)
    y = outcomes(mean, np.outer(sd, sd) * matrix, regressors, 11)
    exact, value, error = maximum(
        regressors, y, np.array([*mean, *sd, matrix[1, 0], matrix[2, 0], matrix[2, 1]])
    )
    found = found_for(regressors, y, Gaussian(), nodes=2)
    assert found.log_likelihood.estimated == pytest.approx(value, abs=1e-3)
    plain = found.parameter_correlations
    assert [c.between for c in plain] == [("a", "b"), ("a", "c"), ("b", "c")]
    estimates = np.array([c.estimate for c in plain])
    assert np.all(np.abs(estimates - exact[6:]) < 0.03 * error[6:])
    told = np.array([c.standard_error for c in plain], dtype=float)
    np.testing.assert_allclose(told, error[6:], rtol=0.03)
    # the last is identified as a partial correlation, which is another number
    assert found.alpha["correlation.b.c.given.a"].estimate != pytest.approx(estimates[2], abs=0.01)


def test_a_known_correlation_and_what_follows_from_known_ones_have_no_error() -> None:
    regressors = conditions(3, 60)
    y = outcomes(np.array([1.0, 2.0, 0.5]), 0.2 * np.eye(3), regressors, 5)
    laws = {name: Normal(Free(-2.0, 4.0), 0.45) for name in COEFFICIENTS}
    found = unjudged(
        simulator(3),
        pd.DataFrame({"z": regressors[:, 1], "t": regressors[:, 2], "y": y}),
        Inputs(laws, {("a", "b"): 0.3, ("a", "c"): Free(-0.9, 0.9)}),
        outcome="y",
        vectorized=True,
        propagation=Collocation(nodes=2),
        density=Gaussian(),
        search=GradientMultistart(2),
        verification=Check(0),
    )
    ab, ac, bc = found.parameter_correlations
    own = found.alpha["correlation.a.c"]
    assert (ab.estimate, ab.standard_error) == (0.3, None)
    assert (ac.estimate, ac.standard_error) == pytest.approx((own.estimate, own.standard_error))
    # independent given a: r_bc = r_ab r_ac, and so is its error
    assert (bc.estimate, bc.standard_error) == pytest.approx(
        (0.3 * own.estimate, 0.3 * (own.standard_error or 0.0))
    )


def test_a_known_correlation_changes_the_prediction() -> None:
    """Var(a + b z) = sa^2 + 2 rho sa sb z + sb^2 z^2."""
    alpha = {"a.mean": 0.0, "a.sd": 1.0, "b.mean": 0.0, "b.sd": 0.5}
    for rho in (-0.8, 0.0, 0.8):
        inputs = Inputs({"a": Normal(0.0, 1.0), "b": Normal(0.0, 0.5)}, {("a", "b"): rho})
        table = predict(
            simulator(2), pd.DataFrame({"z": [2.0]}), inputs, {**alpha, "correlation.a.b": rho}
        )
        expected = np.sqrt(1.0 + 2.0 * rho * 0.5 * 2.0 + 0.25 * 4.0)
        assert table["standard_deviation"][0] == pytest.approx(expected, rel=1e-6)


# ------------------------------------------------------------------------------ the study file

STUDY = """\
[experiments]
file = "lines.csv"
outcome = "y"
[simulator]
function = "model.py:line"
vectorized = true
[parameters.a]
law = "normal"
mean = {lower = -2, upper = 4}
[parameters.b]
law = "normal"
mean = {lower = -2, upper = 4}
[parameters.k]
law = "constant"
value = 0
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "lines.csv").write_text("z,y\n0,1.1\n1,2.9\n2,5.3\n3,7.1\n")
    (tmp_path / "model.py").write_text("def line(z, a, b, k): return a + b * z + k\n")
    return tmp_path


def test_a_study_names_its_correlations_as_the_result_does(folder: Path) -> None:
    (folder / "study.toml").write_text(
        STUDY + "[correlation]\nb.a = {lower = -0.9, upper = 0.8, start = 0.1}\n"
    )
    (h,) = load_study(folder / "study.toml").inputs.hyperparameters[5:]
    assert (h.name, h.lower, h.upper, h.start) == ("correlation.a.b", -0.9, 0.8, 0.1)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("a.c = 0.5", "'correlation'.* 'c'"),
        ("a.k = 0.5", "'correlation'.* 'k'"),
        ("a.b = 0.5\nb.a = 0.5", "'correlation'.* a and b "),
        ("a.b = 1.5", r"correlation\.a\.b.* 1\.5 "),
        ("a.b = {low = 0.5}", r"'correlation\.a\.b\.low'"),
        ("a = 0.5", r"'correlation\.a'.* 0\.5 "),
    ],
)
def test_mistakes_in_a_study_are_named(folder: Path, text: str, names: str) -> None:
    (folder / "study.toml").write_text(f"{STUDY}[correlation]\n{text}\n")
    with pytest.raises(StudyError, match=names) as caught:
        load_study(folder / "study.toml")
    assert caught.value.remedy


def test_the_report_has_a_line_of_correlations() -> None:
    regressors = conditions(2, 40)
    y = outcomes(np.array([1.0, 2.0]), np.array([[0.2, 0.1], [0.1, 0.2]]), regressors, 2)
    document = found_for(regressors, y, Gaussian(), nodes=2).to_dict()
    (entry,) = document["parameter_correlations"]
    assert entry["between"] == ["a", "b"]
    console = Console(width=80)
    with console.capture() as capture:
        console.print(render(document))
    (line,) = (line for line in capture.get().splitlines() if "a and b" in line)
    assert f"{entry['estimate']:.2f}" in line
