"""Nodes that are held as parameters: scores where an outcome jumps or has a kink."""

import numpy as np
import pandas as pd
import pytest
from individual_cases import ALPHA, decay, likelihood_of, table
from scipy import stats

from aleator import Beta, Constant, Free, Gamma, Inputs, LogNormal, Normal, TruncatedNormal, Uniform
from aleator.likelihood.individual import ImportancePoints, Panels
from aleator.likelihood.individual.parameters import moving

ONE = Inputs({"x": Normal(Free(-3.0, 3.0), Free(0.01, 3.0))})
AT = np.array([0.3, 0.7, 0.05])
FINE = np.linspace(-9.0, 9.0, 400_001)


def jump(time, x):
    return x[0] * time + (x[0] > 0.4)


def exact(frame: pd.DataFrame, alpha: np.ndarray) -> float:
    """The log-likelihood by the rectangle rule, with the density of x."""
    x = AT[0] + AT[1] * FINE
    weight = stats.norm.pdf(x, *alpha[:2]) * (x[1] - x[0])
    rows = frame[["time", "y"]].to_numpy()
    return float(
        sum(np.log(stats.norm.pdf(y, jump(t, x[None]), alpha[2]) @ weight) for t, y in rows)
    )


def differences(value, alpha: np.ndarray, step: float = 1e-4) -> list[float]:
    each = step * np.eye(len(alpha))
    return [(value(alpha + by) - value(alpha - by)) / (2.0 * step) for by in each]


def test_the_score_counts_what_moves_across_a_jump() -> None:
    """Held as variates the nodes do not see that a share of the law crosses the jump."""
    rng = np.random.default_rng(2)
    time = rng.uniform(0.0, 1.0, 12)
    y = jump(time, 0.3 + 0.7 * rng.standard_normal((1, 12))) + 0.05 * rng.standard_normal(12)
    frame = pd.DataFrame({"id": range(12), "time": time, "y": y})
    there = np.add(AT, [0.05, 0.03, 0.004])
    likelihood = likelihood_of(jump, frame, ONE).by(Panels(), AT)
    for alpha in (AT, there):
        found = likelihood(alpha)
        assert found.likelihood == pytest.approx(exact(frame, alpha), abs=1e-3)
        wanted = differences(lambda a: exact(frame, a), alpha)
        assert found.score == pytest.approx(np.array(wanted), rel=2e-3, abs=2e-3)


@pytest.mark.parametrize(
    "there",
    [
        (0.3 + 0.92, 0.7, 0.05),
        (0.3 - 0.92, 0.7, 0.05),
        (0.3, 0.41 * 0.7, 0.05),
        (0.3, 1.98 * 0.7, 0.05),
        (0.3, 0.7, 0.41 * 0.05),
        (0.3, 0.7, 1.98 * 0.05),
    ],
)
def test_nodes_serve_up_to_a_distance_of_one(there) -> None:
    rng = np.random.default_rng(2)
    time = rng.uniform(0.0, 1.0, 12)
    y = jump(time, 0.3 + 0.7 * rng.standard_normal((1, 12))) + 0.05 * rng.standard_normal(12)
    frame = pd.DataFrame({"id": range(12), "time": time, "y": y})
    likelihood, alpha = likelihood_of(jump, frame, ONE).by(Panels(), AT), np.array(there)
    assert likelihood.distance(AT) == 0.0
    assert 0.0 < likelihood.distance(alpha) <= 1.0
    assert likelihood.distance(AT + 1.1 * (alpha - AT)) > 1.0
    assert likelihood.evaluate(alpha).total == pytest.approx(exact(frame, alpha), abs=2e-3)


def test_an_objective_takes_the_nodes_that_are_nearest() -> None:
    rng = np.random.default_rng(2)
    y = jump(0.5, 0.3 + 0.7 * rng.standard_normal((1, 12))) + 0.05 * rng.standard_normal(12)
    frame = pd.DataFrame({"id": range(12), "time": 0.5, "y": y})
    here = likelihood_of(jump, frame, ONE).by(Panels(), AT)
    objective, beside, narrow = here.continued, AT * [1.0, 0.8, 1.0], AT * [1.0, 0.04, 1.0]
    assert objective(beside).total == here(beside).total
    assert objective(narrow).total == pytest.approx(exact(frame, narrow), abs=2e-3)
    assert abs(here(narrow).total - exact(frame, narrow)) > 0.1
    own = here.adapted(beside)
    objective.remember(own)
    assert objective(beside).total == own(beside).total


def test_scores_of_correlated_parameters_are_slopes_of_the_value() -> None:
    likelihood = likelihood_of(decay, table(decay)).by(ImportancePoints(600), ALPHA)
    there = np.add(ALPHA, [0.05, 0.03, -0.04, 0.02, 0.05, 0.01])
    found = likelihood(there)
    wanted = differences(lambda a: likelihood.evaluate(a).total, there)
    assert found.score == pytest.approx(np.array(wanted), rel=1e-4, abs=1e-4)


def test_points_that_are_held_tell_the_value_at_a_near_alpha() -> None:
    likelihood = likelihood_of(decay, table(decay)).by(ImportancePoints(1200), ALPHA)
    there = np.add(ALPHA, [0.05, 0.03, -0.04, 0.02, 0.05, 0.01])
    again = likelihood.adapted(there).evaluate(there).total
    assert likelihood.evaluate(there).total == pytest.approx(again, abs=0.01)


def test_a_support_that_moves_is_told() -> None:
    """The score of a uniform law has no mean of zero: its ends move."""
    laws = {
        "normal": Normal(Free(0.0, 2.0), Free(0.1, 1.0)),
        "lognormal": LogNormal(Free(0.5, 2.0), Free(0.1, 1.0)),
        "gamma": Gamma(Free(0.5, 2.0), Free(0.1, 1.0)),
        "beta": Beta((0.0, 2.0), Free(0.5, 1.5), Free(0.1, 0.5)),
        "truncated": TruncatedNormal((0.0, 2.0), Free(), Free()),
    }
    assert not any(moving(Inputs({name: law})) for name, law in laws.items())
    assert moving(Inputs({"x": Uniform(Free(0.5, 1.5), Free(0.1, 1.0))})) == (0, 1)


def test_a_constant_that_is_identified_moves_what_is_simulated() -> None:
    """Nodes held as parameters would not see it: the score is that of the exact likelihood."""
    inputs = Inputs({"x": Normal(Free(-3.0, 3.0), Free(0.01, 3.0)), "c": Constant(Free(-1.0, 1.0))})
    time = np.linspace(0.2, 1.0, 8)
    frame = pd.DataFrame({"id": range(8), "time": time, "y": 0.3 * time + 0.4})
    alpha = np.array([0.3, 0.7, 0.1, 0.05])

    def value(at: np.ndarray) -> float:
        """y = x time + c + e is normal."""
        sd = np.hypot(at[1] * time, at[3])
        return float(stats.norm.logpdf(frame["y"], at[0] * time + at[2], sd).sum())

    likelihood = likelihood_of(lambda t, x: x[0] * t + x[1], frame, inputs).by(Panels(), alpha)
    there = alpha + np.array([0.02, 0.01, 0.03, 0.002])
    found = likelihood.adapted(there)(there)
    assert found.likelihood == pytest.approx(value(there), abs=1e-4)
    assert found.score == pytest.approx(np.array(differences(value, there)), rel=1e-3, abs=1e-3)
    assert likelihood.parameters is None
