"""Responses (measured quantities), their observations, and the limits of a test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from aleator.core.types import Array, Flags, Indices
from aleator.errors import ExperimentsError, nearest


class Transform(StrEnum):
    """The scale on which the law of the outcome is identified: its own, or the logarithmic one.

    Measured and simulated outcomes are given in the original unit, and both are transformed. Means,
    densities and log-likelihoods refer to the transformed outcome.

    >>> Transform.LOG([1.0, 10.0]), Transform.LOG.fault(-2.0)
    (array([0.        , 2.30258509]), 'the logarithm of -2 does not exist')
    """

    NONE = "none"
    LOG = "log"

    @classmethod
    def named(cls, text: str) -> Transform:
        """The transform of this name; raises ExperimentsError if there is none."""
        if text not in [*cls]:
            raise ExperimentsError(f"unknown transform {text!r}", 'it is "none" or "log"')
        return cls(text)

    def __call__(self, outcome: ArrayLike) -> Array:
        """Transform outcomes from the original unit; not finite where there is no logarithm."""
        values = np.asarray(outcome, dtype=np.float64)
        if self is Transform.NONE:
            return values
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.log(values)

    def inverse(self, transformed: Array) -> Array:
        """Outcomes in the original unit, from transformed ones."""
        return transformed if self is Transform.NONE else np.exp(transformed)

    def fault(self, outcome: float) -> str:
        """The reason why a finite outcome cannot be transformed, "" if it can."""
        if self is Transform.NONE or outcome > 0.0:
            return ""
        return f"the logarithm of {outcome:g} does not exist"


@dataclass(frozen=True)
class Response:
    """A quantity that is measured, and the transform under which it enters the likelihood.

    >>> Response("life", "log").transform
    <Transform.LOG: 'log'>
    """

    name: str
    transform: Transform = Transform.NONE

    def __post_init__(self) -> None:
        object.__setattr__(self, "transform", Transform.named(self.transform))


def responses_of(
    names: Sequence[str], transform: str | Mapping[str, str] = Transform.NONE
) -> tuple[Response, ...]:
    """The responses with these names.

    `transform` is one transform for all of them, or a mapping from names to transforms. Raises
    ExperimentsError for a transform of an unknown response.

    >>> [str(r.transform) for r in responses_of(["time", "torque"], {"torque": "log"})]
    ['none', 'log']
    """
    if isinstance(transform, str):
        return tuple(Response(name, Transform.named(transform)) for name in names)
    require_responses(transform, names, "transform")
    return tuple(
        Response(name, Transform.named(transform.get(name, Transform.NONE))) for name in names
    )


def common_transform(responses: Sequence[Response]) -> Transform:
    """The common transform of all responses; Transform.NONE if they differ."""
    found = {response.transform for response in responses}
    return found.pop() if len(found) == 1 else Transform.NONE


def require_responses(keys: Mapping[str, object], names: Sequence[str], what: str) -> None:
    """Raise ExperimentsError if a key names no response; `what` names the mapping in messages."""
    for key in keys:
        if key not in names:
            raise ExperimentsError(
                f"{what}: there is no response '{key}'{nearest(key, names)}",
                f"the responses are {', '.join(names)}",
            )


@dataclass(frozen=True, eq=False)
class Observations:
    """M measured values of N experiments, all values of one experiment together.

    For each value, `experiment` (M,) is the number of its experiment, in ascending order; `row`
    (M,) is its row of the table; `response` (M,) is the position of its response in `responses`.
    `lower` and `upper` (M,) are its bounds, after the transform of the response. They are equal if
    the value was measured exactly. The value is left-censored if `lower` is minus infinity,
    right-censored if `upper` is infinity, and otherwise lies between the two. NaN in both means
    that the value was not measured.

    Raises ExperimentsError for sizes that differ, for experiments in disorder, and for a lower
    above its upper.

    >>> seen = Observations.exact([1.0, 2.0], "time")
    >>> seen.experiment.tolist(), len(seen), seen.names
    ([0, 1], 2, ('time',))
    """

    experiment: Indices
    row: Indices
    response: Indices
    lower: Array
    upper: Array
    responses: tuple[Response, ...]

    def __post_init__(self) -> None:
        kinds = {"experiment": np.intp, "row": np.intp, "response": np.intp}
        for name in (*kinds, "lower", "upper"):
            array = np.array(getattr(self, name), dtype=kinds.get(name, np.float64))
            array.setflags(write=False)
            object.__setattr__(self, name, array)
            if array.shape != np.shape(self.experiment):
                raise ExperimentsError(
                    f"observations: {name} has the shape {array.shape}, and the experiments have "
                    f"{self.experiment.shape}",
                    "give one entry a value",
                )
        if np.any(np.diff(self.experiment) < 0):
            raise ExperimentsError(
                "observations: experiments are in disorder", "sort the values by experiment"
            )
        crossed = np.flatnonzero(self.lower > self.upper)
        if crossed.size:
            k = int(crossed[0])
            raise ExperimentsError(
                f"observations: value {k} has the lower end {self.lower[k]:g} above the upper end "
                f"{self.upper[k]:g}",
                "swap the two ends",
            )

    def __len__(self) -> int:
        return len(self.lower)

    @classmethod
    def exact(
        cls, values: Array, name: str = "outcome", transform: Transform = Transform.NONE
    ) -> Observations:
        """Exactly measured values (N,), one for each experiment and row, already transformed.

        >>> Observations.exact([1.0, 2.0]).measured.tolist()
        [True, True]
        """
        values = np.array(values, dtype=np.float64)
        each = np.arange(len(values))
        responses = (Response(name, transform),)
        return cls(each, each, np.zeros_like(each), values, values, responses)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the responses."""
        return tuple(response.name for response in self.responses)

    def only(self, which: Flags) -> Observations:
        """The observations with only those of the M values that are marked in `which` (M,).

        >>> Observations.exact([1.0, 2.0]).only(np.array([False, True])).lower.tolist()
        [2.0]
        """
        return Observations(
            self.experiment[which], self.row[which], self.response[which],
            self.lower[which], self.upper[which], self.responses,
        )  # fmt: skip

    @cached_property
    def measured(self) -> Flags:
        """Whether each value is known exactly, bool (M,)."""
        return np.asarray(self.lower == self.upper)

    @cached_property
    def censored(self) -> Flags:
        """Whether only bounds of each value are known, bool (M,)."""
        return ~self.measured & ~np.isnan(self.lower)

    @cached_property
    def numbers(self) -> Array:
        """The values (M,) as numbers; for a censored one its finite bound, the lower of two."""
        return np.where(np.isfinite(self.lower), self.lower, self.upper)

    @property
    def bounds(self) -> Array | None:
        """The lower and upper bounds (2, M) of all values; None if no value is censored."""
        return np.stack([self.lower, self.upper]) if np.any(self.censored) else None


def limits_of_test(seen: Observations) -> list[tuple[float, float]] | None:
    """The lower and upper limit of the test for each response, beyond which values are censored.

    If all right-censored values of a response have the same bound, this is the upper limit of the
    test; likewise for left-censored values and the lower limit. A limit is infinite where no value
    is censored. Returns None if such bounds differ, or if a value lies between two bounds, because
    then there are no limits of a test.

    >>> seen = Observations.exact([1.0, 2.0, 2.0])
    >>> limits_of_test(replace(seen, upper=[1.0, np.inf, np.inf]))
    [(-inf, 2.0)]
    """
    limits = []
    for k in range(len(seen.responses)):
        bound = (seen.response == k) & seen.censored
        above = np.unique(seen.lower[bound & np.isposinf(seen.upper)])
        below = np.unique(seen.upper[bound & np.isneginf(seen.lower)])
        between = bound & np.isfinite(seen.lower) & np.isfinite(seen.upper)
        if above.size > 1 or below.size > 1 or np.any(between):
            return None
        limits.append((float([-np.inf, *below][-1]), float([np.inf, *above][-1])))
    return limits


def with_limits_of_test(new: Observations, seen: Observations) -> Observations:
    """New observations (M,) without values, marked as censored at the limits of an earlier test.

    The limits are those of the earlier observations `seen` (`limits_of_test`). Each new value
    counts as lying beyond the limit until it is measured.
    """
    lower, upper = new.lower.copy(), new.upper.copy()
    for k, (low, high) in enumerate(limits_of_test(seen) or []):
        of = new.response == k
        if np.isfinite(high):
            lower[of], upper[of] = high, np.inf
        elif np.isfinite(low):
            lower[of], upper[of] = -np.inf, low
    return replace(new, lower=lower, upper=upper)


def ends_of(seen: Observations, limits: list[tuple[float, float]]) -> tuple[Array, Array]:
    """The lower and upper limit of the test for each of M observations, both (M,)."""
    each = np.array(limits).reshape(-1, 2)[seen.response]
    return each[:, 0], each[:, 1]
