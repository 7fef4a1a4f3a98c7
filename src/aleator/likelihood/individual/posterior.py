"""Individual laws: the distribution of each experiment's parameters given its observations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from aleator.core.types import Array
from aleator.likelihood.individual.levels import LevelRule
from aleator.likelihood.individual.likelihood import IndividualLikelihood, mean_of
from aleator.likelihood.individual.predictors import Block
from aleator.likelihood.individual.rules import proposed, standard_points


@dataclass(frozen=True, eq=False)
class IndividualParameters:
    """Summaries of the individual laws p(x | y_l, alpha) of N experiments.

    `mode`, `mean` and `sd` (N, n) are those of the parameters; the mode is that of the standard
    normal variates, mapped to parameters. `predicted` (M,) is the mean simulated value of each
    observation under its individual law. `shrinkage` (n,) is 1 - sd_l(E[theta_l | y_l]), where
    theta is the standard normal variate of each parameter: 0 where the observations alone determine
    each x, 1 where they say nothing about it (Savic and Karlsson, 2009); NaN for a constant.
    `components` (N, C), for each parameter with a mixture law, has the probabilities
    P(c | y_l, alpha) of its components.
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
    """Simulated values (m, P) under the law alpha (K,) with weights (m, P), for each block.

    There are `points` points of the law of each experiment in each class. A point whose simulation
    failed has the weight zero.
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
    """The individual laws at alpha (K,), to which the nodes of the likelihood must be adapted."""
    inputs, count = likelihood.inputs, likelihood.count
    n = len(inputs.names)
    mode, mean, sd = (np.empty((count, n)) for _ in range(3))
    variate = np.empty((count, inputs.scattering))
    of_class = np.empty((count, len(inputs.classes)))
    predicted = np.empty(likelihood.layout.experiment.size)
    for block in likelihood.blocks:
        part, owner = block.experiments, block.owner
        found = likelihood.at(alpha, block, likelihood.nodes.xi[part])
        share = likelihood.mean_over_nodes(block, found.sums)[1]
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
    shrinkage, grouping = np.full(n, np.nan), inputs.grouping
    if grouping is not None:
        # A parameter of a level counts once for each group.
        variate = np.where(grouping.counted > 0.0, variate, np.nan)
    shrinkage[list(inputs.scattered)] = 1.0 - np.nanstd(variate, axis=0)
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

    They are importance points about the modes, about `count` for each class (see `proposed`). The
    likelihood must be adapted to alpha. Where experiments share parameters they are
    `LevelRule.sample`. A point whose run fails has the weight zero. Cost: a run for each point.
    """
    nodes, inputs, part = likelihood.nodes, likelihood.inputs, block.experiments
    if isinstance(likelihood.rule, LevelRule) and block.clusters is not None:
        with np.errstate(all="ignore"):
            found = likelihood.rule.sample(likelihood.laws(alpha, block), count)
        share = mean_of(found.log_weight)[1]
        return inputs.individual(alpha[: inputs.size], found.xi, part).x, share
    xi, log_weight = proposed(nodes.modes[part], nodes.information[part], count)
    with np.errstate(all="ignore"):
        share = mean_of(likelihood.sums(alpha, block, xi) + log_weight)[1]
    return inputs.individual(alpha[: inputs.size], xi, part).x, share


def individual_variates(likelihood: IndividualLikelihood, alpha: Array) -> tuple[Array, Array]:
    """Means (N, s) and mean products (N, s, s) of the normal scores given the observations."""
    s = likelihood.inputs.scattering
    means, products = np.empty((likelihood.count, s)), np.empty((likelihood.count, s, s))
    for block in likelihood.blocks:
        part = block.experiments
        _, share, individual, _ = likelihood.weighed(alpha, block)
        theta = individual.normal_scores
        means[part] = np.einsum("lj,ljs->ls", share, theta)
        products[part] = np.einsum("lj,ljs,ljt->lst", share, theta, theta)
    return means, products
