"""Nodes adapted to what each experiment's observations leave open of its variates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aleator.likelihood.individual.modes import NEAR, Curved, Modes, modes
from aleator.likelihood.individual.rule import GaussHermite
from aleator.types import Array


@dataclass(frozen=True, eq=False)
class Nodes:
    """Standard normal variates xi (N, J, s) of each experiment, and log weights (N, J).

    int g(xi) phi(xi) dxi = sum_j exp(log_weight_j) g(xi_j) over the nodes of each of C classes,
    which stand one after the other (see `Individual`). `mode` (N, C, s) are the modes, and
    `information` (N, C, s, s) is that of the variates there. `x` (N, C, n) are the modes as
    parameters, under the alpha to which the nodes are adapted; None for the nodes of the law.
    """

    xi: Array
    log_weight: Array
    mode: Array
    information: Array
    x: Array | None = None

    @classmethod
    def of_the_law(cls, count: int, classes: int, variates: int, rule: GaussHermite) -> Nodes:
        """Those of the standard normal law, the same in each of so many experiments."""
        t, log_w = rule.nodes(variates)
        xi, log_weight = np.tile(t, (count, classes, 1)), np.tile(log_w, (count, classes))
        information = np.tile(np.eye(variates), (count, classes, 1, 1))
        return cls(xi, log_weight, np.zeros((count, classes, variates)), information)


def adapted_nodes(log_density: Curved, found: Modes, rule: GaussHermite) -> tuple[Array, Array]:
    """Nodes xi (B, C q, s) about the C modes of each of B experiments, and their log weights.

    The coordinates w = Q' xi are those of the eigenvectors Q of the information at the mode, the
    least informed first. Each has a Gauss-Hermite rule in turn, about its conditional mode given
    those before it and as wide as the information there says:

        w_i = w_i*(t_1 .. t_(i-1)) + c_i(t_1 .. t_(i-1)) t_i,
        weight = w_j prod_i c_i phi(xi)/phi(t).

    So the nodes follow a curved ridge, which is what fewer observations than parameters leave.
    Where the log-density is quadratic they are those of Liu and Pierce (1994).
    """
    z, information = found.z, found.information
    s = z.shape[2]
    basis = np.linalg.eigh(information)[1]
    log_weight = np.zeros(z.shape[:2])
    for i in range(s):
        # those of one mode are next to each other
        rest = np.repeat(basis, z.shape[1] // basis.shape[1], axis=1)[..., i:]
        left = np.linalg.inv(np.swapaxes(rest, -1, -2) @ information @ rest)
        scale = np.sqrt(left[..., 0, 0])
        # the others go along as the conditional normal law says
        along = (rest @ (left[..., :, :1] / scale[..., None, None]))[..., 0]
        t, log_w = rule.coordinate(i)
        z = _spread(z[:, :, None] + t[:, None] * along[:, :, None])
        of_rule = log_w + 0.5 * t**2
        log_weight = _spread((log_weight + np.log(scale))[:, :, None] + of_rule)
        if i < s - 1:
            whole = np.repeat(rest, t.size, axis=1)[..., 1:]
            again = modes(log_density, z, whole, NEAR)
            z, information = again.z, again.information
    return z, log_weight - 0.5 * np.sum(z**2, axis=2)


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


def _spread(values: Array) -> Array:
    """(B, P, q, ...) as (B, P q, ...)."""
    return values.reshape(values.shape[0], -1, *values.shape[3:])
