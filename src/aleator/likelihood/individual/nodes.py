"""Nodes of all experiments, each with its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aleator.likelihood.individual.gauss_hermite import GaussHermite
from aleator.types import Array


@dataclass(frozen=True, eq=False)
class Nodes:
    """Standard normal variates xi (N, J, s) of each experiment, and log weights (N, J).

    int g(xi) phi(xi) dxi = sum_j exp(log_weight_j) g(xi_j) over the nodes of each of C classes,
    which stand one after the other (see `Individual`). `modes` (N, C, M, s) are those that they lie
    about, the highest first, and `information` (N, C, M, s, s) is that of the variates there. `x`
    (N, C, n) are the highest modes as parameters, under the alpha to which the nodes are adapted;
    None for the nodes of the law.
    """

    xi: Array
    log_weight: Array
    modes: Array
    information: Array
    x: Array | None = None

    @classmethod
    def of_the_law(cls, count: int, classes: int, variates: int, rule: GaussHermite) -> Nodes:
        """Those of the standard normal law, the same in each of so many experiments."""
        t, log_w = rule.nodes(variates)
        xi, log_weight = np.tile(t, (count, classes, 1)), np.tile(log_w, (count, classes))
        information = np.tile(np.eye(variates), (count, classes, 1, 1, 1))
        return cls(xi, log_weight, np.zeros((count, classes, 1, variates)), information)

    def peaks(self, count: int) -> tuple[Array, Array]:
        """So many copies of the highest modes, and of the information there."""
        modes, information = self.modes[:, :, :1], self.information[:, :, :1]
        return np.repeat(modes, count, axis=2), np.repeat(information, count, axis=2)

    @property
    def mode(self) -> Array:
        """The highest modes (N, C, s)."""
        return np.asarray(self.modes[:, :, 0])


def joined(
    parts: Sequence[tuple[slice, Array, Array]], count: int, classes: int
) -> tuple[Array, Array]:
    """Nodes (N, J, s) and log weights (N, J) of parts of N experiments, class by class.

    Those that need fewer nodes than others get some without weight.
    """
    most = max(xi.shape[1] for _, xi, _ in parts) // classes
    nodes = np.zeros((count, classes, most, parts[0][1].shape[2]))
    log_weights = np.full((count, classes, most), -np.inf)
    for part, xi, log_weight in parts:
        own = xi.shape[1] // classes
        nodes[part, :, :own] = xi.reshape(len(xi), classes, own, -1)
        log_weights[part, :, :own] = log_weight.reshape(len(xi), classes, own)
    return nodes.reshape(count, classes * most, -1), log_weights.reshape(count, -1)
