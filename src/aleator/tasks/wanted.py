"""What further experiments are to tell: a hyperparameter, a prediction, or all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from aleator.errors import InputsError, nearest
from aleator.inference.design import Scores, probability_gradients, quantile_gradients
from aleator.inference.fit import Fit
from aleator.laws import Hyperparameter
from aleator.observations.experiments import Conditions
from aleator.results.result import Result
from aleator.types import Array, Indices

ALL = "all"
"""All hyperparameters together."""


@dataclass(frozen=True, eq=False)
class Predicted:
    """A quantile of what would be measured under some conditions, or the probability of a limit.

    Give one of `quantile`, a probability, and `below` or `above`, a limit in the outcome's unit.
    Raises InputsError for none or several of them, and a probability outside (0, 1).

    >>> Predicted(pd.DataFrame({"load": [3.0]}), quantile=0.99).name
    'the quantile 0.99'
    """

    conditions: Conditions | pd.DataFrame
    quantile: float | None = None
    below: float | None = None
    above: float | None = None

    def __post_init__(self) -> None:
        given = [name for name in ("quantile", "below", "above") if getattr(self, name) is not None]
        if len(given) != 1:
            raise InputsError(
                f"a prediction says {' and '.join(given) or 'neither quantile nor limit'}",
                "give one of quantile, below and above",
            )
        if self.quantile is not None and not 0.0 < self.quantile < 1.0:
            raise InputsError(f"quantile {self.quantile}", "choose a probability between 0 and 1")

    @property
    def name(self) -> str:
        """What it is called."""
        if self.quantile is not None:
            return f"the quantile {self.quantile:g}"
        side, limit = ("below", self.below) if self.above is None else ("above", self.above)
        return f"the probability {side} {limit:g}"

    def gradients(self, scores: Scores, fit: Fit) -> Array:
        """d/dalpha (G, K) at the conditions that the scores are of."""
        if scores.outcomes is None:
            raise InputsError(
                f"{self.name}: the conditions have several observations an experiment",
                "give each row an id of its own, and predict one response",
            )
        if self.quantile is not None:
            return quantile_gradients(scores, self.quantile)[1]
        limit = self.below if self.above is None else self.above
        scale = fit.table.transform
        if (fault := scale.fault(float(limit or 0.0))) != "":
            raise InputsError(f"{self.name}: {fault}", "choose a limit above zero")
        return probability_gradients(scores, float(scale(limit or 0.0)))[1]


@dataclass(frozen=True, eq=False)
class Wanted:
    """What is to be known better, and for which alpha (K,) experiments are planned.

    `moving` (F,) are the hyperparameters that are not known, `target` the place among them of the
    one that is asked for, if one is. `moved` has the values of those that ended on a limit and
    are planned for elsewhere: on it, no experiment would tell anything of them.
    """

    name: str
    alpha: Array
    moving: Indices
    target: int | None
    predicted: Predicted | None
    moved: Mapping[str, float]

    @classmethod
    def of(cls, about: str | Predicted | None, found: Result, fit: Fit) -> Wanted:
        """What `about` says; None is the standard deviation that is least known for its size.

        Raises InputsError for a name that is unknown or fixed.
        """
        names = [h.name for h in fit.hyperparameters]
        alpha, moving = fit.alpha.copy(), fit.inference.free
        if isinstance(about, Predicted):
            return cls(about.name, alpha, moving, None, about, {})
        about = about or _weakest(fit)
        if about == ALL:
            return cls("all hyperparameters", alpha, moving, None, None, {})
        require_free(about, fit.hyperparameters)
        k, moved = names.index(about), dict[str, float]()
        if k not in moving:
            alpha[k] = _elsewhere(found, fit, k)
            moving, moved = np.sort(np.append(moving, k)), {about: float(alpha[k])}
        return cls(about, alpha, moving, int(np.searchsorted(moving, k)), None, moved)

    def observed(self, fit: Fit) -> Array:
        """The information (F, F) of the experiments that were made about what is moving."""
        place = np.searchsorted(fit.inference.identified, self.moving)
        return np.asarray(fit.inference.information[np.ix_(place, place)])


def require_free(about: str | None, hyperparameters: Sequence[Hyperparameter]) -> None:
    """Raise InputsError for a name that is neither a free hyperparameter nor "all"."""
    free = [h.name for h in hyperparameters if h.free]
    if about is None or about == ALL or about in free:
        return
    fixed = about in [h.name for h in hyperparameters]
    why = "is fixed" if fixed else f"is unknown{nearest(about, free)}"
    raise InputsError(
        f"the hyperparameter '{about}' {why}", f"name one of {', '.join(free)}, or all"
    )


def _weakest(fit: Fit) -> str:
    """The standard deviation with the largest standard error for its size; all without any.

    Of the laws; that of the errors only where no other is identified.
    """
    inference, hyperparameters = fit.inference, fit.hyperparameters
    every = [k for k in inference.identified if hyperparameters[k].log]
    scales = [k for k in every if k < fit.inputs.size] or every
    if not scales:
        return ALL
    share = inference.standard_error[scales] / fit.alpha[scales]
    largest = int(np.argmax(np.where(np.isnan(share), np.inf, share)))
    return str(hyperparameters[scales[largest]].name)


def _elsewhere(found: Result, fit: Fit, k: int) -> float:
    """The end of the interval that is off the limit; without one, the start of the search."""
    h = fit.hyperparameters[k]
    interval = found.alpha[h.name].interval
    if interval is None:
        return h.start
    side = fit.inference.at_bound[k]
    end = interval[0] if side == "upper" else interval[1]
    return float(end) if np.isfinite(end) and h.lower < end < h.upper else h.start
