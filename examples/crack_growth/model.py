"""A fatigue crack by Paris' law."""

import numpy as np

from aleator.core.types import Array


def relative_length(megacycles: Array, rate: Array, exponent: Array) -> Array:
    """The length of a crack over its length at the start.

    Paris' law says da/dN = C (S sqrt(a))^exponent. In r = a/a(0) that is dr/dN = rate r^(1 + b)
    with b = exponent/2 - 1, and so r = (1 - b rate N)^(-1/b). `rate` is dr/dN at the start, in
    1/megacycle. The crack runs through the specimen where the bracket comes to zero; there is no
    length beyond.
    """
    b = 0.5 * exponent - 1.0
    left = 1.0 - b * rate * megacycles
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(left > 0.0, np.exp(-np.log(left) / b), np.nan)
