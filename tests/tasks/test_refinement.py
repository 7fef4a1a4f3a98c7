"""Refine, identify, refine again: few runs, the same answer, the same runs every time."""

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged

from aleator import (
    Check,
    Experiments,
    Free,
    GradientMultistart,
    Inputs,
    ResponseSurface,
    TruncatedNormal,
)
from aleator.core.types import Array
from aleator.fit.regions import plausible_alphas
from aleator.inference.information import Inference
from aleator.laws import Hyperparameter
from aleator.simulators import FunctionSimulator, Runner, Store
from aleator.tasks.identification import Identification

Z = np.linspace(0.5, 2.0, 20)
RANDOM = np.random.default_rng(5)
X = 1.0 + 0.1 * RANDOM.standard_normal(20)
LAW = Inputs({"a": TruncatedNormal((0.2, 1.8), sd=Free(0.01, 0.4))})


def front(z: Array, a: Array) -> Array:
    """A front far from the law, which a surface on the whole box has to resolve."""
    return np.tanh(25.0 * (a - 0.35)) + np.exp(a * z)


TABLE = pd.DataFrame({"z": Z, "y": front(Z, X)})


def found(propagation: ResponseSurface, run: Runner | None = None) -> Identification:
    return unjudged(
        run or front, Experiments.from_frame(TABLE, outcome="y"), LAW, vectorized=True,
        propagation=propagation, search=GradientMultistart(3),
        verification=Check(0),
    )  # fmt: skip


@pytest.fixture(scope="module")
def concentrated() -> Identification:
    return found(ResponseSurface(surfaces="own"))


def test_a_front_far_from_the_law_costs_nothing(concentrated: Identification) -> None:
    everywhere = found(ResponseSurface(tolerance=0.005))
    assert concentrated.runs < 0.4 * everywhere.runs
    for name, estimate in everywhere.alpha.items():
        if estimate.fixed:
            continue
        error = estimate.standard_error
        assert error is not None
        assert abs(concentrated.alpha[name].estimate - estimate.estimate) < 0.1 * error
        one, two = concentrated.alpha[name].interval, estimate.interval
        assert one is not None
        assert two is not None
        assert np.abs(np.subtract(one, two)).max() < 0.1 * error
    gap = concentrated.log_likelihood.estimated - everywhere.log_likelihood.estimated
    assert abs(gap) < 0.2


def test_the_result_says_how_exact_the_surfaces_are(concentrated: Identification) -> None:
    surface = concentrated.surface
    assert surface is not None
    assert surface["where"] == "under the law"
    assert surface["converged"] == surface["experiments"] == 20
    assert 0.0 < surface["median_error"] < surface["worst_error"] < 0.05
    assert surface["runs"] < concentrated.runs <= surface["runs"] + 2


def test_runs_from_a_store_lead_to_the_same_runs(
    concentrated: Identification, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """A store that knows half of the runs, and others too, changes not a bit of the answer."""
    experiments = Experiments.from_frame(TABLE, outcome="y")
    file = tmp_path_factory.mktemp("store") / "runs.sqlite"
    documents = []
    with Store(file) as store:
        simulator = FunctionSimulator(front, vectorized=True)
        first = Runner(simulator, experiments, LAW.names, store=store)
        first.attempt(np.arange(20).repeat(5), np.random.default_rng(0).random((100, 1)) + 0.5)
        for _ in range(2):
            run = Runner(simulator, experiments, LAW.names, store=store)
            documents.append(found(ResponseSurface(surfaces="own"), run).to_dict())
    documents.append(concentrated.to_dict())
    for document in documents:
        del document["seconds"]
    assert documents[0] == documents[1] == documents[2]


def test_likely_alphas_follow_the_information_within_the_limits() -> None:
    information = np.array([[400.0, 380.0], [380.0, 400.0]])
    nothing = np.zeros(3)
    inference = Inference(
        nothing, nothing, nothing, nothing, np.arange(2), np.linalg.inv(information), 0.0,
        (None, None, None), True, np.arange(2), information,
    )  # fmt: skip
    limits = tuple(Hyperparameter(name, 0.0, 2.0, 1.0, True) for name in ("a", "b", "c"))
    alphas = plausible_alphas(np.array([1.0, 1.0, 0.7]), inference, limits)
    assert (alphas[:, 2] == 0.7).all()
    assert np.corrcoef(alphas[:, :2].T)[0, 1] < -0.9
    assert np.abs(alphas[:, :2].mean(axis=0) - 1.0).max() < 0.05
    expected = 1.5 * np.sqrt(np.diag(np.linalg.inv(information)))
    assert alphas[:, :2].std(axis=0) == pytest.approx(expected, rel=0.15)
