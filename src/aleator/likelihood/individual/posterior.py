"""What an experiment's own observations leave open of its parameters: its individual law."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from aleator.core.types import Array
from aleator.likelihood.individual.likelihood import IndividualLikelihood, mean_of
from aleator.likelihood.individual.predictors import Block
from aleator.likelihood.individual.rules import proposed, standard_points


@dataclass(frozen=True, eq=False)
class IndividualParameters:
    """The individual laws p(x | y_l, alpha): mode, mean and sd of the parameters, (N, n) each.

    The mode is that of the standard normal variates, as parameters. `predicted` (M,) is the mean
    simulated value of each observation under its individual law. `shrinkage` (n,) is
    1 - sd_l(E[theta_l | y_l]) with theta the variate of each parameter, whose sd is one: 0 where
    the observations alone say what each x is, 1 where only the law does (Savic and Karlsson,
    2009); NaN for a constant. `components` (N, C) of each parameter with a mixture are the
    probabilities P(c | y_l, alpha) of its components.
    """

    mode: Array
    mean: Array
    sd: Array
    predicted: Array
    shrinkage: Array
    components: Mapping[str, Array]


def values_under_law(
    likelihood: IndividualLikelihood, alpha: Array, points: int
) -> Iterator[tuple[Block, Array, Array]]:
    """Blocks with simulated values (m, P) under the law alpha (K,), and their shares (m, P).

    At so many points of the law of each experiment, class by class; what failed has no share.
    """
    inputs = likelihood.inputs
    classes, theta = len(inputs.classes), standard_points(points, inputs.scattering)
    for block in likelihood.layout.blocks(points * classes):
        xi = np.tile(theta, (len(block), classes, 1))
        law = inputs.individual(alpha[: inputs.size], xi, block.experiments)
        with np.errstate(all="ignore"):
            eta = likelihood.predictor.values(block, law.x)
        share = np.exp(np.broadcast_to(law.log_weight, law.x.shape[:2]))[block.owner]
        share = np.where(np.isfinite(eta), share, 0.0)
        with np.errstate(invalid="ignore"):
            share = share / share.sum(axis=1, keepdims=True)
        yield block, np.where(np.isfinite(eta), eta, 0.0), share


def individual_parameters(likelihood: IndividualLikelihood, alpha: Array) -> IndividualParameters:
    """The individual laws at alpha (K,), where the likelihood's nodes are adapted."""
    inputs, count = likelihood.inputs, likelihood.count
    n = len(inputs.names)
    mode, mean, sd = (np.empty((count, n)) for _ in range(3))
    variate = np.empty((count, inputs.scattering))
    of_class = np.empty((count, len(inputs.classes)))
    predicted = np.empty(likelihood.layout.experiment.size)
    for block in likelihood.blocks:
        part, owner = block.experiments, block.owner
        found = likelihood.at(alpha, block, likelihood.nodes.xi[part])
        share = mean_of(found.sums + likelihood.nodes.log_weight[part])[1]
        of_class[part] = share.reshape(len(share), len(inputs.classes), -1).sum(axis=2)
        x = found.individual.x
        mean[part] = np.einsum("lj,ljn->ln", share, x)
        sd[part] = np.sqrt(np.einsum("lj,ljn->ln", share, (x - mean[part, None]) ** 2))
        variate[part] = np.einsum("lj,ljs->ls", share, found.individual.normal_scores)
        known = np.where(share[owner] > 0.0, found.eta, 0.0)
        predicted[block.rows] = np.sum(share[owner] * known, axis=1)
        at_modes = likelihood.nodes.mode[part]
        height = likelihood.log_density(alpha, block, at_modes)
        best = np.argmax(height, axis=1)[:, None, None]
        x_of_modes = inputs.individual(alpha[: inputs.size], at_modes, part).x
        mode[part] = np.take_along_axis(x_of_modes, best, axis=1)[:, 0]
    shrinkage = np.full(n, np.nan)
    shrinkage[list(inputs.scattered)] = 1.0 - np.std(variate, axis=0)
    components = {
        name: of_class @ (own[:, None] == np.arange(own.max() + 1))
        for name, own in zip(inputs.names, inputs.classes.T, strict=True)
        if own.max() > 0
    }
    return IndividualParameters(mode, mean, sd, predicted, shrinkage, components)


def individual_points(
    likelihood: IndividualLikelihood, alpha: Array, block: Block, count: int
) -> tuple[Array, Array]:
    """Points x (B, J, n) of the individual laws at alpha (K,), with weights (B, J) of sum one.

    Importance points about the modes, to which the likelihood is adapted; some `count` for each
    class (see `proposed`). A point whose run fails weighs nothing. Cost: a run for each point.
    """
    nodes, inputs, part = likelihood.nodes, likelihood.inputs, block.experiments
    xi, log_weight = proposed(nodes.modes[part], nodes.information[part], count)
    with np.errstate(all="ignore"):
        share = mean_of(likelihood.sums(alpha, block, xi) + log_weight)[1]
    return inputs.individual(alpha[: inputs.size], xi, part).x, share


def individual_variates(likelihood: IndividualLikelihood, alpha: Array) -> tuple[Array, Array]:
    """Means (N, s) and mean products (N, s, s) of the variates given the observations, by nodes."""
    s = likelihood.inputs.scattering
    means, products = np.empty((likelihood.count, s)), np.empty((likelihood.count, s, s))
    for block in likelihood.blocks:
        part = block.experiments
        _, share, individual, _ = likelihood.weighed(alpha, block)
        theta = individual.normal_scores
        means[part] = np.einsum("lj,ljs->ls", share, theta)
        products[part] = np.einsum("lj,ljs,ljt->lst", share, theta, theta)
    return means, products
