from collections.abc import Sequence
from typing import Any

import mpmath
import numpy as np
import pandas as pd
import pytest
from scipy import integrate, stats

from aleator.core.types import Array
from aleator.errors import ExperimentsError, InputsError
from aleator.laws import Free
from aleator.observations.errors import MeasurementErrors
from aleator.observations.experiments import Conditions, Experiments
from aleator.observations.model import NUMERICS, NormalError, Observed, StudentError
from aleator.observations.noise import Noise
from aleator.observations.responses import Observations, Response

ENDS = [
    (0.7, 0.7), (-np.inf, 0.4), (0.3, np.inf), (0.2, 1.1), (2.0, 2.4), (-3.1, -1.0),
    (1.0, 1.0 + 1e-5), (-0.5, -0.5 + 1e-4), (9.0, 10.0), (-np.inf, -8.0), (8.5, np.inf),
]  # fmt: skip
"""Lower and upper ends: exact, left, right, and intervals of every kind."""
ETA = np.array([-0.6, 0.1, 0.9, 2.5])


def table(ends: Sequence[tuple[float, float]], responses: int = 1) -> Experiments:
    """Each value an experiment; the responses take turns."""
    each, (lower, upper) = np.arange(len(ends)), np.transpose(ends)
    seen = Observations(
        each, each, each % responses, lower, upper,
        tuple(Response("ab"[k]) for k in range(responses)),
    )  # fmt: skip
    frame = pd.DataFrame({"sd": 0.5 + 0.1 * each})
    return Experiments(tuple(map(str, each)), frame, seen)


def law(noise: Noise, values: Sequence[float]) -> tuple[Any, dict[str, float]]:
    """SciPy's law of the kind, its shapes, and what each value is."""
    named = dict(zip([h.name[6:] for h in noise.hyperparameters], values, strict=True))
    if isinstance(noise.kind, NormalError):
        return stats.norm, named
    return stats.t(named.pop("df", noise.kind.df)), named


def by_integral(
    noise: Noise, values: Sequence[float], ends: tuple[float, float], eta: float, known: float
) -> float:
    """log p of one observation: the density, or its integral between the ends."""
    of, named = law(noise, values)
    sd = known if noise.column else named.get("sd", 0.0)
    scale = np.hypot(sd, named.get("relative", 0.0) * eta)
    a, b = ((end - eta) / scale for end in ends)
    if a == b:
        return float(of.logpdf(a) - np.log(scale))
    tail = of.sf if a + b > 0 else of.cdf
    if np.isinf(a) or np.isinf(b):
        return float(np.log(tail(a if np.isinf(b) else b)))
    return float(np.log(integrate.quad(of.pdf, a, b, epsrel=1e-13, epsabs=0.0)[0]))


NOISES = {
    "normal": (Noise(Free(0.1, 2.0)), [0.7]),
    "column": (Noise("sd"), []),
    "relative": (Noise(relative=Free(0.01, 1.0)), [0.3]),
    "both": (Noise(Free(0.1, 2.0), relative=0.2), [0.6, 0.2]),
    "column and relative": (Noise("sd", relative=Free(0.01, 1.0)), [0.25]),
    "student": (Noise(Free(0.1, 2.0), StudentError(4.0)), [0.6]),
    "free student": (Noise(Free(0.1, 2.0), StudentError(Free())), [0.6, 3.3]),
    "all": (Noise(Free(0.1, 2.0), StudentError(Free()), Free(0.01, 1.0)), [0.6, 0.3, 7.0]),
}


@pytest.mark.parametrize(("noise", "values"), NOISES.values(), ids=NOISES)
def test_log_p_is_that_of_an_integral_of_the_density(noise: Noise, values: list[float]) -> None:
    errors = MeasurementErrors.of(noise, table(ENDS))
    eta = np.tile(ETA, (len(ENDS), 1))
    found = errors.terms(np.array(values), eta, slice(0, len(ENDS))).value
    with np.errstate(divide="ignore"):
        wanted = [
            [by_integral(noise, values, ends, e, 0.5 + 0.1 * k) for e in ETA]
            for k, ends in enumerate(ENDS)
        ]
    seen = np.isfinite(wanted)  # quadrature underflows where the logarithm does not
    assert np.mean(seen) > 0.8
    np.testing.assert_allclose(found[seen], np.array(wanted)[seen], rtol=1e-9, atol=1e-9)
    assert np.all(np.isfinite(found))


@pytest.mark.parametrize(("noise", "values"), NOISES.values(), ids=NOISES)
def test_derivatives_are_those_of_differences(noise: Noise, values: list[float]) -> None:
    errors, rows = MeasurementErrors.of(noise, table(ENDS)), slice(0, len(ENDS))
    eta, at = np.tile(ETA, (len(ENDS), 1)), np.array(values)

    def difference(move: float, k: int | None) -> Array:
        h = 1e-4
        step = np.eye(len(at))[k] * h if k is not None else np.zeros(len(at))
        shift = move * h
        both = [errors.terms(at + s * step, eta + s * shift, rows).value for s in (-2, -1, 1, 2)]
        return (both[0] - 8 * both[1] + 8 * both[2] - both[3]) / (12 * h)

    found = errors.terms(at, eta, rows)
    close = {"rtol": 2e-6, "atol": 2e-6}
    np.testing.assert_allclose(found.d_eta, difference(1.0, None), **close)
    for k, (concerned, by) in enumerate(found.d_values):
        assert concerned.tolist() == list(range(len(ENDS)))
        np.testing.assert_allclose(by, difference(0.0, k), **close)


@pytest.mark.parametrize(("noise", "values"), NOISES.values(), ids=NOISES)
def test_curvature_is_the_second_difference_where_that_is_positive(
    noise: Noise, values: list[float]
) -> None:
    errors, rows = MeasurementErrors.of(noise, table(ENDS)), slice(0, len(ENDS))
    eta, at, h = np.tile(ETA, (len(ENDS), 1)), np.array(values), 1e-5
    above, below = (errors.terms(at, eta + s, rows).d_eta for s in (h, -h))
    wanted = np.maximum((below - above) / (2 * h), 0.0)
    along = np.ones((*eta.shape, 1))
    found = errors.information(at, eta, along, rows)[..., 0, 0]
    np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(("noise", "values"), NOISES.values(), ids=NOISES)
def test_a_slice_of_the_rows_gives_its_part(noise: Noise, values: list[float]) -> None:
    errors = MeasurementErrors.of(noise, table(ENDS))
    eta, at = np.tile(ETA, (len(ENDS), 1)), np.array(values)
    whole, part = (errors.terms(at, eta[s], s) for s in (slice(0, len(ENDS)), slice(2, 6)))
    np.testing.assert_array_equal(part.value, whole.value[2:6])
    np.testing.assert_array_equal(part.d_eta, whole.d_eta[2:6])
    for (concerned, by), (_, every) in zip(part.d_values, whole.d_values, strict=True):
        assert concerned.tolist() == [0, 1, 2, 3]
        np.testing.assert_array_equal(by, every[2:6])


def test_each_response_has_its_own_noise() -> None:
    noises = {"a": Noise(Free(0.1, 2.0)), "b": Noise(0.3, StudentError(Free()))}
    both = MeasurementErrors.of(noises, table(ENDS, 2))
    assert [h.name for h in both.hyperparameters] == ["noise.a.sd", "noise.b.sd", "noise.b.df"]
    assert not both.simple
    eta, rows = np.tile(ETA, (len(ENDS), 1)), slice(1, 7)
    found = both.terms(np.array([0.7, 0.3, 5.0]), eta[rows], rows)
    assert [concerned.tolist() for concerned, _ in found.d_values] == [[1, 3, 5], *[[0, 2, 4]] * 2]
    for name, values, own in (("a", [0.7], [1, 3, 5]), ("b", [0.3, 5.0], [0, 2, 4])):
        alone = MeasurementErrors.of(noises[name], table(ENDS))
        wanted = alone.terms(np.array(values), eta[rows], rows)
        np.testing.assert_array_equal(found.value[own], wanted.value[own])
        np.testing.assert_array_equal(found.d_eta[own], wanted.d_eta[own])


def test_far_tails_keep_their_digits() -> None:
    # Published to 20 digits by series: log Q(40) and the hazard there.
    ends = [(40.0, np.inf), (-np.inf, -40.0), (40.0, 40.5)]
    errors = MeasurementErrors.of(Noise(1.0), table(ends))
    found = errors.terms(np.array([1.0]), np.zeros((3, 1)), slice(0, 3))
    series = 1.0 - 1 / 40**2 + 3 / 40**4 - 15 / 40**6 + 105 / 40**8
    tail = -800.0 - 0.5 * np.log(2 * np.pi) - np.log(40.0) + np.log(series)
    np.testing.assert_allclose(found.value[:2, 0], tail, rtol=1e-14)
    np.testing.assert_allclose(found.value[2, 0], tail + np.log1p(-np.exp(-20.126)), rtol=1e-10)
    np.testing.assert_allclose(found.d_eta[:2, 0], [40.0 / series, -40.0 / series], rtol=1e-8)


def test_intervals_of_rounding_join_the_density_smoothly() -> None:
    width = np.logspace(-12, -2, 60)
    ends = [(1.3 - d / 2, 1.3 + d / 2) for d in width]
    for kind in (NormalError(), StudentError(4.0)):
        errors = MeasurementErrors.of(Noise(1.0, kind), table(ends))
        found = errors.terms(np.array([1.0]), np.zeros((60, 1)), slice(0, 60))
        density = kind.log_density(np.array(1.3), np.array(0.0), np.array(1.0))
        np.testing.assert_allclose(found.value[:, 0] - np.log(width), density.value, atol=1e-3)
        np.testing.assert_allclose(found.d_eta[20:, 0], density.d_eta, atol=1e-3)


@pytest.mark.parametrize("kind", [NormalError(), StudentError(3.0)])
@pytest.mark.parametrize("relative", [None, 0.5])
def test_values_that_a_simulator_may_return_and_nobody_meant(
    kind: NormalError | StudentError, relative: float | None
) -> None:
    ends = [(0.7, 0.7), (-np.inf, 0.4), (0.3, np.inf), (0.2, 1.1)]
    errors = MeasurementErrors.of(Noise(1.0, kind, relative), table(ends))
    eta = np.tile([np.nan, np.inf, -np.inf, 1e200, -1e300], (4, 1))
    values = np.array([h.start for h in errors.hyperparameters])
    found = errors.terms(values, eta, slice(0, 4))
    assert np.all(np.isneginf(found.value[:, 0]))
    assert np.all(found.value[0] < -500.0)
    if relative is None:  # a life beyond the limit is a run-out for sure
        np.testing.assert_array_equal(found.value[2, [1, 3]], 0.0)
        np.testing.assert_array_equal(found.value[1, [2, 4]], 0.0)
    else:  # the scale grows with eta: u tends to -+1/relative
        of = stats.norm if isinstance(kind, NormalError) else stats.t(3.0)
        np.testing.assert_allclose(found.value[2, [1, 3]], of.logsf(-2.0))
        np.testing.assert_allclose(found.value[1, [2, 4]], of.logcdf(2.0))
    for part in (found.d_eta, *(by for _, by in found.d_values)):
        assert np.all(np.isfinite(part))
    along = np.ones((*eta.shape, 1))
    assert np.all(np.isfinite(errors.information(values, eta, along, slice(0, 4))))


class Logistic:
    """A kind that knows exact values and its cdf only, as a plug-in may."""

    name = "logistic"

    def log_density(self, y: Array, eta: Array, scale: Array) -> Observed:
        u = (y - eta) / scale
        value = stats.logistic.logpdf(u) - np.log(scale)
        return Observed(value, np.tanh(0.5 * u) / scale, (u * np.tanh(0.5 * u) - 1.0) / scale)

    def cdf(self, y: Array, eta: Array, scale: Array) -> Array:
        return np.asarray(stats.logistic.cdf((y - eta) / scale))

    def quantile(self, probability: Array, eta: Array, scale: Array) -> Array:
        return np.asarray(eta + scale * stats.logistic.ppf(probability))

    def moments(self, order: int) -> Array:
        return np.array([stats.logistic.moment(m) for m in range(order + 1)])


def test_a_kind_from_outside_is_censored_by_its_cdf() -> None:
    ends = ENDS[:6]
    errors = MeasurementErrors.of(Noise(Free(0.1, 2.0), Logistic()), table(ends))
    eta, rows, h = np.tile(ETA, (6, 1)), slice(0, 6), 1e-5
    found = errors.terms(np.array([0.7]), eta, rows)
    lower, upper = np.transpose(ends)[:, 1:, None]
    law = stats.logistic(eta[1:], 0.7)
    np.testing.assert_allclose(found.value[1:], np.log(law.cdf(upper) - law.cdf(lower)))
    above, below = (errors.terms(np.array([0.7]), eta + s, rows).value for s in (h, -h))
    np.testing.assert_allclose(found.d_eta, (above - below) / (2 * h), rtol=1e-6, atol=1e-7)
    above, below = (errors.terms(np.array([0.7 + s]), eta, rows).value for s in (h, -h))
    by = found.d_values[0][1]
    np.testing.assert_allclose(by, (above - below) / (2 * h), rtol=1e-6, atol=1e-7)


def test_quantiles_and_probabilities_undo_each_other() -> None:
    noises = {"a": Noise(0.4, relative=0.1), "b": Noise(0.3, StudentError(5.0))}
    new = Conditions(("1", "2"), pd.DataFrame({"v": [1.0, 2.0]}), responses=[
        Response("a"), Response("b")
    ])  # fmt: skip
    errors = MeasurementErrors.of(noises, new)
    values = np.array([h.start for h in errors.hyperparameters])
    eta, rows = np.tile(ETA, (4, 1)), slice(0, 4)
    chance = np.linspace(0.01, 0.99, 16).reshape(4, 4)
    y = errors.quantile(values, chance, eta, rows)
    np.testing.assert_allclose(errors.cdf(values, y, eta, rows), chance, rtol=1e-10)
    np.testing.assert_allclose(errors.scale(values, eta, rows)[0], np.hypot(0.4, 0.1 * ETA))


@pytest.mark.parametrize("df", [0.7, 2.5, 4.0, 30.0, 1e6])
def test_moments_of_the_student_law(df: float) -> None:
    found = StudentError(df).moments(6)
    wanted = [stats.t.moment(m, df) if m < df else np.nan for m in range(7)]
    np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-12)


def test_noise_that_cannot_be_is_told() -> None:
    with pytest.raises(InputsError):
        Noise()
    with pytest.raises(InputsError, match="relative"):
        Noise(0.1, relative=0.0)
    with pytest.raises(InputsError, match="relative"):
        Noise(0.1, relative=Free())
    for noise in (Noise("sd"), Noise(0.1, relative=0.1), Noise(0.1, StudentError(Free()))):
        assert not noise.simple
        with pytest.raises(InputsError, match="one standard deviation"):
            _ = noise.hyperparameter
    with pytest.raises(InputsError, match="df"):
        StudentError(-1.0)
    with pytest.raises(InputsError, match="df"):
        StudentError(Free()).log_density(*map(np.array, (1.0, 0.0, 1.0)))


def test_a_response_without_noise_is_told() -> None:
    with pytest.raises(ExperimentsError, match="'b'"):
        MeasurementErrors.of({"a": Noise(0.1)}, table(ENDS, 2))
    with pytest.raises(ExperimentsError, match="a, b"):
        MeasurementErrors.of(Noise(0.1), table(ENDS, 2))
    with pytest.raises(ExperimentsError, match=r"'B'(.|\n)*a, b"):
        MeasurementErrors.of({"a": Noise(0.1), "B": Noise(0.1)}, table(ENDS, 2))


@pytest.mark.parametrize("cell", ["", "0", "-1", "high"])
def test_a_known_sd_that_is_none_is_told_with_its_row(cell: str) -> None:
    frame = pd.DataFrame({"id": ["a", "b"], "y": [1.0, 2.0], "sd": ["0.1", cell]})
    read = Experiments.from_frame(frame, outcome="y", conditions=[])
    with pytest.raises(ExperimentsError, match=r"row 2 .*column 'sd'.*experiment 'b'"):
        MeasurementErrors.of(Noise("sd"), read)
    with pytest.raises(ExperimentsError, match=r"'ds'(.|\n)*sd"):
        MeasurementErrors.of(Noise("ds"), read)


@pytest.mark.parametrize("df", [1e5, 1e7])
def test_an_interval_so_far_out_that_its_probability_underflows(df: float) -> None:
    """By the integral of the density over its value at the nearer end."""
    errors = MeasurementErrors.of(Noise(1.0, StudentError(df)), table([(45.0, 60.0)]))
    found = errors.terms(
        np.array([h.start for h in errors.hyperparameters]), np.zeros((1, 1)), slice(0, 1)
    ).value[0, 0]
    law = stats.t(df)
    share = integrate.quad(lambda y: np.exp(law.logpdf(y) - law.logpdf(45.0)), 45.0, 46.0)[0]
    assert found == pytest.approx(law.logpdf(45.0) + np.log(share), abs=2e-3)


def test_a_narrow_interval_is_exact_to_the_fourth_power_of_its_width() -> None:
    width = 0.45 * NUMERICS.narrow  # beside 2, where narrow is half as much
    errors = MeasurementErrors.of(Noise(1.0), table([(2.0, 2.0 + width)]))
    found = errors.terms(np.array([1.0]), np.zeros((1, 1)), slice(0, 1)).value[0, 0]
    with mpmath.workdps(40):
        truth = mpmath.log(mpmath.ncdf(2.0 + width) - mpmath.ncdf(2.0))
    # the second power contributes width^2 (m^2 - 1)/24
    assert found == pytest.approx(float(truth), abs=0.1 * width**2 / 8.0)
