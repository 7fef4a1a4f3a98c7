"""The measurement errors of all observations: what the likelihood asks at its nodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from aleator.blocks import blocks
from aleator.errors import ExperimentsError
from aleator.laws import Hyperparameter
from aleator.observations.errors import Noise, ResponseErrors, sds_of_column
from aleator.observations.responses import Observations, require_responses
from aleator.types import Array, Indices

if TYPE_CHECKING:
    from aleator.observations.experiments import Conditions, Experiments

BLOCK = 32768
"""Numbers of one operation: what is between them stays in the cache."""


class Terms(NamedTuple):
    """log p of m observations at J nodes each, with derivatives.

    `value` and `d_eta` are (m, J). `d_values` has an entry for each value of the noise: which of
    the m observations depend on it, and the derivatives (of that many, J); those of the others
    are zero.
    """

    value: Array
    d_eta: Array
    d_values: tuple[tuple[Indices, Array], ...]


@dataclass(frozen=True, eq=False)
class MeasurementErrors:
    """The measurement errors of M observations, a `ResponseErrors` for each response.

    >>> import pandas as pd
    >>> from aleator.laws import Free
    >>> from aleator.observations.experiments import Experiments
    >>> table = Experiments.from_frame(pd.DataFrame({"y": [1.0, 2.0]}), outcome="y")
    >>> errors = MeasurementErrors.of(Noise(Free(0.1, 1.0)), table)
    >>> errors.terms(np.array([0.5]), np.array([[1.0], [1.0]]), slice(0, 2)).value.round(3).tolist()
    [[-0.226], [-2.226]]
    """

    parts: tuple[ResponseErrors, ...]
    names: tuple[str, ...]

    @classmethod
    def of(
        cls, noise: Noise | Mapping[str, Noise], experiments: Experiments | Conditions
    ) -> MeasurementErrors:
        """The errors of the observations of a table; a mapping has the noise of each response.

        Raises ExperimentsError for a response without noise, for one noise and several responses,
        and for a column of known sds that is not there, or not positive at an observation.
        """
        seen, noises = experiments.observations, _each(noise, experiments.observations.names)
        parts = []
        for k, name in enumerate(seen.names):
            rows = np.flatnonzero(seen.response == k)
            lower, upper = seen.lower[rows, None], seen.upper[rows, None]
            known = sds_of_column(noises[name], name, experiments, seen.row[rows])
            parts.append(ResponseErrors(noises[name], rows, lower, upper, known))
        return cls(tuple(parts), seen.names)

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All of the noise: `noise.sd`, or `noise.RESPONSE.sd` with several responses."""
        return _named({n: part.noise for n, part in zip(self.names, self.parts, strict=True)})

    @property
    def simple(self) -> bool:
        """Whether there is one response, with one scale that is known or free."""
        return len(self.parts) == 1 and self.parts[0].noise.simple

    def of_others(self, seen: Observations) -> MeasurementErrors:
        """The errors of other values at the same places."""
        ends = seen.lower[:, None], seen.upper[:, None]
        return replace(
            self,
            parts=tuple(
                replace(part, lower=ends[0][part.rows], upper=ends[1][part.rows])
                for part in self.parts
            ),
        )

    def terms(self, values: Array, eta: Array, rows: slice) -> Terms:
        """log p of the observations `rows` at eta (m, J), by the `values` (P,) of the noise.

        An eta that is not finite has p = 0, but for a censored value, which takes the limit.
        Cost: 20 ns a normal term with its derivatives.
        """
        if self._at_once(eta):
            found = self.parts[0].terms(np.asarray(values).tolist(), eta, rows)
            every = np.arange(len(eta))
            return Terms(found[0], found[1], tuple((every, by) for by in found[2:]))
        value, d_eta = np.empty(eta.shape), np.empty(eta.shape)
        by_values: list[tuple[Indices, Array]] = []
        for part, own, at, mine in self._within(values, rows):
            grads = [np.empty((len(at), eta.shape[1])) for _ in mine]
            for some, where in _blocks(at, eta.shape[1]):
                found = part.terms(mine, eta[where], slice(own + some.start, own + some.stop))
                value[where], d_eta[where] = found[:2]
                for grad, by in zip(grads, found[2:], strict=True):
                    grad[some] = by
            by_values += [(at, grad) for grad in grads]
        return Terms(value, d_eta, tuple(by_values))

    def curvature(self, values: Array, eta: Array, rows: slice) -> Array:
        """-d2 log p/d eta2 of the observations `rows` at eta (m, J), floored at zero: (m, J)."""
        if self._at_once(eta):
            return self.parts[0].curvature(np.asarray(values).tolist(), eta, rows)
        found = np.empty(eta.shape)
        for part, own, at, mine in self._within(values, rows):
            for some, where in _blocks(at, eta.shape[1]):
                which = slice(own + some.start, own + some.stop)
                found[where] = part.curvature(mine, eta[where], which)
        return found

    def scale(self, values: Array, eta: Array, rows: slice) -> Array:
        """The scale of the errors of the observations `rows` at eta (m, J): (m, J)."""
        found = np.empty(eta.shape)
        for part, own, at, mine in self._within(values, rows):
            found[at] = part.scale(mine, eta[at], slice(own, own + len(at))).value
        return found

    def cdf(self, values: Array, y: Array, eta: Array, rows: slice) -> Array:
        """Probability of measured values not above y, for the observations `rows`: (m, J)."""
        return self._asked("cdf", values, y, eta, rows)

    def quantile(self, values: Array, probability: Array, eta: Array, rows: slice) -> Array:
        """The measured values of these probabilities, for the observations `rows`: (m, J).

        Uniform probabilities make random values.
        """
        return self._asked("quantile", values, probability, eta, rows)

    def moments(self, values: Array, eta: Array, rows: slice) -> tuple[Array, Array, Array, Array]:
        """Mean and central moments 2 to 4 (m, J) of the values of the observations `rows`.

        NaN where there is none.
        """
        found = np.empty((4, *eta.shape))
        for part, own, at, mine in self._within(values, rows):
            scale = part.scale(mine, eta[at], slice(own, own + len(at))).value
            _, m1, m2, m3, m4 = part.model(mine).moments(4)
            central = (
                m2 - m1**2,
                m3 - 3.0 * m1 * m2 + 2.0 * m1**3,
                m4 - 4.0 * m1 * m3 + 6.0 * m1**2 * m2 - 3.0 * m1**4,
            )
            found[0, at] = eta[at] + m1 * scale
            for k, moment in enumerate(central):
                found[k + 1, at] = moment * scale ** (k + 2)
        return found[0], found[1], found[2], found[3]

    def _asked(self, what: str, values: Array, at_what: Array, eta: Array, rows: slice) -> Array:
        found, at_what = np.empty(eta.shape), np.broadcast_to(at_what, eta.shape)
        for part, own, at, mine in self._within(values, rows):
            scale = part.scale(mine, eta[at], slice(own, own + len(at))).value
            found[at] = getattr(part.model(mine), what)(at_what[at], eta[at], scale)
        return found

    def _at_once(self, eta: Array) -> bool:
        """Whether one call does, which saves most of the time of a small one."""
        return len(self.parts) == 1 and eta.size <= BLOCK

    def _within(
        self, values: Array, rows: slice
    ) -> Iterator[tuple[ResponseErrors, int, Indices, list[float]]]:
        """Each response: its first observation in the rows, where they stand, its values."""
        start = 0
        for part in self.parts:
            count = len(part.noise.hyperparameters)
            first, last = np.searchsorted(part.rows, [rows.start, rows.stop])
            at = part.rows[first:last] - rows.start
            yield part, int(first), at, np.asarray(values[start : start + count]).tolist()
            start += count


def noise_hyperparameters(
    noise: Noise | Mapping[str, Noise] | None, names: tuple[str, ...]
) -> tuple[Hyperparameter, ...]:
    """Those of the noise of responses of these names; none without noise.

    >>> from aleator.laws import Free
    >>> [h.name for h in noise_hyperparameters({"a": Noise(1), "b": Noise(Free(1, 2))}, ("a", "b"))]
    ['noise.a.sd', 'noise.b.sd']
    """
    return () if noise is None else _named(_each(noise, names))


def _named(noises: Mapping[str, Noise]) -> tuple[Hyperparameter, ...]:
    return tuple(
        h if len(noises) == 1 else replace(h, name=f"noise.{name}.{h.name[6:]}")
        for name, noise in noises.items()
        for h in noise.hyperparameters
    )


def _blocks(at: Indices, nodes: int) -> Iterator[tuple[slice, slice | Indices]]:
    """Parts of the positions `at`: each as a slice of them, and where it is among all."""
    adjoin = len(at) > 0 and at[-1] - at[0] + 1 == len(at)
    for some in blocks(len(at), nodes, BLOCK):
        yield some, slice(at[0] + some.start, at[0] + some.stop) if adjoin else at[some]


def _each(noise: Noise | Mapping[str, Noise], names: tuple[str, ...]) -> Mapping[str, Noise]:
    """The noise of each response."""
    if isinstance(noise, Noise):
        if len(names) > 1:
            raise ExperimentsError(
                f"one noise for the {len(names)} responses {', '.join(names)}",
                f'give each its own: noise={{"{names[0]}": Noise(...), ...}}, or in a study '
                f"[noise.{names[0]}] and so on",
            )
        return {names[0]: noise}
    require_responses(noise, names, "noise")
    for name in names:
        if name not in noise:
            raise ExperimentsError(
                f"the response '{name}' has no noise",
                f'give it one: noise={{"{name}": Noise(...), ...}}, or in a study [noise.{name}]',
            )
    return {name: noise[name] for name in names}
