"""The likelihood of experiments with any number of observations, and the objective of a search."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from aleator.core.status import Status
from aleator.core.types import Array, Flags, Indices
from aleator.laws.hyperparameter import Hyperparameter, log_prior
from aleator.laws.inputs import Individual, Inputs, parameters_at, variates_of
from aleator.likelihood.individual.levels import LevelRule, cluster_modes
from aleator.likelihood.individual.modes import (
    MODES,
    Curved,
    DenseRule,
    IndividualLaws,
    Modes,
    ModeSettings,
    NodeRule,
    PlacedNodes,
    highest,
    inner,
    modes,
)
from aleator.likelihood.individual.parameters import (
    FOLLOWING,
    FollowingSettings,
    Parameters,
    holds,
    scattered_density,
)
from aleator.likelihood.individual.predictors import Block, Layout, OnSurfaces, Predictor
from aleator.likelihood.individual.restricted import restricted
from aleator.likelihood.individual.rules import GaussHermite, Nodes
from aleator.observations.errors import MeasurementErrors, Terms
from aleator.search.interface import LogLikelihood


@dataclass(frozen=True, eq=False)
class IndividualLikelihood:
    """log L(alpha) = sum_l log int prod_k p(y_lk | eta_lk(x), sigma_lk) p(x | alpha) dx.

    x is the image of standard normal variates xi (see `Individual`). The integral over xi is
    computed at `nodes` that were adapted to each experiment (Pinheiro and Bates, 1995) and are then
    fixed, so that a call gives a smooth function of alpha with an exact score (Fisher's identity).
    With mixtures the integral is a sum over the classes, each with its own nodes. `adapted` returns
    a new likelihood with nodes adapted to another alpha. The quadrature is poor at an alpha that is
    far from the one to which the nodes were adapted. If `restricted` is true, locations are
    integrated out (see `aleator.likelihood.individual.restricted`).
    """

    inputs: Inputs
    errors: MeasurementErrors
    predictor: Predictor
    layout: Layout
    rule: NodeRule
    nodes: Nodes
    parameters: Parameters | None = None
    settings: ModeSettings = MODES
    restricted: bool = False

    @classmethod
    def of(
        cls,
        inputs: Inputs,
        errors: MeasurementErrors,
        predictor: Predictor,
        layout: Layout,
        rule: GaussHermite | LevelRule,
        *,
        restricted: bool = False,
    ) -> IndividualLikelihood:
        """The likelihood with nodes of the law itself, not yet adapted to the experiments."""
        classes = len(inputs.classes)
        first = rule if isinstance(rule, GaussHermite) else GaussHermite(1)
        nodes = Nodes.of_the_law(layout.count, classes, inputs.scattering, first)
        return cls(inputs, errors, predictor, layout, rule, nodes, restricted=restricted)

    @property
    def name(self) -> str:
        """The name for reports: the rule and its number of nodes per experiment."""
        if not self.inputs.scattering:
            return "measurement errors alone"
        return f"{self.rule.name}, {self.nodes.xi.shape[1]:,} nodes"

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters in the order of alpha: those of the inputs, then of the errors."""
        return (*self.inputs.hyperparameters, *self.errors.hyperparameters)

    @property
    def count(self) -> int:
        """The number N of experiments."""
        return self.layout.count

    @property
    def independent(self) -> int:
        """The number U of independent terms: of experiments, or of clusters of them."""
        grouping = self.layout.grouping
        return self.count if grouping is None else grouping.clusters

    @property
    def region(self) -> Array:
        """The region (n, 2) in which simulated values are known.

        It is the region of the response surfaces, or with the simulator itself the full ranges.
        """
        predictor = self.predictor
        return predictor.region if isinstance(predictor, OnSurfaces) else self.inputs.box

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Blocks of experiments that fit into memory together with their nodes."""
        return self.layout.blocks(self.nodes.xi.shape[1])

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood and scores (N, K) at alpha (K,), with the present nodes.

        The scores of the experiments of a cluster add up to the derivative of its log-likelihood.
        """
        if self.restricted:
            return self._restricted(alpha, slope=True)
        return self._scored(alpha)

    def _restricted(self, alpha: Array, *, slope: bool) -> LogLikelihood:
        """The restricted log-likelihood at alpha (K,); see the function `restricted`.

        Scores near alpha have the same nodes if these are parameters. Others are adapted to each:
        three fixed nodes leave an error of 6e-3 with the weights of 16 rats, adapted ones 2e-7.
        """
        same = self._held is not None

        def scored(point: Array) -> LogLikelihood:
            held = self if same else self.adapted(point)
            return held._scored(point)

        return restricted(scored, alpha, self.hyperparameters, slope=slope)

    def _scored(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood and scores at alpha (K,), before locations are integrated out."""
        each, scores = np.zeros(self.independent), np.zeros((self.count, alpha.size))
        held = self._held
        for block in self.blocks:
            part = block.experiments
            if held is not None:
                each[part], scores[part] = self._by_density(held, alpha, block)
                continue
            found = self.at(alpha, block, self.nodes.xi[part])
            each[block.independent], share = self.mean_over_nodes(block, found.sums)
            scores[part] = found.scores(share)
        grouping = self.layout.grouping
        of = None if grouping is None else grouping.cluster
        value = LogLikelihood(each, scores, _status(each), cluster=of)
        return value.believed(self.hyperparameters, alpha)

    def evaluate(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood at alpha (K,) without its score, with the present nodes."""
        if self.restricted:
            return self._restricted(alpha, slope=False)
        each, held = np.zeros(self.independent), self._held
        for block in self.blocks:
            part = block.independent
            if held is not None:
                sums = self.sums_of(alpha, block, held.eta[block.rows])
                each[part] = mean_of(sums + held.log_weights(alpha[: self.inputs.size], block))[0]
            else:
                sums = self.sums(alpha, block, self.nodes.xi[block.experiments])
                each[part] = self.mean_over_nodes(block, sums)[0]
        value = LogLikelihood(each, None, _status(each))
        return value.believed(self.hyperparameters, alpha)

    def values(self, alphas: Array) -> Array:
        """The total log-likelihoods (A,) at alphas (A, K), with the present nodes."""
        return np.array([self.evaluate(alpha).total for alpha in np.asarray(alphas)])

    def adapted(self, alpha: Array, arrived: float = MODES.arrived) -> IndividualLikelihood:
        """This likelihood with nodes adapted to alpha (see `GaussHermite`, `ImportancePoints`).

        `arrived` is the tolerance, in log-density, of the modes about which nodes are placed.
        """
        classes, n = self.inputs.classes.shape
        s, arrived = self.inputs.scattering, max(arrived, self.rule.arrived)
        if not s:
            return self
        count, placed = classes * self.rule.size(s), list[tuple[slice, PlacedNodes]]()
        peaks, information = self.nodes.peaks(self.rule.centers)
        x = np.zeros((self.count, classes, n))
        for block in self.layout.blocks(count):
            part, laws = block.experiments, self.laws(alpha, block, arrived)
            peaks[part], information[part] = laws.modes.z, laws.modes.information
            x[part] = self._individual(alpha, block, laws.modes.z[:, :, 0]).x
            placed.append((part, self.rule.place(laws)))
        nodes = Nodes.joined(placed, peaks, information, x)
        xi, parameters = nodes.xi, None
        if self.rule.holds_parameters and holds(self.inputs, self.layout.size * xi.shape[1]):
            parameters = self._at_parameters(alpha, nodes)
        return replace(self, nodes=nodes, parameters=parameters)

    def laws(self, alpha: Array, block: Block, arrived: float = MODES.arrived) -> IndividualLaws:
        """The individual laws of a block at alpha, with their modes, for a node rule."""
        curved, valued = (
            partial(self._curved, alpha, block),
            partial(self.log_density, alpha, block),
        )
        found = self._modes(alpha, block, curved, arrived)
        return IndividualLaws(curved, valued, found, block.experiments.start, block.clusters)

    def distance(self, alpha: Array) -> float:
        """The distance of alpha from that of the nodes, which are valid up to a distance of 1.

        It is infinite if the nodes are not stored as parameter values.
        """
        return np.inf if self._held is None else self._held.distance(alpha)

    def weighed(self, alpha: Array, block: Block) -> tuple[Array, Array, Individual, Terms]:
        """The log-likelihood (B,) of each experiment, with details at the nodes.

        The details are the share (B, J) of each node in the likelihood, and the parameters and
        terms of the measurement errors there.
        """
        individual = self._individual(alpha, block, self.nodes.xi[block.experiments])
        terms = self._terms(alpha, block, self.predictor.values(block, individual.x))
        sums = individual.log_weight + block.summed(terms.value)
        each, share = self.mean_over_nodes(block, sums)
        return each, share, individual, terms

    def mean_over_nodes(self, block: Block, sums: Array) -> tuple[Array, Array]:
        """The log-likelihood of each independent term of a block, and the nodes' shares (B, J).

        `sums` (B, J) are log P(class) + sum_k log p(y_k | eta_k) at the present nodes.
        """
        part, shared = block.experiments, self.nodes.shared
        total = sums + self.nodes.log_weight[part]
        if block.clusters is None or shared is None:
            return mean_of(total)
        found = block.clusters.mean_of(total, shared[part])
        return found.each, found.share

    def conditional(self, alpha: Array) -> Array:
        """log p(y_l | the other experiments that share parameters with experiment l) (N,)."""
        found = np.zeros(self.count)
        for block in self.blocks:
            part, shared = block.experiments, self.nodes.shared
            total = self.sums(alpha, block, self.nodes.xi[part]) + self.nodes.log_weight[part]
            if block.clusters is None or shared is None:
                found[part] = mean_of(total)[0]
            else:
                found[part] = block.clusters.mean_of(total, shared[part]).conditional
        return found

    def by(self, rule: NodeRule, alpha: Array) -> IndividualLikelihood:
        """This likelihood with another node rule, whose nodes are adapted to alpha."""
        return self.ruled(rule).adapted(alpha)

    def among(self, inputs: Inputs, place: Indices) -> IndividualLikelihood:
        """This likelihood with further experiments, which have no observations.

        The `inputs` are for all of them, and say which share parameters with measured ones. `place`
        (N,) are the new numbers of the measured ones, in their order.
        """
        grouping, rule = inputs.grouping, self.rule
        assert grouping is not None
        assert isinstance(rule, LevelRule)
        layout = replace(
            self.layout, count=grouping.cluster.size, experiment=place[self.layout.experiment],
            grouping=grouping, chosen=(), _blocks={},
        )  # fmt: skip
        return self.of(inputs, self.errors, self.predictor, layout, rule.on(grouping))

    def ruled(self, rule: NodeRule) -> IndividualLikelihood:
        """This likelihood with another node rule, whose nodes are not yet adapted."""
        return replace(self, rule=rule, parameters=None)

    def sampled(self, size: int) -> IndividualLikelihood:
        """The likelihood of about `size` of the experiments, spread evenly over all.

        The other experiments contribute zero.
        """
        return replace(self, layout=self.layout.sampled(size))

    def only(self, which: Flags) -> IndividualLikelihood:
        """The likelihood of the experiments `which` (N,); the others contribute zero."""
        return replace(self, layout=self.layout.only(which))

    @property
    def continued(self) -> Following:
        """The objective of a search, which adapts the nodes to every alpha."""
        return Following(self, self.settings.near)

    @property
    def followed(self) -> Following:
        """The objective for derivatives by alpha, which adapts nodes to alpha about exact modes.

        Fixed nodes would miss a narrow individual law, because even a very small step of alpha can
        move it by more than its width.
        """
        return Following(self, self.settings.arrived)

    def at(self, alpha: Array, block: Block, xi: Array, scores: bool = True) -> Evaluated:
        """The simulated values of a block at variates xi (B, J, s), with slopes and error terms.

        Without `scores` derivatives by the hyperparameters of the errors may be left out.
        """
        individual = self._individual(alpha, block, xi)
        eta, slopes = self.predictor.with_slopes(block, individual.x)
        return Evaluated(individual, eta, slopes, self._terms(alpha, block, eta, scores), block)

    def sums(self, alpha: Array, block: Block, xi: Array) -> Array:
        """The sums log P(class) + sum_k log p(y_k | eta_k) (B, J) at variates xi (B, J, s)."""
        own, often = alpha[: self.inputs.size], isinstance(self.rule, DenseRule)
        x, log_weight = parameters_at(self.inputs, own, xi, block.experiments, often=often)
        return log_weight + self.sums_of(alpha, block, self.predictor.values(block, x))

    def sums_of(self, alpha: Array, block: Block, eta: Array) -> Array:
        """The sums sum_k log p(y_k | eta_k) (B, J) for simulated values eta (m, J)."""
        of_errors = alpha[self.inputs.size :]
        return block.summed(self.errors.log_density(of_errors, eta, block.rows))

    def at_point(self, x: Array) -> tuple[Array, Array]:
        """The simulated values (M,) of all experiments at one point x (n,), with slopes (M, n)."""
        eta, slopes = np.empty(self.layout.size), np.empty((self.layout.size, x.size))
        for block in self.blocks:
            value, slope = self.predictor.with_slopes(block, np.tile(x, (len(block), 1, 1)))
            eta[block.rows], slopes[block.rows] = value[:, 0], slope[:, :, 0].T
        return eta, slopes

    def log_density(self, alpha: Array, block: Block, z: Array) -> Array:
        """The log-density (B, P), up to a constant, of variates z (B, P, s) given observations."""
        return np.asarray(self.sums(alpha, block, z) - 0.5 * inner(self._counted(block, z), z))

    def _counted(self, block: Block, z: Array) -> Array:
        """The variates z (B, P, s), but zero where another experiment counts them."""
        clusters = block.clusters
        return z if clusters is None else clusters.counted[:, None] * z

    @property
    def _held(self) -> Parameters | None:
        """The nodes stored as parameters, if they are for these inputs and predictor; else None."""
        held = self.parameters
        known = held and held.inputs is self.inputs and held.predictor is self.predictor
        return held if known else None

    def _at_parameters(self, alpha: Array, nodes: Nodes) -> Parameters:
        """The nodes as parameter values under alpha, with the simulated values there."""
        inputs, (count, most) = self.inputs, nodes.log_weight.shape
        x, eta = np.zeros((count, most, len(inputs.names))), np.zeros((self.layout.size, most))
        for block in self.layout.blocks(most):
            part = block.experiments
            x[part] = self._individual(alpha, block, nodes.xi[part]).x
            eta[block.rows] = self.predictor.values(block, x[part])
        there = np.isfinite(nodes.log_weight)
        density = scattered_density(inputs, alpha[: inputs.size], x[there])
        log_weight = np.where(np.isfinite(density), nodes.log_weight[there] - density, -np.inf)
        of_errors = self.errors.hyperparameters
        return Parameters(
            inputs, self.predictor, of_errors, alpha, there, x[there], log_weight, eta
        )

    def _by_density(self, held: Parameters, alpha: Array, block: Block) -> tuple[Array, Array]:
        """The log-likelihoods (B,) and scores (B, K) with nodes stored as parameter values."""
        terms = self._terms(alpha, block, held.eta[block.rows])
        of_laws = alpha[: self.inputs.size]
        each, share = mean_of(held.log_weights(of_laws, block) + block.summed(terms.value))
        laws = held.scores(of_laws, block, share)
        return each, np.concatenate([laws, scores_of_errors(terms, block, share)], axis=1)

    def _individual(self, alpha: Array, block: Block, xi: Array) -> Individual:
        return self.inputs.individual(alpha[: self.inputs.size], xi, block.experiments)

    def _terms(self, alpha: Array, block: Block, eta: Array, scores: bool = True) -> Terms:
        return self.errors.terms(alpha[self.inputs.size :], eta, block.rows, scores)

    def _modes(self, alpha: Array, block: Block, curved: Curved, arrived: float) -> Modes:
        """The modes (B, C, M, s) about which the rule places its nodes.

        The search starts from the last modes and from points along each axis. The last modes are
        tried with the same variates and with the same parameter values, because the latter change
        less where the observations say more than the law. A rule that needs one mode uses the start
        of highest density. A rule that needs several approximate modes starts from the last ones.
        """
        several = self.rule.centers > 1
        if several and arrived >= self.settings.near and self.nodes.x is not None:
            known = self.nodes.modes[block.experiments]
            return highest(curved, known, self.rule.centers, arrived, self.settings)
        s, last = self.inputs.scattering, self.nodes.mode[block.experiments]
        if block.clusters is not None:
            tried = np.concatenate([last, np.zeros_like(last)], axis=1)
            value = block.clusters.summed(self.log_density(alpha, block, tried))
            best = np.argmax(value, axis=1)[block.clusters.top(0)]
            start = np.take_along_axis(tried, best[:, None, None], axis=1)
            found = cluster_modes(curved, start, block.clusters, 0, arrived, self.settings)
            return Modes(found.z[:, :, None], found.information[:, :, None], found.value[..., None])
        around = np.concatenate(
            [np.zeros((1, s)), *(reach * np.eye(s) for reach in self.settings.starts)]
        )
        around = np.broadcast_to(around, (*last.shape[:2], *around.shape))
        again = self._again(alpha, block, last)
        trial = np.concatenate([last[:, :, None], again[:, :, None], around], axis=2)
        if several:
            return highest(curved, trial, self.rule.centers, arrived, self.settings)
        count, classes, points, _ = trial.shape
        flat = trial.reshape(count, classes * points, s)
        value = self.log_density(alpha, block, flat)
        best = np.argmax(value.reshape(count, classes, points), axis=2)
        start = np.take_along_axis(trial, best[:, :, None, None], axis=2)[:, :, 0]
        found = modes(curved, start, None, arrived, classes, self.settings)
        return Modes(found.z[:, :, None], found.information[:, :, None], found.value[..., None])

    def _again(self, alpha: Array, block: Block, last: Array) -> Array:
        """The variates (B, C, s) that under alpha give the parameters of the last modes."""
        if self.nodes.x is None:
            return last
        with np.errstate(all="ignore"):
            own, x = alpha[: self.inputs.size], self.nodes.x[block.experiments]
            found = variates_of(self.inputs, own, x, block.experiments)
        fine = np.all(np.abs(found) < self.settings.farthest, axis=2, keepdims=True)
        return np.where(fine, found, last)

    def _curved(self, alpha: Array, block: Block, z: Array) -> tuple[Array, Array, Array]:
        """The log-density of variates z (B, P, s) given the observations, with derivatives.

        Its information is the Gauss-Newton approximation.
        """
        found, gradient, outer = self.of_observations(alpha, block, z)
        own, law = self._counted(block, z), np.eye(z.shape[2])
        if block.clusters is not None:
            law = block.clusters.counted[:, None, :, None] * law
        value = found.sums - 0.5 * inner(own, z)
        return value, block.summed(gradient) - own, block.summed(outer) + law

    def of_observations(
        self, alpha: Array, block: Block, z: Array
    ) -> tuple[Evaluated, Array, Array]:
        """The score (m, P, s) and information of each observation about variates z (B, P, s).

        The information (m, P, s, s) is the Gauss-Newton approximation. The simulated values are
        returned first.
        """
        found = self.at(alpha, block, z, scores=False)
        by_xi = found.individual.by_variates()[block.owner]
        slopes = np.einsum("nmp,mpns->mps", found.slopes, by_xi)
        of_errors = alpha[self.inputs.size :]
        outer = self.errors.information(of_errors, found.eta, slopes, block.rows)
        return found, found.terms.d_eta[..., None] * slopes, outer


class Following:
    """The objective of a search: a log-likelihood whose nodes are adapted to every alpha.

    The score is exact except for the error of the quadrature. The search for modes starts from the
    last ones, with the tolerance `arrived` in log-density. Nodes stored as parameter values are
    reused until the laws have changed too much; of several sets of nodes the nearest is used. If
    every experiment has one mode, the value depends on alpha alone and not on earlier calls.
    """

    def __init__(
        self,
        likelihood: IndividualLikelihood,
        arrived: float,
        settings: FollowingSettings = FOLLOWING,
    ) -> None:
        self._known, self._arrived, self._settings = [likelihood], arrived, settings
        self.resolution = settings.resolution * arrived

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood and scores at alpha (K,), with nodes adapted to it."""
        return self._adapted(alpha)(alpha)

    def values(self, alphas: Array) -> Array:
        """The total log-likelihoods (A,) at alphas (A, K), with nodes adapted to each."""
        return np.array([self._adapted(a).evaluate(a).total for a in np.asarray(alphas)])

    def expectation_step(self, alpha: Array) -> tuple[float, Array] | None:
        """The log-likelihood at alpha, and the alpha after a step of the EM algorithm.

        See the function of this name. None for the restricted likelihood.
        """
        adapted = self._adapted(alpha)
        return None if adapted.restricted else expectation_step(adapted, alpha)

    def reach(self, alpha: Array, ahead: Array) -> float:
        """The largest allowed share of a step from alpha (K,) to the point `ahead` (K,).

        It is below one where nodes are stored as parameter values: a step beyond their validity
        needs new nodes, and its length rests only on the slope at alpha.
        """
        nearest, share, settings = self.nearest(alpha), 1.0, self._settings
        while (
            nearest.parameters is not None
            and nearest.parameters.between(alpha, alpha + share * (ahead - alpha)) > 1.0
        ):
            share *= settings.shorter
        return share

    def remember(self, adapted: IndividualLikelihood) -> None:
        """Remember the nodes of this likelihood, for every alpha to which they are nearest."""
        known = [*self._known, adapted] if adapted.parameters is not None else [adapted]
        kept = self._settings.kept_nodes
        while len(known) > 1 and sum(k.nodes.log_weight.size for k in known) > kept:
            known = known[1:]
        self._known = known

    def nearest(self, alpha: Array) -> IndividualLikelihood:
        """The likelihood whose nodes, among the remembered ones, are nearest to alpha."""
        return min(self._known, key=lambda known: known.distance(alpha))

    def _adapted(self, alpha: Array) -> IndividualLikelihood:
        nearest = self.nearest(alpha)
        if nearest.distance(alpha) <= 1.0:
            return nearest
        found = nearest.adapted(alpha, self._arrived)
        if np.all(np.isfinite(found.nodes.mode)):
            self.remember(found)
        return found


@dataclass(frozen=True, eq=False)
class Evaluated:
    """A block of experiments evaluated at nodes: parameters, simulated values, slopes, error terms.

    Scores are computed from these.
    """

    individual: Individual
    eta: Array
    slopes: Array
    terms: Terms
    block: Block

    @property
    def sums(self) -> Array:
        """The sums log P(class) + sum_k log p(y_k | eta_k) (B, J) at the nodes."""
        return self.individual.log_weight + self.block.summed(self.terms.value)

    def scores(self, share: Array) -> Array:
        """The scores (B, K), where `share` (B, J) is the share of each node in the likelihood."""
        gradient = np.zeros(self.individual.x.shape)
        for i, slope in enumerate(self.slopes):
            if np.any(slope):
                with np.errstate(over="ignore", invalid="ignore"):
                    # Where the result is not a number, the share is zero.
                    gradient[..., i] = share * self.block.summed(self.terms.d_eta * slope)
        law = self.individual.score(np.where(share[..., None] > 0.0, gradient, 0.0), share)
        return np.concatenate([law, scores_of_errors(self.terms, self.block, share)], axis=1)


def scores_of_errors(terms: Terms, block: Block, share: Array) -> Array:
    """The scores (B, P) by the P hyperparameters of the measurement errors."""
    errors = np.zeros((len(share), len(terms.d_values)))
    for p, (rows, derivative) in enumerate(terms.d_values):
        owner = block.owner[rows]
        each = np.sum(share[owner] * derivative, axis=1)
        errors[:, p] = np.bincount(owner, each, minlength=len(share))
    return errors


def mean_of(total: Array) -> tuple[Array, Array]:
    """The log-sum-exp log sum_j exp(total_j) (B,), and the share (B, J) of each term in the sum."""
    top = total.max(axis=1, keepdims=True)
    safe = np.where(np.isfinite(top), top, 0.0)
    part = np.exp(total - safe)
    whole = part.sum(axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        return (safe + np.log(whole))[:, 0], np.where(whole > 0.0, part / whole, 0.0)


def _status(each: Array) -> NDArray[np.int64]:
    status = np.where(np.isfinite(each), Status.SOLVED, Status.OUTSIDE_SUPPORT)
    return status.astype(np.int64)


@dataclass(frozen=True)
class ExpectationSettings:
    """Settings that limit a step of expectation and maximization; chosen by judgement.

    `least_share`: the smallest value of w_l, the share of a parameter's variance that observations
    explain, so that no step becomes too long. `stretch`: the largest factor by which a step may
    increase or decrease the sd of a law. `smaller` and `larger`: the smallest and the largest such
    factor for the sd of a measurement error, limited so that the laws can explain more of the
    scatter before the errors do.
    """

    least_share: float = 0.05
    stretch: float = 10.0
    smaller: float = 0.1
    larger: float = 2.0


EXPECTATION = ExpectationSettings()


def expectation_step(
    likelihood: IndividualLikelihood,
    alpha: Array,
    settings: ExpectationSettings = EXPECTATION,
) -> tuple[float, Array]:
    """The log-likelihood at alpha, and the alpha (K,) after a step that should increase it.

    The nodes must be adapted to alpha. It is a step of expectation and maximization (Dempster,
    Laird and Rubin, 1977), made longer where observations are less informative (Louis, 1982). With
    m_l and V_l the mean and the variance of x in experiment l given its observations, and mu and v
    those of the law,

        mu' = mu + sum_l (m_l - mu) / sum_l w_l,                 w_l = 1 - V_l/v,
        v'  = v + sum_l ((m_l - mu)^2 + V_l - v) / sum_l w_l^2,
        sd'^2 = sd^2 (1 + sd/M d log L/d sd)                     of the errors of M observations.

    For normal laws and errors the steps converge to a maximum, for others to a point near one.
    Constants, correlations, shapes, and laws without a mean and an sd do not change. The result may
    lie outside the limits. Cost: an evaluation without a score.
    """
    inputs, errors = likelihood.inputs, likelihood.errors
    center, spread = _laws(inputs, alpha, likelihood.count)
    mean, square = np.full(center.shape, np.nan), np.full(center.shape, np.nan)
    slope, count = np.zeros(len(errors.hyperparameters)), np.zeros(len(errors.hyperparameters))
    value = log_prior(likelihood.hyperparameters, alpha)
    for block in likelihood.blocks:
        part = block.experiments
        each, share, individual, terms = likelihood.weighed(alpha, block)
        value += float(each.sum())
        mean[part] = np.einsum("bj,bjn->bn", share, individual.x)
        away = individual.x - center[part, None]
        square[part] = np.einsum("bj,bjn->bn", share, away**2)
        for p, (rows, derivative) in enumerate(terms.d_values):
            slope[p] += np.sum(share[block.owner[rows]] * derivative)
            count[p] += len(rows)
    found, counted = alpha.copy(), ~np.isnan(mean[:, 0])
    if not np.isfinite(value) or not np.all(np.isfinite(square[counted])):
        return value, found
    for i in _known(inputs):
        some = counted
        if inputs.grouping is not None:
            some = counted & (inputs.grouping.counted[:, inputs.scattered.index(i)] > 0.0)
        own = (mean[some, i] - center[some, i], square[some, i], spread[some, i])
        _place(inputs, i, found, *own, some, settings)
    _place_errors(errors, found[inputs.size :], slope / np.maximum(count, 1.0), settings)
    return value, found


def _known(inputs: Inputs) -> list[int]:
    """The scattering parameters whose laws have exactly the hyperparameters mean and sd."""
    names = [[h.name for h in law.hyperparameters] for law in inputs.laws.values()]
    return [i for i in inputs.scattered if names[i] == ["mean", "sd"]]


def _laws(inputs: Inputs, alpha: Array, count: int) -> tuple[Array, Array]:
    """The laws' means (N, n) and variances (N, n) in all experiments.

    A law without a mean and an sd has the mean zero and the variance one.
    """
    values = inputs.values(alpha[: inputs.size], slice(0, count))
    center, spread = np.zeros((count, len(values))), np.ones((count, len(values)))
    for i in _known(inputs):
        center[:, i], spread[:, i] = values[i][0].ravel(), values[i][1].ravel() ** 2
    return center, spread


def _place(
    inputs: Inputs,
    i: int,
    alpha: Array,
    shift: Array,
    square: Array,
    spread: Array,
    counted: Flags,
    settings: ExpectationSettings,
) -> None:
    """Set the mean and the sd of parameter i in alpha by a step of expectation and maximization.

    `shift` has m_l - mu, `square` the mean of (x - mu)^2, and `spread` v, for each experiment.
    """
    at, model = inputs.parts[i].start, inputs.covariate_model
    mean, sd = slice(at, at + 1), slice(at + 1, at + 2)
    columns = np.ones((len(shift), 1))
    if model is not None:
        of_mean, of_sd = model.entries[at], model.entries[at + 1]
        mean, sd = of_mean.places, of_sd.places
        columns = columns if of_mean.design is None else of_mean.design.matrix[counted]
    share = np.clip(1.0 - (square - shift**2) / spread, settings.least_share, 1.0)
    alpha[mean] += np.linalg.lstsq((columns.T * share) @ columns, columns.T @ shift)[0]
    if model is None or of_sd.design is None:
        grown = 1.0 + np.mean(square / spread - 1.0) / np.mean(share**2)
        stretch = settings.stretch
        alpha[sd] *= np.sqrt(np.clip(grown, stretch**-2.0, stretch**2.0))


def _place_errors(
    errors: MeasurementErrors, values: Array, slope: Array, settings: ExpectationSettings
) -> None:
    """Set the sds of the errors, from the log-likelihood's slope (P,) by them per observation."""
    for p, h in enumerate(errors.hyperparameters):
        if h.free and h.name.endswith(".sd"):
            ratio = np.sqrt(np.maximum(1.0 + values[p] * slope[p], 0.0))
            values[p] *= np.clip(ratio, settings.smaller, settings.larger)
