"""The measurement errors of all observations: log-densities at simulated values, derivatives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import special

from aleator.core.blocks import blocks
from aleator.core.toml_text import key
from aleator.core.types import Array, Flags, Indices
from aleator.errors import ExperimentsError
from aleator.laws import Hyperparameter
from aleator.observations.correlated import SerialOrder, Whitening
from aleator.observations.model import (
    HALF_LOG_2_PI,
    NUMERICS,
    ObservationModel,
    Observed,
    is_curved,
    is_shaped,
    observed,
)
from aleator.observations.noise import Noise
from aleator.observations.responses import Observations, require_responses
from aleator.observations.serial_order import numbers_of, serial_order

if TYPE_CHECKING:
    from aleator.observations.experiments import Conditions, Experiments


def _sds_of_column(
    noise: Noise, response: str, experiments: Experiments | Conditions, rows: Indices
) -> Array | None:
    """The known sds (m, 1) of observations in these rows (m,), from the column named by the noise.

    None where the noise names no column. Raises ExperimentsError, which names the row, for a cell
    that is no positive number.
    """
    if noise.column is None:
        return None
    return numbers_of(
        noise.column, f"noise of '{response}': sd", "the sd of the measurement error", experiments,
        rows, lambda cells: cells > 0.0, "write a number > 0 there",
        "; a number or limits need no column",
    )  # fmt: skip


def _covariate_of_column(
    noise: Noise, response: str, experiments: Experiments | Conditions, rows: Indices
) -> Array | None:
    """The covariate (m, 1) of the variance function, if it is a column; else None."""
    variance = noise.variance
    if variance is None or variance.of is None:
        return None
    return numbers_of(
        variance.of, f"noise of '{response}': variance of", "the covariate of the variance",
        experiments, rows, variance.admissible, "correct the cell, or name another column",
    )  # fmt: skip


class ErrorScale(NamedTuple):
    """The scale of an error, and its partial derivatives.

    `d_eta` is None where the scale does not depend on eta. `d_values` are the derivatives by the
    hyperparameters of the scale, None where it is the hyperparameter itself.
    """

    value: Array
    d_eta: Array | None = None
    d_values: tuple[Array | None, ...] = ()


@dataclass(frozen=True, eq=False)
class ResponseErrors:
    """The m observations of one response, and their noise.

    `rows` (m,) are their positions among all observations, in ascending order; `lower` and `upper`
    (m, 1) are their bounds; `sds` (m, 1) are their known standard deviations, and `covariate`
    (m, 1) that of the variance function, if columns give them. `serial` is their order where their
    errors are correlated. `added` (m, 1) are sds of auxiliary errors (`MeasurementErrors.eased`).
    In all methods `values` are the values of `noise.hyperparameters`,
    `which` selects k of the m observations, those of whole experiments where the errors are
    correlated, and eta (k, J) are J simulated values of each.
    """

    noise: Noise
    rows: Indices
    lower: Array
    upper: Array
    sds: Array | None = None
    covariate: Array | None = None
    serial: SerialOrder | None = None
    added: Array | None = None

    def scale(self, values: Sequence[float], eta: Array, which: slice) -> ErrorScale:
        """The scale of the errors with its derivatives, each (), (k, 1) or (k, J)."""
        found = self._stated(values, eta, which)
        if self.added is None:
            return found
        whole = np.hypot(found.value, self.added[which])
        share = found.value / whole
        return ErrorScale(
            whole,
            None if found.d_eta is None else share * found.d_eta,
            tuple(share if d is None else share * d for d in found.d_values),
        )

    def _stated(self, values: Sequence[float], eta: Array, which: slice) -> ErrorScale:
        """The scale of the errors as the noise states it, without auxiliary errors."""
        sd, variance = self._sd(values, which), self.noise.variance
        if variance is not None:
            v = self.covariate[which] if self.covariate is not None else eta
            found = variance.factor(
                values[self._scales - 1], np.clip(v, -NUMERICS.farthest, NUMERICS.farthest)
            )
            scale = sd * found.value
            return ErrorScale(
                scale,
                None if self.covariate is not None else scale * found.by_covariate,
                (*[found.value] * self._free_sd, scale * found.by_value),
            )
        if self.noise.relative is None:
            return ErrorScale(sd, None, (None,) * self._free_sd)
        relative = values[self._scales - 1]
        eta = np.clip(eta, -NUMERICS.farthest, NUMERICS.farthest)
        scale = np.sqrt(sd**2 + (relative * eta) ** 2)
        return ErrorScale(
            scale, relative**2 * eta / scale,
            (*[sd / scale] * self._free_sd, relative * eta**2 / scale),
        )  # fmt: skip

    def marginal(self, values: Sequence[float], eta: Array, which: slice) -> Array:
        """The scale of each single error, whatever the others are."""
        scale, ties = self.scale(values, eta, which).value, self.noise.correlation
        return scale if ties is None else ties.marginal(self._ties(values), scale)

    def model(self, values: Sequence[float]) -> ObservationModel:
        """The law of the error, with the given values of its shape hyperparameters."""
        kind, free = self.noise.kind, len(self.noise.shapes)
        return kind.at(values[self._scales : self._scales + free]) if is_shaped(kind) else kind

    def terms(
        self, values: Sequence[float], eta: Array, which: slice, scores: bool = True
    ) -> list[Array]:
        """log p (k, J), then its derivatives by eta and by each of the `values`, each (k, J).

        Where p is zero or eta is not a number, log p is minus infinity and the derivatives are
        zero. Correlated errors have the log p given the earlier ones, and sums of derivatives that
        are those of the whole experiment. Without `scores` those by the `values` may be left out.
        """
        with np.errstate(all="ignore"):
            if self.serial is not None:
                return _finite(self._correlated(values, eta, which, scores))
            scale, seen = self._seen(values, eta, which)
            by_scale = seen.d_scale
            found = [seen.value, seen.d_eta]
            found += [by_scale if d is None else by_scale * d for d in scale.d_values]
            kind = self.noise.kind
            if is_shaped(kind):
                shapes, ends = values[self._scales :], (self.lower[which], self.upper[which])
                found += kind.by_shapes(shapes, *ends, eta, scale.value)
            return _finite(found)

    def log_density(self, values: Sequence[float], eta: Array, which: slice) -> Array:
        """log p (k, J) of `terms`, without its derivatives."""
        if self.serial is None:
            return self.terms(values, eta, which)[0]
        with np.errstate(all="ignore"):
            found = _normal(*self._whitened(values, eta, which))
            scale = self.scale(values, eta, which).value
            return self._possible(self.serial.part(which).back(found), eta, scale)

    def conditional(self, values: Sequence[float], eta: Array, which: slice) -> tuple[Array, Array]:
        """Location and scale (k, J) of each value, given the earlier ones of its experiment."""
        if self.serial is None:
            return eta, np.broadcast_to(self.scale(values, eta, which).value, eta.shape)
        with np.errstate(all="ignore"):
            u, scale, whitening = self._whitened(values, eta, which)
            serial = self.serial.part(which)
            moved = serial.back(scale * whitening.expected(u))
            return eta + moved, serial.back(np.broadcast_to(scale * whitening.root, eta.shape))

    def ranks(self, values: Sequence[float], eta: Array, which: slice) -> tuple[Array, Array]:
        """log p (k, J) of correlated errors, and the probability of a value up to the measured one.

        Both are those given the earlier values of the experiment.
        """
        assert self.serial is not None
        with np.errstate(all="ignore"):
            u, scale, whitening = self._whitened(values, eta, which)
            serial, w = self.serial.part(which), u - whitening.expected(u)
            w /= whitening.root
            chance = serial.back(special.ndtr(w))
            value = serial.back(_of_standard(w, scale, whitening))
            value = self._possible(value, eta, self.scale(values, eta, which).value)
            if not np.all(u):  # An error that is not finite, or too large, was taken as zero.
                known = np.abs(self.upper[which] - eta) < NUMERICS.farthest * serial.back(scale)
                chance = np.where(known, chance, self.upper[which] > eta)
            return value, chance

    def drawn(self, values: Sequence[float], probability: Array, eta: Array, which: slice) -> Array:
        """Measured values (k, J) from independent uniform random `probability` (k, J)."""
        if self.serial is None:
            scale = self.scale(values, eta, which).value
            return self.model(values).quantile(probability, eta, scale)
        _, scale, whitening = self._whitened(values, eta, which)
        serial, normal = self.serial.part(which), self.model(values)
        z = normal.quantile(serial.take(probability), np.zeros(1), np.ones(1))
        return eta + serial.back(scale * whitening.drawn(z))

    def information(
        self, values: Sequence[float], eta: Array, slopes: Array, which: slice
    ) -> Array:
        """The information (k, J, s, s) of each observation about s directions.

        `slopes` (k, J, s) are the derivatives of eta in these directions. It is the Gauss-Newton
        approximation; correlated errors have the information beyond that of the earlier ones.
        """
        if self.serial is None:
            curvature = self.curvature(values, eta, which)
            return curvature[..., None, None] * slopes[..., :, None] * slopes[..., None, :]
        with np.errstate(all="ignore"):
            _, scale, whitening = self._whitened(values, eta, which)
            serial, found = self.serial.part(which), np.empty(slopes.shape)
            for d in range(slopes.shape[2]):
                own = serial.take(slopes[..., d]) / scale
                own = np.where(np.isfinite(own), own, 0.0)
                found[..., d] = serial.back((own - whitening.expected(own)) / whitening.root)
            outer = found[..., :, None] * found[..., None, :]
            by_eta = self.scale(values, eta, which)
            if by_eta.d_eta is not None:
                grown = (by_eta.d_eta / by_eta.value)[..., None] * slopes
                outer += 2.0 * np.nan_to_num(grown[..., :, None] * grown[..., None, :])
            return outer

    def _correlated(
        self, values: Sequence[float], eta: Array, which: slice, scores: bool
    ) -> list[Array]:
        """`terms` of correlated errors, by those given the earlier ones of their experiment."""
        assert self.serial is not None
        u, scale, whitening = self._whitened(values, eta, which)
        serial, own = self.serial.part(which), self.scale(values, eta, which)
        value = self._possible(serial.back(_normal(u, scale, whitening)), eta, own.value)
        if not scores and own.d_eta is None:
            return [value, serial.back(whitening.solved(u) / scale)]
        found = whitening.derivatives(u)
        parts = [found.solved / scale, found.by_scale / scale, *found.by_values]
        by_eta, by_scale, *by_ties = (serial.back(part) for part in parts)
        if own.d_eta is not None:
            by_eta = by_eta + by_scale * own.d_eta
        by_values = [by_scale if d is None else by_scale * d for d in own.d_values]
        return [value, by_eta, *by_values, *by_ties]

    def _possible(self, value: Array, eta: Array, scale: Array) -> Array:
        """log p (k, J), minus infinity where eta or the scale is none that can be."""
        fine = np.isfinite(eta) & (scale > 0.0) & np.isfinite(scale)
        return value if np.all(fine) else np.where(fine, value, -np.inf)

    def _whitened(
        self, values: Sequence[float], eta: Array, which: slice
    ) -> tuple[Array, Array, Whitening]:
        """Errors over their scale (k, J), the scale, and its whitening, in serial order.

        An error that is not finite is zero, because a sum over all would not be finite.
        """
        assert self.serial is not None
        assert self.noise.correlation is not None
        serial, scale = self.serial.part(which), self.scale(values, eta, which).value
        if scale.ndim < 2:
            scale = np.full((len(eta), 1), float(scale))
        scale = serial.take(np.where((scale > 0.0) & np.isfinite(scale), scale, 1.0))
        u = serial.take(self.upper[which] - eta) / scale
        far = NUMERICS.farthest
        if not (-far < np.min(u, initial=0.0) and np.max(u, initial=0.0) < far):
            u = np.where(np.abs(u) < far, u, 0.0)
        ties = self.noise.correlation
        return u, scale, ties.whitening(self._ties(values), serial, scale)

    def _ties(self, values: Sequence[float]) -> Sequence[float]:
        """The values of the hyperparameters of the correlation."""
        ties = self.noise.correlation
        return values[len(values) - (0 if ties is None else len(ties.hyperparameters)) :]

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
        """The number of `values` that belong to the scale.

        The others belong to the shapes and the correlation.
        """
        ties = self.noise.correlation
        others = len(self.noise.shapes) + (0 if ties is None else len(ties.hyperparameters))
        return len(self.noise.hyperparameters) - others

    def _sd(self, values: Sequence[float], which: slice) -> Array:
        if self.sds is not None:
            return self.sds[which]
        return np.asarray(values[0] if self._free_sd else 0.0)


def _normal(u: Array, scale: Array, whitening: Whitening) -> Array:
    """log p (k, J) of normal errors over their scale, each given the earlier ones."""
    w = u - whitening.expected(u)
    w /= whitening.root
    return _of_standard(w, scale, whitening)


def _of_standard(w: Array, scale: Array, whitening: Whitening) -> Array:
    """log p (k, J) of normal errors, from their standard normal values w, which are overwritten."""
    w *= w
    w *= -0.5
    w -= np.log(whitening.root * scale) + HALF_LOG_2_PI
    return w


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
            covariate = _covariate_of_column(noises[name], name, experiments, seen.row[rows])
            serial = serial_order(noises[name].correlation, name, experiments, rows)
            parts.append(ResponseErrors(noises[name], rows, lower, upper, known, covariate, serial))
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

    def eased(self, added: Array) -> MeasurementErrors:
        """These errors with auxiliary ones of sds `added` (M,), as sqrt(scale^2 + added^2)."""
        parts = (replace(part, added=added[part.rows, None]) for part in self.parts)
        return replace(self, parts=tuple(parts))

    def terms(self, values: Array, eta: Array, rows: slice, scores: bool = True) -> Terms:
        """log p of the observations `rows` at eta (m, J), with its derivatives.

        Where eta is not finite p is zero; for a censored value it is the limit for infinite eta.
        Without `scores` the derivatives by the hyperparameters may be left out.
        Cost: 20 ns for each normal log-density with its derivatives.
        """
        if self._at_once(eta):
            found = self.parts[0].terms(np.asarray(values).tolist(), eta, rows, scores)
            every = np.arange(len(eta))
            return Terms(found[0], found[1], tuple((every, by) for by in found[2:]))
        value, d_eta = np.empty(eta.shape), np.empty(eta.shape)
        by_values: list[tuple[Indices, Array]] = []
        for part, first, at, mine in self._parts(values, rows):
            grads = [np.empty((len(at), eta.shape[1])) for _ in mine if scores]
            for some, where in _blocks(part, first, at, eta.shape[1]):
                which = slice(first + some.start, first + some.stop)
                value[where], d_eta[where], *by = part.terms(mine, eta[where], which, scores)
                for grad, one in zip(grads, by, strict=scores):
                    grad[some] = one
            by_values += [(at, grad) for grad in grads]
        return Terms(value, d_eta, tuple(by_values))

    def log_density(self, values: Array, eta: Array, rows: slice) -> Array:
        """log p (m, J) of the observations `rows` at eta (m, J), as in `terms`."""
        if self._at_once(eta):
            return self.parts[0].log_density(np.asarray(values).tolist(), eta, rows)
        found = np.empty(eta.shape)
        for part, first, at, mine in self._parts(values, rows):
            for some, where in _blocks(part, first, at, eta.shape[1]):
                which = slice(first + some.start, first + some.stop)
                found[where] = part.log_density(mine, eta[where], which)
        return found

    def information(self, values: Array, eta: Array, slopes: Array, rows: slice) -> Array:
        """The information (m, J, s, s) of each observation about s directions.

        `slopes` (m, J, s) are the derivatives of eta in these directions. It is the Gauss-Newton
        approximation, and that beyond the earlier observations where errors are correlated.
        """
        if self._at_once(eta):
            return self.parts[0].information(np.asarray(values).tolist(), eta, slopes, rows)
        found = np.empty((*slopes.shape, slopes.shape[2]))
        for part, first, at, mine in self._parts(values, rows):
            for some, where in _blocks(part, first, at, eta.shape[1]):
                which = slice(first + some.start, first + some.stop)
                found[where] = part.information(mine, eta[where], slopes[where], which)
        return found

    def scale(self, values: Array, eta: Array, rows: slice) -> Array:
        """The scale (m, J) of the errors of the observations `rows` at eta (m, J).

        It is that of each by itself, as in `cdf`, `quantile` and `moments`.
        """
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
        """Quantiles (m, J) of the measured values of the observations `rows`."""
        found, probability = np.empty(eta.shape), np.broadcast_to(probability, eta.shape)
        for at, model, scale in self._models(values, eta, rows):
            found[at] = model.quantile(probability[at], eta[at], scale)
        return found

    def drawn(self, values: Array, probability: Array, eta: Array, rows: slice) -> Array:
        """Measured values (m, J) of the observations `rows`, which are those of whole experiments.

        They are made from independent uniform random probabilities (m, J).
        """
        found = np.empty(eta.shape)
        for part, first, at, mine in self._parts(values, rows):
            which = slice(first, first + len(at))
            found[at] = part.drawn(mine, probability[at], eta[at], which)
        return found

    def ranks(self, values: Array, eta: Array, rows: slice) -> tuple[Array, Array] | None:
        """log p (m, J) of correlated errors, and the probability of a value up to the measured one.

        Both are those given the earlier values of the experiment, and `rows` those of whole
        experiments. None where errors of a response are independent.
        """
        if any(part.serial is None for part in self.parts):
            return None
        value, chance = np.empty(eta.shape), np.empty(eta.shape)
        for part, first, at, mine in self._parts(values, rows):
            for some, where in _blocks(part, first, at, eta.shape[1]):
                which = slice(first + some.start, first + some.stop)
                value[where], chance[where] = part.ranks(mine, eta[where], which)
        return value, chance

    def conditional_cdf(self, values: Array, y: Array, eta: Array, rows: slice) -> Array:
        """Probability (m, J) of a value up to y, given the earlier ones of its experiment and eta.

        `rows` are those of whole experiments. The earlier values are the measured ones.
        """
        found, y = np.empty(eta.shape), np.broadcast_to(y, eta.shape)
        for part, first, at, mine in self._parts(values, rows):
            which = slice(first, first + len(at))
            location, scale = part.conditional(mine, eta[at], which)
            found[at] = part.model(mine).cdf(y[at], location, scale)
        return found

    def conditional(self, values: Array, eta: Array, rows: slice) -> tuple[Array, Array]:
        """Location and scale (m, J) of each value, given the earlier ones of its experiment."""
        found = np.empty((2, *eta.shape))
        for part, first, at, mine in self._parts(values, rows):
            which = slice(first, first + len(at))
            found[:, at] = part.conditional(mine, eta[at], which)
        return found[0], found[1]

    @cached_property
    def sequence(self) -> Indices | None:
        """The M observations in an order in which each follows those that its error depends on.

        None where this is their own order.
        """
        found = np.arange(sum(len(part.rows) for part in self.parts))
        for part in self.parts:
            if part.serial is not None:
                found[part.rows] = part.rows[part.serial.order]
        return None if np.array_equal(found, np.arange(found.size)) else found

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
            scale = part.marginal(mine, eta[at], slice(first, first + len(at)))
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


def _blocks(
    part: ResponseErrors, first: int, at: Indices, nodes: int
) -> Iterator[tuple[slice, slice | Indices]]:
    """Blocks of the positions `at`: a slice of `at`, and these positions in the whole array.

    `at` are the observations of a response from number `first` on. Blocks have whole experiments
    where errors are correlated.
    """
    adjoin = len(at) > 0 and at[-1] - at[0] + 1 == len(at)
    cut = blocks(len(at), nodes, NUMERICS.together)
    if part.serial is not None:
        cut = part.serial.cut(first, cut)
    for some in cut:
        yield some, slice(at[0] + some.start, at[0] + some.stop) if adjoin else at[some]


def _each(noise: Noise | Mapping[str, Noise], names: tuple[str, ...]) -> Mapping[str, Noise]:
    """The noise of each response by its name; ExperimentsError if one is missing or ambiguous."""
    if isinstance(noise, Noise):
        if len(names) > 1:
            raise ExperimentsError(
                f"one noise for the {len(names)} responses {', '.join(names)}",
                f'give each its own: noise={{"{names[0]}": Noise(...), ...}}, or in a study '
                f"[noise.{key(names[0])}] and so on",
            )
        return {names[0]: noise}
    require_responses(noise, names, "noise")
    for name in names:
        if name not in noise:
            raise ExperimentsError(
                f"the response '{name}' has no noise",
                f'give it one: noise={{"{name}": Noise(...), ...}}, or in a study '
                f"[noise.{key(name)}]",
            )
    return {name: noise[name] for name in names}
