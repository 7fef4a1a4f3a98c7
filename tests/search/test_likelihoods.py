"""Searches on likelihoods of the library, and as a study names them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from problems import GROWTH, REGRESSION, SAMPLE
from scipy import optimize, stats

from aleator import (
    CMAES,
    Check,
    Collocation,
    Constant,
    CustomSearch,
    DifferentialEvolution,
    Free,
    Gaussian,
    GeneticAlgorithm,
    GradientMultistart,
    Inputs,
    Normal,
)
from aleator.errors import InputsError
from aleator.moments.likelihood import Continued
from aleator.search import wide_limits
from aleator.study import load_study
from reproduction.trials import compare


def simplex(value, lower, upper, start, rng) -> np.ndarray:  # noqa: ARG001
    bounds = optimize.Bounds(lower, upper)
    return optimize.minimize(
        lambda a: -value(a), start, method="Nelder-Mead", bounds=bounds,
        options={"maxfev": 300, "maxiter": 300},
    ).x  # fmt: skip


SEARCHES = [
    GradientMultistart(4),
    GeneticAlgorithm(population=16, generations=12, patience=6),
    DifferentialEvolution(population=16, generations=12),
    CMAES(runs=1, evaluations=150),
    CustomSearch(simplex),
]


def test_all_searches_agree_on_a_normal_sample_with_its_closed_form() -> None:
    problem = replace(SAMPLE, z=np.zeros(30))
    y = problem.draw(1)
    exact = stats.norm.logpdf(y, y.mean(), y.std()).sum()
    likelihood = problem.likelihood(y, Gaussian())
    for trial in compare(SEARCHES, likelihood, problem.hyperparameters, seed=0):
        assert trial.log_likelihood == pytest.approx(exact, abs=1e-6), trial.name
        assert trial.result.alpha == pytest.approx([y.mean(), y.std()], abs=1e-4), trial.name
        assert trial.result.converged
        assert trial.result.method == trial.name


@pytest.mark.parametrize("problem", [REGRESSION, GROWTH], ids=lambda p: p.name)
def test_all_searches_agree_to_a_hundredth_on_small_identifications(problem) -> None:
    problem = replace(problem, z=np.linspace(0.5, 2.0, 30))
    likelihood = problem.likelihood(problem.draw(2), Gaussian(), nodes=6)
    trials = compare(SEARCHES, likelihood, problem.hyperparameters, seed=0)
    values = {trial.name: trial.log_likelihood for trial in trials}
    assert max(values.values()) - min(values.values()) < 0.01, values


def test_values_are_the_totals_of_the_calls() -> None:
    """A population and an ascent must climb the same hill."""
    problem = replace(REGRESSION, z=np.linspace(-2.0, 3.0, 12))
    likelihood = problem.likelihood(problem.draw(3))
    rng = np.random.default_rng(0)
    low, high = np.array([[h.lower, h.upper] for h in problem.hyperparameters]).T
    alphas = low + (high - low) * rng.random((6, low.size))
    totals = [Continued(likelihood)(alpha).total for alpha in alphas]
    np.testing.assert_allclose(Continued(likelihood).values(alphas), totals, rtol=1e-7)


def test_wide_limits_are_those_of_many_orders() -> None:
    inputs = Inputs(
        {
            "modulus": Normal(mean=Free(1e9, 3e11), sd=Free(1e7, 1e10)),
            "far": Constant(Free(-1e9, 1e9)),
            "started": Constant(Free(0.0, 1e9, start=3.0)),
            "near": Normal(mean=Free(-50.0, 50.0), sd=Free(1e-9, 1.0)),
            "known": Constant(1e12),
        }
    )
    names = wide_limits(inputs.hyperparameters)
    assert names == ("far.value", "started.value")


def saturating(z: np.ndarray, v: np.ndarray, b: np.ndarray) -> np.ndarray:
    return v * z + np.tanh(b - 1.0)


def test_an_answer_that_is_no_maximum_names_the_wide_limits() -> None:
    """Beyond a few units b has no effect; nothing leads back from there."""
    z = np.linspace(0.5, 3.0, 20)
    x = np.random.default_rng(0).normal(2.0, 0.2, 20)
    found = unjudged(
        saturating,
        pd.DataFrame({"z": z, "y": x * z + 1.0}),
        Inputs({"v": Normal(Free(0.0, 4.0), Free(0.01, 1.0)), "b": Constant(Free(1e3, 1e10))}),
        outcome="y",
        vectorized=True,
        propagation=Collocation(nodes=5),
        density=Gaussian(),
        search=GradientMultistart(2),
        verification=Check(0),
    )
    assert not found.sound
    remedies = [w.remedy for w in found.warnings if w.about == "search"]
    assert len(remedies) == 1
    assert "b.value" in remedies[0]


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


def test_starts_are_of_the_gradient_search_only(write) -> None:
    assert load_study(write("")).overridden(starts=4).search == GradientMultistart(4)
    study = load_study(write('method = "genetic"'))
    assert study.overridden(seed=4).search == GeneticAlgorithm()
    with pytest.raises(InputsError, match="genetic") as caught:
        study.overridden(starts=4)
    assert 'method = "gradient"' in caught.value.remedy
