"""Nodes that are held while alpha moves: their scores, how far they serve, the step they show."""

import numpy as np
import pandas as pd
import pytest
from individual_cases import ALPHA, PAIR, decay, likelihood_of, straight_line, table
from scipy import stats

from aleator import (
    Beta,
    Constant,
    Free,
    Gamma,
    Inputs,
    LogNormal,
    Mixture,
    Noise,
    Normal,
    TruncatedNormal,
    Uniform,
)
from aleator.laws import By
from aleator.likelihood.individual import ImportancePoints, Panels
from aleator.likelihood.individual.parameters import law_scores, moving

ALONE = Inputs({"x": Normal(Free(-3.0, 3.0), Free(0.01, 3.0))})
AT = np.array([0.3, 0.7, 0.05])
FINE = np.linspace(-9.0, 9.0, 400_001)


def jump(time, x):
    return x[0] * time + (x[0] > 0.4)


def jumping(time: float | None = None) -> pd.DataFrame:
    rng = np.random.default_rng(2)
    time = rng.uniform(0.0, 1.0, 12) if time is None else time
    y = jump(time, 0.3 + 0.7 * rng.standard_normal((1, 12))) + 0.05 * rng.standard_normal(12)
    return pd.DataFrame({"id": range(12), "time": time, "y": y})


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
    frame = jumping()
    there = np.add(AT, [0.05, 0.03, 0.004])
    likelihood = likelihood_of(jump, frame, ALONE).by(Panels(), AT)
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
    frame = jumping()
    likelihood, alpha = likelihood_of(jump, frame, ALONE).by(Panels(), AT), np.array(there)
    assert likelihood.distance(AT) == 0.0
    assert 0.0 < likelihood.distance(alpha) <= 1.0
    assert likelihood.distance(AT + 1.1 * (alpha - AT)) > 1.0
    assert likelihood.evaluate(alpha).total == pytest.approx(exact(frame, alpha), abs=2e-3)


def test_an_objective_takes_the_nodes_that_are_nearest() -> None:
    frame = jumping(0.5)
    here = likelihood_of(jump, frame, ALONE).by(Panels(), AT)
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


# ------------------------------------------------------------------------------ scores of the law

LAWS = {
    "a": TruncatedNormal((0.0, 3.0), Free(0.0, 3.0), Free(0.05, 2.0)),
    "alone": Normal(Free(-2.0, 2.0), Free(0.1, 2.0)),
    "b": Gamma(Free(0.5, 3.0), Free(0.05, 2.0)),
}
TIED = np.array([0.4, 0.8, 0.2, 0.7, 1.2, 0.5, -0.6])


@pytest.fixture
def tied() -> Inputs:
    return Inputs(LAWS, {("a", "b"): Free(-0.9, 0.9)})


def test_scores_of_tied_laws_are_the_slopes_of_their_density(tied: Inputs) -> None:
    rng = np.random.default_rng(3)
    x = tied.sample(TIED, rng.random((12, 3))).reshape(3, 4, 3)
    share = rng.dirichlet(np.ones(4), 3)

    def mean(alpha: np.ndarray) -> np.ndarray:
        return np.sum(share * tied.log_density(alpha, x.reshape(12, 3)).reshape(3, 4), axis=1)

    steps = 1e-6 * np.eye(TIED.size)
    slopes = [(mean(TIED + step) - mean(TIED - step)) / 2e-6 for step in steps]
    assert law_scores(tied, TIED, x, share) == pytest.approx(np.array(slopes).T, rel=1e-5)


def test_normal_scores_of_a_truncated_law_have_no_step_where_a_tail_is_faint() -> None:
    """From where on logarithms tell them: second differences are as small there as beside it."""
    values, x = np.array([0.4, 0.1]), np.linspace(-0.1, 0.9, 20_001)
    score = TruncatedNormal((-1.0, 2.0)).normal_score(values, x)
    assert np.abs(np.diff(score, 2)).max() < 1e-9


# --------------------------------------------------------- the step that individual parameters show

ONE = Inputs({"a": Normal(Free(-10.0, 10.0), Free(0.01, 5.0)), "b": Constant(Free(-5.0, 5.0))})


def balanced(experiments=6, observations=4, seed=1) -> pd.DataFrame:
    """y_lk = a_l + e_lk, as many values of each."""
    rng = np.random.default_rng(seed)
    own = 2.0 + 0.8 * rng.standard_normal(experiments)
    y = np.repeat(own, observations) + 0.5 * rng.standard_normal(experiments * observations)
    ids = np.repeat([f"e{l}" for l in range(experiments)], observations)
    return pd.DataFrame({"id": ids, "time": 0.0, "y": y})


def individual_laws(frame, mean, sd, noise):
    """Means (N,) and variance of a_l given the observations of l."""
    groups = frame.groupby("id", sort=False)["y"]
    precision = sd**-2 + groups.size().to_numpy() * noise**-2
    return (mean / sd**2 + groups.sum().to_numpy() / noise**2) / precision, 1.0 / precision


def test_a_step_is_that_of_expectation_and_maximization_over_the_share_that_is_told():
    frame, alpha = balanced(), np.array([1.0, 0.7, 0.0, 0.6])
    likelihood = likelihood_of(straight_line, frame, ONE)
    value, found = likelihood.continued.expectation_step(alpha)
    mean, variance = individual_laws(frame, 1.0, 0.7, 0.6)
    told = 1.0 - variance / 0.49
    assert value == pytest.approx(likelihood.adapted(alpha).evaluate(alpha).total, abs=1e-9)
    assert found[0] == pytest.approx(1.0 + np.sum(mean - 1.0) / told.sum(), abs=1e-9)
    square = np.sum((mean - 1.0) ** 2 + variance - 0.49) / np.sum(told**2)
    assert found[1] ** 2 == pytest.approx(0.49 + square, abs=1e-9)
    assert found[2] == 0.0
    residual = frame["y"].to_numpy() - np.repeat(mean, 4)
    assert found[3] ** 2 == pytest.approx(np.mean(residual**2 + np.repeat(variance, 4)), abs=1e-9)


def test_one_step_finds_the_mean_of_a_balanced_table():
    """Whatever the sds are, its maximum is the mean of all observations."""
    frame = balanced()
    for alpha in ([-1.0, 0.7, 0.0, 0.6], [4.0, 1.5, 0.0, 2.0], [2.2, 0.3, 0.0, 0.5]):
        following = likelihood_of(straight_line, frame, ONE).continued
        found = following.expectation_step(np.array(alpha))[1]
        assert found[0] == pytest.approx(frame["y"].mean(), abs=1e-8)


def test_steps_end_at_the_maximum_of_a_balanced_table():
    """Of a balanced table the maximum is known from sums of squares within and between."""
    frame = balanced(experiments=8, observations=5)
    means = frame.groupby("id", sort=False)["y"].mean().to_numpy()
    within = np.mean((frame["y"].to_numpy() - np.repeat(means, 5)) ** 2) * 5 / 4
    between = np.mean((means - means.mean()) ** 2) - within / 5
    following = likelihood_of(straight_line, frame, ONE).continued
    alpha = np.array([-3.0, 0.2, 0.0, 2.0])
    for _ in range(12):
        _, alpha = following.expectation_step(alpha)
    assert alpha == pytest.approx([means.mean(), between**0.5, 0.0, within**0.5], abs=1e-5)


def test_errors_grow_twofold_at_most_so_that_laws_explain_more():
    alpha = np.array([9.0, 0.02, 0.0, 0.05])
    following = likelihood_of(straight_line, balanced(), ONE).continued
    assert following.expectation_step(alpha)[1][3] == pytest.approx(0.1)


def test_a_formula_follows_the_individual_means():
    frame = balanced(experiments=7).iloc[3:]
    covariate = pd.DataFrame({"z": np.arange(7.0)}, index=frame["id"].unique())
    laws = {"a": Normal(By("1 + z", -10.0, 10.0), Free(0.01, 5.0)), "b": ONE.laws["b"]}
    inputs = Inputs(laws).resolved(covariate)
    z, alpha = covariate["z"].to_numpy(), np.array([2.0, 0.1, 0.7, 0.0, 0.6])
    found = likelihood_of(straight_line, frame, inputs).continued.expectation_step(alpha)[1]
    # generalized least squares, with the sds that the law and the errors have
    groups = frame.groupby("id", sort=False)["y"]
    weight = 1.0 / (0.7**2 + 0.6**2 / groups.size().to_numpy())
    design = np.stack([np.ones(7), z], axis=1)
    wanted = np.linalg.solve((design.T * weight) @ design, design.T @ (weight * groups.mean()))
    assert found[:2] == pytest.approx(wanted, abs=1e-8)
    assert found[2] != 0.7


def test_what_is_no_mean_and_no_sd_stays():
    frame = table(straight_line)
    noise = Noise(Free(0.01, 5.0), relative=Free(0.001, 1.0))
    likelihood = likelihood_of(straight_line, frame, PAIR, noise=noise)
    alpha = np.append(ALPHA, 0.1)
    found = likelihood.continued.expectation_step(alpha)[1]
    assert found[[4, 6]] == pytest.approx(alpha[[4, 6]])
    assert np.all(found[[0, 1, 2, 3, 5]] != alpha[[0, 1, 2, 3, 5]])


def test_of_a_mixture_only_the_rest_moves():
    parts = (Normal(Free(-10.0, 10.0), Free(0.01, 5.0)), Normal(Free(-10.0, 10.0), 0.3))
    inputs = Inputs({"a": Mixture(parts), "b": ONE.laws["b"]})
    likelihood = likelihood_of(straight_line, balanced(), inputs)
    alpha = np.array([1.0, 0.7, 3.0, 0.3, 0.4, 0.0, 0.6])
    value, found = likelihood.continued.expectation_step(alpha)
    assert value == pytest.approx(likelihood.adapted(alpha).evaluate(alpha).total, abs=1e-9)
    np.testing.assert_array_equal(found[:6], alpha[:6])
    assert found[6] != 0.6


def test_where_nothing_is_possible_no_step_is_made():
    likelihood = likelihood_of(lambda time, x: x[0] * np.nan * time, balanced(), ONE)
    alpha = np.array([1.0, 0.7, 0.0, 0.6])
    value, found = likelihood.continued.expectation_step(alpha)
    assert value == -np.inf
    np.testing.assert_array_equal(found, alpha)
