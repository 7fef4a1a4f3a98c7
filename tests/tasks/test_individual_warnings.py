"""What is told of incomplete data, of runs that fail and of other maxima."""

import time as clock

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from individual_cases import PAIR, straight_line, table

import aleator
from aleator import (
    Check,
    Experiments,
    Free,
    GradientMultistart,
    Identification,
    Inputs,
    Noise,
    Normal,
)
from aleator.inference.diagnostics import Rival, rival_warnings
from aleator.laws import Hyperparameter
from aleator.observations.outcomes import Censoring

FRAME = table(straight_line, experiments=12)
NOISE = Noise(Free(0.01, 5.0))
LATE = 2.8
ONE = Inputs({"a": Normal(Free(-10.0, 10.0), Free(0.01, 5.0))})


def line(time, a, b):
    return a + b * time


def identified(
    model, frame, inputs=PAIR, vectorized=True, starts=2, samples=1000, surfaces=None, **keys
) -> Identification:
    experiments = Experiments.from_frame(frame, outcome="y", id="id", **keys)
    return unjudged(
        model, experiments, inputs, vectorized=vectorized, noise=NOISE,
        search=GradientMultistart(starts=starts), verification=Check(samples),
        propagation=aleator.ResponseSurface(surfaces=surfaces),
    )  # fmt: skip


def told(found: Identification, *words: str) -> tuple[str, ...]:
    """What the warning with these words concerns."""
    (warning,) = (w for w in found.warnings if all(word in w.message for word in words))
    return warning.concerns


def early(time, a, b):
    return np.where(time > LATE, np.nan, a + b * time)


def slowly_early(time, a, b):
    if time > LATE:
        raise ValueError("no convergence")
    clock.sleep(0.0025)
    return a + b * time


@pytest.fixture(scope="module")
def without_late() -> Identification:
    return identified(line, FRAME[FRAME["time"] <= LATE])


@pytest.mark.parametrize("model", [early, slowly_early])
def test_observations_without_a_run_are_left_out_and_told(
    model, without_late: Identification
) -> None:
    late = FRAME["time"] > LATE
    found = identified(model, FRAME, vectorized=model is early, samples=64)
    same = without_late
    assert found.log_likelihood.estimated == pytest.approx(same.log_likelihood.estimated, abs=0.01)
    assert len(found.observations) == len(FRAME) - late.sum()
    assert set(told(found, "no run gives")) == set(FRAME.loc[late, "id"])
    assert found.sound


def test_an_experiment_that_is_lost_has_the_individual_law_of_none() -> None:
    lost = FRAME.assign(time=np.where(FRAME["id"] == "e0", 5.0, FRAME["time"]))
    found = identified(lambda time, a, b: np.where(time == 5.0, np.nan, a + b * time), lost)
    own = found.individuals.loc["e0"]
    assert (own["observations"], own["log_density"]) == (0, pytest.approx(0.0, abs=1e-12))
    assert [own["a.mean"], own["a.sd"]] == pytest.approx(
        [found.values["a.mean"], found.values["a.sd"]], rel=1e-6
    )


@pytest.mark.long
def test_laws_that_reach_where_runs_fail_are_told() -> None:
    found = identified(
        lambda time, a: np.where(a > 1.8, np.nan, a - 0.5 * time), FRAME, ONE, starts=1
    )
    assert len(told(found, "runs fail at up to", "% of the identified law")) > 6


def test_censored_values_above_half_are_told() -> None:
    bound = float(FRAME["y"].quantile(0.4))
    cut = FRAME["y"] > bound
    frame = FRAME.assign(y=FRAME["y"].clip(upper=bound), status=np.where(cut, "over", ""))
    censoring = Censoring("status", right="over")
    found = identified(
        lambda time, a: a - 0.5 * time, frame, ONE, conditions=["time"], censored=censoring
    )
    assert told(found, "only bounds are known") == ()


@pytest.mark.parametrize("surfaces", ["none", "own"])
def test_two_maxima_are_told(surfaces: str) -> None:
    """y = x^2 t says nothing of the sign of x; surfaces are made exact about one maximum only."""
    rng = np.random.default_rng(4)
    frame = pd.DataFrame(
        [
            {"id": str(l), "time": t, "y": x**2 * t + 0.1 * rng.normal()}
            for l, x in enumerate(1.5 + 0.2 * rng.normal(size=10))
            for t in (1.0, 2.0, 3.0)
        ]
    )
    inputs = Inputs({"x": Normal(Free(-4.0, 4.0), Free(0.01, 2.0))})
    found = identified(lambda time, x: x**2 * time, frame, inputs, starts=6, surfaces=surfaces)
    assert told(found, "two maxima", "x.mean") == ("x.mean",)
    single = identified(line, FRAME, starts=4)
    assert not any("maxima" in warning.message for warning in single.warnings)


def test_another_maximum_is_news_only_outside_the_intervals() -> None:
    h = [Hyperparameter("x.mean", -4.0, 4.0, 0.0, free=True)]
    rival = Rival(np.array([-1.5]), np.array([1.5]), 0.3, (0,))
    assert rival_warnings([rival], h, np.array([[1.0, 2.0]]))
    assert rival_warnings([rival], h, np.array([[np.nan, np.nan]]))
    assert not rival_warnings([rival], h, np.array([[-2.0, 2.0]]))


@pytest.mark.parametrize(
    "choice",
    [
        {"density": aleator.Gaussian()},
        {"propagation": aleator.Collocation(nodes=5)},
        {"propagation": aleator.ResponseSurface(surfaces="shared")},
        {"propagation": aleator.ResponseSurface(nodes=20)},
    ],
    ids=["gaussian", "collocation", "shared", "nodes"],
)
@pytest.mark.parametrize("frame", [FRAME, FRAME.groupby("id").head(1)], ids=["series", "single"])
def test_what_is_of_exact_outcomes_is_refused_before_any_run(choice, frame) -> None:
    def never(time, a):  # noqa: ARG001
        raise AssertionError

    for noise in (aleator.Noise(0.1), NOISE):
        with pytest.raises(aleator.AleatorError, match=r"exact outcome.*\n?.*leave \["):
            unjudged(never, frame, ONE, outcome="y", noise=noise, **choice)
    new = pd.DataFrame({"time": [1.0]})
    with pytest.raises(aleator.AleatorError, match="exact outcome"):
        aleator.predict(never, new, ONE, {}, noise=NOISE, **choice)


def test_a_tolerance_is_met_all_over_the_region_before_the_search() -> None:
    """Exact surfaces of a smooth response from the first: more runs, the same answer."""
    plain, exact = (
        unjudged(
            lambda time, a: np.exp(-a * time), FRAME, ONE, outcome="y", noise=NOISE,
            verification=aleator.Check(0), propagation=surfaces,
        )
        for surfaces in (aleator.ResponseSurface(), aleator.ResponseSurface(tolerance=1e-5))
    )  # fmt: skip
    assert exact.runs > plain.runs
    assert exact.alpha["a.mean"].estimate == pytest.approx(plain.alpha["a.mean"].estimate, abs=1e-3)
