"""Nodes of the joint law with their weights, and how a tensor rule of the laws makes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aleator.laws import Inputs, Rule
from aleator.laws.inputs import zeros
from aleator.threads import single_threaded
from aleator.types import Array, Indices


@dataclass(frozen=True)
class Nodes:
    """A cubature rule of J nodes in n parameters with K hyperparameters.

    `x` (J, n), `weights` (J,) that sum to one, and the derivatives by alpha: `dx` (J, n, K),
    `dweights` (J, K). `dx[:, i, k]` lies in one piece in memory.
    """

    x: Array
    weights: Array
    dx: Array
    dweights: Array


def axes(inputs: Inputs, alpha: Array, per_dimension: int) -> list[Rule]:
    """A Gauss rule for each parameter (n of them), whose product is a rule of the joint law.

    A constant has one node; a correlated parameter has the rule of its standard normal variate.
    """
    laws, values = inputs.independent(alpha)
    rules = [law.rule(v, per_dimension) for law, v in zip(laws, values, strict=True)]
    for i in inputs.correlated:
        own = np.zeros((per_dimension, inputs.slices[i].stop - inputs.slices[i].start))
        rules[i] = Rule(rules[i].x, rules[i].weights, rules[i].t, own, own)
    return rules


@single_threaded
def combined(inputs: Inputs, alpha: Array, rules: Sequence[Rule], picks: Indices) -> Nodes:
    """Nodes that combine one node of each parameter's rule (n of them), by `picks` (J, n).

    The weights are the products of those of the rules. Cost O(J n K).
    """
    count, n = picks.shape
    x, dx = zeros(count, n, inputs.size)
    weights, dweights = np.ones(count), np.zeros((count, inputs.size))
    factors = [rule.weights[picks[:, i]] for i, rule in enumerate(rules)]
    for i, (rule, part) in enumerate(zip(rules, inputs.slices, strict=True)):
        x[:, i] = rule.x[picks[:, i]]
        dx[:, i, part] = rule.dx[picks[:, i]]
        weights *= factors[i]
        if np.any(rule.dweights):
            others = np.prod([np.ones(count), *factors[:i], *factors[i + 1 :]], axis=0)
            dweights[:, part] = others[:, None] * rule.dweights[picks[:, i]]
    if inputs.correlated:
        tied = list(inputs.correlated)
        x[:, tied], dx[:, tied] = inputs.tied(alpha, x[:, tied])
    return Nodes(x, weights, dx, dweights)
