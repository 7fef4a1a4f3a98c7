"""Exact outcomes of responses with folds, kinks, peaks and jumps, against exact likelihoods."""

from __future__ import annotations

import json
import re
import time
import warnings
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
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
    TruncatedNormal,
    identify,
)
from aleator.core.types import Array
from aleator.errors import ExperimentsError
from aleator.inference.surface_diagnostics import by_finer_cells, cells_error
from aleator.likelihood.level_sets import LevelLikelihood
from aleator.search import GradientMultistart
from aleator.simulators.response_functions import DirectResponse

LEAST = 1e-3
"""Error of a log-likelihood that is none."""
COUNT = 60
OWN = ResponseSurface(surfaces="own")
BOX = (0.0, 2.0)


def truncated(mean: float, sd: float) -> stats.rv_continuous:
    return stats.truncnorm((BOX[0] - mean) / sd, (BOX[1] - mean) / sd, mean, sd)


def by_both_signs(c: Array, y: Array, alpha: Array) -> Array:
    """y = a^2 + 0.01 c: the roots are +-r."""
    r = np.sqrt(y - 0.01 * c)
    law = stats.norm(*alpha)
    return np.asarray((law.pdf(r) + law.pdf(-r)) / (2.0 * r))


def beside_a_maximum(c: Array, y: Array, alpha: Array) -> Array:
    """y = 2 - (a - c)^2: the roots are c +- r."""
    r = np.sqrt(2.0 - y)
    law = truncated(*alpha)
    return np.asarray((law.pdf(c + r) + law.pdf(c - r)) / (2.0 * r))


STUDIES = {
    "mirror": (lambda c, a: a**2 + 0.01 * c, by_both_signs, (0.0, 1.0), {"a": (0.3, 0.4)}),
    "maximum": (
        lambda c, a: 2.0 - (a - c) ** 2, beside_a_maximum, (0.6, 1.4), {"a": (1.0, 0.25)},
    ),
}  # fmt: skip
BOXED = ("maximum",)


def study(name: str, seed: int) -> tuple[pd.DataFrame, Inputs]:
    response, _, ends, laws = STUDIES[name]
    rng = np.random.default_rng([seed, 28])
    c = rng.uniform(*ends, COUNT)
    boxed = name in BOXED
    x = {
        n: (truncated(*at) if boxed else stats.norm(*at)).ppf(rng.uniform(1e-9, 1.0, COUNT))
        for n, at in laws.items()
    }
    free = {
        n: TruncatedNormal(box=BOX)
        if boxed
        else Normal(Free(m - 4.0 * sd, m + 4.0 * sd), Free(0.1 * sd, 4.0 * sd))
        for n, (m, sd) in laws.items()
    }
    return pd.DataFrame({"c": c, "y": response(c, **x)}), Inputs(free)


def identified(name: str, seed: int, **options: object) -> Identification:
    table, inputs = study(name, seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return unjudged(STUDIES[name][0], table, inputs, outcome="y", vectorized=True, **options)  # type: ignore[arg-type]


def exact(name: str, seed: int, found: Identification) -> float:
    table, _ = study(name, seed)
    alpha = np.array([one.estimate for one in found.alpha.values()])
    f = STUDIES[name][1](table["c"].to_numpy(), table["y"].to_numpy(), alpha)
    return float(np.log(f).sum())


@pytest.mark.parametrize(("name", "seed"), [("mirror", 3), ("maximum", 5)])
def test_a_log_likelihood_is_exact_within_its_error(name: str, seed: int) -> None:
    found = identified(name, seed)
    reported = found.log_likelihood
    assert found.sound
    assert abs(reported.estimated - exact(name, seed, found)) < max(reported.error or 0.0, LEAST)


def test_on_surfaces_the_error_is_that_of_the_surfaces_too() -> None:
    found = identified("mirror", 4, propagation=OWN)
    reported = found.log_likelihood
    assert reported.verified is not None
    assert abs(reported.estimated - exact("mirror", 4, found)) < 2.0 * reported.error


def bump(seed: int, count: int) -> tuple[pd.DataFrame, Array]:
    """y = exp(-(a - c)^2/0.72) + 0.2 c, with the roots' distance from c."""
    rng = np.random.default_rng([seed, *b"bump"])
    c = rng.uniform(0.3, 1.7, count)
    a = truncated(1.0, 0.3).ppf(rng.uniform(1e-12, 1.0, count))
    height = np.exp(-0.5 * ((a - c) / 0.6) ** 2)
    return pd.DataFrame({"c": c, "y": height + 0.2 * c}), 0.6 * np.sqrt(-2.0 * np.log(height))


def valley(seed: int) -> tuple[pd.DataFrame, Array]:
    """y = log(a/c)^2 + 0.2 c, a lognormal, with |log(a/c)|."""
    rng = np.random.default_rng([seed, *b"valley, lognormal"])
    c = rng.uniform(0.5, 1.5, COUNT)
    width = np.sqrt(np.log1p(0.16))
    law = stats.lognorm(width, scale=np.exp(-0.5 * width**2))
    r = np.abs(np.log(law.ppf(rng.uniform(1e-12, 1.0, COUNT)) / c))
    return pd.DataFrame({"c": c, "y": r**2 + 0.2 * c}), r


LOGNORMAL = Inputs({"a": LogNormal(Free(0.2, 3.0), Free(0.01, 2.0))})


def test_an_outcome_at_the_floor_of_a_valley_is_in_reach() -> None:
    table, r = valley(811)
    found = unjudged(
        lambda c, a: np.log(a / c) ** 2 + 0.2 * c, table, LOGNORMAL, outcome="y", vectorized=True,
        propagation=OWN,
    )  # fmt: skip
    mean, sd = (one.estimate for one in found.alpha.values())
    width = np.sqrt(np.log1p((sd / mean) ** 2))
    law = stats.lognorm(width, scale=mean * np.exp(-0.5 * width**2))
    a = table["c"].to_numpy() * np.exp(np.stack([r, -r]))
    exact = np.log(np.sum(law.pdf(a) * a / (2.0 * r), axis=0)).sum()
    assert found.sound
    assert abs(found.log_likelihood.estimated - exact) < found.log_likelihood.error < 0.1


def test_an_outcome_below_the_floor_of_a_valley_is_not() -> None:
    table, _ = valley(5)
    table.loc[7, "y"] = 0.2 * table.loc[7, "c"] - 0.1
    with pytest.raises(ExperimentsError, match="experiment 8: "):
        unjudged(
            lambda c, a: np.log(a / c) ** 2 + 0.2 * c, table, LOGNORMAL, outcome="y",
            vectorized=True,
        )  # fmt: skip


def test_the_error_of_cells_beside_a_kink_holds() -> None:
    """y = min(a, c b): one halving of the cells may change nothing by chance, two do not."""
    inputs = Inputs({n: Normal(Free(0.0, 2.0), Free(0.05, 1.0)) for n in "ab"})
    alpha = np.array([1.02, 0.25, 0.97, 0.2])
    first, second = stats.norm(*alpha[:2]), stats.norm(*alpha[2:])
    shares = []
    for seed in range(4):
        rng = np.random.default_rng([seed, 82])
        c = rng.uniform(0.5, 2.0, COUNT)
        y = np.minimum(first.rvs(COUNT, rng), c * second.rvs(COUNT, rng))
        simulator = DirectResponse(
            lambda index, x, c=c: np.minimum(x[:, 0], c[index] * x[:, 1]), COUNT, inputs.box
        )
        levels = LevelLikelihood(inputs, simulator, inputs.box, np.arange(COUNT), y, 96)
        problem = SimpleNamespace(levels=levels, outcomes=y)
        f = first.pdf(y) * second.sf(y / c) + second.pdf(y / c) / c * first.sf(y)
        error = cells_error(problem, by_finer_cells(problem, alpha))  # type: ignore[arg-type]
        shares.append(abs(levels.evaluate(alpha).total - np.log(f).sum()) / error)
    assert max(shares) < 1.0


@pytest.mark.parametrize("noise", [None, Noise(0.1)], ids=["exact", "noise"])
def test_a_law_whose_mirror_image_is_as_good_is_said_so(noise: Noise | None) -> None:
    rng = np.random.default_rng(6)
    c, a = rng.uniform(0.0, 1.0, COUNT), rng.normal(0.3, 0.4, COUNT)
    y = a**2 + 0.01 * c + (0.1 * rng.standard_normal(COUNT) if noise else 0.0)
    inputs = Inputs({"a": Normal(Free(-1.0, 2.0), Free(0.05, 2.0))})
    found = unjudged(
        lambda c, a: a**2 + 0.01 * c, pd.DataFrame({"c": c, "y": y}), inputs, outcome="y",
        vectorized=True, noise=noise,
    )  # fmt: skip
    other = f"a.mean {-found.values['a.mean']:.2g}"
    assert found.sound
    assert any("a.mean" in w.concerns and other in w.message for w in found.warnings)


# ---------------------------------------- an outcome far out, on a bend that the others do not show

NARROW = Inputs({"a": Normal(Free(0.5, 1.5), Free(0.02, 1.0))})
FIRST = 0.6
"""Load below which the outcome bends: that of the first experiment."""
UNLIMITED = Budget(runs=10**9)
"""Of a simulator with a budget surfaces take the place to the end, however fast it is."""


def bent(
    height: float, width: float, place: float, count: int = 12
) -> tuple[Callable[..., Array], pd.DataFrame]:
    """A simulator and its experiments, the first of which lies on the bend."""

    def simulator(load: Array, a: Array) -> Array:
        return load * a + height * np.exp(-(((a - place) / width) ** 2)) * (load < FIRST)

    load = np.linspace(0.5, 2.0, count)
    a = 1.0 + 0.2 * np.random.default_rng(0).standard_normal(count)
    a[0] = place + 0.00301
    return simulator, pd.DataFrame({"load": load, "y": simulator(load, a)})


def maximum_of_bent(simulator: Callable[..., Array], table: pd.DataFrame) -> tuple[Array, float]:
    """The maximum of the likelihood, and its value: sums of p/|slope| over the roots."""
    load, y = table["load"].to_numpy(), table["y"].to_numpy()
    grid = np.linspace(-1.0, 4.0, 200_001)
    off = simulator(load[0], grid) - y[0]
    at = np.flatnonzero(np.sign(off[:-1]) != np.sign(off[1:]))
    slope = np.abs(np.diff(off)[at]) / (grid[1] - grid[0])
    root = grid[at] - off[at] / np.diff(off)[at] * (grid[1] - grid[0])

    def loss(alpha: Array) -> float:
        first = np.log(np.sum(stats.norm.pdf(root, *alpha) / slope))
        others = stats.norm.logpdf(y[1:] / load[1:], *alpha) - np.log(load[1:])
        return -float(first + others.sum())

    found = optimize.minimize(loss, [1.0, 0.2], method="Nelder-Mead", options={"xatol": 1e-6})
    return found.x, -found.fun


@pytest.mark.parametrize("bend", [(-0.1, 0.3, 1.8), (0.1, 0.1, 1.8)])
def test_runs_near_an_outlier_make_its_density_exact(bend: tuple[float, float, float]) -> None:
    simulator, table = bent(*bend)
    alpha, value = maximum_of_bent(simulator, table)
    found = unjudged(simulator, table, NARROW, outcome="y", vectorized=True, budget=UNLIMITED)
    assert found.sound
    assert np.abs((found.values - alpha) / found.errors).max() < 0.02
    assert found.surface is not None
    assert found.surface["log_likelihood_error"] < 0.3
    assert found.log_likelihood.estimated == pytest.approx(value, abs=0.05)


# ------------------------------------------------------------------------------ a density that ends

THIN = 0.005
"""Standard deviation of what is added to the outcome, a fortieth of the other law's."""
TOP, BREADTH = 1.5, 0.25
"""The first experiment's outcome is largest at the peak, and was measured there."""


def peaked(load: Array, a: Array, z: Array) -> Array:
    peaked = 1.0 / (1.0 + ((a - TOP) / BREADTH) ** 2)
    return np.where(load < FIRST, peaked, load * a) + z


def exact_loss(load: Array, y: Array, alpha: Array) -> float:
    """Minus the log-likelihood, z left out of each outcome by its own density."""
    mean, sd, shift = alpha
    a = np.linspace(mean - 8.0 * sd, mean + 8.0 * sd, 4001)
    weight = stats.norm.pdf(a, mean, sd) * (a[1] - a[0])
    rest = y[:, None] - peaked(load[:, None], a, 0.0) - shift
    return -float(np.sum(np.log(stats.norm.pdf(rest, 0.0, THIN) @ weight + 1e-300)))


@pytest.mark.long
def test_a_right_answer_is_sound_where_the_kernel_smears_the_end_of_a_density() -> None:
    rng, load = np.random.default_rng(1), np.linspace(0.5, 2.0, 10)
    a = 1.0 + 0.2 * rng.standard_normal(10)
    z = THIN * rng.standard_normal(10)
    a[0], z[0] = TOP, 0.0
    y = peaked(load, a, z)
    laws = {
        "a": TruncatedNormal((0.2, 2.0), Free(0.5, 1.5), Free(0.02, 0.6)),
        "z": TruncatedNormal((-0.2, 0.2), Free(-0.1, 0.1), THIN),
    }
    found = unjudged(
        peaked, pd.DataFrame({"load": load, "y": y}), Inputs(laws), outcome="y",
        vectorized=True, budget=UNLIMITED,
    )  # fmt: skip
    alpha = [found.alpha[name] for name in ("a.mean", "a.sd", "z.mean")]
    estimates = np.array([e.estimate for e in alpha])
    truth = optimize.minimize(
        lambda p: exact_loss(load, y, p), estimates, method="Nelder-Mead",
        bounds=[(0.5, 1.5), (0.02, 0.6), (-0.1, 0.1)],
    )  # fmt: skip
    errors = np.array([e.standard_error for e in alpha], dtype=float)
    assert np.abs((estimates - truth.x) / errors).max() < 0.1
    assert found.log_likelihood.estimated == pytest.approx(-truth.fun, abs=0.02)
    assert found.sound


# ------------------------------------------------------------------------------ jumps

LAW_OF_JUMP = Inputs({"a": Normal(Free(0.0, 2.0), Free(0.01, 0.6))})


def jump(c: Array, a: Array) -> Array:
    """Two branches, one above the other."""
    return a * c + (a > 1.0)


def jumping(count: int = 40, seed: int = 3) -> tuple[pd.DataFrame, Array]:
    """Synthetic outcomes of the jump, and the parameters behind them."""
    rng = np.random.default_rng(seed)
    c, a = rng.uniform(0.5, 2.0, count), rng.normal(1.0, 0.2, count)
    return pd.DataFrame({"c": c, "y": jump(c, a)}), a


def found_of(rows: pd.DataFrame, simulator=jump, **options) -> Identification:
    return identify(
        simulator, rows, LAW_OF_JUMP, outcome="y", vectorized=True, search=GradientMultistart(4),
        best_law=False, **options,
    )  # fmt: skip


def test_a_jump_is_answered_exactly() -> None:
    """Each outcome has one parameter behind it, so that the law is that of a normal sample."""
    rows, a = jumping()
    found, c = found_of(rows), rows["c"].to_numpy()
    assert found.sound
    assert found.propagation == "direct"
    assert found.alpha["a.mean"].estimate == pytest.approx(a.mean(), abs=1e-4)
    assert found.alpha["a.sd"].estimate == pytest.approx(a.std(), abs=1e-4)
    assert found.alpha["a.mean"].standard_error == pytest.approx(a.std() / 40**0.5, rel=1e-2)
    exact = stats.norm.logpdf(a, a.mean(), a.std()).sum() - np.log(c).sum()
    assert found.log_likelihood.estimated == pytest.approx(exact, abs=0.01)
    assert found.consistency.consistent

    def drop(mean: float) -> float:
        ratio = 1.0 + (mean - a.mean()) ** 2 / a.var()
        return 0.5 * a.size * np.log(ratio) - 0.5 * stats.chi2.ppf(0.95, 1)

    high = optimize.brentq(drop, a.mean(), a.mean() + 1.0)
    assert found.alpha["a.mean"].interval[1] == pytest.approx(high, abs=1e-3)


def test_another_law_is_not_consistent() -> None:
    """Two clusters of parameters under a normal law."""
    rng = np.random.default_rng(5)
    c, a = rng.uniform(0.5, 2.0, 60), rng.choice([0.6, 1.4], 60) + rng.normal(0.0, 0.02, 60)
    found = found_of(pd.DataFrame({"c": c, "y": jump(c, a)}))
    assert found.sound
    assert found.propagation == "direct"
    assert not found.consistency.consistent


def test_an_outcome_in_the_gap_of_the_jump_is_not_explained() -> None:
    rows, _ = jumping()
    rows.loc[7, "y"] = rows.loc[7, "c"] + 0.5
    found = found_of(rows, consistency=False)
    assert not found.sound
    (told,) = [w for w in found.warnings if w.about == "jump"]
    assert told.concerns == ("8",)


def one_by_one(c: float, a: float) -> float:
    """The jump by numbers, not by arrays."""
    return a * c + (1.0 if a > 1.0 else 0.0)


@pytest.mark.long
def test_a_simulator_of_one_run_at_a_time_gets_surfaces_however_fast() -> None:
    rows, _ = jumping(12)
    choice = ResponseSurface(max_runs=30)
    found = identify(
        one_by_one, rows, LAW_OF_JUMP, outcome="y", search=GradientMultistart(4), best_law=False,
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
            one, rows, LAW_OF_JUMP, outcome="y", vectorized=True, noise=noise, consistency=False,
            search=GradientMultistart(2), best_law=False,
        )
        for one in (model, slowed)
    ]  # fmt: skip
    first, second = (answer.to_dict() | {"seconds": None, "simulator": None} for answer in answers)
    assert json.dumps(first) == json.dumps(second)
    assert first["propagation_reason"] == "the simulator takes arrays"


def test_a_budget_and_a_choice_of_surfaces_are_kept() -> None:
    rows, _ = jumping(10)
    within = found_of(rows, budget=Budget(runs=200), consistency=False)
    assert within.propagation != "direct"
    assert within.runs <= 200
    chosen = found_of(rows, propagation=ResponseSurface(tolerance=0.05, max_runs=60),
                      consistency=False)  # fmt: skip
    assert chosen.propagation != "direct"


def test_surfaces_of_a_simulator_that_jumps_are_given_up_and_it_is_said_where() -> None:
    rows, a = jumping(10)
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
