"""Responses with extremes, saddles, folds and kinks without noise, against exact likelihoods."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import stats

from aleator import (
    Free,
    Identification,
    Inputs,
    LogNormal,
    Noise,
    Normal,
    ResponseSurface,
    TruncatedNormal,
)
from aleator.core.types import Array
from aleator.errors import ExperimentsError
from aleator.inference.diagnostics import search_refusals
from aleator.inference.surface_diagnostics import by_finer_cells, cells_error
from aleator.likelihood.level_sets import LevelLikelihood
from aleator.surrogates.responses import DirectResponse

LEAST = 1e-3
"""Error of a log-likelihood that is none."""
COUNT = 60
OWN = ResponseSurface(surfaces="own")
BOX = (0.0, 2.0)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)


def truncated(mean: float, sd: float) -> stats.rv_continuous:
    return stats.truncnorm((BOX[0] - mean) / sd, (BOX[1] - mean) / sd, mean, sd)


def by_roots(c: Array, y: Array, alpha: Array) -> Array:
    """y = max(a - c, 0.3 (c - a)): one root on either side of c."""
    law = truncated(*alpha)
    return np.asarray(law.pdf(c + y) + law.pdf(c - y / 0.3) / 0.3)


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


def by_panels(f: Callable[[Array], Array], ends: Array) -> float:
    half, middle = 0.5 * np.diff(ends), 0.5 * (ends[1:] + ends[:-1])
    x = middle[:, None] + half[:, None] * NODES
    return float(np.sum(half[:, None] * WEIGHTS * f(x)))


def along_the_fold(c: Array, y: Array, alpha: Array) -> Array:
    """y = |a - c| + c b: the line b = (y - |a - c|)/c, with a kink at a = c."""
    first, second = truncated(*alpha[:2]), truncated(*alpha[2:])
    return np.array([
        by_panels(
            lambda a, c=c, y=y: first.pdf(a) * second.pdf((y - np.abs(a - c)) / c) / c,
            # the line leaves the box of b where |a - c| is y or y - 2 c
            np.unique(np.clip([*np.linspace(*BOX, 101), c, c - y, c + y, c - y + 2.0 * c,
                               c + y - 2.0 * c], *BOX)),
        )
        for c, y in zip(c, y, strict=True)
    ])  # fmt: skip


def along_hyperbolas(c: Array, y: Array, alpha: Array) -> Array:
    """y = c (a - 1) (b - 0.8): both branches, by the logarithm of |a - 1|."""
    first, second = stats.norm(*alpha[:2]), stats.norm(*alpha[2:])

    def both(t: Array, z: float, c: float) -> Array:
        u = np.exp(t)
        return np.asarray(
            (first.pdf(1.0 + u) * second.pdf(0.8 + z / u)
             + first.pdf(1.0 - u) * second.pdf(0.8 - z / u)) / c
        )  # fmt: skip

    return np.array([
        by_panels(lambda t, z=y / c, c=c: both(t, z, c),
                  np.linspace(np.log(abs(y / c)) - 2.5, 2.5, 301))
        for c, y in zip(c, y, strict=True)
    ])  # fmt: skip


STUDIES = {
    "two slopes": (
        lambda c, a: np.maximum(a - c, 0.3 * (c - a)), by_roots, (0.2, 1.8), {"a": (1.0, 0.3)},
    ),
    "mirror": (lambda c, a: a**2 + 0.01 * c, by_both_signs, (0.0, 1.0), {"a": (0.3, 0.4)}),
    "maximum": (
        lambda c, a: 2.0 - (a - c) ** 2, beside_a_maximum, (0.6, 1.4), {"a": (1.0, 0.25)},
    ),
    "fold": (
        lambda c, a, b: np.abs(a - c) + c * b, along_the_fold, (0.2, 1.8),
        {"a": (1.0, 0.25), "b": (1.0, 0.2)},
    ),
    "saddle": (
        lambda c, a, b: c * (a - 1.0) * (b - 0.8), along_hyperbolas, (0.5, 2.0),
        {"a": (1.1, 0.3), "b": (0.9, 0.25)},
    ),
}  # fmt: skip
BOXED = ("two slopes", "maximum", "fold")


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


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        pytest.param("two slopes", 2, marks=pytest.mark.slow),
        ("mirror", 3),
        ("mirror", 13),
        ("maximum", 5),
        pytest.param("fold", 1, marks=pytest.mark.slow),
        pytest.param("saddle", 1, marks=pytest.mark.long),
    ],
)
def test_a_log_likelihood_is_exact_within_its_error(name: str, seed: int) -> None:
    found = identified(name, seed)
    reported = found.log_likelihood
    assert found.sound
    assert abs(reported.estimated - exact(name, seed, found)) < max(reported.error or 0.0, LEAST)


def test_on_surfaces_the_error_is_that_of_the_surfaces_too() -> None:
    found = identified("mirror", 4, propagation=OWN)
    reported = found.log_likelihood
    assert reported.verified is not None
    assert reported.error is not None
    assert abs(reported.estimated - exact("mirror", 4, found)) < 2.0 * reported.error


def bump(seed: int, count: int) -> tuple[pd.DataFrame, Array]:
    """y = exp(-(a - c)^2/0.72) + 0.2 c, with the roots' distance from c."""
    rng = np.random.default_rng([seed, *b"bump"])
    c = rng.uniform(0.3, 1.7, count)
    a = truncated(1.0, 0.3).ppf(rng.uniform(1e-12, 1.0, count))
    height = np.exp(-0.5 * ((a - c) / 0.6) ** 2)
    return pd.DataFrame({"c": c, "y": height + 0.2 * c}), 0.6 * np.sqrt(-2.0 * np.log(height))


@pytest.mark.parametrize(
    ("seed", "count"), [(2811, 30), pytest.param(2811, 60, marks=pytest.mark.slow)]
)
def test_a_bump_by_surfaces_is_accepted_with_an_error_that_holds(seed: int, count: int) -> None:
    """Outcomes within 3e-5 of the maximum: a kernel smears them, and small errors matter."""
    table, r = bump(seed, count)
    found = unjudged(
        lambda c, a: np.exp(-0.5 * ((a - c) / 0.6) ** 2) + 0.2 * c, table,
        Inputs({"a": TruncatedNormal(box=BOX)}), outcome="y", vectorized=True, propagation=OWN,
    )  # fmt: skip
    law = truncated(*[one.estimate for one in found.alpha.values()])
    c, height = table["c"].to_numpy(), np.exp(-0.5 * (r / 0.6) ** 2)
    f = (law.pdf(c + r) + law.pdf(c - r)) / (height * r / 0.36)
    assert found.sound
    assert found.log_likelihood.error is not None
    assert found.log_likelihood.error < 0.15
    assert abs(found.log_likelihood.estimated - np.log(f).sum()) < found.log_likelihood.error


def valley(seed: int) -> tuple[pd.DataFrame, Array]:
    """y = log(a/c)^2 + 0.2 c, a lognormal, with |log(a/c)|."""
    rng = np.random.default_rng([seed, *b"valley, lognormal"])
    c = rng.uniform(0.5, 1.5, COUNT)
    width = np.sqrt(np.log1p(0.16))
    law = stats.lognorm(width, scale=np.exp(-0.5 * width**2))
    r = np.abs(np.log(law.ppf(rng.uniform(1e-12, 1.0, COUNT)) / c))
    return pd.DataFrame({"c": c, "y": r**2 + 0.2 * c}), r


LOGNORMAL = Inputs({"a": LogNormal(Free(0.2, 3.0), Free(0.01, 2.0))})


@pytest.mark.parametrize("seed", [811, 2811])
def test_an_outcome_at_the_floor_of_a_valley_is_in_reach(seed: int) -> None:
    table, r = valley(seed)
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
    assert found.log_likelihood.error is not None
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


def test_a_maximum_is_reached_by_standard_errors() -> None:
    """What is left to gain is half the square of the distance in standard errors."""
    at = [SimpleNamespace(positive=True, edm=0.5 * distance**2) for distance in (0.05, 0.5)]
    assert not search_refusals(at[0], ())  # type: ignore[arg-type]
    assert search_refusals(at[1], ())  # type: ignore[arg-type]
