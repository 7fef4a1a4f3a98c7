"""Errors that hang together, against the multivariate normal law written here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest
from scipy import linalg, stats

from aleator import (
    AR1,
    CAR1,
    AleatorError,
    Censoring,
    CompoundSymmetry,
    Experiments,
    ExponentialVariance,
    Free,
    GaussianProcess,
    Noise,
    PowerVariance,
    StudentError,
)
from aleator.core.types import Array, Flags
from aleator.observations import state_space
from aleator.observations.errors import MeasurementErrors

SIZES = (5, 1, 7, 3)
OWNER = np.repeat(np.arange(4), SIZES)
RNG = np.random.default_rng(3)
TIME = np.concatenate([np.sort(RNG.random(n)) * n for n in SIZES])
DAY = np.concatenate([np.cumsum([1, 1, 2, 1, 3, 1, 1][:n]) for n in SIZES])
SHUFFLED = np.concatenate([RNG.permutation(np.flatnonzero(np.equal(OWNER, k))) for k in range(4)])
TABLE = pd.DataFrame(
    {"id": OWNER, "time": TIME, "day": DAY, "y": 2.0 + RNG.standard_normal(OWNER.size)}
)
ETA = 2.0 + 0.3 * RNG.standard_normal((OWNER.size, 3))
EVERY = slice(0, OWNER.size)
FREE = Free(0.01, 5.0)


def distances(of: Array) -> Array:
    return np.abs(np.subtract.outer(of, of))


def matern(r: Array, p: int) -> Array:
    if p == 1:
        return np.exp(-r)
    if p == 2:
        return (1.0 + np.sqrt(3.0) * r) * np.exp(-np.sqrt(3.0) * r)
    b = np.sqrt(5.0) * r
    return (1.0 + b + b**2 / 3.0) * np.exp(-b)


class Place(NamedTuple):
    """Times, days, scales and simulated values of the observations of an experiment."""

    t: Array
    d: Array
    s: Array = np.ones(1)
    eta: Array = np.ones(1)


def process(p: int) -> Callable[[Array, Place], Array]:
    return lambda v, at: (
        np.eye(at.t.size) + v[0] ** 2 * matern(distances(at.t) / v[1], p) / np.outer(at.s, at.s)
    )


TIES: dict[str, tuple[Any, list[float], Callable[[Array, Place], Array]]] = {
    "AR(1)": (AR1(along="day"), [-0.6], lambda v, at: v[0] ** distances(at.d)),
    "CAR(1)": (CAR1("time", FREE), [0.8], lambda v, at: np.exp(-distances(at.t) / v[0])),
    "symmetry": (
        CompoundSymmetry(), [0.4], lambda v, at: v[0] + (1.0 - v[0]) * np.eye(at.t.size),
    ),
} | {
    f"process {p}": (GaussianProcess("time", FREE, FREE, p - 0.5), [0.7, 0.9], process(p))
    for p in (1, 2, 3)
}  # fmt: skip
SCALES: dict[str, tuple[Noise, list[float], Callable[[Array, Place], Array]]] = {
    "sd": (Noise(FREE), [0.5], lambda v, at: np.full(at.eta.shape, v[0])),
    "relative": (
        Noise(FREE, relative=FREE), [0.5, 0.3], lambda v, at: np.hypot(v[0], v[1] * at.eta),
    ),
    "power": (
        Noise(FREE, variance=PowerVariance(at=2.0)), [0.5, 0.7],
        lambda v, at: v[0] * (at.eta / 2.0) ** v[1],
    ),
    "power of a column": (
        Noise(FREE, variance=PowerVariance(of="time")), [0.5, 0.7],
        lambda v, at: v[0] * at.t ** v[1],
    ),
    "exponential": (
        Noise(FREE, variance=ExponentialVariance(Free(-1.0, 1.0), at=2.0)), [0.5, 0.3],
        lambda v, at: v[0] * np.exp(v[1] * (at.eta - 2.0)),
    ),
}  # fmt: skip


def own(k: int) -> Flags:
    """The observations of an experiment."""
    return np.equal(OWNER, k)


def of(table: pd.DataFrame, noise: Noise) -> MeasurementErrors:
    return MeasurementErrors.of(noise, Experiments.from_frame(table, outcome="y", id="id"))


def given(tie: str, scale: str) -> tuple[Noise, Array]:
    correlation, ties, _ = TIES[tie]
    noise, values, _ = SCALES[scale]
    return replace(noise, correlation=correlation), np.array([*values, *ties])


def covariances(tie: str, scale: str, values: Array, eta: Array) -> list[Array]:
    """The covariance of the errors of each experiment, for one column of eta."""
    count, found = len(SCALES[scale][1]), []
    for k in range(4):
        at = Place(TIME[own(k)], DAY[own(k)], eta=eta[own(k)])
        s = SCALES[scale][2](values[:count], at)
        found.append(np.outer(s, s) * TIES[tie][2](values[count:], at._replace(s=s)))
    return found


def summed(values: Array) -> Array:
    return np.stack([values[own(k)].sum(axis=0) for k in range(4)])


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("tie", TIES)
def test_density_is_that_of_the_multivariate_normal_law(tie: str, scale: str) -> None:
    """Each observation has its density given the earlier ones, and derivatives are of the whole."""
    noise, values = given(tie, scale)
    errors, y = of(TABLE, noise), TABLE["y"].to_numpy()
    found = errors.terms(values, ETA, EVERY)
    np.testing.assert_array_equal(errors.log_density(values, ETA, EVERY), found.value)
    for j in range(3):
        for k, c in enumerate(covariances(tie, scale, values, ETA[:, j])):
            e, some = (y - ETA[:, j])[own(k)], found.value[own(k), j]
            for n in range(1, e.size + 1):
                exact = stats.multivariate_normal.logpdf(e[:n], cov=c[:n, :n])
                assert some[:n].sum() == pytest.approx(exact, abs=1e-9)
    h = 1e-6
    for k in range(OWNER.size):
        step = h * (np.arange(OWNER.size) == k)[:, None]
        up, down = (errors.terms(values, ETA + s, EVERY).value for s in (step, -step))
        slope = summed(up - down)[OWNER[k]] / (2.0 * h)
        np.testing.assert_allclose(found.d_eta[k], slope, atol=2e-7)
    assert len(found.d_values) == values.size
    for p, (rows, by) in enumerate(found.d_values):
        assert rows.tolist() == list(range(OWNER.size))
        step = h * (np.arange(values.size) == p)
        up, down = (errors.terms(values + s, ETA, EVERY).value for s in (step, -step))
        np.testing.assert_allclose(summed(by), summed(up - down) / (2.0 * h), atol=2e-7)


@pytest.mark.parametrize("scale", ["sd", "power"])
@pytest.mark.parametrize("tie", TIES)
def test_residuals_are_whitened_and_draws_are_coloured(tie: str, scale: str) -> None:
    """Phi^-1 of the probabilities given the earlier ones is L^-1 e; draws from z are L z."""
    noise, values = given(tie, scale)
    errors, y = of(TABLE, noise), TABLE["y"].to_numpy()
    u = errors.conditional_cdf(values, y[:, None], ETA, EVERY)
    z = RNG.standard_normal(ETA.shape)
    drawn = errors.drawn(values, stats.norm.cdf(z), ETA, EVERY) - ETA
    marginal = errors.scale(values, ETA, EVERY)
    for j in range(3):
        for k, c in enumerate(covariances(tie, scale, values, ETA[:, j])):
            here, root = own(k), np.linalg.cholesky(c)
            white = linalg.solve_triangular(root, (y - ETA[:, j])[here], lower=True)
            np.testing.assert_allclose(stats.norm.ppf(u[here, j]), white, atol=1e-6)
            np.testing.assert_allclose(drawn[here, j], root @ z[here, j], atol=1e-9)
            np.testing.assert_allclose(marginal[here, j], np.sqrt(np.diag(c)), rtol=1e-12)


@pytest.mark.parametrize("scale", ["sd", "power"])
@pytest.mark.parametrize("tie", TIES)
def test_ranks_are_density_and_probability_of_measured_values(tie: str, scale: str) -> None:
    """Where a simulated value does not exist, or is far off or the measured one, too."""
    noise, values = given(tie, scale)
    errors, y, eta = of(TABLE, noise), TABLE["y"].to_numpy()[:, None], ETA.copy()
    eta[OWNER.size - 1] = -np.inf, y[-1, 0], np.nan
    found = errors.ranks(values, eta, EVERY)
    assert found is not None
    density = errors.log_density(values, eta, EVERY)
    chance = errors.conditional_cdf(values, y, eta, EVERY)
    np.testing.assert_allclose(found[0], density, rtol=1e-12)
    np.testing.assert_allclose(found[1], np.nan_to_num(chance), atol=1e-12)


@pytest.mark.parametrize("tie", TIES)
def test_information_is_that_of_the_normal_law(tie: str) -> None:
    noise, values = given(tie, "sd")
    slopes = RNG.standard_normal((*ETA.shape, 2))
    found = of(TABLE, noise).information(values, ETA, slopes, EVERY)
    for j in range(3):
        for k, c in enumerate(covariances(tie, "sd", values, ETA[:, j])):
            a = slopes[own(k), j]
            exact = a.T @ np.linalg.solve(c, a)
            np.testing.assert_allclose(found[own(k), j].sum(axis=0), exact, rtol=1e-9)


@pytest.mark.parametrize("tie", ["AR(1)", "CAR(1)", "process 2"])
def test_rows_in_any_order_are_put_in_the_order_of_the_column(tie: str) -> None:
    noise, values = given(tie, "power")
    sorted_, mixed = of(TABLE, noise), of(TABLE.iloc[SHUFFLED].reset_index(drop=True), noise)
    one, other = (
        e.terms(values, eta, EVERY) for e, eta in ((sorted_, ETA), (mixed, ETA[SHUFFLED]))
    )
    np.testing.assert_allclose(other.value, one.value[SHUFFLED], rtol=1e-12)
    np.testing.assert_allclose(other.d_eta, one.d_eta[SHUFFLED], rtol=1e-12)
    assert sorted_.sequence is None
    assert SHUFFLED[mixed.sequence].tolist() == list(range(OWNER.size))


@pytest.mark.parametrize("p", [1, 2, 3])
def test_experiments_at_the_same_places_share_matrices(p: int) -> None:
    """17 experiments of two patterns, and the same with places that all differ a little."""
    sizes = [4] * 9 + [3] * 8
    owner = np.repeat(np.arange(17), sizes)
    time = np.concatenate([[0.0, 0.4, 1.0, 1.3][:n] for n in sizes])
    process = GaussianProcess("time", FREE, FREE, p - 0.5)
    noise = Noise(FREE, correlation=process)
    table = pd.DataFrame({"id": owner, "time": time, "y": RNG.standard_normal(owner.size)})
    values, eta = np.array([0.5, 0.7, 0.9]), RNG.standard_normal((owner.size, 3))
    alike, apart = (of(t, noise) for t in (table, table.assign(time=time * (1.0 + 1e-14 * owner))))
    for errors, patterns in ((alike, 2), (apart, 17)):
        (serial,) = (part.serial for part in errors.parts)
        assert serial is not None
        assert len(serial.alike) == patterns
        shared = process.whitening([0.7, 0.9], serial, np.full((owner.size, 1), 0.5))
        assert isinstance(shared, state_space.AlikeErrors) == (patterns == 2)
    every = slice(0, owner.size)
    one, other = (errors.terms(values, eta, every) for errors in (alike, apart))
    np.testing.assert_allclose(one.value, other.value, atol=1e-9)
    np.testing.assert_allclose(one.d_eta, other.d_eta, atol=1e-9)
    starts = np.flatnonzero(np.diff(owner, prepend=-1))
    for (_, by), (_, wanted) in zip(one.d_values, other.d_values, strict=True):
        sums = (np.add.reduceat(each, starts) for each in (by, wanted))
        np.testing.assert_allclose(*sums, atol=1e-9)
    uniform = RNG.random(eta.shape)
    one, other = (errors.drawn(values, uniform, eta, every) for errors in (alike, apart))
    np.testing.assert_allclose(one, other, atol=1e-9)


@pytest.mark.parametrize("p", [1, 2, 3])
def test_a_long_curve_with_equal_gaps_has_a_steady_filter(p: int) -> None:
    """600 rows against the normal law, and against a scale that is not the same everywhere."""
    rows = 600
    table = pd.DataFrame({"id": 0, "time": np.linspace(0.0, 60.0, rows), "sd": 0.5, "y": 0.0})
    table.loc[0, "sd"] = 0.5 * (1.0 + 1e-13)
    process = GaussianProcess("time", FREE, FREE, p - 0.5)
    regular, other = (of(table, Noise(sd, correlation=process)) for sd in (FREE, "sd"))
    eta, every = RNG.standard_normal((rows, 2)), slice(0, rows)
    one = regular.terms(np.array([0.5, 0.7, 0.9]), eta, every)
    two = other.terms(np.array([0.7, 0.9]), eta, every)
    (part,) = regular.parts
    assert part.serial is not None
    load = np.full((rows, 1), 1.4)
    assert state_space.FilteredErrors.of(part.serial, 0.7, 0.9, load, p).settled < 200
    np.testing.assert_allclose(one.value, two.value, rtol=1e-9)
    np.testing.assert_allclose(one.d_eta, two.d_eta, rtol=1e-8, atol=1e-9)
    for (_, by), (_, wanted) in zip(one.d_values[1:], two.d_values, strict=True):
        np.testing.assert_allclose(by, wanted, rtol=1e-7, atol=1e-8)
    covariance = 0.25 * np.eye(rows) + 0.49 * matern(distances(table["time"].to_numpy()) / 0.9, p)
    exact = stats.multivariate_normal.logpdf(-eta.T, cov=covariance)
    np.testing.assert_allclose(one.value.sum(axis=0), exact, rtol=1e-10)


def test_parts_of_the_table_are_as_the_whole() -> None:
    """Blocks of whole experiments give the same values, however the array is cut."""
    noise, values = given("process 3", "relative")
    errors = of(TABLE, noise)
    whole, part = (errors.terms(values, ETA[r], r) for r in (EVERY, slice(5, 13)))
    np.testing.assert_allclose(part.value, whole.value[5:13], rtol=1e-12)
    (serial,) = (p.serial for p in errors.parts)
    assert serial is not None
    assert serial.cut(0, [slice(0, 7), slice(7, 9), slice(9, 16)]) == [slice(0, 6), slice(6, 16)]
    assert serial.cut(5, [slice(0, 4), slice(4, 8)]) == [slice(0, 1), slice(1, 8)]


@pytest.mark.parametrize("tie", ["AR(1)", "symmetry", "process 2"])
def test_a_value_that_does_not_exist_is_impossible_and_touches_no_other(tie: str) -> None:
    noise, values = given(tie, "power")
    errors, eta = of(TABLE, noise), ETA.copy()
    eta[2, 0], eta[7, 1], eta[9, 2] = np.nan, np.inf, 0.0
    found, usual = errors.terms(values, eta, EVERY), errors.terms(values, ETA, EVERY)
    for j, k in ((0, 0), (1, 2), (2, 2)):
        assert np.isneginf(found.value[own(k), j].sum())
        other = ~own(k)
        np.testing.assert_allclose(found.value[other, j], usual.value[other, j], rtol=1e-12)
        np.testing.assert_allclose(found.d_eta[other, j], usual.d_eta[other, j], rtol=1e-12)
    for part in (found.d_eta, *(by for _, by in found.d_values)):
        assert np.all(np.isfinite(part))


def test_blank_cells_of_a_wide_table_are_steps_and_rows_of_another_response_are_not() -> None:
    noise = Noise(1.0, correlation=AR1(0.5))
    wide = pd.DataFrame(
        {"id": 1, "a": [1.0, np.nan, 2.0, 3.0], "b": [1.0, 2.0, np.nan, 3.0]}
    ).assign(t=range(4))
    read = Experiments.from_frame(wide, outcome=["a", "b"], id="id")
    errors = MeasurementErrors.of({"a": noise, "b": noise}, read)
    assert [p.serial.gap.tolist() for p in errors.parts if p.serial] == [[0, 2, 1], [0, 1, 2]]
    long = pd.DataFrame({"id": 1, "what": ["a", "b", "a", "b"], "y": [1.0, 2.0, 3.0, 4.0]})
    read = Experiments.from_frame(long, outcome="y", response="what", id="id")
    errors = MeasurementErrors.of({"a": noise, "b": noise}, read)
    assert [p.serial.gap.tolist() for p in errors.parts if p.serial] == [[0, 1], [0, 1]]


def test_the_process_costs_twice_as_much_for_twice_the_rows(monkeypatch) -> None:
    """Numbers in the banded systems that are solved, and steps of the filter."""
    solved = state_space.dtbtrs
    numbers: list[int] = []

    def counted(bands: Array, values: Array, **more: object) -> tuple[Array, int]:
        numbers.append(bands.size + values.size)
        return solved(bands, values, **more)

    monkeypatch.setattr(state_space, "dtbtrs", counted)
    cost = []
    for rows in (400, 800):
        numbers.clear()
        table = pd.DataFrame({"id": 1, "time": np.arange(rows), "y": 0.0})
        errors = of(table, Noise(FREE, correlation=GaussianProcess("time", FREE, FREE)))
        errors.terms(np.array([1.0, 1.0, 3.0]), np.zeros((rows, 2)), slice(0, rows))
        (part,) = errors.parts
        assert part.serial is not None
        cost.append(np.array([sum(numbers), len(state_space.places(part.serial))]))
    assert (cost[1] / cost[0]).tolist() == [2.0, 2.0]


@pytest.mark.parametrize(
    ("noise", "table", "words"),
    [
        (CAR1("tyme", FREE), TABLE, ["noise of 'y': along = 'tyme' is not a column", "time"]),
        (CAR1("time", FREE), TABLE.assign(time=1.0), ["row 2", "experiment '0'", "same place"]),
        (AR1(along="time"), TABLE, ["whole number", "car1"]),
        (AR1(along="day"), TABLE.assign(day=1), ["row 2", "same place", "gaussian_process"]),
        (AR1(along="day"), TABLE.assign(day="x"), ["row 1", "column 'day'", "'x'", "number"]),
        (
            AR1(), TABLE.assign(y=["< 1", *map(str, range(15))]),
            ["row 1", "only a bound", "'y' of experiment '0'", "leave out the correlation"],
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_with_its_row(noise, table, words) -> None:
    censored = Censoring(signs=True) if "only a bound" in words[1] else None
    read = Experiments.from_frame(table, outcome="y", id="id", censored=censored)
    with pytest.raises(AleatorError) as found:
        MeasurementErrors.of(Noise(0.1, correlation=noise), read)
    assert all(word in str(found.value) for word in words), str(found.value)


def test_a_column_of_a_variance_has_no_zero() -> None:
    with pytest.raises(AleatorError, match=r"row 1.*column 'day'.*covariate of the variance"):
        of(TABLE.assign(day=0), Noise(0.1, variance=PowerVariance(of="day")))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Noise(0.1, StudentError(4.0), correlation=AR1()), "closed form"),
        (lambda: Noise(0.1, relative=0.1, variance=PowerVariance()), "no relative part"),
        (lambda: Noise(relative=0.1, variance=PowerVariance()), "no relative part"),
        (lambda: Noise(0.1, correlation=0.5), "correlation"),
        (lambda: Noise(0.1, variance="power"), "variance"),
        (lambda: AR1(1.0), r"rho is 1\n.*\(-1, 1\)"),
        (lambda: AR1(Free(-1.0, 0.5)), r"between -1 and 0.5"),
        (lambda: CompoundSymmetry(-0.1), r"\[0, 1\)"),
        (lambda: CAR1("time", Free()), "length"),
        (lambda: GaussianProcess("time", 0.1, 1.0, 2.0), "smoothness"),
        (lambda: ExponentialVariance(Free()), "rate"),
        (lambda: PowerVariance(at=0.0), "at = 0"),
        (lambda: ExponentialVariance(0.1, at=np.inf), "at = inf"),
    ],
)
def test_what_is_no_noise_is_refused(make, words: str) -> None:
    with pytest.raises(AleatorError, match=words):
        make()
