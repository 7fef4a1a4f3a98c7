"""The parameters of single experiments, as images of standard normal variates of their own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from aleator.laws.inputs import image_at
from aleator.laws.law import Law, Standard
from aleator.laws.mixture import Mixture
from aleator.types import Array, Indices

if TYPE_CHECKING:
    from aleator.laws.inputs import Inputs


@dataclass(frozen=True, eq=False)
class Individual:
    """Parameters x (B, J, n) of B experiments at J standard normal variates xi (B, J, s) of each.

    x = T(xi | alpha): every law is the image of a variate theta, and theta = L xi ties correlated
    parameters (see `Inputs`); `theta` is (B, J, s). It is smooth in alpha with xi held, whatever
    the support of a law. Where laws are mixtures an experiment belongs to one of C classes
    (`Inputs.classes`): the first J/C variates are those of the first class, and so on, and
    `log_weight` (B or 1, J) is the logarithm of the probability of each point's class.
    """

    inputs: Inputs
    xi: Array
    theta: Array
    x: Array
    own: tuple[Standard, ...]
    log_weight: Array
    mixing: Array
    mixing_slope: Array
    values: tuple[Array, ...]
    alpha: Array
    experiments: slice

    @classmethod
    def of(cls, inputs: Inputs, alpha: Array, xi: Array, experiments: slice) -> Individual:
        """The image of the variates under the law alpha (K,) of these experiments."""
        mixing, slope = _mixing(inputs, alpha)
        theta = xi @ mixing.T if inputs.correlation.members else xi
        place = {i: s for s, i in enumerate(inputs.scattered)}
        none = np.zeros(xi.shape[:2])
        values = inputs.values(alpha, experiments)
        own = tuple(
            _of_classes(law, values[i], theta[..., place[i]] if i in place else none, classes)
            for i, (law, classes) in enumerate(
                zip(inputs.laws.values(), inputs.classes.T, strict=True)
            )
        )
        x = np.empty((*none.shape, len(own)))
        for i, part in enumerate(own):
            x[..., i] = part.x
        each = xi.shape[1] // len(inputs.classes)
        log_weight = np.repeat(_log_weights(inputs, values), each, axis=1)
        return cls(inputs, xi, theta, x, own, log_weight, mixing, slope, values, alpha, experiments)

    def by_variates(self) -> Array:
        """dx/dxi (B, J, n, s)."""
        slopes = np.zeros((*self.x.shape, self.xi.shape[2]))
        for s, i in enumerate(self.inputs.scattered):
            slopes[:, :, i] = self.own[i].dtheta[..., None] * self.mixing[s]
        return slopes

    @property
    def normal_scores(self) -> Array:
        """The variates (B, J, s) of the whole laws: theta, but for mixtures, which have parts."""
        found = self.theta
        for s, i in enumerate(self.inputs.scattered):
            law = list(self.inputs.laws.values())[i]
            if not isinstance(law, Mixture):
                continue
            found = found.copy()
            found[..., s] = law.normal_score(self.values[i], self.x[..., i])
            components = self.inputs.classes[:, i]
            for part, c in zip(_parts(found.shape[1], len(components)), components, strict=True):
                if c in law.points:
                    own = self.theta[:, part, s]
                    found[:, part, s] = law.normal_score_within(self.values[i], int(c), own)
        return found

    def score(self, gradient: Array, share: Array) -> Array:
        """sum_j g_j dx_j/dalpha + share_j dlog w_j/dalpha (B, K), xi held.

        The gradient g is by x (B, J, n), and w is the probability of each point's class.
        """
        first = self.inputs.partials.start
        found = np.zeros((len(self.x), self.inputs.size))
        found[:, :first] = self._score_of_laws(gradient, share)
        for k in range(self.mixing_slope.shape[2]):
            moved = self.xi @ self.mixing_slope[:, :, k].T
            for s, i in enumerate(self.inputs.scattered):
                if np.any(self.mixing_slope[s, :, k]):
                    by_theta = gradient[..., i] * self.own[i].dtheta
                    found[:, first + k] += np.sum(by_theta * moved[..., s], axis=1)
        return found

    def _score_of_laws(self, gradient: Array, share: Array) -> Array:
        """The part of the score by what is not a correlation."""
        by_values = np.concatenate(
            [
                np.einsum("bj,bjk->bk", gradient[..., i], own.dvalues)
                for i, own in enumerate(self.own)
            ],
            axis=1,
        )
        if len(self.inputs.classes) > 1:
            by_values += self._score_of_classes(share)
        model = self.inputs.covariate_model
        if model is None:
            return by_values
        return model.score(self.alpha, by_values, self.experiments)

    def _score_of_classes(self, share: Array) -> Array:
        """sum_c p_c dlog w_c/dvalues (B, H), p the share of each class."""
        classes = self.inputs.classes
        of_class = share.reshape(len(share), len(classes), -1).sum(axis=2)
        found = []
        for law, values, own in zip(self.inputs.laws.values(), self.values, classes.T, strict=True):
            each = np.zeros((len(share), len(law.hyperparameters)))
            if isinstance(law, Mixture):
                slopes = law.log_weights(values)[1][own].reshape(len(classes), each.shape[1], -1)
                whole = np.broadcast_to(slopes, (*slopes.shape[:2], len(share)))
                each += np.einsum("bc,ckb->bk", of_class, whole)
            found.append(each)
        return np.concatenate(found, axis=1)


def parameters_at(
    inputs: Inputs, alpha: Array, xi: Array, experiments: slice, *, often: bool
) -> tuple[Array, Array]:
    """`x` and `log_weight` of `Individual.of`, in less time: no derivatives.

    `often` is whether the same laws are asked for at many other variates too.
    """
    if inputs.covariate_model is not None or len(inputs.classes) > 1:
        found = Individual.of(inputs, alpha, xi, experiments)
        return found.x, found.log_weight
    theta = xi @ _mixing(inputs, alpha)[0].T if inputs.correlation.members else xi
    values = inputs.values(alpha, experiments)
    x = np.empty((*xi.shape[:2], len(values)))
    place = {i: s for s, i in enumerate(inputs.scattered)}
    for i, own in enumerate(values):
        at = theta[..., place[i]] if i in place else np.zeros(1)
        x[..., i] = image_at(inputs, i, own, at, often=often and i in place)
    return x, _log_weights(inputs, values)


def drawn(inputs: Inputs, alpha: Array, count: int, rng: np.random.Generator) -> Array:
    """Parameters (N, n) of so many experiments, one draw of its own law for each."""
    classes = len(inputs.classes)
    xi = np.repeat(rng.standard_normal((count, 1, inputs.scattering)), classes, axis=1)
    found = Individual.of(inputs, alpha, xi, slice(0, count))
    if classes == 1:
        return found.x[:, 0]
    reached = np.cumsum(np.exp(np.broadcast_to(found.log_weight, (count, classes))), axis=1)
    chosen = np.sum(reached[:, :-1] < rng.random((count, 1)), axis=1)
    return np.asarray(found.x[np.arange(count), chosen])


def variates_of(inputs: Inputs, alpha: Array, x: Array, experiments: slice) -> Array:
    """The variates xi (B, C, s) whose image the parameters x (B, C, n) of C classes are.

    The inverse of `Individual.of`: xi = L^-1 theta with theta the normal scores of x; not finite
    beyond a law.
    """
    values = inputs.values(alpha, experiments)
    laws = list(inputs.laws.values())
    theta = np.empty((*x.shape[:2], inputs.scattering))
    for s, i in enumerate(inputs.scattered):
        for c, component in enumerate(inputs.classes[:, i]):
            law, own, _ = _component(laws[i], values[i], component)
            theta[:, c, s] = law.normal_score(own, x[:, c, i, None])[:, 0]
    return np.asarray(theta @ np.linalg.inv(_mixing(inputs, alpha)[0]).T)


def _parts(count: int, classes: int) -> list[slice]:
    """Which of so many points are those of each class."""
    each = count // classes
    return [slice(c * each, (c + 1) * each) for c in range(classes)]


def _of_classes(law: Law, values: Array, theta: Array, components: Indices) -> Standard:
    """The image of theta (B, J), whose C parts belong to these components of the law."""
    if not isinstance(law, Mixture):
        return _standard(law, values, theta)
    found = []
    for part, component in zip(np.split(theta, len(components), axis=1), components, strict=True):
        own_law, own_values, place = _component(law, values, component)
        own = _standard(own_law, own_values, part)
        dvalues = np.zeros((*part.shape, len(law.hyperparameters)))
        dvalues[..., place] = own.dvalues
        found.append((own.x, own.dtheta, dvalues))
    return Standard(*(np.concatenate(parts, axis=1) for parts in zip(*found, strict=True)))


def _component(law: Law, values: Array, component: int) -> tuple[Law, Array, slice]:
    """The law of one component, its values and where among the law's they are."""
    if not isinstance(law, Mixture):
        return law, values, slice(0, len(values))
    place = law.parts[component]
    return law.components[component], values[place], place


def _log_weights(inputs: Inputs, values: tuple[Array, ...]) -> Array:
    """log of the probability of each class, (B, C), or (1, C) where it is the same in all."""
    found = np.zeros((1, len(inputs.classes)))
    for law, own, components in zip(inputs.laws.values(), values, inputs.classes.T, strict=True):
        if isinstance(law, Mixture):
            found = found + law.log_weights(own)[0][components].reshape(components.size, -1).T
    return found


def _mixing(inputs: Inputs, alpha: Array) -> tuple[Array, Array]:
    """L (s, s) of theta = L xi over all scattering parameters, and dL/d partial (s, s, p)."""
    s, members = inputs.scattering, list(inputs.correlation.members)
    partial = alpha[inputs.partials]
    mixing, slope = np.eye(s), np.zeros((s, s, partial.size))
    if members:
        factor, by_partial = inputs.correlation.cholesky(partial)
        mixing[np.ix_(members, members)] = factor
        slope[np.ix_(members, members, range(partial.size))] = by_partial
    return mixing, slope


def _standard(law: Law, values: Array, theta: Array) -> Standard:
    """The image of theta (B, J), with dvalues (B, J, k)."""
    if values.ndim > 1:
        return law.standard(values, theta)
    # a law from elsewhere may know flat variates only
    found = law.standard(values, theta.ravel())
    shape = theta.shape
    return Standard(
        found.x.reshape(shape), found.dtheta.reshape(shape), found.dvalues.reshape(*shape, -1)
    )
