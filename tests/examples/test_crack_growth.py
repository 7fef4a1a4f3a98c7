"""Crack growth of 21 specimens, a series each, against a quadrature of its own."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identifications import assert_maximum, errors_of, estimates, of_study
from scipy import optimize, stats

from aleator import Check, identify
from aleator.core.types import Array
from aleator.study import load_study

STUDY = Path(__file__).parents[2] / "examples" / "crack_growth"


def curve(time: Array, rate: Array, exponent: Array) -> Array:
    """The solution of dr/dN = rate r^(exponent/2), r(0) = 1."""
    power = 1.0 - 0.5 * exponent
    with np.errstate(invalid="ignore"):
        return np.asarray((1.0 + power * rate * time) ** (1.0 / power))


@pytest.fixture(scope="module")
def exact():
    """log L(alpha) by Gauss-Legendre about each specimen's own least-squares fit.

    The variables are the logarithm of the rate and the exponent, within eight standard errors.
    """
    t, w = np.polynomial.legendre.leggauss(80)
    grid = np.stack(np.meshgrid(t, t, indexing="ij"), axis=-1).reshape(-1, 2)
    weight = np.outer(w, w).ravel()
    points, squares, sizes, volumes = [], [], [], []
    for _, own in pd.read_csv(STUDY / "cracks.csv").groupby("specimen"):
        time, length = (own[name].to_numpy() for name in ("megacycles", "relative_length"))
        fit = optimize.least_squares(
            lambda u, n=time, r=length: curve(n, np.exp(u[0]), u[1]) - r, [1.1, 5.0]
        )
        root = 8.0 * 0.0085 * np.linalg.cholesky(np.linalg.inv(fit.jac.T @ fit.jac))
        u = fit.x + grid @ root.T
        r = curve(time[:, None], np.exp(u[:, 0]), u[:, 1])
        points.append(u)
        squares.append(np.sum((r - length[:, None]) ** 2, axis=0))
        sizes.append(len(own))
        volumes.append(np.linalg.det(root) * weight)
    u, square, volume = np.array(points), np.array(squares), np.array(volumes)
    size = np.array(sizes)[:, None]

    def log_likelihood(alpha: Array) -> float:
        mean, sd, center, width, rho, noise = alpha
        spread = np.sqrt(np.log1p((sd / mean) ** 2))
        a = (u[..., 0] - np.log(mean) + 0.5 * spread**2) / spread
        b = (u[..., 1] - center) / width
        law = stats.multivariate_normal.pdf(np.stack([a, b], axis=-1), cov=[[1, rho], [rho, 1]])
        error = (2.0 * np.pi * noise**2) ** (-0.5 * size) * np.exp(-0.5 * square / noise**2)
        each = np.sum(volume * np.nan_to_num(error) * law / (spread * width), axis=1)
        return float(np.log(each).sum())

    return log_likelihood


@pytest.mark.slow
def test_the_answer_is_the_exact_maximum_of_the_likelihood(exact) -> None:
    found = of_study(STUDY / "study.toml", Check(0))
    alpha = estimates(found)
    assert found.sound
    assert found.log_likelihood.estimated == pytest.approx(exact(alpha), abs=0.01)
    assert_maximum(exact, alpha, errors_of(found))
    # the pooled fit began where curves have a length, for all that the lognormal law has no end
    pooled = found.baselines["least_squares"]
    assert isinstance(pooled, dict)
    assert pooled["rmse"] < 0.2


@pytest.mark.slow
def test_the_curve_of_paris_law_is_told_to_have_another_shape() -> None:
    """Innovations by cycles: of exact quadratures 2.9 and 4.3 standard errors late, -3.2 before."""
    study = load_study(STUDY / "study.toml")
    found = identify(
        study.runner(), study.experiments, study.inputs, noise=study.noise, seed=study.seed,
        best_law=False,
    )  # fmt: skip
    assert found.consistency is not None
    assert found.consistency.consistent is False
    named = found.consistency.discrepancies[0].test
    assert (named.kind, named.of, named.column) == ("groups", "outcomes", "megacycles")
    assert named.corrected < 1e-5
