"""Without noise, simulators with kinks and jumps: those that take arrays are run themselves."""

from __future__ import annotations

import json
import re
import time

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy import optimize, stats

from aleator import (
    Budget,
    Free,
    Identification,
    Inputs,
    LogNormal,
    Noise,
    Normal,
    ResponseSurface,
    identify,
)
from aleator.search import GradientMultistart

Array = NDArray[np.float64]
OWN = ResponseSurface(surfaces="own")
LAW = Inputs({"a": Normal(Free(0.0, 2.0), Free(0.01, 0.6))})


def jump(c: Array, a: Array) -> Array:
    """Two branches, one above the other."""
    return a * c + (a > 1.0)


def table(count: int = 40, seed: int = 3) -> tuple[pd.DataFrame, Array]:
    """Synthetic outcomes of the jump, and the parameters behind them."""
    rng = np.random.default_rng(seed)
    c, a = rng.uniform(0.5, 2.0, count), rng.normal(1.0, 0.2, count)
    return pd.DataFrame({"c": c, "y": jump(c, a)}), a


def found_of(rows: pd.DataFrame, simulator=jump, **options) -> Identification:
    return identify(
        simulator, rows, LAW, outcome="y", vectorized=True, search=GradientMultistart(4),
        best_law=False, **options,
    )  # fmt: skip


@pytest.fixture(scope="module")
def asked() -> tuple[Identification, Array, Array]:
    rows, a = table()
    return found_of(rows), a, rows["c"].to_numpy()


def test_a_jump_is_answered_exactly(asked) -> None:
    """Each outcome has one parameter behind it, so that the law is that of a normal sample."""
    found, a, c = asked
    assert found.sound
    assert found.propagation == "direct"
    assert found.alpha["a.mean"].estimate == pytest.approx(a.mean(), abs=1e-4)
    assert found.alpha["a.sd"].estimate == pytest.approx(a.std(), abs=1e-4)
    assert found.alpha["a.mean"].standard_error == pytest.approx(a.std() / 40**0.5, rel=1e-2)
    exact = stats.norm.logpdf(a, a.mean(), a.std()).sum() - np.log(c).sum()
    assert found.log_likelihood.estimated == pytest.approx(exact, abs=0.01)


def test_its_intervals_are_those_of_the_normal_sample(asked) -> None:
    found, a, _ = asked

    def drop(mean: float) -> float:
        ratio = 1.0 + (mean - a.mean()) ** 2 / a.var()
        return 0.5 * a.size * np.log(ratio) - 0.5 * stats.chi2.ppf(0.95, 1)

    high = optimize.brentq(drop, a.mean(), a.mean() + 1.0)
    assert found.alpha["a.mean"].interval[1] == pytest.approx(high, abs=1e-3)


def test_the_second_verdict_is_given(asked) -> None:
    found = asked[0]
    assert found.consistency is not None
    assert found.consistency.consistent


def test_another_law_is_not_consistent() -> None:
    """Two clusters of parameters under a normal law."""
    rng = np.random.default_rng(5)
    c, a = rng.uniform(0.5, 2.0, 60), rng.choice([0.6, 1.4], 60) + rng.normal(0.0, 0.02, 60)
    found = found_of(pd.DataFrame({"c": c, "y": jump(c, a)}))
    assert found.sound
    assert found.propagation == "direct"
    assert found.consistency is not None
    assert not found.consistency.consistent


def test_an_outcome_in_the_gap_of_the_jump_is_not_explained() -> None:
    rows, _ = table()
    rows.loc[7, "y"] = rows.loc[7, "c"] + 0.5
    found = found_of(rows, consistency=False)
    assert not found.sound
    (told,) = [w for w in found.warnings if w.about == "jump"]
    assert told.concerns == ("8",)


def one_by_one(c: float, a: float) -> float:
    """The jump by numbers, not by arrays."""
    return a * c + (1.0 if a > 1.0 else 0.0)


def test_a_simulator_of_one_run_at_a_time_gets_surfaces_however_fast() -> None:
    rows, _ = table(12)
    choice = ResponseSurface(max_runs=30)
    found = identify(
        one_by_one, rows, LAW, outcome="y", search=GradientMultistart(4), best_law=False,
        consistency=False, propagation=choice,
    )  # fmt: skip
    assert found.propagation == "response_surface"
    assert found.runs < 12 * 200


@pytest.mark.parametrize("noise", [None, Noise(0.05)])
def test_no_clock_decides(noise: Noise | None) -> None:
    """The same function, fast and slowed: the same answer to the last bit."""

    def model(c: Array, a: Array) -> Array:
        return a * c + 0.1 * a**2

    def slowed(c: Array, a: Array) -> Array:
        time.sleep(0.01)
        return model(c, a)

    rng = np.random.default_rng(9)
    c, a = rng.uniform(0.5, 2.0, 8), rng.normal(1.0, 0.2, 8)
    rows = pd.DataFrame({"c": c, "y": model(c, a)})
    answers = [
        identify(
            one, rows, LAW, outcome="y", vectorized=True, noise=noise, consistency=False,
            search=GradientMultistart(2), best_law=False,
        )
        for one in (model, slowed)
    ]  # fmt: skip
    first, second = (answer.to_dict() | {"seconds": None, "simulator": None} for answer in answers)
    assert json.dumps(first) == json.dumps(second)
    assert first["propagation_reason"] == "the simulator takes arrays"


def test_a_budget_and_a_choice_of_surfaces_are_kept() -> None:
    rows, _ = table(20)
    within = found_of(rows, budget=Budget(runs=2000), consistency=False)
    assert within.propagation != "direct"
    assert within.runs <= 2000
    chosen = found_of(rows, propagation=ResponseSurface(tolerance=0.05, max_runs=60),
                      consistency=False)  # fmt: skip
    assert chosen.propagation != "direct"


def test_a_smooth_simulator_is_not_asked_more_than_its_surfaces_need() -> None:
    rows, _ = table()
    found = found_of(
        rows.assign(y=rows["c"] * 1.1), lambda c, a: c * np.exp(0.2 * a), propagation=OWN
    )
    assert found.runs < 40 * 30


def test_surfaces_of_a_simulator_that_jumps_are_given_up_and_it_is_said_where() -> None:
    rows, a = table(10)
    found = found_of(rows, consistency=False, propagation=OWN)
    off = abs(found.alpha["a.mean"].estimate - a.mean())
    assert found.sound
    assert off < 0.3 * a.std() / 10**0.5
    (told,) = [w for w in found.warnings if w.about == "jump"]
    places = [float(part) for part in re.findall(r"a = ([0-9.]+)", told.message)]
    assert places[0] <= 1.0 <= places[1] < places[0] + 0.1
    assert found.runs_by_stage["response surface"] < 10 * 500


def test_a_pole_far_from_the_law_is_no_jump() -> None:
    rng = np.random.default_rng(2)
    c, a = rng.uniform(1.0, 5.0, 30), rng.lognormal(0.4, 0.2, 30)
    law = Inputs({"a": LogNormal(Free(0.3, 4.0), Free(0.01, 2.0))})
    found = identify(
        lambda c, a: c / a, pd.DataFrame({"c": c, "y": c / a}), law, outcome="y", vectorized=True,
        search=GradientMultistart(4), consistency=False, best_law=False, propagation=OWN,
    )  # fmt: skip
    assert found.sound
    assert found.propagation == "response_surface"
    fitted = np.log(a).std()
    mean = np.exp(np.log(a).mean() + 0.5 * fitted**2)
    assert found.alpha["a.mean"].estimate == pytest.approx(mean, rel=1e-3)


@pytest.mark.parametrize("noise", [None, Noise(0.05)])
def test_a_tolerance_asks_for_surfaces(noise: Noise | None) -> None:
    """It says how exact these are to be, of a simulator that takes arrays too."""
    rng = np.random.default_rng(4)
    c = rng.uniform(0.5, 2.0, 12)
    y = c * rng.normal(1.0, 0.2, 12) + (0.05 * rng.standard_normal(12) if noise else 0.0)
    found = found_of(
        pd.DataFrame({"c": c, "y": y}), lambda c, a: c * a, noise=noise, consistency=False,
        propagation=ResponseSurface(tolerance=0.01),
    )  # fmt: skip
    assert found.propagation == "response_surface"
    assert found.runs < 1000
