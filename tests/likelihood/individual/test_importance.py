"""Importance points against integrals that are known, where nodes about one mode miss a part."""

import numpy as np
import pytest
from individual_cases import ALPHA, decay, likelihood_of, straight_line, table
from scipy import integrate, stats

from aleator import Free, Inputs, Noise, Normal
from aleator.fit.quadrature import several_modes, with_enough_nodes
from aleator.likelihood.individual import GaussHermite, ImportancePoints, PlanePanels
from aleator.likelihood.individual.modes import highest
from aleator.likelihood.individual.rules import proposed

SQUARE = Inputs(
    {
        "a": Normal(Free(-3.0, 3.0), Free(0.01, 4.0)),
        "b": Normal(Free(-3.0, 3.0), Free(0.01, 4.0)),
    }
)
AT = np.array([1.3, 0.8, 0.5, 0.3, 0.4])


def square(time, x):
    return x[0] ** 2 * np.sqrt(1.0 + time) + x[1]


def squares():
    frame = table(straight_line, experiments=14)
    rng = np.random.default_rng(4)
    draws = {name: rng.normal(AT[[0, 2]], AT[[1, 3]]) for name in frame["id"].unique()}
    x = np.array([draws[name] for name in frame["id"]]).T
    frame["y"] = square(frame["time"].to_numpy(), x) + AT[4] * rng.standard_normal(len(frame))
    return frame


def exact(frame, alpha):
    """b in closed form: given a the outcomes are normal; a by the trapezoidal rule."""
    a = np.linspace(-7.0, 7.0, 20001)
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
    return likelihood_of(square, frame, SQUARE, noise=Noise(Free(0.005, 2.0))), frame


def test_they_see_the_mode_that_nodes_about_one_do_not(both):
    likelihood, frame = both
    wanted = exact(frame, AT)
    about_one = likelihood.by(GaussHermite(9), AT).evaluate(AT).each
    about_all = likelihood.by(ImportancePoints(4800), AT).evaluate(AT).each
    assert np.abs(about_one - wanted).max() > 0.04
    assert about_all == pytest.approx(wanted, abs=0.01)


def test_a_second_mode_is_noticed_and_a_ridge_is_none(both):
    likelihood, _ = both
    assert several_modes(likelihood, AT)
    assert not several_modes(likelihood_of(decay, table(decay)), ALPHA)


def test_an_answer_with_two_modes_is_that_of_the_exact_integral(both):
    likelihood, frame = both
    end = with_enough_nodes(likelihood, AT, enough=0.02)
    assert isinstance(end.likelihood.rule, PlanePanels)
    assert end.value == pytest.approx(exact(frame, end.alpha).sum(), abs=0.05)
    for k in range(5):
        moved = end.alpha + 0.02 * np.eye(5)[k] * end.alpha
        back = end.alpha - 0.02 * np.eye(5)[k] * end.alpha
        top = exact(frame, end.alpha).sum()
        assert top > max(exact(frame, at).sum() for at in (moved, back)) - 0.02


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


def test_with_points_held_the_score_is_the_derivative_of_what_is_computed(both):
    likelihood = both[0].by(ImportancePoints(60), AT)
    alpha, step = AT * 1.03, 1e-6
    score = likelihood(alpha).score
    for k in range(5):
        moved = np.eye(5)[k] * step
        ends = [likelihood.evaluate(alpha + sign * moved).total for sign in (1.0, -1.0)]
        assert score[k] == pytest.approx((ends[0] - ends[1]) / 2 / step, rel=1e-6, abs=1e-5)


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
