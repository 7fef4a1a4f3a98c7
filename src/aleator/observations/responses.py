"""What was measured: responses, and the observations of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aleator.errors import ExperimentsError, nearest
from aleator.observations.responses import Transform
from aleator.types import Array, Flags, Indices


@dataclass(frozen=True)
class Response:
    """A quantity that is measured, and the scale on which the likelihood sees it.

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
    """The responses of these names; `transform` is one for all, or one for each that has one.

    Raises ExperimentsError for a transform of an unknown response.

    >>> [str(r.transform) for r in responses_of(["time", "torque"], {"torque": "log"})]
    ['none', 'log']
    """
    if isinstance(transform, str):
        return tuple(Response(name, Transform.named(transform)) for name in names)
    require_known(transform, names, "transform")
    return tuple(
        Response(name, Transform.named(transform.get(name, Transform.NONE))) for name in names
    )


def require_known(keys: Mapping[str, object], names: Sequence[str], what: str) -> None:
    """Raise ExperimentsError where a key names no response; `what` says what the keys are of."""
    for key in keys:
        if key not in names:
            raise ExperimentsError(
                f"{what}: there is no response '{key}'{nearest(key, names)}",
                f"the responses are {', '.join(names)}",
            )


@dataclass(frozen=True, eq=False)
class Observations:
    """M measured values of N experiments, all values of one experiment together.

    `experiment` (M,) rises; `row` (M,) is the row of the table; `response` (M,) the position in
    `responses`. `lower` and `upper` (M,) are on the scale of the likelihood, after the transform of
    the response. Where they are equal the value was measured exactly. A lower of minus infinity is
    left-censored at the upper, an upper of infinity is right-censored at the lower, and else the
    value lies between them. NaN in both is a value that is asked for and was not measured.

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
        for name in ("experiment", "row", "response"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=np.intp))
        for name in ("lower", "upper"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=np.float64))
        arrays = (self.experiment, self.row, self.response, self.lower, self.upper)
        if any(array.shape != (len(self),) for array in arrays):
            shapes = ", ".join(str(array.shape) for array in arrays)
            raise ExperimentsError(
                f"observations: the arrays have the shapes {shapes}", "give one entry a value"
            )
        for array in arrays:
            array.setflags(write=False)
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
        """One value (N,) an experiment, each experiment a row; the values are transformed already.

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
        """Some of the values (M,).

        >>> Observations.exact([1.0, 2.0]).only(np.array([False, True])).lower.tolist()
        [2.0]
        """
        return Observations(
            self.experiment[which], self.row[which], self.response[which],
            self.lower[which], self.upper[which], self.responses,
        )  # fmt: skip

    @cached_property
    def measured(self) -> Flags:
        """Which values are known exactly, bool (M,)."""
        return np.asarray(self.lower == self.upper)

    @cached_property
    def censored(self) -> Flags:
        """Of which values only bounds are known, bool (M,)."""
        return ~self.measured & ~np.isnan(self.lower)
