"""Correlated errors and variance functions: published fits, each beside an exact value.

nlme linearizes, and its default is the restricted likelihood. So the closed forms written here are
first held to what nlme prints (tests/extras/scripts.Rout.save of nlme 3.1-169, Pinheiro and Bates,
2000, chapters 5 and 6), and then Aleator to their maximum likelihood, or to a quadrature.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identifications import estimates, unjudged
from individual_cases import likelihood_of
from scipy import optimize

from aleator import (
    AR1,
    CAR1,
    By,
    Check,
    Constant,
    Experiments,
    Free,
    GradientMultistart,
    Identification,
    Inputs,
    LogNormal,
    Noise,
    Normal,
    PowerVariance,
    identify,
)
from aleator.core.types import Array
from aleator.likelihood.individual import GaussHermite

DATA = Path(__file__).parents[1] / "data"
LOG_2_PI = np.log(2.0 * np.pi)


def _groups(column: pd.Series) -> list[Array]:
    return [np.flatnonzero(column == name) for name in column.unique()]


def _profiled(
    y: Array, x: Array, groups: list[Array], covariance: Callable[[Array], Array], restricted: bool
) -> tuple[float, Array]:
    """The (restricted) log-likelihood of a linear model at its best coefficients, and these."""
    parts = [(g, np.linalg.inv(covariance(g))) for g in groups]
    information = sum(x[g].T @ inverse @ x[g] for g, inverse in parts)
    beta = np.linalg.solve(information, sum(x[g].T @ inverse @ y[g] for g, inverse in parts))
    value = 0.0
    for g, inverse in parts:
        e = y[g] - x[g] @ beta
        value += 0.5 * (np.linalg.slogdet(inverse)[1] - e @ inverse @ e - g.size * LOG_2_PI)
    if restricted:
        value -= 0.5 * (np.linalg.slogdet(information)[1] - x.shape[1] * LOG_2_PI)
    return value, beta


def _highest(value: Callable[[Array], float], start: list[float]) -> tuple[float, Array]:
    found = optimize.minimize(lambda p: -value(p), start, method="BFGS", options={"gtol": 1e-6})
    return -found.fun, found.x


def _identified(
    model, frame: pd.DataFrame, key: str, outcome: str, inputs, noise
) -> Identification:  # type: ignore[no-untyped-def]
    table = Experiments.from_frame(frame, outcome=outcome, id=key)
    return unjudged(
        model, table, inputs, noise=noise, vectorized=True, verification=Check(0),
        search=GradientMultistart(2), seed=0,
    )  # fmt: skip


# ------------------------------------------------------------------------------ Ovary: AR(1)

OVARY = pd.read_csv(DATA / "ovary.csv")


def _harmonic(Time, A, B, C):
    return A + B * np.sin(2.0 * np.pi * Time) + C * np.cos(2.0 * np.pi * Time)


def test_follicles_of_mares_with_ar1_errors() -> None:
    angle = 2.0 * np.pi * OVARY["Time"].to_numpy()
    x = np.stack([np.ones_like(angle), np.sin(angle), np.cos(angle)], axis=1)
    y, groups = OVARY["follicles"].to_numpy(float), _groups(OVARY["Mare"])

    def covariance(p: Array, g: Array) -> Array:
        lags = np.abs(np.subtract.outer(np.arange(g.size), np.arange(g.size)))
        own = np.exp(p[0]) ** 2 + np.exp(p[1]) ** 2 * np.outer(x[g, 1], x[g, 1])
        return own + np.exp(p[2]) ** 2 * np.tanh(p[3]) ** lags

    def value(p: Array, restricted: bool) -> float:
        return _profiled(y, x, groups, partial(covariance, p), restricted)[0]

    start = [1.0, 0.2, 1.2, 0.6]
    restricted, at = _highest(partial(value, restricted=True), start)
    # the book, p. 241: log-restricted-likelihood -774.72 with 7 hyperparameters, phi = 0.572
    assert restricted == pytest.approx(-774.724, abs=5e-4)
    assert np.tanh(at[3]) == pytest.approx(0.572, abs=5e-4)
    highest, at = _highest(partial(value, restricted=False), start)
    beta = _profiled(y, x, groups, partial(covariance, at), False)[1]
    inputs = Inputs({
        "A": Normal(Free(0.0, 30.0), Free(0.1, 10.0)),
        "B": Normal(Free(-10.0, 10.0), Free(0.1, 10.0)),
        "C": Constant(Free(-10.0, 10.0)),
    })  # fmt: skip
    noise = Noise(Free(0.5, 10.0), correlation=AR1())
    found = _identified(_harmonic, OVARY, "Mare", "follicles", inputs, noise)
    assert found.sound
    assert found.log_likelihood.estimated == pytest.approx(highest, abs=1e-4)
    exact = [beta[0], np.exp(at[0]), beta[1], np.exp(at[1]), beta[2], np.exp(at[2]), np.tanh(at[3])]
    np.testing.assert_allclose(estimates(found), exact, atol=2e-3)


# --------------------------------------------------- BodyWeight: exponential in time, a power

RATS = pd.read_csv(DATA / "body_weight.csv")
GROWTH = Inputs(
    {
        "a": Normal(By("1 + C(Diet)", 100.0, 800.0), Free(5.0, 150.0)),
        "b": Normal(By("1 + C(Diet)", -2.0, 4.0), Free(0.02, 2.0)),
    },
    {("a", "b"): Free(-0.95, 0.95)},
)


class _Rats:
    """weight = a + b Time with a correlated normal law, whose means differ by diet."""

    y = RATS["weight"].to_numpy(float)
    time = RATS["Time"].to_numpy(float)
    groups = _groups(RATS["Rat"])
    diets = (RATS["Diet"].to_numpy()[:, None] == [2, 3]).astype(float)
    x = np.column_stack([np.ones_like(time), time, diets, time[:, None] * diets])

    def law(self, p: Array) -> Array:
        a, b, r = np.exp(p[0]), np.exp(p[1]), np.tanh(p[2])
        return np.array([[a**2, r * a * b], [r * a * b, b**2]])

    def errors(self, p: Array, g: Array, sd: Array) -> Array:
        away = np.abs(np.subtract.outer(self.time[g], self.time[g]))
        return np.outer(sd, sd) * np.exp(-away / np.exp(p[4]))

    def covariance(self, p: Array, fitted: Array, g: Array) -> Array:
        z = self.x[g][:, :2]
        return z @ self.law(p) @ z.T + self.errors(p, g, np.exp(p[3]) * fitted[g] ** p[5])


def test_weights_of_rats_with_errors_that_fade_in_time() -> None:
    rats, ones = _Rats(), np.ones(len(RATS))

    def value(p: Array) -> float:
        return _profiled(
            rats.y, rats.x, rats.groups, partial(rats.covariance, [*p, 0.0], ones), False
        )[0]

    highest, at = _highest(value, [3.5, -1.5, -0.15, 1.5, 1.3])
    at = np.array([*at, 0.0])
    beta = _profiled(rats.y, rats.x, rats.groups, partial(rats.covariance, at, ones), False)[1]
    noise = Noise(Free(0.5, 30.0), correlation=CAR1("Time", Free(0.5, 60.0)))
    found = _identified(
        lambda Time, a, b: a + b * Time, RATS[["Rat", "Diet", "Time", "weight"]], "Rat", "weight",
        GROWTH, noise,
    )  # fmt: skip
    assert found.log_likelihood.estimated == pytest.approx(highest, abs=1e-4)
    exact = [*beta[[0, 2, 3]], np.exp(at[0]), *beta[[1, 4, 5]], np.exp(at[1]), np.tanh(at[2])]
    exact += np.exp(at[3:5]).tolist()
    errors = np.array([e.standard_error for e in found.alpha.values()])
    np.testing.assert_array_less(np.abs(estimates(found) - exact), 0.02 * errors)


def _conditional(rats: _Rats, p: Array, fitted: Array) -> tuple[float, Array]:
    """The restricted log-likelihood with the scales of the fitted values, and the next of these."""
    value, beta = _profiled(rats.y, rats.x, rats.groups, partial(rats.covariance, p, fitted), True)
    after = rats.x @ beta
    for g in rats.groups:
        z = rats.x[g][:, :2]
        gain = z @ rats.law(p) @ z.T @ np.linalg.inv(rats.covariance(p, fitted, g))
        after[g] += gain @ (rats.y[g] - rats.x[g] @ beta)
    return value, after


def test_weights_of_rats_with_a_power_of_the_fitted_values() -> None:
    """nlme takes scales of the fitted values as known; the integral over the law does not."""
    rats = _Rats()
    # The book, p. 246: range 4.89, power 0.594, sds 36.9 and 0.233, correlation -0.147, scale 0.138
    p = np.array([*np.log([36.92, 0.2328]), np.arctanh(-0.147), *np.log([0.1384, 4.886]), 0.5943])
    fitted = rats.y
    for _ in range(20):
        value, fitted = _conditional(rats, p, fitted)
    assert value == pytest.approx(-560.57, abs=0.01)
    slopes = optimize.approx_fprime(p, lambda q: _conditional(rats, q, fitted)[0], 1e-6)
    assert np.max(np.abs(slopes)) < 0.3  # three printed digits away from its maximum
    frame = RATS.rename(columns={"Rat": "id", "Time": "time", "weight": "y"})
    means, alpha = np.array([251.5, 0.3626]), np.array([251.5, 33.3, 0.3626, 0.2047, -0.1427])
    inputs = Inputs(
        {"a": Normal(Free(100.0, 800.0), Free(5.0, 150.0)),
         "b": Normal(Free(-2.0, 4.0), Free(0.02, 2.0))},
        {("a", "b"): Free(-0.95, 0.95)},
    )  # fmt: skip
    first = frame[frame["Diet"] == 1].reset_index(drop=True)
    noise = Noise(
        Free(0.002, 5.0), variance=PowerVariance(), correlation=CAR1("time", Free(0.5, 60.0))
    )
    alpha = np.array([*alpha, 0.1338, 0.6005, 4.933])
    likelihood = likelihood_of(lambda t, x: x[0] + x[1] * t, first, inputs, noise=noise)
    found = likelihood.by(GaussHermite(9), alpha).evaluate(alpha).likelihood
    assert found == pytest.approx(_by_quadrature(rats, means, alpha), abs=1e-4)


def _by_quadrature(rats: _Rats, means: Array, alpha: Array) -> float:
    """log L of the rats of the first diet by 60 x 60 nodes about each individual least squares."""
    p = np.array([*np.log(alpha[[1, 3]]), np.arctanh(alpha[4]), *np.log(alpha[[5, 7]]), alpha[6]])
    law, (t, w), total = rats.law(p), np.polynomial.hermite_e.hermegauss(60), 0.0
    nodes = np.stack(np.meshgrid(t, t), axis=-1).reshape(-1, 2)
    log_weight = np.log(np.outer(w, w).ravel() / (2.0 * np.pi)) + 0.5 * np.sum(nodes**2, axis=1)
    for g in rats.groups[:8]:
        z = rats.x[g][:, :2]
        inverse = np.linalg.inv(rats.errors(p, g, alpha[5] * rats.y[g] ** alpha[6]))
        spread = np.linalg.inv(z.T @ inverse @ z + np.linalg.inv(law))
        middle = spread @ (z.T @ inverse @ rats.y[g] + np.linalg.solve(law, means))
        root = np.linalg.cholesky(spread)
        b = middle + nodes @ root.T
        eta = b @ z.T
        away = b - means
        terms = log_weight - 0.5 * np.sum(away @ np.linalg.inv(law) * away, axis=1)
        terms += 0.5 * (np.linalg.slogdet(spread)[1] - np.linalg.slogdet(law)[1])
        correlations = rats.errors(p, g, np.ones(g.size))
        u = (rats.y[g] - eta) / (alpha[5] * eta ** alpha[6])
        terms -= 0.5 * np.sum(u @ np.linalg.inv(correlations) * u, axis=1)
        terms -= np.sum(np.log(alpha[5] * eta ** alpha[6]), axis=1)
        terms -= 0.5 * (np.linalg.slogdet(correlations)[1] + g.size * LOG_2_PI)
        total += np.logaddexp.reduce(terms)
    return float(total)


# ------------------------------------------------------------------------- Soybean: a power

SOYBEAN = pd.read_csv(DATA / "soybean.csv")


def test_growth_of_soybeans_with_a_power_variance() -> None:
    """Model fm4Soy.nlme: one random effect, so that a quadrature of one dimension is exact.

    nlme prints a log-likelihood of -292 at its estimates, of a model that is linearized in the
    random effects.
    """
    own, y = pd.factorize(SOYBEAN["Plot"])[0], SOYBEAN["weight"].to_numpy()
    year = (SOYBEAN["Year"].to_numpy()[:, None] == [1989, 1990]).astype(float)
    kind = (SOYBEAN["Variety"] == "P").to_numpy(float)[:, None]
    one = np.ones((y.size, 1))
    x, w = np.polynomial.hermite_e.hermegauss(100)

    def exact(p: Array) -> float:
        rise = np.hstack([one, year]) @ p[11:14]
        away = (SOYBEAN["Time"] - np.hstack([one, year, kind]) @ p[7:11]) / rise
        top = np.hstack([one, year, kind, year * kind]) @ p[:6]
        eta = (top[:, None] + p[6] * x) / (1.0 + np.exp(-away.to_numpy()))[:, None]
        scale = p[14] * np.abs(eta) ** p[15]
        terms = -0.5 * ((y[:, None] - eta) / scale) ** 2 - np.log(scale) - 0.5 * LOG_2_PI
        each = np.zeros((48, x.size))
        np.add.at(each, own, terms)
        return float(np.sum(np.logaddexp.reduce(each + np.log(w / w.sum()), axis=1)))

    inputs = Inputs({
        "Asym": Normal(By("1 + C(Year)*C(Variety)", 5.0, 35.0), Free(0.05, 6.0)),
        "xmid": Constant(By("1 + C(Year) + C(Variety)", 35.0, 70.0)),
        "scal": Constant(By("1 + C(Year)", 4.0, 14.0)),
    })  # fmt: skip
    found = _identified(
        lambda Time, Asym, xmid, scal: Asym / (1.0 + np.exp(-(Time - xmid) / scal)), SOYBEAN,
        "Plot", "weight", inputs, Noise(Free(0.02, 2.0), variance=PowerVariance()),
    )  # fmt: skip
    assert found.sound
    alpha = estimates(found)
    # as many nodes as the search needs, and more of them at the same place
    assert found.log_likelihood.estimated == pytest.approx(exact(alpha), abs=2e-3)
    finer = found.fit.likelihood.integral.by(GaussHermite(25), alpha)  # type: ignore[union-attr]
    assert finer.evaluate(alpha).likelihood == pytest.approx(exact(alpha), abs=1e-5)
    highest, _ = _highest(exact, alpha.tolist())
    assert highest - exact(alpha) < 1e-4
    assert highest == pytest.approx(-290.25384, abs=1e-4)
    printed = [19.4, -8.8, -3.7, 1.6, 5.6, 0.1, 1.04, 54.8, -2.2, -5.0, -1.3, 8.1, -0.9, -0.7]
    errors = np.array([e.standard_error for e in found.alpha.values()])
    np.testing.assert_array_less(np.abs(alpha - [*printed, 0.218, 0.943]), 0.75 * errors)


# ----------------------------------------------------------------- Wang 2007: relative error


def test_ten_decays_with_a_relative_error() -> None:
    """Wang, J. Pharmacokinet. Pharmacodyn. 34 (2007) 575: y = 10 exp(-k t), at his values."""
    frame = pd.read_csv(DATA / "wang.csv")
    variance = 0.04  # of log k, so that k has the mean 0.5 exp(0.02)
    mean = 0.5 * np.exp(0.5 * variance)
    inputs = Inputs({"k": LogNormal(mean, mean * np.sqrt(np.expm1(variance)))})
    likelihood = likelihood_of(
        lambda t, x: 10.0 * np.exp(-x[0] * t), frame, inputs, noise=Noise(relative=np.sqrt(0.1))
    )
    alpha = np.array([h.start for h in likelihood.hyperparameters])
    value = likelihood.by(GaussHermite(25), alpha).evaluate(alpha).likelihood
    assert -2.0 * value - 20.0 * LOG_2_PI == pytest.approx(39.354803, abs=1e-6)


# ------------------------------------------------------------------------------ consistency


def test_correlation_that_is_left_out_is_found_and_named() -> None:
    """20 series of ten, rho = 0.5; `python -m benchmarks findings` has many of them."""
    rng = np.random.default_rng(5)
    root = np.linalg.cholesky(0.5 ** np.abs(np.subtract.outer(np.arange(10), np.arange(10))))
    load = np.tile(np.linspace(1.0, 3.0, 10), 20)
    a = np.repeat(1.0 + 0.2 * rng.standard_normal(20), 10)
    errors = 0.1 * (rng.standard_normal((20, 10)) @ root.T).ravel()
    frame = pd.DataFrame({"id": np.repeat(np.arange(20), 10), "load": load, "y": a * load + errors})
    inputs = Inputs({"a": Normal(Free(0.5, 1.5), Free(0.01, 1.0))})
    asked = partial(
        identify, lambda load, a: a * load, frame, inputs, outcome="y", vectorized=True,
        verification=Check(0), best_law=False, search=GradientMultistart(2),
    )  # fmt: skip
    left_out = asked(noise=Noise(Free(0.01, 1.0)))
    assert left_out.consistent is False
    (first, *_) = left_out.consistency.discrepancies
    assert first.test.kind == "neighbours"
    assert 'correlation = "ar1"' in first.remedy
    found = asked(noise=Noise(Free(0.01, 1.0), correlation=AR1()))
    assert found.consistent
    low, high = found.alpha["noise.rho"].interval
    assert low < 0.5 < high
    for report in found.observations:  # innovations: the residual of the first is its own
        assert abs(report.residual) < 5.0
    residual = np.array([r.residual for r in found.observations]).reshape(20, 10)
    assert abs(np.mean(residual[:, 1:] * residual[:, :-1])) < 0.2
