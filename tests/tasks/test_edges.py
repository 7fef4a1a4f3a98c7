"""Identifications at the edges: limits that bind, weak directions, what is told and refused."""

from __future__ import annotations

import time as clock
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from identifications import Array, estimates, identified, maximum, unjudged
from individual_cases import PAIR, straight_line, table
from problems import BINDING, REGRESSION, SAMPLE

import aleator
from aleator import (
    Check,
    Collocation,
    Constant,
    Experiments,
    Free,
    GradientMultistart,
    Identification,
    Inputs,
    Noise,
    Normal,
    ResponseSurface,
    TruncatedNormal,
)
from aleator.errors import ExperimentsError
from aleator.observations.outcomes import Censoring

# ------------------------------------------------------------------------------ a binding box


def test_a_binding_box_is_identified_as_by_the_exact_likelihood() -> None:
    problem = replace(BINDING, z=np.linspace(0.5, 2.0, 60))
    y = problem.draw(6)

    def log_likelihood(p: Array) -> float:
        if p[1] <= 0.0:
            return -1e10
        return float(problem.log_density(p, problem.z, y).sum())

    alpha, value, error = maximum(log_likelihood, [[0.8, 0.4]])
    found = identified(problem, y, samples=512)
    # the surface's allowance for its own error widens the support by some 1e-9
    assert found.log_likelihood.estimated == pytest.approx(value, abs=0.01)
    assert np.all(np.abs(estimates(found) - alpha) < 0.02 * error)
    assert found.sound


# ------------------------------------------------------------------------------ what is refused


def test_an_unreachable_outcome_is_named_with_its_remedy() -> None:
    problem = replace(BINDING, z=np.linspace(0.5, 2.0, 10))
    y = problem.draw(7)
    y[4] = 5.0
    with pytest.raises(ExperimentsError, match="experiment 5: ") as caught:
        identified(problem, y)
    assert "noise" in caught.value.remedy
    assert "experiment 5" in caught.value.remedy  # Its value lies apart from all others.


def test_a_known_constant_is_no_parameter_of_the_surface() -> None:
    """y = k x with k = 2 known."""
    y = 2.0 * replace(SAMPLE, z=np.zeros(20)).draw(8)
    inputs = Inputs({"x": SAMPLE.inputs.laws["x"], "k": Constant(2.0)})
    found = unjudged(
        lambda x, k: k * x, pd.DataFrame({"y": y}), inputs, outcome="y", vectorized=False,
        search=GradientMultistart(3), verification=Check(0),
    )  # fmt: skip
    assert found.alpha["x.mean"].estimate == pytest.approx(y.mean() / 2.0, abs=1e-4)
    assert found.alpha["k.value"].fixed
    assert found.alpha["k.value"].interval is None


def test_constants_and_noise_alone_are_least_squares() -> None:
    z = np.linspace(0.0, 4.0, 40)
    y = 1.0 + 2.0 * z + 0.5 * np.random.default_rng(9).standard_normal(40)
    inputs = Inputs({"b0": Constant(Free(-20.0, 20.0)), "b1": Constant(Free(-20.0, 20.0))})
    found = unjudged(
        lambda z, b0, b1: b0 + b1 * z, pd.DataFrame({"z": z, "y": y}), inputs, outcome="y",
        noise=Noise(Free(0.01, 10.0)), vectorized=False, search=GradientMultistart(3),
        verification=Check(64),
    )  # fmt: skip
    design = np.stack([np.ones(40), z], axis=1)
    coefficients, rss, *_ = np.linalg.lstsq(design, y)
    np.testing.assert_allclose(estimates(found)[:2], coefficients, atol=1e-3)
    assert estimates(found)[2] == pytest.approx((float(rss[0]) / 40) ** 0.5, rel=1e-3)
    assert found.sound
    exact = -20.0 * (np.log(2.0 * np.pi * float(rss[0]) / 40) + 1.0)
    assert found.log_likelihood.estimated == pytest.approx(exact, abs=1e-4)


def test_a_logarithmic_transform_is_that_of_the_outcome() -> None:
    """Lognormal outcomes: the likelihood sees their logarithms, which are normal."""
    y = np.exp(replace(SAMPLE, z=np.zeros(25)).draw(10))
    table = Experiments.from_frame(pd.DataFrame({"y": y}), outcome="y", transform="log")
    found = unjudged(
        lambda x: np.exp(x), table, SAMPLE.inputs, vectorized=True,
        search=GradientMultistart(3), verification=Check(0),
    )  # fmt: skip
    assert found.alpha["x.mean"].estimate == pytest.approx(np.log(y).mean(), abs=1e-4)
    assert found.alpha["x.sd"].estimate == pytest.approx(np.log(y).std(), abs=1e-4)


def test_an_answer_on_a_limit_says_so_and_keeps_an_interval() -> None:
    problem = replace(
        SAMPLE,
        z=np.zeros(20),
        inputs=Inputs(
            {"x": TruncatedNormal((-4.0, 4.0), mean=Free(-2.0, 0.5), sd=Free(0.05, 3.0))}
        ),
    )
    y = replace(SAMPLE, z=np.zeros(20)).draw(11)
    found = identified(problem, y)
    mean = found.alpha["x.mean"]
    assert mean.at_bound == "upper"
    assert mean.standard_error is None
    assert mean.interval[1] == pytest.approx(0.5)
    assert ("bounds", ("x.mean",)) in [(w.about, w.concerns) for w in found.warnings]


SUM = replace(
    REGRESSION,
    z=np.ones(15),
    inputs=Inputs(
        {
            "a": Normal(mean=Free(-5.0, 5.0), sd=Free(0.05, 3.0)),
            "b": Normal(mean=Free(-5.0, 5.0), sd=Free(0.05, 3.0)),
        }
    ),
)


@pytest.mark.parametrize(
    "propagation", [Collocation(nodes=5), ResponseSurface()], ids=["collocation", "surface"]
)
def test_a_sum_of_parameters_is_told_as_a_direction_and_not_sound(propagation) -> None:
    found = identified(SUM, SUM.draw(12), propagation=propagation)
    told = [set(w.concerns) for w in found.warnings if w.about == "identifiability"]
    assert {"a.mean", "b.mean"} in told
    # there is no maximum, hence no interval
    assert "search" in [w.about for w in found.warnings]
    assert all(e.interval is None and e.standard_error is None for e in found.alpha.values())
    assert not found.sound


# ---------------------------------------------------------------- incomplete data, and other maxima


FRAME = table(straight_line, experiments=12)
NOISE = Noise(Free(0.01, 5.0))
LATE = 2.8
ONE = Inputs({"a": Normal(Free(-10.0, 10.0), Free(0.01, 5.0))})


def line(time, a, b):
    return a + b * time


def identified_series(
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
    return identified_series(line, FRAME[FRAME["time"] <= LATE])


@pytest.mark.parametrize("model", [early, slowly_early])
def test_observations_without_a_run_are_left_out_and_told(
    model, without_late: Identification
) -> None:
    late = FRAME["time"] > LATE
    found = identified_series(model, FRAME, vectorized=model is early, samples=64)
    same = without_late
    assert found.log_likelihood.estimated == pytest.approx(same.log_likelihood.estimated, abs=0.05)
    assert len(found.observations) == len(FRAME) - late.sum()
    assert set(told(found, "no run gives")) == set(FRAME.loc[late, "id"])
    assert found.sound


def test_censored_values_above_half_are_told() -> None:
    bound = float(FRAME["y"].quantile(0.4))
    cut = FRAME["y"] > bound
    frame = FRAME.assign(y=FRAME["y"].clip(upper=bound), status=np.where(cut, "over", ""))
    censoring = Censoring("status", right="over")
    found = identified_series(
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
    found = identified_series(
        lambda time, x: x**2 * time, frame, inputs, starts=6, surfaces=surfaces
    )
    assert told(found, "two maxima", "x.mean") == ("x.mean",)


def test_one_maximum_is_not_called_several(without_late: Identification) -> None:
    assert not any("maxima" in warning.message for warning in without_late.warnings)


@pytest.mark.parametrize(
    "choice",
    [
        {"density": aleator.Gaussian()},
        {"propagation": aleator.Collocation(nodes=5)},
        {"propagation": aleator.ResponseSurface(nodes=20)},
    ],
    ids=["gaussian", "collocation", "nodes"],
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
