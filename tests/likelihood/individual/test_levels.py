"""Parameters that experiments share, against multivariate normal laws and plain integrals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import integrate, special, stats

from aleator import By, Constant, Free, Inputs, Noise, Normal, TruncatedNormal
from aleator.core.types import Array, Indices
from aleator.errors import InputsError
from aleator.fit.question import first_rule
from aleator.inference.calibration import sequential_pit
from aleator.laws.levels import Grouping
from aleator.likelihood.individual import (
    Direct,
    GaussHermite,
    IndividualLikelihood,
    Layout,
    LevelRule,
    individual_parameters,
    individual_points,
)
from aleator.likelihood.individual.levels import balanced_points
from aleator.observations.errors import MeasurementErrors
from aleator.observations.experiments import Experiments, covariates

DATA = Path(__file__).parents[2] / "data"
PUBLISHED = {
    # Pinheiro and Bates (2000); Bates, Maechler, Bolker and Walker (2015): -2 log L, ML
    "pastes": ("batch", None, 247.9944658625, [60.05333333, 1.09506, 2.90408, 0.82341]),
    "oxide": ("lot", None, 458.67690815, [2000.15277778, 10.58300, 5.98880, 3.54534]),
    "penicillin": ("plate", "sample", 332.1883486700, [22.97222222, 0.84557, 1.77065, 0.54993]),
}


class Total(Direct):
    """The sum of all parameters; those after the first may have a slope `t` for each row."""

    t: Array | None = None

    def values(self, block, x: Array) -> Array:  # type: ignore[no-untyped-def]
        eta = x[block.owner].sum(axis=2)
        if self.t is not None:
            eta += (self.t[block.rows, None] - 1.0) * x[block.owner, :, -1]
        return np.asarray(eta)

    def with_slopes(self, block, x: Array) -> tuple[Array, Array]:  # type: ignore[no-untyped-def]
        eta = self.values(block, x)
        slopes = np.ones((x.shape[2], *eta.shape))
        if self.t is not None:
            slopes[-1] = self.t[block.rows, None]
        return eta, slopes


def likelihood_of(
    table: pd.DataFrame, inputs: Inputs, outcome: str, t: Array | None = None
) -> tuple[IndividualLikelihood, Experiments]:
    """The likelihood of the sum of all parameters, with the rule of a search."""
    experiments = Experiments.from_frame(table, outcome=outcome)
    inputs = inputs.resolved(covariates(experiments, inputs.columns))
    seen = experiments.observations
    unit: Indices = np.arange(len(seen))
    layout = Layout(
        len(experiments.ids), seen.experiment, unit, np.zeros_like(unit), grouping=inputs.grouping
    )
    predictor = Total(None, np.arange(len(inputs.names)), inputs.box)  # type: ignore[arg-type]
    object.__setattr__(predictor, "t", t)
    errors = MeasurementErrors.of(Noise(sd=Free(0.01, 100.0)), experiments)
    return IndividualLikelihood.of(
        inputs, errors, predictor, layout, first_rule(inputs)
    ), experiments


def slope_of(likelihood: IndividualLikelihood, alpha: Array, free: list[int]) -> Array:
    """Central differences of the log-likelihood with nodes adapted to each alpha."""
    found = []
    for k in free:
        step = 1e-5 * max(1.0, abs(alpha[k])) * (np.arange(alpha.size) == k)
        up, down = (likelihood.adapted(a).evaluate(a).total for a in (alpha + step, alpha - step))
        found.append((up - down) / (2.0 * step[k]))
    return np.array(found)


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_likelihoods(name: str) -> None:
    one, other, deviance, estimates = PUBLISHED[name]
    inputs = Inputs(
        {
            "mean": Constant(Free(0.0, 3000.0)),
            "a": Normal(0.0, Free(0.0, 100.0)),
            "b": Normal(0.0, Free(0.0, 100.0)),
        },
        levels={"a": one} | ({"b": other} if other else {}),
    )
    table = pd.read_csv(DATA / f"{name}.csv")
    likelihood, _ = likelihood_of(table, inputs, table.columns[-1])
    alpha = np.array([estimates[0], 0.0, estimates[1], 0.0, *estimates[2:]])
    found = likelihood.adapted(alpha)(alpha)
    assert -2.0 * found.total == pytest.approx(deviance, abs=1e-6)
    free = [0, 2, 4, 5]
    away = alpha * [1.0, 1.0, 1.2, 1.0, 0.9, 1.1]
    exact = slope_of(likelihood, away, free)
    assert likelihood.adapted(away)(away).score[free] == pytest.approx(exact, rel=1e-5, abs=1e-5)


def nested_table(rng: np.random.Generator) -> pd.DataFrame:
    """Observations of specimens in casks in batches, in an order that mixes them."""
    site, batch, cask = np.unravel_index(np.arange(18), (2, 3, 3))
    rows = rng.permutation(np.repeat(np.arange(18), 2))
    frame = {
        "id": rows, "site": site[rows], "batch": 3 * site[rows] + batch[rows],
        "cask": 9 * site[rows] + 3 * batch[rows] + cask[rows], "z": np.linspace(-1, 1, 18)[rows],
    }  # fmt: skip
    return pd.DataFrame(frame).assign(y=rng.normal(0.0, 3.0, len(rows)))


def same(column: pd.Series) -> Array:
    return np.equal.outer(column.to_numpy(), column.to_numpy()).astype(float)


def test_three_nested_levels_in_any_order_of_rows() -> None:
    """Levels nested to depth three are multivariate normal, with a mean that follows a column."""
    table = nested_table(np.random.default_rng(2))
    inputs = Inputs(
        {
            "m": Normal(By("1 + z", -5.0, 5.0), 0.7),
            "s": Normal(0.0, Free(0.1, 9.0)),
            "b": Normal(0.0, Free(0.1, 9.0)),
        },
        levels={"s": "site", "b": "batch"},
    )
    likelihood, experiments = likelihood_of(table, inputs, "y")
    alpha = np.array([0.4, -0.3, 0.7, 0.0, 1.5, 0.0, 0.9, 0.5])
    assert [h.name for h in likelihood.hyperparameters][:2] == ["m.mean[Intercept]", "m.mean[z]"]
    covariance = (
        0.7**2 * same(table.id) + 1.5**2 * same(table.site) + 0.9**2 * same(table.batch)
        + 0.5**2 * np.eye(len(table))
    )  # fmt: skip
    exact = stats.multivariate_normal(0.4 - 0.3 * table.z, covariance).logpdf(table.y)
    found = likelihood.adapted(alpha)(alpha)
    assert found.total == pytest.approx(exact, abs=1e-9)
    assert found.each.shape == (2,)
    assert found.independent.sum(axis=0) == pytest.approx(found.score)
    assert likelihood.adapted(alpha).evaluate(alpha).total == pytest.approx(exact, abs=1e-9)
    assert found.score[[0, 1, 4, 6, 7]] == pytest.approx(
        slope_of(likelihood, alpha, [0, 1, 4, 6, 7]), rel=1e-5, abs=1e-6
    )
    held = likelihood.adapted(alpha)
    first = np.unique(table.id, return_index=True)[1]
    assert tuple(experiments.ids) == tuple(str(k) for k in dict.fromkeys(table.id))
    # log p(one | all others) is that of the conditional normal law.
    own = (table.id == table.id[first[4]]).to_numpy()
    rest = stats.multivariate_normal(
        (0.4 - 0.3 * table.z)[~own], covariance[np.ix_(~own, ~own)]
    ).logpdf(table.y[~own])
    place = experiments.ids.index(str(table.id[first[4]]))
    finer = held.by(LevelRule.first(likelihood.inputs.grouping, GaussHermite(5), 25), alpha)  # type: ignore[arg-type]
    assert finer.conditional(alpha)[place] == pytest.approx(exact - rest, abs=1e-4)


def test_two_correlated_parameters_of_a_batch() -> None:
    rng = np.random.default_rng(8)
    batch, t = np.repeat(np.arange(6), 5), np.tile(np.linspace(0.0, 2.0, 5), 6)
    table = pd.DataFrame({"batch": batch, "y": rng.normal(1.0, 1.5, 30)})
    inputs = Inputs(
        {"a": Normal(Free(-2.0, 4.0), Free(0.1, 3.0)), "slope": Normal(0.5, Free(0.1, 3.0))},
        {("a", "slope"): Free(-0.9, 0.9)},
        levels={"a": "batch", "slope": "batch"},
    )
    likelihood, _ = likelihood_of(table, inputs, "y", t)
    alpha = np.array([1.0, 0.8, 0.5, 0.4, -0.5, 0.6])
    z = np.stack([np.ones(30), t], axis=1)
    law = np.array([[0.64, -0.5 * 0.32], [-0.5 * 0.32, 0.16]])
    covariance = same(table.batch) * (z @ law @ z.T) + 0.36 * np.eye(30)
    exact = stats.multivariate_normal(1.0 + 0.5 * t, covariance).logpdf(table.y)
    found = likelihood.adapted(alpha)(alpha)
    assert found.total == pytest.approx(exact, abs=1e-9)
    free = [0, 1, 3, 4, 5]
    assert found.score[free] == pytest.approx(slope_of(likelihood, alpha, free), rel=1e-5)


def crossed_table() -> pd.DataFrame:
    """Two designs of machines and days that share nothing, of different size, with specimens."""
    rows = [(d, m) for d in range(3) for m in range(4)] + [(d, m) for d in (3, 4) for m in (4, 5)]
    frame = pd.DataFrame([*rows, *rows], columns=["day", "machine"])
    frame["id"] = [f"{d}.{m}" for d, m in [*rows, *rows]]
    return frame.assign(y=np.random.default_rng(5).normal(0.0, 2.0, len(frame)))


def test_crossed_levels_with_specimens_in_two_clusters() -> None:
    table = crossed_table()
    inputs = Inputs(
        {
            "m": Normal(Free(-3.0, 3.0), Free(0.1, 2.0)),
            "d": Normal(0.0, Free(0.1, 3.0)),
            "k": Normal(0.0, Free(0.1, 3.0)),
        },
        levels={"d": "day", "k": "machine"},
    )
    likelihood, _ = likelihood_of(table, inputs, "y")
    alpha = np.array([0.3, 0.6, 0.0, 1.1, 0.0, 0.8, 0.5])
    covariance = (
        0.36 * same(table.id) + 1.21 * same(table.day) + 0.64 * same(table.machine)
        + 0.25 * np.eye(len(table))
    )  # fmt: skip
    exact = stats.multivariate_normal(np.full(len(table), 0.3), covariance).logpdf(table.y)
    held = likelihood.adapted(alpha)
    found = held(alpha)
    assert found.total == pytest.approx(exact, abs=1e-9)
    assert found.each.shape == (2,)
    free = [0, 1, 3, 5, 6]
    assert found.score[free] == pytest.approx(slope_of(likelihood, alpha, free), rel=1e-5)
    # The parameters of an experiment have the conditional normal law.
    rows = np.flatnonzero(table.id == "1.2")
    across = 0.36 * same(table.id)[rows[0]]
    gain = np.linalg.solve(covariance, table.y - 0.3)
    mean, sd = (
        0.3 + across @ gain, np.sqrt(0.36 - across @ np.linalg.solve(covariance, across)),
    )  # fmt: skip
    place = [*dict.fromkeys(table.id)].index("1.2")
    individuals = individual_parameters(held, alpha)
    assert individuals.mean[place, 0] == pytest.approx(mean, abs=1e-8)
    assert individuals.sd[place, 0] == pytest.approx(sd, abs=1e-8)
    block = held.layout.alone(place)
    x, share = individual_points(held, alpha, block, 1024)
    own = place - block.experiments.start
    assert share[own] @ x[own, :, 0] == pytest.approx(mean, abs=0.01 * sd)
    assert share[own] @ (x[own, :, 0] - mean) ** 2 == pytest.approx(sd**2, rel=0.02)


STRESS = np.tile(np.linspace(275.0, 400.0, 8), 12)


class Life(Direct):
    """log10 of a life above a limit that each specimen has, with a shift of its batch."""

    def values(self, block, x: Array) -> Array:  # type: ignore[no-untyped-def]
        x = x[block.owner]
        return np.asarray(9.0 + x[..., 1] - 2.0 * np.log10(STRESS[block.rows, None] - x[..., 0]))

    def with_slopes(self, block, x: Array) -> tuple[Array, Array]:  # type: ignore[no-untyped-def]
        over = 2.0 / np.log(10.0) / (STRESS[block.rows, None] - x[block.owner, :, 0])
        return self.values(block, x), np.stack([over, np.ones_like(over)])


def by_fixed_nodes(y: Array, mean: float, sd: float, of_batch: float, noise: float) -> float:
    """log L by Legendre nodes over the box of the limit and a trapezoidal rule over the shift."""
    b = np.linspace(-8.0, 8.0, 801) * of_batch
    x, w = np.polynomial.legendre.leggauss(300)
    x, w = 185.0 + 85.0 * x, 85.0 * w
    law = stats.truncnorm((100.0 - mean) / sd, (270.0 - mean) / sd, mean, sd).pdf(x) * w
    log_sum = np.zeros((len(y) // 8, b.size))
    for k, own in enumerate(y):
        eta = 9.0 - 2.0 * np.log10(STRESS[k] - x)
        with np.errstate(divide="ignore"):
            log_sum[k // 8] += np.log(stats.norm.pdf(own, eta + b[:, None], noise) @ law)
    of_law = stats.norm.pdf(b, 0.0, of_batch) * (b[1] - b[0])
    return float(np.log(np.exp(log_sum) @ of_law).sum())


def by_adaptive_nodes(y: Array, mean: float, sd: float, of_batch: float, noise: float) -> float:
    """The same by adaptive Gauss-Kronrod rules (QUADPACK's), one within the other."""
    inside = np.diff(special.ndtr((np.array([100.0, 270.0]) - mean) / sd))[0]

    def of_specimens(b: float, first: int) -> Array:
        """p(y | b) of the eight specimens of a batch."""
        own, stress = y[first : first + 8] - 9.0 - b, STRESS[:8]

        def density(x: float) -> Array:
            far = (own + 2.0 * np.log10(stress - x)) / noise
            return np.asarray(np.exp(-0.5 * far**2 - 0.5 * ((x - mean) / sd) ** 2))

        whole = integrate.quad_vec(density, 100.0, 270.0, epsabs=1e-7, epsrel=1e-7)[0]
        return np.asarray(whole / (2.0 * np.pi * noise * sd * inside))

    total = 0.0
    for first in range(0, len(y), 8):

        def of_batches(v: float, first: int = first) -> float:
            return float(np.prod(of_specimens(of_batch * v, first)) * np.exp(-0.5 * v * v))

        found = integrate.quad(of_batches, -6.0, 6.0, epsabs=0.0, epsrel=1e-6, limit=200)[0]
        total += np.log(found / np.sqrt(2.0 * np.pi))
    return float(total)


def lives() -> Array:
    """Logarithms of lives of eight specimens of each of twelve batches."""
    rng = np.random.default_rng(4)
    shift, limit = np.repeat(rng.normal(0.0, 0.25, 12), 8), rng.normal(205.0, 18.0, 96)
    return np.asarray(9.0 + shift - 2.0 * np.log10(STRESS - limit) + rng.normal(0.0, 0.05, 96))


@pytest.mark.long
def test_two_integrals_of_our_own_agree() -> None:
    alpha = (203.0, 16.0, 0.27, 0.06)
    assert by_adaptive_nodes(lives(), *alpha) == pytest.approx(
        by_fixed_nodes(lives(), *alpha), abs=1e-8
    )


def test_a_nonlinear_simulator_by_a_plain_integral() -> None:
    """The error of the nodes falls to nothing, and the differences to finer rules tell it."""
    y = lives()
    inputs = Inputs(
        {
            "limit": TruncatedNormal(box=(100.0, 270.0), mean=Free(150, 250), sd=Free(1.0, 50.0)),
            "shift": Normal(0.0, Free(0.0, 2.0)),
        },
        levels={"shift": "batch"},
    )
    table = pd.DataFrame({"batch": np.repeat(np.arange(12), 8), "y": y})
    made, _ = likelihood_of(table, inputs, "y")
    predictor = Life(None, np.arange(2), inputs.box)  # type: ignore[arg-type]
    likelihood = IndividualLikelihood.of(
        made.inputs, made.errors, predictor, made.layout, first_rule(made.inputs)
    )
    alpha = np.array([203.0, 16.0, 0.0, 0.27, 0.06])
    exact = by_fixed_nodes(y, 203.0, 16.0, 0.27, 0.06)

    grouping = made.inputs.grouping
    assert grouping is not None
    errors = []
    for nodes in (5, 11, 25):
        rule = LevelRule.first(grouping, GaussHermite(nodes), nodes)
        errors.append(abs(likelihood.by(rule, alpha).evaluate(alpha).total - exact))
    assert errors[0] < 0.08
    assert errors[2] < 1e-5
    fine = likelihood.by(LevelRule.first(grouping, GaussHermite(25), 15), alpha)
    free = [0, 1, 3, 4]
    assert fine(alpha).score[free] == pytest.approx(slope_of(fine, alpha, free), rel=1e-3, abs=1e-3)


def test_points_of_crossed_levels_are_exact_to_degree_three() -> None:
    t = balanced_points(40, 30)
    assert t.T @ t / len(t) == pytest.approx(np.eye(30), abs=1e-12)
    assert np.abs(np.einsum("ji,jk,jl->ikl", t, t, t)).max() < 1e-10


def test_blocks_hold_whole_clusters() -> None:
    """Experiments of a cluster that are far apart in the table come into one block."""
    batch = np.array([0, 0, 1, 2, 1, 3, 3, 4])
    grouping = Grouping.by({"batch": batch}, ["batch"])
    each = np.arange(8)
    layout = Layout(8, each, each, np.zeros_like(each), grouping=grouping)
    assert [b.experiments.stop for b in layout.blocks(400_000)] == [2, 5, 7, 8]
    assert (layout.alone(3).experiments.start, layout.alone(3).experiments.stop) == (2, 5)


@pytest.mark.parametrize(
    ("levels", "words"),
    [
        ({"nothing": "batch"}, "there is no such parameter"),
        ({"fixed": "batch"}, "is a constant"),
        ({"a": "batch"}, "belong to different levels"),
    ],
)
def test_impossible_levels_are_refused(levels: dict[str, str], words: str) -> None:
    laws = {"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0), "fixed": Constant(1.0)}
    with pytest.raises(InputsError, match=words):
        Inputs(laws, {("a", "b"): 0.5}, levels)


def test_probabilities_given_all_earlier_values_of_the_batch() -> None:
    """Rosenblatt's transform of a multivariate normal law, experiment after experiment."""
    inputs = Inputs(
        {
            "mean": Constant(Free(0.0, 100.0)),
            "a": Normal(0.0, Free(0.0, 100.0)),
            "b": Normal(0.0, Free(0.0, 100.0)),
        },
        levels={"a": "batch"},
    )
    table = pd.read_csv(DATA / "pastes.csv")
    likelihood, experiments = likelihood_of(table, inputs, "strength")
    alpha = np.array([60.0, 0.0, 2.0, 0.0, 1.5, 0.8])
    seen = experiments.observations
    found = sequential_pit(likelihood.adapted(alpha), alpha, seen)
    rows = table.iloc[seen.row]
    covariance = 4.0 * same(rows.batch) + 2.25 * same(rows.id) + 0.64 * np.eye(60)
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), seen.lower - 60.0)
    assert found == pytest.approx(stats.norm.cdf(whitened), abs=0.04)
    assert np.sqrt(np.mean((stats.norm.ppf(found) - whitened) ** 2)) < 0.05


def test_probabilities_where_a_batch_and_a_specimen_are_only_known_together() -> None:
    """Series tell a + b to 0.03, while a of the batch and b of the specimen may differ by one."""
    rng, (specimens, length) = np.random.default_rng(3), (20, 8)
    time = np.linspace(0.0, 1.0, length)
    each = np.repeat(np.arange(specimens), length)
    frame = pd.DataFrame({"id": each, "batch": each // 5, "t": np.tile(time, specimens)})
    t = frame.t.to_numpy()
    covariance = same(frame.batch) + same(frame.id) * (1.0 + np.outer(t, t)) + 0.05**2 * np.eye(160)
    root = np.linalg.cholesky(covariance)
    normal = rng.standard_normal(len(frame))
    table = frame.assign(y=root @ normal)
    inputs = Inputs(
        {"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0), "c": Normal(0.0, 1.0)},
        levels={"a": "batch"},
    )
    likelihood, experiments = likelihood_of(table, inputs, "y", t)
    alpha = np.array([0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.05])
    found = sequential_pit(likelihood.adapted(alpha), alpha, experiments.observations)
    assert np.mean(np.isfinite(found)) > 0.98
    assert np.sqrt(np.nanmean((stats.norm.ppf(found) - normal) ** 2)) < 0.1
