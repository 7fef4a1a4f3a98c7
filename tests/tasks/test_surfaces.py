"""Surfaces in an identification: how many runs they take, where they lie, and what is shared."""

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged

from aleator import (
    Budget,
    Check,
    Experiments,
    Free,
    GradientMultistart,
    Inputs,
    LogNormal,
    MaximumEntropy,
    Noise,
    Normal,
    ResponseSurface,
    TruncatedNormal,
)
from aleator.core.types import Array, Indices
from aleator.errors import InputsError
from aleator.simulators import FunctionSimulator, Runner, Store
from aleator.surrogates import AdaptiveSurfaces
from aleator.tasks.identification import Identification

N = 20
BOXED = {"a": TruncatedNormal(box=(-3.0, 4.0)), "b": TruncatedNormal(box=(-2.0, 3.0))}
BOX = np.array([[-3.0, 4.0], [-2.0, 3.0]])


def lines(noise: float) -> pd.DataFrame:
    rng = np.random.default_rng(1)
    c = np.linspace(0.0, 2.0, N)
    a, b = 0.5 + 0.3 * rng.standard_normal(N), 0.4 * rng.standard_normal(N)
    return pd.DataFrame({"c": c, "y": a + b * c + noise * rng.standard_normal(N)})


@pytest.mark.parametrize(
    ("noise", "bent"), [(0.2, False), pytest.param(0.0, True, marks=pytest.mark.long)]
)
def test_a_linear_outcome_takes_four_runs_an_experiment(noise: float, bent: bool) -> None:
    """So does one whose logarithm is linear, over eleven decades."""
    rows = lines(noise)
    found = unjudged(
        lambda c, a, b: np.exp(a + b * c) if bent else a + b * c,
        Experiments.from_frame(rows.assign(y=np.exp(rows.y)) if bent else rows, outcome="y"),
        Inputs(BOXED), vectorized=True, noise=Noise(noise) if noise else None,
        search=GradientMultistart(starts=2), budget=Budget(runs=10**6),
    )  # fmt: skip
    assert found.sound
    assert found.runs_by_stage["response surface"] == 4 * N
    assert found.emulator_error <= 0.05


def surfaces(run, experiments: int) -> AdaptiveSurfaces:
    return AdaptiveSurfaces(run, BOX, experiments, ResponseSurface())


def test_one_bent_outcome_gives_all_experiments_their_first_runs() -> None:
    def run(index: Indices, x: Array) -> Array:
        return x[:, 0] + np.where(index == 3, np.tanh(2.0 * x[:, 1]), x[:, 1])

    assert surfaces(run, 6).emulator.runs.tolist() == [12] * 6


def test_a_jump_between_few_runs_of_one_experiment_is_met_by_those_of_another() -> None:
    highest = surfaces(lambda _, x: x.sum(axis=1), 12).emulator.samples.x[:, 1].max()
    jump = 0.5 * (highest + BOX[1, 1])

    def run(index: Indices, x: Array) -> Array:
        return x[:, 0] + (x[:, 1] > jump - 0.4 * index)

    alone, together = (surfaces(run, count) for count in (1, 12))
    assert alone.emulator.runs.tolist() == [12]
    assert together.emulator.runs.tolist() == [12] * 12


@pytest.mark.parametrize("bent", [np.sin, np.tanh, lambda z: z**3])
def test_an_odd_function_about_the_middle_is_not_taken_for_a_line(bent) -> None:
    def run(_: Indices, x: Array) -> Array:
        middle = BOX.mean(axis=1)
        return x[:, 0] + bent(x[:, 1] - middle[1])

    assert surfaces(run, 6).emulator.runs.tolist() == [12] * 6


# ------------------------------------------------------------------------- refined about the answer

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
        assert abs(concentrated.alpha[name].estimate - estimate.estimate) < 0.1 * error
        one, two = concentrated.alpha[name].interval, estimate.interval
        assert np.abs(np.subtract(one, two)).max() < 0.1 * error
    gap = concentrated.log_likelihood.estimated - everywhere.log_likelihood.estimated
    assert abs(gap) < 0.2


def test_the_result_says_how_exact_the_surfaces_are(concentrated: Identification) -> None:
    surface = concentrated.surface
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


# ----------------------------------------------------------------------------- where surfaces begin

COUNT = 60


def test_a_quotient_takes_few_runs_and_none_where_the_law_ends() -> None:
    """y = c / a: the logarithms of y / c are normal, and their mean and sd tell those of a."""
    random = np.random.default_rng(4)
    c = np.exp(random.uniform(0.0, 4.0, COUNT))
    normal = 0.3 + 0.4 * random.standard_normal(COUNT)
    asked: list[Array] = []

    def quotient(c: Array, a: Array) -> Array:
        asked.append(a)
        return np.asarray(c / a)

    table = pd.DataFrame({"c": c, "y": c / np.exp(normal)})
    found = unjudged(
        quotient, Experiments.from_frame(table, outcome="y"),
        Inputs({"a": LogNormal(Free(0.3, 4.0), Free(0.01, 2.0))}), vectorized=True,
        propagation=ResponseSurface(surfaces="own"),
    )  # fmt: skip
    mean = np.exp(normal.mean() + 0.5 * normal.var())
    sd = mean * np.sqrt(np.expm1(normal.var()))
    assert found.alpha["a.mean"].estimate == pytest.approx(mean, rel=1e-3)
    assert found.alpha["a.sd"].estimate == pytest.approx(sd, rel=1e-3)
    assert found.sound
    assert np.concatenate(asked).min() > 0.0
    assert found.runs <= 15 * COUNT


# ------------------------------------------------------------------------------ sharing

RNG = np.random.default_rng(8)


def test_gaussian_processes_have_no_tolerance() -> None:
    with pytest.raises(InputsError, match="leave out the tolerance"):
        ResponseSurface(tolerance=0.01, surfaces="process")


def test_gaussian_processes_lead_to_the_exact_maximum() -> None:
    load = RNG.uniform(1.0, 3.0, 40)
    x = RNG.normal(1.0, 0.1, 40)
    table = pd.DataFrame({"load": load, "y": load * x + np.sin(load)})
    inputs = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))})
    result = unjudged(
        lambda load, x: load * x + np.sin(load), table, inputs, outcome="y",
        propagation=ResponseSurface(surfaces="process"), density=MaximumEntropy(order=4),
        verification=Check(0),
    )  # fmt: skip
    assert result.alpha["x.mean"].estimate == pytest.approx(x.mean(), abs=0.02 * x.std())
    assert result.alpha["x.sd"].estimate == pytest.approx(x.std(), rel=0.02)
    assert result.surface["runs"] <= 40 * 5
