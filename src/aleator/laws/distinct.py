"""Laws that take one set of values at a time, for experiments that have different ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aleator.laws.law import Standard
from aleator.types import Array


def by_distinct(
    of_one: Callable[[Array, Array], Standard], values: Array, theta: Array
) -> Standard:
    """What `of_one(values (k,), theta (M,))` gives, for values (k, ...) that broadcast to theta.

    `of_one` is called once for each distinct column of values, so the cost is that of as many laws.

    >>> def shifted(values, theta):
    ...     return Standard(values[0] + theta, np.ones(theta.shape), np.ones((theta.size, 1)))
    >>> values = np.array([[[1.0], [2.0], [1.0]]])                           # k = 1, B = 3, J = 1
    >>> by_distinct(shifted, values, np.zeros((3, 2))).x.tolist()
    [[1.0, 1.0], [2.0, 2.0], [1.0, 1.0]]
    """
    k = values.shape[0]
    distinct, which = np.unique(values.reshape(k, -1), axis=1, return_inverse=True)
    owner = np.broadcast_to(which.reshape(values.shape[1:]), theta.shape).ravel()
    order = np.argsort(owner, kind="stable")
    ends = np.cumsum(np.bincount(owner, minlength=distinct.shape[1]))[:-1]
    flat = theta.ravel()
    x, dtheta, dvalues = np.empty(flat.size), np.empty(flat.size), np.empty((flat.size, k))
    for column, part in zip(distinct.T, np.split(order, ends), strict=True):
        own = of_one(column, flat[part])
        x[part], dtheta[part], dvalues[part] = own.x, own.dtheta, own.dvalues
    shape = theta.shape
    return Standard(x.reshape(shape), dtheta.reshape(shape), dvalues.reshape(*shape, k))
