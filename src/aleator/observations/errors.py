"""The measurement errors of all observations: log-densities at simulated values, derivatives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from aleator.core.blocks import blocks
from aleator.core.types import Array, Flags, Indices
from aleator.errors import ExperimentsError, InputsError, nearest, require_filled
from aleator.laws import Hyperparameter, Specification, resolve
from aleator.observations.model import (
    NUMERICS,
    NormalError,
    ObservationModel,
    Observed,
    is_curved,
    is_shaped,
    observed,
)
from aleator.observations.responses import Observations, require_responses

if TYPE_CHECKING:
    from aleator.observations.experiments import Conditions, Experiments


@dataclass(frozen=True)
class Noise:
    """The measurement error of a response: measured value = simulated value eta + error.

    The errors of different observations are independent. Their density p(y | eta, scale) is given
    by `kind`, by default Normal(0, scale^2), with

        scale^2 = sd^2 + (relative eta)^2

    `sd`, in the unit of the response, is a number (known), `Free(lower, upper)` (to be identified,
    both limits needed), or the name of a column that holds a known sd for each row. `relative` is a
    share of eta, known or free. One of the two may be left out. The scale is the standard deviation
    if the errors are normal, but not for every kind. With a "log" transform, eta and the sd are
    those of the logarithm.

    Raises InputsError where neither is given, where one is zero, where limits are missing or out of
    order, or where `kind` lacks a member of `ObservationModel`.

    >>> Noise(0.002).hyperparameter.name
    'noise.sd'
    >>> from aleator.laws import Free
    >>> [h.name for h in Noise(Free(0.1, 1.0), relative=0.05).hyperparameters]
    ['noise.sd', 'noise.relative']
    """

    sd: Specification | str | None = None
    kind: ObservationModel = field(default_factory=NormalError)
    relative: Specification | None = None

    def __post_init__(self) -> None:
        """Check all arguments; InputsError if they are not valid."""
        if self.sd is None and self.relative is None:
            raise InputsError("noise: neither sd nor relative is given", "give one of them")
        for name, value in (("sd", self.sd), ("relative", self.relative)):
            if value == 0:
                raise InputsError(f"noise: {name} = 0 is no noise", "leave the noise out")
        require_filled(self.kind, ObservationModel, "noise")
        _ = self.hyperparameters

    @property
    def normal(self) -> bool:
        """Whether the error is normal; then moments and densities with it have a closed form."""
        return isinstance(self.kind, NormalError)

    @property
    def simple(self) -> bool:
        """Whether one standard deviation, known or free, describes the whole noise."""
        plain = self.sd is not None and not isinstance(self.sd, str)
        return plain and self.relative is None and not self.shapes

    @cached_property
    def shapes(self) -> tuple[Hyperparameter, ...]:
        """The free shape hyperparameters of the kind, named without the prefix `noise.`."""
        return self.kind.shapes if is_shaped(self.kind) else ()

    @property
    def column(self) -> str | None:
        """The name of the column of known sds, or None if the sd is not given by a column."""
        return self.sd if isinstance(self.sd, str) else None

    @property
    def hyperparameter(self) -> Hyperparameter:
        """The hyperparameter `noise.sd` of simple noise, which has no other.

        Raises InputsError for noise that is not `simple`.
        """
        if not self.simple:
            raise InputsError(
                "this noise is not one standard deviation, known or free, and more is known to the "
                "integral over individual parameters only",
                "give the noise by one sd: Noise(sd), without relative, a column or a free shape",
            )
        return self.hyperparameters[0]

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters of the noise, known or free.

        They are `noise.sd` (unless it is a column), `noise.relative` if given, then the free shapes
        of the kind.
        """
        found = []
        if self.sd is not None and not isinstance(self.sd, str):
            found.append(resolve("sd", self.sd, (None, None), positive=True))
        if self.relative is not None:
            found.append(resolve("relative", self.relative, (None, None), positive=True))
        return tuple(h.named("noise") for h in (*found, *self.shapes))


def _sds_of_column(
    noise: Noise, response: str, experiments: Experiments | Conditions, rows: Indices
) -> Array | None:
    """The known sds (m, 1) of observations in these rows (m,), from the column named by the noise.

    None where the noise names no column. Raises ExperimentsError, which names the row, for a cell
    that is no positive number.
    """
    if noise.column is None:
        return None
    table = experiments.table
    if noise.column not in table.columns:
        columns = [*map(str, table.columns)]
        raise ExperimentsError(
            f"noise of '{response}': sd = '{noise.column}' is not a column"
            f"{nearest(noise.column, columns)}",
            f"the columns are {', '.join(columns)}; a number or limits need no column",
        )
    cells = table[noise.column].to_numpy()[rows]
    sds = np.array([_number(cell) for cell in cells]) if cells.dtype == object else cells
    bad = np.flatnonzero(~((sds > 0.0) & np.isfinite(sds)))
    if bad.size:
        row = int(rows[bad[0]])
        name = experiments.ids[experiments.experiment[row]]
        raise ExperimentsError(
            f"{experiments.places[row]}, column '{noise.column}': the sd of the measurement "
            f"error of experiment '{name}' is '{cells[bad[0]]}'",
            "write a number > 0 there",
        )
    return sds.astype(np.float64)[:, None]


def _number(cell: object) -> float:
    """The number in a cell of a column with texts; NaN for a text."""
    try:
        return float(str(cell))
    except ValueError:
        return np.nan


class ErrorScale(NamedTuple):
    """The scale of an error, sqrt(sd^2 + (relative eta)^2), and its partial derivatives.

    Without a relative part the derivatives are None, because the scale is the sd itself.
    """

    value: Array
    d_eta: Array | None = None
    d_sd: Array | None = None
    d_relative: Array | None = None


@dataclass(frozen=True, eq=False)
class ResponseErrors:
    """The m observations of one response, and their noise.

    `rows` (m,) are their positions among all observations, in ascending order; `lower` and `upper`
    (m, 1) are their bounds; `sds` (m, 1) are their known standard deviations, if a column gives
    them. In all methods `values` are the values of `noise.hyperparameters`, `which` selects k of
    the m observations, and eta (k, J) are J simulated values of each.
    """

    noise: Noise
    rows: Indices
    lower: Array
    upper: Array
    sds: Array | None = None

    def scale(self, values: Sequence[float], eta: Array, which: slice) -> ErrorScale:
        """The scale of the errors with its derivatives, each (), (k, 1) or (k, J)."""
        sd = self._sd(values, which)
        if self.noise.relative is None:
            return ErrorScale(sd)
        relative = values[self._scales - 1]
        eta = np.clip(eta, -NUMERICS.farthest, NUMERICS.farthest)
        scale = np.sqrt(sd**2 + (relative * eta) ** 2)
        return ErrorScale(scale, relative**2 * eta / scale, sd / scale, relative * eta**2 / scale)

    def model(self, values: Sequence[float]) -> ObservationModel:
        """The law of the error, with the given values of its shape hyperparameters."""
        kind = self.noise.kind
        return kind.at(values[self._scales :]) if is_shaped(kind) else kind

    def terms(self, values: Sequence[float], eta: Array, which: slice) -> list[Array]:
        """log p (k, J), then its derivatives by eta and by each of the `values`, each (k, J).

        Where p is zero or eta is not a number, log p is minus infinity and the derivatives are
        zero.
        """
        with np.errstate(all="ignore"):
            scale, seen = self._seen(values, eta, which)
            by_scale = seen.d_scale
            found = [seen.value, seen.d_eta]
            if self._free_sd:
                found.append(by_scale if scale.d_sd is None else by_scale * scale.d_sd)
            if scale.d_relative is not None:
                found.append(by_scale * scale.d_relative)
            kind = self.noise.kind
            if is_shaped(kind):
                shapes, ends = values[self._scales :], (self.lower[which], self.upper[which])
                found += kind.by_shapes(shapes, *ends, eta, scale.value)
            return _finite(found)

    def curvature(self, values: Sequence[float], eta: Array, which: slice) -> Array:
        """Minus the second derivative of log p by eta (k, J); negative values become zero.

        If the scale does not depend on eta there are two closed forms. For exact values the law of
        the error may have one. Normal errors have one for censored values too: p solves the heat
        equation dp/d scale = scale d2p/d eta2, so that the result is
        (d log p/d eta)^2 - (d log p/d scale)/scale. Otherwise it is computed by differences.
        """
        with np.errstate(all="ignore"):
            scale, model = self.scale(values, eta, which), self.model(values)
            if is_curved(model) and scale.d_eta is None and np.all(self._exact[which]):
                # Values that are not a number become zero too.
                return np.fmax(model.curvature(self.upper[which], eta, scale.value), 0.0)
            if self.noise.normal and scale.d_eta is None:
                seen = self._seen(values, eta, which)[1]
                return np.fmax(seen.d_eta**2 - seen.d_scale / scale.value, 0.0)
            step = NUMERICS.eta_step * scale.value
            above, below = (self._seen(values, eta + h, which)[1].d_eta for h in (step, -step))
            bent = (below - above) / (2.0 * step)
            return np.where(np.isfinite(bent), np.maximum(bent, 0.0), 0.0)

    def _seen(
        self, values: Sequence[float], eta: Array, which: slice
    ) -> tuple[ErrorScale, Observed]:
        """The scale, and log p with its derivatives by the scale and by eta.

        The derivative by eta includes the effect of eta on the scale.
        """
        scale, lower, upper = self.scale(values, eta, which), self.lower[which], self.upper[which]
        seen = observed(self.model(values), lower, upper, eta, scale.value, self._exact[which])
        if scale.d_eta is not None:
            seen = seen._replace(d_eta=seen.d_eta + seen.d_scale * scale.d_eta)
        return scale, seen

    @cached_property
    def _exact(self) -> Flags:
        """Whether each observation is known exactly, bool (m,)."""
        return np.asarray((self.lower == self.upper)[:, 0])

    @cached_property
    def _free_sd(self) -> bool:
        """Whether the sd is a hyperparameter, and neither given by a column nor left out."""
        return self.noise.sd is not None and self.noise.column is None

    @cached_property
    def _scales(self) -> int:
        """The number of `values` that belong to the scale; the others belong to the shapes."""
        return len(self.noise.hyperparameters) - len(self.noise.shapes)

    def _sd(self, values: Sequence[float], which: slice) -> Array:
        if self.sds is not None:
            return self.sds[which]
        return np.asarray(values[0] if self._free_sd else 0.0)


def _finite(found: list[Array]) -> list[Array]:
    # A sum is finite if all its terms are, and takes one pass. Only log p and its derivative by eta
    # are summed, because an infinite derivative by the scale comes with an infinite log p.
    if all(np.isfinite(np.sum(part)) for part in found[:2]):
        return found
    fine = np.logical_and.reduce([np.isfinite(part) for part in found])
    return [np.where(fine, part, 0.0 if k else -np.inf) for k, part in enumerate(found)]


class Terms(NamedTuple):
    """The log-densities of m observations at J simulated values each, with derivatives.

    `value` (m, J) is log p and `d_eta` (m, J) its derivative by the simulated value. `d_values` has
    an entry for each hyperparameter of the noise: which k of the m observations depend on it, and
    the derivatives (k, J) of these; those of the others are zero.
    """

    value: Array
    d_eta: Array
    d_values: tuple[tuple[Indices, Array], ...]


@dataclass(frozen=True, eq=False)
class MeasurementErrors:
    """The measurement errors of M observations, with a `ResponseErrors` for each response.

    In all methods `values` (P,) are the values of `hyperparameters`, `rows` selects m of the
    observations, and eta (m, J) are J simulated values of each.

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
        """The measurement errors of the observations of a table.

        `noise` is that of the only response, or a mapping from each response to its noise. Raises
        ExperimentsError for a response without noise, for one noise with several responses, and for
        a column of known sds that is absent, or not positive for an observation.
        """
        seen, noises = experiments.observations, _each(noise, experiments.observations.names)
        parts = []
        for k, name in enumerate(seen.names):
            rows = np.flatnonzero(seen.response == k)
            lower, upper = seen.lower[rows, None], seen.upper[rows, None]
            known = _sds_of_column(noises[name], name, experiments, seen.row[rows])
            parts.append(ResponseErrors(noises[name], rows, lower, upper, known))
        return cls(tuple(parts), seen.names)

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters of the noise; with several responses they are `noise.RESPONSE.sd`."""
        return _named({n: part.noise for n, part in zip(self.names, self.parts, strict=True)})

    @property
    def simple(self) -> bool:
        """Whether there is one response, with one standard deviation that is known or free."""
        return len(self.parts) == 1 and self.parts[0].noise.simple

    def of_others(self, seen: Observations) -> MeasurementErrors:
        """The measurement errors of other measured values, one for each of these observations."""
        ends = seen.lower[:, None], seen.upper[:, None]
        return replace(
            self,
            parts=tuple(
                replace(part, lower=ends[0][part.rows], upper=ends[1][part.rows])
                for part in self.parts
            ),
        )

    def terms(self, values: Array, eta: Array, rows: slice) -> Terms:
        """log p of the observations `rows` at eta (m, J), with its derivatives.

        Where eta is not finite p is zero; for a censored value it is the limit for infinite eta.
        Cost: 20 ns for each normal log-density with its derivatives.
        """
        if self._at_once(eta):
            found = self.parts[0].terms(np.asarray(values).tolist(), eta, rows)
            every = np.arange(len(eta))
            return Terms(found[0], found[1], tuple((every, by) for by in found[2:]))
        value, d_eta = np.empty(eta.shape), np.empty(eta.shape)
        by_values: list[tuple[Indices, Array]] = []
        for part, first, at, mine in self._parts(values, rows):
            grads = [np.empty((len(at), eta.shape[1])) for _ in mine]
            for some, where in _blocks(at, eta.shape[1]):
                which = slice(first + some.start, first + some.stop)
                value[where], d_eta[where], *by = part.terms(mine, eta[where], which)
                for grad, one in zip(grads, by, strict=True):
                    grad[some] = one
            by_values += [(at, grad) for grad in grads]
        return Terms(value, d_eta, tuple(by_values))

    def curvature(self, values: Array, eta: Array, rows: slice) -> Array:
        """Minus the second derivative of log p by eta (m, J); negative values become zero."""
        if self._at_once(eta):
            return self.parts[0].curvature(np.asarray(values).tolist(), eta, rows)
        found = np.empty(eta.shape)
        for part, first, at, mine in self._parts(values, rows):
            for some, where in _blocks(at, eta.shape[1]):
                which = slice(first + some.start, first + some.stop)
                found[where] = part.curvature(mine, eta[where], which)
        return found

    def scale(self, values: Array, eta: Array, rows: slice) -> Array:
        """The scale (m, J) of the errors of the observations `rows` at eta (m, J)."""
        found = np.empty(eta.shape)
        for at, _, scale in self._models(values, eta, rows):
            found[at] = scale
        return found

    def cdf(self, values: Array, y: Array, eta: Array, rows: slice) -> Array:
        """Probability (m, J) that the measured values of the observations `rows` are at most y."""
        found, y = np.empty(eta.shape), np.broadcast_to(y, eta.shape)
        for at, model, scale in self._models(values, eta, rows):
            found[at] = model.cdf(y[at], eta[at], scale)
        return found

    def quantile(self, values: Array, probability: Array, eta: Array, rows: slice) -> Array:
        """Quantiles (m, J) of the measured values of the observations `rows`.

        With uniform random probabilities they are random measured values.
        """
        found, probability = np.empty(eta.shape), np.broadcast_to(probability, eta.shape)
        for at, model, scale in self._models(values, eta, rows):
            found[at] = model.quantile(probability[at], eta[at], scale)
        return found

    def moments(self, values: Array, eta: Array, rows: slice) -> tuple[Array, Array, Array, Array]:
        """Mean and central moments of orders 2 to 4, each (m, J), of the measured values of `rows`.

        NaN where a moment does not exist.
        """
        found = np.empty((4, *eta.shape))
        for at, model, scale in self._models(values, eta, rows):
            _, m1, m2, m3, m4 = model.moments(4)
            found[0, at] = eta[at] + m1 * scale
            found[1, at] = (m2 - m1**2) * scale**2
            found[2, at] = (m3 - 3.0 * m1 * m2 + 2.0 * m1**3) * scale**3
            found[3, at] = (m4 - 4.0 * m1 * m3 + 6.0 * m1**2 * m2 - 3.0 * m1**4) * scale**4
        return found[0], found[1], found[2], found[3]

    def _at_once(self, eta: Array) -> bool:
        """Whether one array operation is enough, which saves most of the time for small arrays."""
        return len(self.parts) == 1 and eta.size <= NUMERICS.together

    def _parts(
        self, values: Array, rows: slice
    ) -> Iterator[tuple[ResponseErrors, int, Indices, list[float]]]:
        """For each response, the part of it that lies in `rows`.

        Yields its errors, the number of its first observation there, the positions of its
        observations in `rows`, and the values of its hyperparameters.
        """
        start = 0
        for part in self.parts:
            count = len(part.noise.hyperparameters)
            first, last = np.searchsorted(part.rows, [rows.start, rows.stop])
            at = part.rows[first:last] - rows.start
            yield part, int(first), at, np.asarray(values[start : start + count]).tolist()
            start += count

    def _models(
        self, values: Array, eta: Array, rows: slice
    ) -> Iterator[tuple[Indices, ObservationModel, Array]]:
        """For each response, yield positions of its observations in `rows`, their law and scale."""
        for part, first, at, mine in self._parts(values, rows):
            scale = part.scale(mine, eta[at], slice(first, first + len(at))).value
            yield at, part.model(mine), scale


def noise_hyperparameters(
    noise: Noise | Mapping[str, Noise] | None, names: tuple[str, ...]
) -> tuple[Hyperparameter, ...]:
    """The hyperparameters of the noise of the responses `names`; an empty tuple without noise.

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
    """Blocks of the positions `at`: a slice of `at`, and these positions in the whole array."""
    adjoin = len(at) > 0 and at[-1] - at[0] + 1 == len(at)
    for some in blocks(len(at), nodes, NUMERICS.together):
        yield some, slice(at[0] + some.start, at[0] + some.stop) if adjoin else at[some]


def _each(noise: Noise | Mapping[str, Noise], names: tuple[str, ...]) -> Mapping[str, Noise]:
    """The noise of each response by its name; ExperimentsError if one is missing or ambiguous."""
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
