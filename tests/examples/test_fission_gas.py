"""Fission gas: 31 experiments with a simulator and a known noise each, against a grid."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identifications import assert_maximum, errors_of, estimates, of_study
from scipy import stats
from scipy.stats import qmc

from aleator import Check, ceiling
from aleator.core.types import Array
from aleator.inference.npmle import npmle
from aleator.study import load_study

STUDY = Path(__file__).parents[2] / "examples" / "fission_gas"
BOX = ((0.1, 40.0), (1e-4, 1.0))
NODES = 80


@pytest.fixture(scope="module")
def densities():
    """log p(y_l | x) (N, J) by the simulators themselves, at points x (J, 2)."""
    table = pd.read_csv(STUDY / "experiments.csv")
    runner = load_study(STUDY / "study.toml").runner()

    def log_density(x: Array) -> Array:
        eta = np.array([runner.straight(np.full(len(x), l), x)[:, 0] for l in range(len(table))])
        return stats.norm.logpdf(table["release"].to_numpy()[:, None], eta, table[["noise_sd"]])

    return log_density


@pytest.fixture(scope="module")
def exact(densities):
    """log L(alpha) by Gauss-Legendre on the box; 80 and 200 nodes an axis agree to ten digits."""
    t, w = np.polynomial.legendre.leggauss(NODES)
    axes = [low + 0.5 * (high - low) * (t + 1.0) for low, high in BOX]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    density = np.exp(densities(x)).reshape(-1, NODES, NODES)

    def log_likelihood(alpha: Array) -> float:
        laws = []
        for axis, (low, high), mean, sd in zip(axes, BOX, alpha[::2], alpha[1::2], strict=True):
            ends = (low - mean) / sd, (high - mean) / sd
            laws.append(0.5 * (high - low) * w * stats.truncnorm.pdf(axis, *ends, mean, sd))
        return float(np.log(np.einsum("i,lij,j->l", laws[0], density, laws[1])).sum())

    return log_likelihood


def test_the_grid_meets_the_known_answer(exact) -> None:
    assert exact(np.array([0.1, 11.98618, 1e-4, 0.3060442])) == pytest.approx(57.102331, abs=1e-5)


def test_the_best_of_all_laws_has_six_points_and_the_known_log_likelihood(densities) -> None:
    low, high = np.array(BOX).T
    points = (qmc.Sobol(2, rng=seed).random(512) for seed in (0, 1))
    found = npmle(lambda z: densities(low + (high - low) * z), *points)
    assert found.log_likelihood == pytest.approx(69.694062, abs=5e-4)
    assert found.log_likelihood <= 69.694062 <= found.log_likelihood + found.gap + 1e-6
    assert found.weights.size == 6


@pytest.mark.slow
@pytest.mark.long
def test_the_answer_is_the_exact_maximum_of_the_likelihood(exact) -> None:
    found = of_study(STUDY / "study.toml", Check(0))
    alpha = estimates(found)
    assert found.sound
    assert found.log_likelihood.estimated == pytest.approx(57.102331, abs=0.01)
    assert exact(alpha) == pytest.approx(57.102331, abs=0.01)
    assert alpha == pytest.approx([0.1, 11.98618, 1e-4, 0.3060442], rel=0.01)
    assert [e.at_bound for e in found.alpha.values()] == ["lower", None, "lower", None]
    assert_maximum(exact, alpha, errors_of(found))
    best = ceiling(found, replicates=0)
    assert best.log_likelihood == pytest.approx(69.694062, abs=0.02)
    # without surfaces nothing is left to verify
    reached = best.log_likelihood if found.propagation == "direct" else best.verified
    assert reached is not None
    assert 69.69 < reached < 69.6945
