"""Answers with noise are those of published maxima, closed forms and exact integrals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from identifications import assert_maximum, errors_of, estimates, unjudged
from individual_cases import PAIR, straight_line, table
from problems import FRONTIER, Problem, log_frontier
from scipy import integrate, optimize, special, stats

from aleator import (
    Censoring,
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
    ResponseSurface,
    StudentError,
    TruncatedNormal,
    identify,
)
from aleator.core.types import Array
from aleator.errors import InputsError


def growth(time: np.ndarray, log_rate: np.ndarray) -> np.ndarray:
    return np.exp(np.minimum(np.exp(log_rate) * time, 30.0))


def censored_table(kind: str, rows: int, seed: int = 4) -> pd.DataFrame:
    """Sixteen experiments of `rows` values, of which those of the kind are known by bounds only."""
    rng = np.random.default_rng(seed)
    frame = []
    for l in range(16):
        x = rng.normal(-0.5, 0.6)
        for time in np.linspace(0.5, 1.5, rows) if rows > 1 else [rng.uniform(0.5, 1.5)]:
            y = float(growth(time, x)) + 0.2 * rng.standard_normal()
            low, high, word = y, y, "measured"
            if kind == "left" and y < 1.6:
                low, high, word = np.nan, 1.6, "below"
            elif kind == "right" and y > 2.4:
                low, high, word = 2.4, np.nan, "above"
            elif kind == "between":
                low, high = np.floor(2.0 * y) / 2.0, np.floor(2.0 * y) / 2.0 + 0.5
            value = high if word == "below" else low
            upper = high if kind == "between" else np.nan
            frame.append({"id": f"e{l}", "time": time, "y": value, "status": word, "upper": upper})
    return pd.DataFrame(frame)


def exact_with_bounds(frame: pd.DataFrame, alpha: np.ndarray) -> float:
    """log L by Simpson's rule with 20,001 points of the one parameter."""
    mean, sd, noise = alpha
    total = 0.0
    for _, own in frame.groupby("id"):
        t, low, word = own["time"].to_numpy(), own["y"].to_numpy(), own["status"].to_numpy()
        high = own["upper"].to_numpy()

        x = np.linspace(mean - 8.0 * sd, mean + 8.0 * sd, 20_001)
        eta = growth(t, x[:, None])
        u, above = (low - eta) / noise, (high - eta) / noise
        p = stats.norm.pdf(u) / noise
        p = np.where(word == "below", stats.norm.cdf(u), p)
        p = np.where(word == "above", stats.norm.sf(u), p)
        p = np.where(np.isnan(high), p, stats.norm.cdf(above) - stats.norm.cdf(u))
        density = np.prod(p, axis=1) * stats.norm.pdf(x, mean, sd)
        total += float(np.log(integrate.simpson(density, x=x)))
    return total


@pytest.mark.slow
@pytest.mark.parametrize("rows", [1, pytest.param(4, marks=pytest.mark.long)])
@pytest.mark.parametrize("kind", ["left", "right", "between"])
def test_censored_values_give_the_exact_maximum(kind: str, rows: int) -> None:
    frame = censored_table(kind, rows)
    words = {"left": {"left": "below"}, "right": {"right": "above"}}.get(kind)
    censored = Censoring(upper="upper") if words is None else Censoring("status", **words)
    table = Experiments.from_frame(frame, outcome="y", conditions=["time"], censored=censored)
    assert np.any(table.observations.censored)
    inputs = Inputs({"log_rate": Normal(Free(-2.0, 1.0), Free(0.01, 2.0))})
    # one value an experiment does not tell the noise from the scatter
    noise = Noise(Free(0.01, 2.0) if rows > 1 else 0.2)
    answer = unjudged(growth, table, inputs, noise=noise, vectorized=True)
    alpha = estimates(answer)
    assert answer.sound
    assert answer.log_likelihood.estimated == pytest.approx(
        exact_with_bounds(frame, alpha), abs=0.01
    )
    assert_maximum(lambda a: exact_with_bounds(frame, a), alpha, errors_of(answer))


# ----------------------------------------------------------------- sharp densities and little noise


def answered(problem: Problem, y: np.ndarray, **more: object) -> Identification:
    return unjudged(
        problem.simulator, problem.table(y), problem.inputs, outcome="y", vectorized=True,
        noise=problem.noise, search=GradientMultistart(3), verification=Check(0), **more,
    )  # type: ignore[arg-type]  # fmt: skip


def test_a_stochastic_frontier_is_found_exactly() -> None:
    """A sharp density that meets little noise, where four moments are 1.3 errors off."""
    sds = (1.6, 0.1)
    problem = replace(FRONTIER, z=np.linspace(0.0, 3.0, 100))
    y = problem.draw(3, np.array([1.0, 0.7, 0.0, *sds]))

    def negative(p: np.ndarray) -> float:
        return -float(np.sum(log_frontier(y - p[0] - p[1] * problem.z, p[2], p[3])))

    start, bounds = np.array([1.0, 0.7, *sds]), [(-1, 5), (-1, 3), (0.02, 2.0), (0.02, 1.0)]
    end = optimize.minimize(
        negative, start, method="L-BFGS-B", bounds=bounds, tol=1e-14, options={"maxiter": 500}
    )
    found = answered(problem, y)
    assert found.density.startswith("panels")
    assert found.log_likelihood.estimated == pytest.approx(-end.fun, abs=1e-3)
    for name, value in zip(("b0.value", "b1.value", "u.sd", "noise.sd"), end.x, strict=True):
        estimate = found.alpha[name]
        assert abs(estimate.estimate - value) < 0.02 * estimate.standard_error
    assert found.sound


# ---------------------------------------------------------------------- the verified log-likelihood

FINE = np.linspace(-8.0, 8.0, 4001)
TIME = np.tile([0.5, 1.2, 2.5], 40)
ROWS = np.repeat(np.arange(40), 3)
NOISE, SD = 0.05, 0.6


def fading(time: Array, rate: Array) -> Array:
    return np.exp(-rate * time)


@pytest.mark.parametrize("law", [Normal, LogNormal])
def test_the_verified_log_likelihood_is_as_exact_as_told(law) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(1)
    rates = np.exp(SD * rng.standard_normal(40))
    y = fading(TIME, rates[ROWS]) + NOISE * rng.standard_normal(120)
    frame = pd.DataFrame({"id": [f"e{k}" for k in ROWS], "time": TIME, "y": y})
    inputs = Inputs({"rate": law(Free(0.2, 4.0), Free(0.01, 2.0))})
    found = unjudged(
        fading, Experiments.from_frame(frame, outcome="y"), inputs, noise=Noise(NOISE),
        vectorized=True, propagation=ResponseSurface(surfaces="own"),
    )  # fmt: skip
    alpha = np.array([found.values["rate.mean"], found.values["rate.sd"]])
    x = inputs.sample(alpha, special.ndtr(FINE)[:, None])[:, 0]
    each = stats.norm.logpdf(y[:, None], fading(TIME[:, None], x), NOISE)
    of_experiment = np.add.reduceat(each, np.arange(0, 120, 3))
    weight = stats.norm.logpdf(FINE) + np.log(FINE[1] - FINE[0])
    exact = special.logsumexp(of_experiment + weight, axis=1).sum()
    told = found.log_likelihood
    assert told.verified_standard_error < 0.01
    assert abs(told.verified - exact) < 3.0 * told.verified_standard_error


AT = np.linspace(-1.0, 1.0, 7)
DESIGN = np.stack([AT**k for k in range(4)], axis=1)


def negative(p: np.ndarray, y: np.ndarray) -> float:
    """-log L of the normal law that y = Z x + e has, x normal with independent parts."""
    means, sds, noise = p[:4], p[4:8], p[8]
    covariance = (DESIGN * sds**2) @ DESIGN.T + noise**2 * np.eye(AT.size)
    return -float(stats.multivariate_normal.logpdf(y, DESIGN @ means, covariance).sum())


# ------------------------------------------------------------------------------ more than four

LARGE = 0.25


def study(many: int, count: int, bend: float, seed: int):
    """A simulator y = s + bend s^2 of s = c.x, a table, and the exact -log L of (means, last sd).

    With noise, s is normal, and y a smooth function of it: one integral an experiment.
    """
    rng = np.random.default_rng(seed)
    means, sds = rng.uniform(-1.0, 1.0, many), np.linspace(0.15, 0.5, many)
    c = rng.uniform(0.2, 2.0, (count, many)) * rng.choice([-1.0, 1.0], (count, many))
    s = np.sum(c * (means + sds * rng.standard_normal((count, many))), axis=1)
    y = s + bend * s**2 + LARGE * rng.standard_normal(count)
    table = pd.DataFrame({f"c{i}": c[:, i] for i in range(many)} | {"y": y})
    laws = {
        f"x{i}": Normal(Free(-2.0, 2.0), Free(0.02, 1.5) if i == many - 1 else float(sds[i]))
        for i in range(many)
    }
    arguments = ",".join([f"c{i}" for i in range(many)] + [f"x{i}" for i in range(many)])
    total = "+".join(f"c{i}*x{i}" for i in range(many))
    model = eval(f"lambda {arguments}: ({total}) + {bend} * ({total})**2")

    def negative(p: np.ndarray) -> float:
        own, t = np.append(sds[:-1], p[-1]), np.linspace(-8.0, 8.0, 1601)
        middle, spread = c @ p[:-1], np.sqrt(c**2 @ own**2)
        if not bend:
            return -float(stats.norm.logpdf(y, middle, np.hypot(spread, LARGE)).sum())
        at = middle[:, None] + spread[:, None] * t
        f = stats.norm.pdf(y[:, None], at + bend * at**2, LARGE) @ stats.norm.pdf(t)
        return -float(np.log(np.maximum(f * (t[1] - t[0]), 1e-300)).sum())

    limits = [(-2.0, 2.0)] * many + [(0.02, 1.5)]
    start = np.append(means, sds[-1])
    end = optimize.minimize(negative, start, method="L-BFGS-B", bounds=limits, tol=1e-12)
    return model, table, Inputs(laws), end


@pytest.mark.parametrize(
    ("many", "count", "bend"), [(5, 15, 0.0), pytest.param(10, 50, 0.03, marks=pytest.mark.long)]
)
def test_the_maximum_is_that_of_the_closed_form(many: int, count: int, bend: float) -> None:
    model, table, inputs, end = study(many, count, bend, seed=many + 30)
    found = unjudged(
        model, table, inputs, outcome="y", vectorized=True, noise=Noise(LARGE),
        search=GradientMultistart(2), verification=Check(0),
    )  # fmt: skip
    # a flat standard deviation can be told as not arrived at, by a score of few points
    off = abs(found.log_likelihood.estimated + end.fun)
    assert off < 1e-2
    assert off < max(abs(found.quadrature["gap"]), 2e-3)
    names = [f"x{i}.mean" for i in range(many)] + [f"x{many - 1}.sd"]
    for name, value in zip(names, end.x, strict=True):
        one = found.alpha[name]
        error = one.standard_error or 1e-6  # none where the maximum lies on a limit
        assert one.estimate == pytest.approx(value, abs=0.05 * error)


# ------------------------------------------------------------------------- maxima at several noises

LIMITS = (0.5, 2.0)
PLACES = np.linspace(*LIMITS, 15_001)


def peak(c: Array, a: Array) -> Array:
    """The resonance of an oscillator of natural frequency a with a damping of 0.05."""
    return 1.0 / np.sqrt((1.0 - (c / a) ** 2) ** 2 + (0.1 * c / a) ** 2)


def within(mean: float, sd: float) -> object:
    return stats.truncnorm((LIMITS[0] - mean) / sd, (LIMITS[1] - mean) / sd, mean, sd)


def log_likelihood(alpha: Array, c: Array, y: Array) -> float:
    """By the trapezoidal rule on 15,001 points of a."""
    mean, sd, noise = alpha
    law = within(mean, sd).pdf(PLACES)
    density = stats.norm.pdf(y[:, None], peak(c[:, None], PLACES), noise) * law
    return float(np.sum(np.log(np.trapezoid(density, PLACES, axis=1))))


def test_no_climb_from_another_noise_ends_higher() -> None:
    """Fifteen experiments hardly tell noise from scatter: there are maxima at many noises."""
    rng = np.random.default_rng(1017)
    c = rng.uniform(0.8, 1.6, 15)
    a = within(1.2, 0.1).ppf(stats.norm.cdf(rng.standard_normal(15)))
    y = peak(c, a) + rng.normal(0.0, 0.02, 15)
    found = unjudged(
        peak,
        pd.DataFrame({"c": c, "y": y}),
        Inputs({"a": TruncatedNormal(LIMITS, Free(), Free())}),
        outcome="y",
        noise=Noise(Free(0.002, 1.0)),
        vectorized=True,
        seed=0,
    )
    told = log_likelihood(np.array([e.estimate for e in found.alpha.values()]), c, y)
    highest = [
        -optimize.minimize(
            lambda u: -log_likelihood(np.array([u[0], *np.exp(u[1:])]), c, y),
            [1.195, np.log(0.09), np.log(noise)],
            method="Nelder-Mead",
            options={"xatol": 1e-3, "fatol": 1e-4},
        ).fun
        for noise in (0.02, 0.2)
    ]
    assert told > max(highest) - 2e-3
    assert found.log_likelihood.estimated == pytest.approx(told, abs=2e-3)


# ------------------------------------------------------------------------------ lives


def life(log_life: Array) -> Array:
    return np.exp(log_life)


def test_sorted_lives_with_bounds_do_not_drift() -> None:
    rng = np.random.default_rng(6)
    lives, stopped = np.exp(rng.normal(10.0, 0.5, 40)), np.exp(rng.normal(9.7, 0.4, 40))
    km, runs = np.minimum(lives, stopped), lives > stopped
    order = np.argsort(km)
    km, runs = km[order], runs[order]
    frame = pd.DataFrame({"km": km, "ended": np.where(runs, "running", "failed")})
    found = identify(
        life,
        Experiments.from_frame(
            frame, outcome="km", transform="log", censored=Censoring("ended", right="running")
        ),
        Inputs({"log_life": Constant(Free(6.0, 14.0))}),
        noise=Noise(Free(0.01, 3.0)),
        vectorized=True,
        verification=Check(0),
        best_law=False,
    )

    def minus(p: Array) -> float:
        u = (np.log(km) - p[0]) / np.exp(p[1])
        return -float(np.where(runs, stats.norm.logsf(u), stats.norm.logpdf(u) - p[1]).sum())

    exact = optimize.minimize(minus, (10.0, -0.5))
    assert found.log_likelihood.estimated == pytest.approx(-exact.fun, abs=1e-3)
    assert found.values["log_life.value"] == pytest.approx(exact.x[0], abs=1e-3)
    assert found.consistent


# ------------------------------------------------------------------------------ surfaces


@pytest.mark.slow
def test_surfaces_and_the_simulator_itself_lead_to_one_answer() -> None:
    frame = table(straight_line, experiments=15)
    experiments = Experiments.from_frame(frame, outcome="y", id="id")
    noise = Noise(Free(0.01, 5.0))
    direct, surfaced = (
        unjudged(
            lambda time, a, b: a + b * time, experiments, PAIR, noise=noise,
            propagation=ResponseSurface(surfaces=way),
        )
        for way in ("none", "own")
    )  # fmt: skip
    assert surfaced.sound
    assert surfaced.log_likelihood.estimated == pytest.approx(
        direct.log_likelihood.estimated, abs=0.01
    )
    assert surfaced.log_likelihood.verified == pytest.approx(
        direct.log_likelihood.estimated, abs=0.01
    )
    off = (surfaced.values - direct.values) / direct.errors
    assert off.abs().max() < 0.05


# ------------------------------------------------------------------------------ another kind


def test_noise_of_student_is_identified_exactly() -> None:
    """y = z x + e, x normal and e of Student: the maximum of the exact integral, found by SciPy."""
    rng = np.random.default_rng(3)
    z = np.tile([0.5, 1.0, 2.0, 3.0], 30)
    y = z * rng.normal(1.0, 0.2, z.size) + 0.15 * rng.standard_t(5, z.size)
    law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.02, 1.0))})
    found = unjudged(
        lambda z, x: z * x, pd.DataFrame({"z": z, "y": y}), law, outcome="y", vectorized=True,
        noise=Noise(Free(0.02, 1.0), StudentError(5)), verification=Check(0),
    )  # fmt: skip
    u = np.linspace(-9.0, 9.0, 801)

    def lost(alpha: Array) -> float:
        mean, sd, scale = alpha
        each = stats.t.logpdf(y[:, None], 5, z[:, None] * (mean + sd * u), scale)
        return -float(np.log(np.trapezoid(np.exp(each + stats.norm.logpdf(u)), u, axis=1)).sum())

    best = optimize.minimize(lost, [1.0, 0.2, 0.15], method="Nelder-Mead", options={"xatol": 1e-7})
    assert found.log_likelihood.estimated == pytest.approx(-best.fun, abs=0.005)
    for estimate, value in zip(found.alpha.values(), best.x, strict=True):
        assert abs(estimate.estimate - value) < 0.01 * estimate.standard_error
    assert found.sound


def test_the_sum_of_two_parameters_with_tiny_noise_is_exact_until_it_is_refused() -> None:
    """The outcome is normal: with a known sd of b, mean and sd of a have a closed form."""
    y = np.random.default_rng(0).normal(3.0, 0.5, 12)
    laws = {"a": Normal(Free(0.0, 4.0), Free(0.05, 2.0)), "b": Normal(1.0, 0.3)}

    def found(sd: float) -> Identification:
        return unjudged(
            lambda a, b: a + b, pd.DataFrame({"y": y}), Inputs(laws), outcome="y", vectorized=True,
            noise=Noise(sd), verification=Check(0),
        )  # fmt: skip

    exact = stats.norm(y.mean(), y.std()).logpdf(y).sum()
    assert found(3e-7).log_likelihood.estimated == pytest.approx(exact, abs=1e-5)
    with pytest.raises(InputsError, match="double precision"):
        found(1e-9)
