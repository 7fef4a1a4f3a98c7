"""The likelihood of experiments with any number of observations each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from aleator.core.status import Status
from aleator.core.types import Array
from aleator.laws.hyperparameter import Hyperparameter
from aleator.laws.inputs import Individual, Inputs, parameters_at, variates_of
from aleator.likelihood.individual.following import Following, Parameters, holds, scattered_density
from aleator.likelihood.individual.modes import (
    MODES,
    AsManyAsNeeded,
    Curved,
    Modes,
    NodeRule,
    highest,
    modes,
)
from aleator.likelihood.individual.predictors import Block, Layout, OnSurfaces, Predictor
from aleator.likelihood.individual.rules import GaussHermite, Nodes, joined
from aleator.observations.errors import MeasurementErrors, Terms
from aleator.search.interface import LogLikelihood


@dataclass(frozen=True, eq=False)
class IndividualLikelihood:
    """log L(alpha) = sum_l log int prod_k p(y_lk | eta_lk(x), sigma_lk) p(x | alpha) dx.

    x is the image of standard normal variates xi (see `Individual`), and the integral over them a
    quadrature at `nodes` that are adapted to each experiment (Pinheiro and Bates, 1995) and held:
    called, it is smooth in alpha with an exact score (Fisher's identity). Where laws are mixtures
    it is a sum over the classes, each with nodes of its own. `adapted` returns the same with nodes
    adapted to another alpha; nothing changes in place. Nodes that are held far from where they
    were adapted integrate poorly.
    """

    inputs: Inputs
    errors: MeasurementErrors
    predictor: Predictor
    layout: Layout
    rule: NodeRule
    nodes: Nodes
    parameters: Parameters | None = None

    @classmethod
    def of(
        cls,
        inputs: Inputs,
        errors: MeasurementErrors,
        predictor: Predictor,
        layout: Layout,
        rule: GaussHermite,
    ) -> IndividualLikelihood:
        """The likelihood with the nodes of the law itself."""
        classes = len(inputs.classes)
        nodes = Nodes.of_the_law(layout.count, classes, inputs.scattering, rule)
        return cls(inputs, errors, predictor, layout, rule, nodes)

    @property
    def name(self) -> str:
        """The rule with its number of nodes an experiment, for reports."""
        if not self.inputs.scattering:
            return "measurement errors alone"
        return f"{self.rule.name}, {self.nodes.xi.shape[1]:,} nodes"

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters in the order of alpha: the inputs', then the errors'."""
        return (*self.inputs.hyperparameters, *self.errors.hyperparameters)

    @property
    def count(self) -> int:
        """N, the number of experiments."""
        return self.layout.count

    @property
    def region(self) -> Array:
        """Where simulated values are known, (n, 2): that of the surfaces, or the box."""
        predictor = self.predictor
        return predictor.region if isinstance(predictor, OnSurfaces) else self.inputs.box

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The experiments in blocks that fit into memory with their nodes."""
        return self.layout.blocks(self.nodes.xi.shape[1])

    def __call__(self, alpha: Array) -> LogLikelihood:
        """Value and score (N, K) at alpha (K,), nodes held."""
        each, scores = np.zeros(self.count), np.zeros((self.count, alpha.size))
        held = self._held
        for block in self.blocks:
            part = block.experiments
            if held is not None:
                each[part], scores[part] = self._by_density(held, alpha, block)
                continue
            found = self.at(alpha, block, self.nodes.xi[part])
            each[part], share = mean_of(found.sums + self.nodes.log_weight[part])
            scores[part] = found.scores(share)
        value = LogLikelihood(each, scores, _status(each))
        return value.believed(self.hyperparameters, alpha)

    def evaluate(self, alpha: Array) -> LogLikelihood:
        """The value at alpha without its score, nodes held."""
        each, held = np.zeros(self.count), self._held
        for block in self.blocks:
            part = block.experiments
            if held is not None:
                sums = self.sums_of(alpha, block, held.eta[block.rows])
                total = sums + held.log_weights(alpha[: self.inputs.size], block)
            else:
                total = self.sums(alpha, block, self.nodes.xi[part]) + self.nodes.log_weight[part]
            each[part] = mean_of(total)[0]
        value = LogLikelihood(each, None, _status(each))
        return value.believed(self.hyperparameters, alpha)

    def values(self, alphas: Array) -> Array:
        """The totals (A,) at alphas (A, K), nodes held."""
        return np.array([self.evaluate(alpha).total for alpha in np.asarray(alphas)])

    def adapted(self, alpha: Array, arrived: float = MODES.arrived) -> IndividualLikelihood:
        """The same with nodes adapted to alpha (see `GaussHermite`, `ImportancePoints`).

        Modes are found to `arrived` in log-density.
        """
        classes, n = self.inputs.classes.shape
        s, arrived = self.inputs.scattering, max(arrived, self.rule.arrived)
        if not s:
            return self
        count, placed = classes * self.rule.size(s), list[tuple[slice, Array, Array]]()
        peaks, information = self.nodes.peaks(self.rule.centers)
        x = np.zeros((self.count, classes, n))
        for block in self.layout.blocks(count):
            part, curved = block.experiments, partial(self._curved, alpha, block)
            found = self._modes(alpha, block, curved, arrived)
            peaks[part], information[part] = found.z, found.information
            x[part] = self._individual(alpha, block, found.z[:, :, 0]).x
            valued = partial(self.log_density, alpha, block)
            placed.append((part, *self.rule.about(curved, valued, found, part.start)))
        xi, log_weight = joined(placed, self.count, classes)
        nodes = Nodes(xi, log_weight, peaks, information, x)
        parameters = None
        if self.rule.holds_parameters and holds(self.inputs, self.layout.size * xi.shape[1]):
            parameters = self._at_parameters(alpha, nodes)
        return replace(self, nodes=nodes, parameters=parameters)

    def distance(self, alpha: Array) -> float:
        """How far alpha is from where the nodes serve, up to one; others than parameters do not."""
        return np.inf if self._held is None else self._held.distance(alpha)

    def weighed(self, alpha: Array, block: Block) -> tuple[Array, Array, Individual, Terms]:
        """log L_l (B,), the share (B, J) of each node in it, and the parameters and terms there."""
        individual = self._individual(alpha, block, self.nodes.xi[block.experiments])
        terms = self._terms(alpha, block, self.predictor.values(block, individual.x))
        sums = individual.log_weight + block.summed(terms.value)
        each, share = mean_of(sums + self.nodes.log_weight[block.experiments])
        return each, share, individual, terms

    def by(self, rule: NodeRule, alpha: Array) -> IndividualLikelihood:
        """The same with other nodes, adapted to alpha."""
        return self.ruled(rule).adapted(alpha)

    def ruled(self, rule: NodeRule) -> IndividualLikelihood:
        """The same with a rule by which nodes are not yet adapted."""
        return replace(self, rule=rule, parameters=None)

    def sampled(self, size: int) -> IndividualLikelihood:
        """That of about so many of the experiments, spread evenly; the others count as nothing."""
        return replace(self, layout=self.layout.sampled(size))

    @property
    def continued(self) -> Following:
        """What a search climbs."""
        return Following(self, MODES.near)

    @property
    def followed(self) -> Following:
        """What derivatives by alpha are taken of: nodes that are held lose a sharp individual law.

        The law of all experiments moves by more than its width in the least step of alpha.
        """
        return Following(self, MODES.arrived)

    def at(self, alpha: Array, block: Block, xi: Array) -> Evaluated:
        """Some experiments at variates xi (B, J, s) of their own, with slopes."""
        individual = self._individual(alpha, block, xi)
        eta, slopes = self.predictor.with_slopes(block, individual.x)
        return Evaluated(individual, eta, slopes, self._terms(alpha, block, eta), block)

    def sums(self, alpha: Array, block: Block, xi: Array) -> Array:
        """log P(class) + sum_k log p(y_k | eta_k) (B, J) at variates xi (B, J, s)."""
        own, often = alpha[: self.inputs.size], isinstance(self.rule, AsManyAsNeeded)
        x, log_weight = parameters_at(self.inputs, own, xi, block.experiments, often=often)
        return log_weight + self.sums_of(alpha, block, self.predictor.values(block, x))

    def sums_of(self, alpha: Array, block: Block, eta: Array) -> Array:
        """sum_k log p(y_k | eta_k) (B, J) of simulated values eta (m, J) that are known."""
        return block.summed(self._terms(alpha, block, eta).value)

    def at_point(self, x: Array) -> tuple[Array, Array]:
        """Simulated values (M,) at one point x (n,) for all experiments, with slopes (M, n)."""
        eta, slopes = np.empty(self.layout.size), np.empty((self.layout.size, x.size))
        for block in self.blocks:
            value, slope = self.predictor.with_slopes(block, np.tile(x, (len(block), 1, 1)))
            eta[block.rows], slopes[block.rows] = value[:, 0], slope[:, :, 0].T
        return eta, slopes

    def log_density(self, alpha: Array, block: Block, z: Array) -> Array:
        """The log-density (B, P) of variates z (B, P, s) given the observations."""
        return np.asarray(self.sums(alpha, block, z) - 0.5 * np.sum(z**2, axis=2))

    @property
    def _held(self) -> Parameters | None:
        """The parameters at the nodes, where they were computed for this law and predictor."""
        held = self.parameters
        known = held and held.inputs is self.inputs and held.predictor is self.predictor
        return held if known else None

    def _at_parameters(self, alpha: Array, nodes: Nodes) -> Parameters:
        """What the simulator says at the nodes under alpha."""
        inputs, (count, most) = self.inputs, nodes.log_weight.shape
        x, eta = np.zeros((count, most, len(inputs.names))), np.zeros((self.layout.size, most))
        for block in self.layout.blocks(most):
            part = block.experiments
            x[part] = self._individual(alpha, block, nodes.xi[part]).x
            eta[block.rows] = self.predictor.values(block, x[part])
        there = np.isfinite(nodes.log_weight)
        density = scattered_density(inputs, alpha[: inputs.size], x[there])
        log_weight = np.where(np.isfinite(density), nodes.log_weight[there] - density, -np.inf)
        return Parameters(inputs, self.predictor, alpha, there, x[there], log_weight, eta)

    def _by_density(self, held: Parameters, alpha: Array, block: Block) -> tuple[Array, Array]:
        """log L_l (B,) and scores (B, K) with the parameters at the nodes held."""
        terms = self._terms(alpha, block, held.eta[block.rows])
        of_laws = alpha[: self.inputs.size]
        each, share = mean_of(held.log_weights(of_laws, block) + block.summed(terms.value))
        laws = held.scores(of_laws, block, share)
        return each, np.concatenate([laws, scores_of_errors(terms, block, share)], axis=1)

    def _individual(self, alpha: Array, block: Block, xi: Array) -> Individual:
        return self.inputs.individual(alpha[: self.inputs.size], xi, block.experiments)

    def _terms(self, alpha: Array, block: Block, eta: Array) -> Terms:
        return self.errors.terms(alpha[self.inputs.size :], eta, block.rows)

    def _modes(self, alpha: Array, block: Block, curved: Curved, arrived: float) -> Modes:
        """The modes (B, C, M, s) that the rule's nodes lie about.

        They are sought from the last modes, as variates and as parameters, because where the
        observations tell more than the law it is the parameters that stay, and from points all
        about. One mode is sought from the likeliest of these alone; several that only have to be
        near, from the last ones.
        """
        several = self.rule.centers > 1
        if several and arrived >= MODES.near and self.nodes.x is not None:
            known = self.nodes.modes[block.experiments]
            return highest(curved, known, self.rule.centers, arrived)
        s, last = self.inputs.scattering, self.nodes.mode[block.experiments]
        around = np.concatenate([np.zeros((1, s)), *(reach * np.eye(s) for reach in MODES.starts)])
        around = np.broadcast_to(around, (*last.shape[:2], *around.shape))
        again = self._again(alpha, block, last)
        trial = np.concatenate([last[:, :, None], again[:, :, None], around], axis=2)
        if several:
            return highest(curved, trial, self.rule.centers, arrived)
        count, classes, points, _ = trial.shape
        flat = trial.reshape(count, classes * points, s)
        value = self.log_density(alpha, block, flat)
        best = np.argmax(value.reshape(count, classes, points), axis=2)
        start = np.take_along_axis(trial, best[:, :, None, None], axis=2)[:, :, 0]
        found = modes(curved, start, arrived=arrived, classes=classes)
        return Modes(found.z[:, :, None], found.information[:, :, None], found.value[..., None])

    def _again(self, alpha: Array, block: Block, last: Array) -> Array:
        """The variates (B, C, s) under alpha of the parameters that the last modes were."""
        if self.nodes.x is None:
            return last
        with np.errstate(all="ignore"):
            own, x = alpha[: self.inputs.size], self.nodes.x[block.experiments]
            found = variates_of(self.inputs, own, x, block.experiments)
        fine = np.all(np.abs(found) < MODES.farthest, axis=2, keepdims=True)
        return np.where(fine, found, last)

    def _curved(self, alpha: Array, block: Block, z: Array) -> tuple[Array, Array, Array]:
        """The log-density of variates z (B, P, s) given the observations, by Gauss and Newton."""
        found, gradient, outer = self.of_observations(alpha, block, z)
        value = found.sums - 0.5 * np.sum(z**2, axis=2)
        return value, block.summed(gradient) - z, block.summed(outer) + np.eye(z.shape[2])

    def of_observations(
        self, alpha: Array, block: Block, z: Array
    ) -> tuple[Evaluated, Array, Array]:
        """What each observation says of variates z (B, P, s): its score (m, P, s) and information.

        The information (m, P, s, s) is that of Gauss and Newton.
        """
        found = self.at(alpha, block, z)
        by_xi = found.individual.by_variates()[block.owner]
        slopes = np.einsum("nmp,mpns->mps", found.slopes, by_xi)
        of_errors = alpha[self.inputs.size :]
        curvature = self.errors.curvature(of_errors, found.eta, block.rows)
        outer = curvature[..., None, None] * slopes[..., :, None] * slopes[..., None, :]
        return found, found.terms.d_eta[..., None] * slopes, outer


@dataclass(frozen=True, eq=False)
class Evaluated:
    """A block of experiments at their nodes, with all that scores are made of."""

    individual: Individual
    eta: Array
    slopes: Array
    terms: Terms
    block: Block

    @property
    def sums(self) -> Array:
        """log P(class) + sum_k log p(y_k | eta_k), (B, J)."""
        return self.individual.log_weight + self.block.summed(self.terms.value)

    def scores(self, share: Array) -> Array:
        """The scores (B, K) where node j has this share (B, J) of the likelihood."""
        gradient = np.zeros(self.individual.x.shape)
        for i, slope in enumerate(self.slopes):
            if np.any(slope):
                with np.errstate(over="ignore", invalid="ignore"):
                    # where it is no number, the share is zero
                    gradient[..., i] = share * self.block.summed(self.terms.d_eta * slope)
        law = self.individual.score(np.where(share[..., None] > 0.0, gradient, 0.0), share)
        return np.concatenate([law, scores_of_errors(self.terms, self.block, share)], axis=1)


def scores_of_errors(terms: Terms, block: Block, share: Array) -> Array:
    """The scores (B, P) by the values of the errors."""
    errors = np.zeros((len(share), len(terms.d_values)))
    for p, (rows, derivative) in enumerate(terms.d_values):
        owner = block.owner[rows]
        each = np.sum(share[owner] * derivative, axis=1)
        errors[:, p] = np.bincount(owner, each, minlength=len(share))
    return errors


def mean_of(total: Array) -> tuple[Array, Array]:
    """log sum_j exp(total_j) (B,), and the share (B, J) of each."""
    top = total.max(axis=1, keepdims=True)
    safe = np.where(np.isfinite(top), top, 0.0)
    part = np.exp(total - safe)
    whole = part.sum(axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        return (safe + np.log(whole))[:, 0], np.where(whole > 0.0, part / whole, 0.0)


def _status(each: Array) -> NDArray[np.int64]:
    status = np.where(np.isfinite(each), Status.SOLVED, Status.OUTSIDE_SUPPORT)
    return status.astype(np.int64)
