"""Nodes of the integral over individual parameters, against integrals that are known."""

import numpy as np
import pandas as pd
import pytest
from individual_cases import ALPHA, decay, likelihood_of, straight_line, table
from scipy import integrate, special, stats

from aleator import Free, Inputs, Noise, Normal, TruncatedNormal
from aleator.fit.quadrature import several_modes, with_enough_nodes
from aleator.likelihood.individual import (
    Direct,
    GaussHermite,
    ImportancePoints,
    Panels,
    PlanePanels,
    RidgePoints,
)
from aleator.likelihood.individual.lines import LINES, integrated
from aleator.likelihood.individual.modes import highest, modes
from aleator.likelihood.individual.predictors import Layout
from aleator.likelihood.individual.rules import proposed


@pytest.mark.parametrize("nodes", [40, 90, 200])
def test_weights_far_out_keep_their_digits(nodes: int) -> None:
    """int sech(t) dt = pi: the weights are multiplied by exp(t^2/2), up to 1e150 and more."""
    t, log_w = GaussHermite(nodes).nodes(1)
    t = t[:, 0]
    assert np.sum(np.exp(log_w + 0.5 * t**2) / np.cosh(t)) == pytest.approx(
        np.pi / np.sqrt(2.0 * np.pi), abs=1e-4
    )


class _Limit:
    """A life that is infinite below the limit x = 1."""

    def straight(self, _: np.ndarray, x: np.ndarray) -> np.ndarray:
        return np.where(x > 1.0, 1.0 / np.maximum(x - 1.0, 1e-300), np.inf)


def test_a_life_without_end_has_no_slope() -> None:
    each = np.arange(2)
    block = Layout(2, each, each, np.zeros(2, dtype=np.intp)).blocks(1)[0]
    predictor = Direct(_Limit(), np.array([0]), np.array([[-9.0, 9.0]]))
    eta, slopes = predictor.with_slopes(block, np.array([[[0.5]], [[1.5]]]))
    assert eta.ravel().tolist() == [np.inf, 2.0]
    assert slopes.ravel() == pytest.approx([0.0, -4.0], rel=1e-6)


# ---------------------------------------------------------------------------- panels of one variate

ONE = Inputs({"x": Normal(Free(-3.0, 3.0), Free(0.01, 3.0))})
AT_ONE = np.array([0.3, 0.7, 0.05])
"""Mean and sd of x, and the sd of the noise."""
FINE = np.linspace(-9.0, 9.0, 100_001)


def front(time, x):
    return np.tanh((time - x[0]) / 0.05)


def square(time, x):
    return x[0] ** 2 + time


def clip(time, x):
    return np.clip(x[0] * (1.0 + time), -0.2, 0.9)


def jump(time, x):
    return x[0] * time + (x[0] > 0.4)


def line(time, x):
    return x[0] * (1.0 + time)


def rise(time, x):
    return np.sinh(x[0]) + time


def drawn_of_one(model, noise: float = 0.05) -> pd.DataFrame:
    rng = np.random.default_rng(2)
    time = rng.uniform(0.0, 1.0, 20)
    y = model(time, AT_ONE[0] + AT_ONE[1] * rng.standard_normal((1, 20)))
    return pd.DataFrame({"id": range(20), "time": time, "y": y + noise * rng.standard_normal(20)})


def exact_of_one(model, frame: pd.DataFrame, alpha: np.ndarray) -> float:
    """By the trapezoidal rule on 100,000 points."""
    weights = stats.norm.pdf(FINE) * (FINE[1] - FINE[0])
    x = (alpha[0] + alpha[1] * FINE)[None]
    return float(
        sum(
            np.log(stats.norm.pdf(y, model(time, x), alpha[2]) @ weights)
            for time, y in zip(frame["time"], frame["y"], strict=True)
        )
    )


@pytest.mark.parametrize("model", [line, front, square, clip, jump])
def test_panels_integrate_what_one_centre_misses(model) -> None:
    frame = drawn_of_one(model)
    on_panels = likelihood_of(model, frame, ONE).by(Panels(), AT_ONE)
    truth = exact_of_one(model, frame, AT_ONE)
    assert on_panels.evaluate(AT_ONE).total == pytest.approx(truth, abs=1e-3)
    about_modes = on_panels.by(GaussHermite(40), AT_ONE).evaluate(AT_ONE).total
    assert (abs(about_modes - truth) < 1e-3) == (model is line)


def test_where_runs_fail_there_is_no_probability() -> None:
    """Of a parabola with a hole only what lies outside the hole counts."""

    def holed(time, x):
        return np.where((x[0] > 0.2) & (x[0] < 0.6), np.nan, square(time, x))

    frame = drawn_of_one(square)
    weights = stats.norm.pdf(FINE) * (FINE[1] - FINE[0])
    x = (AT_ONE[0] + AT_ONE[1] * FINE)[None]
    truth = sum(
        np.log(np.nan_to_num(stats.norm.pdf(y, holed(time, x), AT_ONE[2])) @ weights)
        for time, y in zip(frame["time"], frame["y"], strict=True)
    )
    on_panels = likelihood_of(holed, frame, ONE).by(Panels(), AT_ONE)
    assert on_panels.evaluate(AT_ONE).total == pytest.approx(truth, abs=2e-3)


def test_little_noise_is_no_trap() -> None:
    """Two modes a thousandth of the law wide."""
    frame, alpha = drawn_of_one(square, 0.0), np.array([0.3, 0.7, 1e-3])
    on_panels = likelihood_of(square, frame, ONE).by(Panels(), alpha)
    truth = exact_of_one(square, frame, alpha)
    assert on_panels.evaluate(alpha).total == pytest.approx(truth, abs=1e-3)


def test_the_score_with_panels_held_is_that_of_differences() -> None:
    held = likelihood_of(front, drawn_of_one(front), ONE).by(Panels(), AT_ONE)
    steps = 1e-5 * np.eye(3)
    differences = [
        (held.evaluate(AT_ONE + h).total - held.evaluate(AT_ONE - h).total) / 2e-5 for h in steps
    ]
    np.testing.assert_allclose(held(AT_ONE).score, differences, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize(
    ("model", "kind"),
    [(line, GaussHermite), (rise, GaussHermite), (square, Panels), (clip, Panels)],
)
def test_an_answer_settles_on_panels_where_more_nodes_do_not_converge(model, kind) -> None:
    frame = drawn_of_one(model)
    end = with_enough_nodes(likelihood_of(model, frame, ONE), AT_ONE)
    assert isinstance(end.likelihood.rule, kind)
    assert abs(end.gap) < 2e-3
    assert end.value == pytest.approx(exact_of_one(model, frame, end.alpha), abs=1e-3)


# ------------------------------------------------------------------------------ importance points

TWO = Inputs(
    {"a": Normal(Free(-3.0, 3.0), Free(0.01, 4.0)), "b": Normal(Free(-3.0, 3.0), Free(0.01, 4.0))}
)
AT_TWO = np.array([1.3, 0.8, 0.5, 0.3, 0.4])


def square_of_two(time, x):
    return x[0] ** 2 * np.sqrt(1.0 + time) + x[1]


def squares():
    frame = table(straight_line, experiments=10)
    rng = np.random.default_rng(4)
    draws = {name: rng.normal(AT_TWO[[0, 2]], AT_TWO[[1, 3]]) for name in frame["id"].unique()}
    x = np.array([draws[name] for name in frame["id"]]).T
    frame["y"] = square_of_two(frame["time"].to_numpy(), x) + AT_TWO[4] * rng.standard_normal(
        len(frame)
    )
    return frame


def exact_of_squares(frame, alpha):
    """b in closed form: given a the outcomes are normal; a by the trapezoidal rule."""
    a = np.linspace(-7.0, 7.0, 4001)
    total = []
    for _, own in frame.groupby("id", sort=False):
        time, y = own["time"].to_numpy(), own["y"].to_numpy()
        spread = alpha[4] ** 2 * np.eye(y.size) + alpha[3] ** 2
        law = stats.multivariate_normal(np.zeros(y.size), spread)
        mean = np.outer(a**2, np.sqrt(1.0 + time)) + alpha[2]
        height = law.logpdf(y - mean) + stats.norm.logpdf(a, *alpha[:2])
        top = height.max()
        total.append(top + np.log(integrate.trapezoid(np.exp(height - top), a)))
    return np.array(total)


@pytest.fixture(scope="module")
def both():
    """A likelihood with two modes an experiment, and the table."""
    frame = squares()
    return likelihood_of(square_of_two, frame, TWO, noise=Noise(Free(0.005, 2.0))), frame


def test_they_see_the_mode_that_nodes_about_one_do_not(both):
    likelihood, frame = both
    wanted = exact_of_squares(frame, AT_TWO)
    about_one = likelihood.by(GaussHermite(9), AT_TWO).evaluate(AT_TWO).each
    about_all = likelihood.by(ImportancePoints(4800), AT_TWO).evaluate(AT_TWO).each
    assert np.abs(about_one - wanted).max() > 0.04
    assert about_all == pytest.approx(wanted, abs=0.01)


def test_a_second_mode_is_noticed_and_a_ridge_is_none(both):
    likelihood, _ = both
    assert several_modes(likelihood, AT_TWO)
    assert not several_modes(likelihood_of(decay, table(decay)), ALPHA)


def test_an_answer_with_two_modes_is_that_of_the_exact_integral(both):
    likelihood, frame = both
    end = with_enough_nodes(likelihood, AT_TWO, enough=0.02)
    assert isinstance(end.likelihood.rule, PlanePanels)
    assert end.value == pytest.approx(exact_of_squares(frame, end.alpha).sum(), abs=0.05)
    for k in range(5):
        moved = end.alpha + 0.02 * np.eye(5)[k] * end.alpha
        back = end.alpha - 0.02 * np.eye(5)[k] * end.alpha
        top = exact_of_squares(frame, end.alpha).sum()
        assert top > max(exact_of_squares(frame, at).sum() for at in (moved, back)) - 0.02


@pytest.mark.parametrize("model", [straight_line, decay])
def test_their_error_falls_as_points_are_added(model):
    likelihood = likelihood_of(model, table(model), nodes=25).adapted(ALPHA)
    wanted = likelihood.evaluate(ALPHA).each
    errors = [
        np.abs(likelihood.by(ImportancePoints(count), ALPHA).evaluate(ALPHA).each - wanted).max()
        for count in (60, 600, 6000)
    ]
    assert errors[0] > 2.0 * errors[1] > 4.0 * errors[2]
    assert errors[2] < 2e-3


@pytest.mark.parametrize("dimensions", [1, 2, 5])
def test_weights_make_averages_of_the_normal_law(dimensions):
    modes = np.zeros((3, 1, 2, dimensions))
    modes[:, :, 1] = 1.5
    information = np.tile(4.0 * np.eye(dimensions), (3, 1, 2, 1, 1))
    xi, log_weight = proposed(modes, information, 20000, np.arange(3))
    weight = np.exp(log_weight)
    assert weight.sum(axis=1) == pytest.approx(1.0, abs=5e-3)
    assert np.einsum("nj,njs->ns", weight, xi**2) == pytest.approx(1.0, abs=0.02)


def test_modes_are_told_apart_and_the_first_stands_in_for_those_that_are_not_there():
    def two(z):
        """Normal laws of width 0.1 about -1 and 1, the second with twice the mass."""
        parts = np.stack([np.log(w) - 50.0 * (z - c) ** 2 for c, w in ((-1.0, 1.0), (1.0, 2.0))])
        value = np.logaddexp(*parts)
        share = np.exp(parts - value)
        slope = -100.0 * (share[0] * (z + 1.0) + share[1] * (z - 1.0))
        return value[..., 0], slope, np.full((*z.shape, 1), 100.0)

    start = np.array([-2.0, -0.5, 0.5, 2.0])[None, None, :, None]
    found = highest(two, start, 3)
    assert found.z[0, 0, :, 0] == pytest.approx([1.0, -1.0, 1.0], abs=1e-4)


# ----------------------------------------------------------------------------- points along a ridge

MANY, LITTLE = 10, 0.05
MEANS, SDS = np.linspace(-0.8, 1.1, MANY), np.linspace(0.1, 0.6, MANY)
AT_MANY = np.append(np.stack([MEANS, SDS], axis=1).ravel(), LITTLE)
LAW_OF_MANY = Inputs({f"x{i}": Normal(Free(-3.0, 3.0), Free(0.02, 2.0)) for i in range(MANY)})


def factors(time: np.ndarray) -> np.ndarray:
    """(n, M)"""
    return np.stack([np.cos((1.0 + 0.7 * i) * time + i) + 0.3 for i in range(MANY)])


def linear(time, x):
    return np.sum(factors(time) * x, axis=0)


def bent(time, x):
    s = linear(time, x)
    return s + 0.06 * s**2


def frame_of(model, each: int) -> pd.DataFrame:
    rng, rows = np.random.default_rng(21), []
    for l in range(8):
        x = MEANS + SDS * rng.standard_normal(MANY)
        time = rng.uniform(0.0, 3.0, each)
        y = model(time, x[:, None]) + LITTLE * rng.standard_normal(each)
        rows += [{"id": f"e{l}", "time": t, "y": v} for t, v in zip(time, y, strict=True)]
    return pd.DataFrame(rows)


@pytest.mark.parametrize("each", [1, 3, 12])
def test_a_linear_outcome_is_exact_with_the_fewest_points(each: int) -> None:
    """Fewer observations than variates, and more: log L is that of a normal law."""
    frame = frame_of(linear, each)
    likelihood = likelihood_of(linear, frame, LAW_OF_MANY, nodes=1, noise=Noise(Free(0.01, 1.0)))
    found = likelihood.by(RidgePoints(), AT_MANY).evaluate(AT_MANY).each
    for own, (_, rows) in zip(found, frame.groupby("id", sort=False), strict=True):
        c, y = factors(rows["time"].to_numpy()), rows["y"].to_numpy()
        spread = (c.T * SDS**2) @ c + LITTLE**2 * np.eye(y.size)
        assert own == pytest.approx(
            stats.multivariate_normal(c.T @ MEANS, spread).logpdf(y), abs=1e-4
        )


def exact_of_bent(frame: pd.DataFrame) -> np.ndarray:
    """One bent observation an experiment: the sum s is normal, and integrated by a fine grid."""
    c, t = factors(frame["time"].to_numpy()), np.linspace(-9.0, 9.0, 20_001)
    s = (c.T @ MEANS)[:, None] + np.sqrt(c.T**2 @ SDS**2)[:, None] * t
    away = stats.norm.pdf(frame["y"].to_numpy()[:, None], s + 0.06 * s**2, LITTLE)
    return np.log(away @ stats.norm.pdf(t) * (t[1] - t[0]))


def test_a_bent_outcome_is_as_exact_as_twice_the_points_tell() -> None:
    frame = frame_of(bent, 1)
    likelihood = likelihood_of(bent, frame, LAW_OF_MANY, nodes=1, noise=Noise(Free(0.01, 1.0)))
    truth = exact_of_bent(frame)
    few, more, by_modes = (
        likelihood.by(rule, AT_MANY).evaluate(AT_MANY).each
        for rule in (RidgePoints(), RidgePoints(128), ImportancePoints(600))
    )
    assert np.max(np.abs(few - truth)) < 2e-3
    assert np.max(np.abs(more - truth)) < 1e-3
    # points of a normal law about the mode do not know where the ridge goes
    assert np.max(np.abs(by_modes - truth)) > 10.0 * np.max(np.abs(few - truth))


# ----------------------------------------------------- individual laws that are a narrow bent ridge

LAW_OF_GROWTH = Inputs(
    {name: TruncatedNormal(box, Free(*box), Free(0.01, 1.0)) for name, box in
     {"a": (0.3, 2.0), "b": (0.2, 1.8)}.items()}
)  # fmt: skip
AT_GROWTH = np.array([0.92, 0.09, 1.13, 0.3, 0.01])


def growth(time, x):
    return x[0] * np.exp(x[1] * time)


FRAME = pd.DataFrame({"id": range(4), "time": [0.5, 0.78, 1.2, 1.96], "y": [2.13, 3.52, 5.96, 6.5]})


def exact_of_growth(time: float, y: float) -> float:
    """The density of an outcome by quadrature over b, the noise as a law of a alone."""
    a, b = (
        stats.truncnorm((low - m) / s, (high - m) / s, m, s)
        for m, s, low, high in ((0.92, 0.09, 0.3, 2.0), (1.13, 0.3, 0.2, 1.8))
    )
    error = np.linspace(-6.0, 6.0, 401)
    weight = stats.norm.pdf(error) * (error[1] - error[0])

    def of_b(b_value: float) -> float:
        slope = np.exp(b_value * time)
        return float(b.pdf(b_value) * (a.pdf((y - 0.01 * error) / slope) @ weight) / slope)

    return np.log(integrate.quad(of_b, 0.2, 1.8, limit=400, epsabs=0.0, epsrel=1e-10)[0])


@pytest.mark.parametrize("rule", [GaussHermite(29, 6), GaussHermite(105, 9), GaussHermite(200, 9)])
def test_more_nodes_do_not_count_a_part_twice(rule: GaussHermite) -> None:
    """Nodes far out, whose lines do not meet the ridge, once wandered back to where others are."""
    each = likelihood_of(growth, FRAME, LAW_OF_GROWTH).by(rule, AT_GROWTH).evaluate(AT_GROWTH).each
    wanted = [exact_of_growth(*row) for row in FRAME[["time", "y"]].to_numpy()]
    assert each == pytest.approx(wanted, abs=1e-3)


def test_a_mode_is_found_along_a_bent_ridge() -> None:
    """log f = -(r - 3)^2/(2 w^2) - |z - p|^2/8: a ring, its top where it is nearest to p."""
    width, p = 0.01, np.array([5.0, 0.0])

    def ring(z):
        r = np.linalg.norm(z, axis=2)
        slope = z / r[..., None]
        value = -((r - 3.0) ** 2) / (2.0 * width**2) - np.sum((z - p) ** 2, axis=2) / 8.0
        gradient = -((r - 3.0) / width**2)[..., None] * slope - (z - p) / 4.0
        information = slope[..., :, None] * slope[..., None, :] / width**2 + np.eye(2) / 4.0
        return value, gradient, information

    angle = np.linspace(0.1, 0.4, 6)
    start = 3.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[None]
    found = modes(ring, start)
    assert found.value == pytest.approx(np.full((1, 6), -0.5), abs=0.03)


SURFACE = Inputs(
    {
        "a": Normal(Free(0.0, 4.0), Free(0.01, 2.0)),
        "b": TruncatedNormal((0.1, 3.0), Free(0.1, 3.0), Free(0.01, 1.0)),
        "c": Normal(Free(-1.0, 2.0), Free(0.01, 1.0)),
    },
    {("a", "b"): Free(-0.9, 0.9)},
)
WIDE = np.array([2.2, 0.7, 1.2, 0.7, 0.5, 0.06, 0.88, 0.05])


def fading(time, x):
    return x[0] * np.exp(-x[1] * time) + x[2] * time


@pytest.mark.parametrize("count", [3, 6])
def test_one_observation_of_three_parameters_has_a_smooth_likelihood(count: int) -> None:
    """It tells of one direction alone: across it nodes lay as rounding errors had them."""
    time = np.linspace(0.4, 2.8, 7)
    frame = pd.DataFrame({"id": range(7), "time": time, "y": fading(time, WIDE[::2]) + 0.3})
    adapted = likelihood_of(fading, frame, SURFACE).by(GaussHermite(count), WIDE)
    beside = WIDE * (1.0 + 1e-7 * np.arange(5)[:, None])
    values = [adapted.adapted(alpha).evaluate(alpha).each for alpha in beside]
    np.testing.assert_allclose(values, values[:1] * np.ones((5, 1)), atol=1e-4)


def test_lines_without_any_density_have_the_integral_zero_and_are_not_halved() -> None:
    """Outcomes that a law cannot give: the first panels are enough for them, beside others."""

    def log_density(line: np.ndarray, at: np.ndarray) -> np.ndarray:
        return np.where((line == 1)[:, None], -0.5 * at**2, -np.inf)

    pieces, totals = integrated(log_density, np.arange(2), points=8, enough=1e-6)
    np.testing.assert_allclose(totals, [-np.inf, 0.5 * np.log(2.0 * np.pi)], atol=1e-9)
    assert np.bincount(pieces.line).max() < 50


def test_a_log_density_with_noise_of_the_simulator_takes_a_bounded_number_of_panels() -> None:
    """Noise of 30 %, which no halving resolves; the integral is right within its mean."""

    def log_density(_: np.ndarray, at: np.ndarray) -> np.ndarray:
        return -0.5 * at**2 + 0.3 * np.sin(1e9 * at)

    pieces, totals = integrated(log_density, np.arange(1), points=8, enough=1e-6)
    assert pieces.line.size <= 2 * LINES.panels
    exact = 0.5 * np.log(2.0 * np.pi) + np.log(special.i0(0.3))
    assert totals[0] == pytest.approx(exact, abs=0.02)
