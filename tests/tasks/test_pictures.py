"""What a report draws: profiles, surfaces, bands, quantiles, against closed forms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from aleator import (
    Check,
    Experiments,
    Free,
    GradientMultistart,
    Identification,
    Inputs,
    Noise,
    Normal,
    full,
    identify,
    load,
)
from aleator.inference.likelihood_shape import likelihood_surface
from aleator.inference.pictures import responses
from aleator.tasks.identification import pictured

COUNT, SD = 60, 0.2
RNG = np.random.default_rng(8)
Y = RNG.normal(1.0, 0.5, COUNT)
LEFT, RIGHT = "0.025", "0.975"


def normal_sample(count: int = COUNT) -> Identification:
    """y = x + noise: the log-likelihood of mean and sd has a closed form."""
    return identify(
        lambda x: x,
        pd.DataFrame({"maker": ["A", "B"] * (count // 2), "y": Y[:count]}),
        Inputs({"x": Normal(Free(0.0, 2.0), Free(0.05, 2.0))}),
        outcome="y", noise=Noise(SD), vectorized=True, verification=Check(0),
        consistency=False, best_law=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def found() -> Identification:
    return pictured(normal_sample())


def log_likelihood(mean: float, sd: float) -> float:
    return float(stats.norm(mean, np.hypot(sd, SD)).logpdf(Y).sum())


def test_the_profile_of_a_mean_is_that_of_a_normal_sample(found: Identification) -> None:
    curve = found.pictures["profiles"]["x.mean"]
    top = stats.norm(Y.mean(), Y.std()).logpdf(Y).sum()
    for at, below in zip(curve["at"], curve["below"], strict=True):
        spread = np.sqrt(np.mean((Y - at) ** 2))  # the sd follows
        assert below == pytest.approx(top - stats.norm(at, spread).logpdf(Y).sum(), abs=0.02)
    assert 0.0 in curve["below"]


def test_the_surface_of_two_is_the_likelihood_itself(found: Identification) -> None:
    surface = found.pictures["surface"]
    assert surface["between"] == ["x.mean", "x.sd"]
    first, second, below = (np.array(surface[k], float) for k in ("first", "second", "below"))
    top = log_likelihood(*found.values.iloc[:2])
    for mean, sd, drop in zip(first.ravel(), second.ravel(), below.ravel(), strict=True):
        assert drop == pytest.approx(top - log_likelihood(mean, sd), abs=0.02)


def test_quantiles_of_an_observation_are_those_of_the_law_and_the_noise(
    found: Identification,
) -> None:
    mean, sd = found.values.iloc[:2]
    for p in (LEFT, "0.25", "0.5", "0.75", RIGHT):
        exact = stats.norm(mean, np.hypot(sd, SD)).ppf(float(p))
        assert found.pictures["predicted"][p] == pytest.approx([exact] * COUNT, abs=0.05 * sd)


def test_a_band_holds_the_density_and_narrows_with_more_experiments(found: Identification) -> None:
    wide = pictured(normal_sample(10)).pictures["laws"]["x"]
    narrow = found.pictures["laws"]["x"]
    for curve in (wide, narrow):
        low, here, high = (np.array(curve[k]) for k in ("lower", "density", "upper"))
        middle = np.argmax(here)
        assert low[middle] < here[middle] < high[middle]
    relative = [(np.array(c["upper"]) - np.array(c["lower"])).max() / max(c["density"])
                for c in (wide, narrow)]  # fmt: skip
    assert relative[1] < 0.7 * relative[0]
    x, density = (np.array(narrow[k]) for k in ("x", "density"))
    assert density == pytest.approx(stats.norm(*found.values.iloc[:2]).pdf(x), rel=1e-4)


def test_contours_hold_what_they_say_of_correlated_parameters() -> None:
    rng = np.random.default_rng(2)
    truth = rng.multivariate_normal([1.0, 1.0], [[0.09, 0.06], [0.06, 0.09]], 40)
    id, time = np.repeat(np.arange(40), 5), np.tile(np.arange(5.0), 40)
    frame = pd.DataFrame({"id": id, "time": time})
    frame["y"] = truth[id, 0] + truth[id, 1] * time + rng.normal(0.0, 0.1, id.size)
    found = pictured(identify(
        lambda time, a, b: a + b * time, Experiments.from_frame(frame, outcome="y"),
        Inputs({"a": Normal(Free(0.0, 2.0), Free(0.01, 1.0)),
                "b": Normal(Free(0.0, 2.0), Free(0.01, 1.0))}, full(["a", "b"])),
        noise=Noise(0.1), vectorized=True, verification=Check(0),
        consistency=False, best_law=False,
    ))  # fmt: skip
    (pair,) = found.pictures["contours"]
    assert pair["between"] == ["a", "b"]
    from matplotlib.path import Path as Outline

    drawn = found.law.sample(20_000, seed=1)[["a", "b"]].to_numpy()
    for mass, curve in pair["curves"].items():
        inside = Outline(np.transpose(curve)).contains_points(drawn).mean()
        assert inside == pytest.approx(float(mass), abs=0.015)


def test_a_file_gives_the_pictures_back(found: Identification, tmp_path: Path) -> None:
    found.save(tmp_path / "found.json")
    assert load(tmp_path / "found.json") == found
    assert found.pictures["conditions"] == {"maker": ["A", "B"] * (COUNT // 2)}


def test_the_response_is_the_simulators_own_and_knows_where_it_has_no_value() -> None:
    rng = np.random.default_rng(2)
    load = np.linspace(1.0, 3.0, 10)
    table = pd.DataFrame({"load": load, "y": load * rng.normal(1.0, 0.2, 10)})

    def simulator(load: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.where(a > 1.4, np.nan, load * a + b**2)

    with np.errstate(all="ignore"):
        found = identify(
            simulator,
            table,
            Inputs({"a": Normal(Free(0.8, 1.2), 0.2), "b": Normal(0.0, 0.1)}),
            outcome="y", noise=Noise(0.2), vectorized=True, verification=Check(0),
            search=GradientMultistart(1), consistency=False, best_law=False,
        )  # fmt: skip
        response = responses(found.fit)
    over, shown = response["over"], response["shown"]
    loads = dict(zip(found.fit.table.ids, load, strict=True))
    assert {"1", "10"} <= {entry["id"] for entry in shown}
    for entry in shown:
        a, b = (np.array(over[name]) for name in "ab")
        slope = loads[entry["id"]]
        assert np.array(entry["curves"]["a"], float) == pytest.approx(
            np.where(a > 1.4, np.nan, slope * a), nan_ok=True, abs=0.001 * slope
        )
        assert np.ptp(np.array(entry["curves"]["b"]) - b**2) < 0.001
        plane = np.array(entry["map"], float)
        a, b = (np.array(response["map"][name]) for name in "ab")
        whole = np.where(a > 1.4, np.nan, slope * a)[:, None] + b**2
        assert plane == pytest.approx(whole, nan_ok=True, rel=1e-3)
        assert np.isnan(plane).any()


def test_a_surface_that_limits_cut_is_still_a_surface(found: Identification) -> None:
    fit, inference = found.fit, found.fit.inference
    wide = replace(inference, covariance=1e4 * inference.covariance)  # hardly known
    surface = likelihood_surface(fit.objective(), fit.alpha, fit.hyperparameters, wide, (0, 1), 5)
    assert np.isfinite(surface.value).all()
    assert [np.ptp(surface.first), np.ptp(surface.second)] == pytest.approx([2.0, 1.95])
