"""The joint law of the parameters, x = T(theta | alpha), for all experiments or for single ones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from scipy import special

from aleator.core.threads import single_threaded
from aleator.core.types import Array, Indices
from aleator.errors import InputsError
from aleator.laws.correlation import Correlation, Pair, between
from aleator.laws.covariates import CovariateModel, Table, variables
from aleator.laws.hyperparameter import Hyperparameter, Specification
from aleator.laws.images import IMAGES, image_at
from aleator.laws.law import Law, Standard, require_law
from aleator.laws.levels import Grouping, checked_levels
from aleator.laws.marginals import Normal
from aleator.laws.mixture import Mixture

STANDARD_NORMAL: Law = Normal(0.0, 1.0)
"""The law of the standard normal variate whose image a correlated parameter is."""


class Inputs:
    """The uncertain parameters: a marginal law for each name, and correlations between them.

    alpha (K,) holds the hyperparameters of all laws, fixed ones included, named
    ``<parameter>.<hyperparameter>``, and after them the correlations. Parameters are independent
    except for the pairs in `correlation`, each a number or `Free(lower, upper)` within [-1, 1]. The
    joint law of correlated parameters is a Gaussian copula: x_i = F_i^-1(Phi(theta_i)), where the
    normal variates theta have the correlation. For normal laws this is the multivariate normal law.
    Correlated parameters have the quadrature nodes and the polynomials of theta. For more than two
    of them see `aleator.laws.correlation.between`. Raises InputsError when there is no parameter,
    when a name is not an identifier or its law lacks a member of `Law`, and for a pair or limits
    that are inadmissible.

    >>> from aleator.laws import Constant, Free, Normal
    >>> inputs = Inputs({"v": Normal(mean=Free(-1, 1), sd=0.5), "b0": Constant(2.0)})
    >>> [h.name for h in inputs.hyperparameters]
    ['v.mean', 'v.sd', 'b0.value']
    >>> tied = Inputs({"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0)}, {("a", "b"): Free(-0.9, 0.9)})
    >>> tied.hyperparameters[-1].name
    'correlation.a.b'
    >>> tied.correlation_matrix(np.array([0.0, 1.0, 0.0, 1.0, 0.6])).tolist()
    [[1.0, 0.6], [0.6, 1.0]]

    Laws may follow covariates (see `By`), so that each experiment has a law of its own. `resolved`
    then applies them to a table of covariates, and `Individual` evaluates them. Methods that need
    one law for all experiments raise InputsError.

    `levels` names the column of the table by which a parameter is grouped: experiments with the
    same entry share one draw of it. Levels are nested, as casks within batches, or crossed.
    `resolved` takes the groups from a table too.

    >>> batches = Inputs({"a": Normal(0.0, 1.0), "b": Normal(0.0, 2.0)}, levels={"b": "batch"})
    >>> batches.columns, batches.individual_laws
    (('batch',), True)
    """

    def __init__(
        self,
        laws: Mapping[str, Law],
        correlation: Mapping[Pair, Specification] | None = None,
        levels: Mapping[str, str] | None = None,
    ) -> None:
        if not laws:
            raise InputsError("no parameter is given", "name at least one parameter with a law")
        for name, law in laws.items():
            if not name.isidentifier():
                raise InputsError(
                    f"parameter name '{name}' is not an identifier",
                    "use letters, digits and underscores, not starting with a digit",
                )
            require_law(law, f"parameter '{name}'")
        self.laws = dict(laws)
        scattered = [name for name, law in laws.items() if law.scatters]
        self.correlation: Correlation = between(scattered, correlation or {})
        for i in self.correlated:
            if isinstance(self.law(i), Mixture):
                raise InputsError(
                    f"parameter '{self.names[i]}' is correlated with another, and its law is a "
                    "mixture",
                    "take the correlation away, or a law of one component",
                )
        self.levels = checked_levels(self.laws, [*(correlation or {})], levels or {})
        self.covariate_model: CovariateModel | None = None
        self.grouping: Grouping | None = None

    def __repr__(self) -> str:
        """The laws, and the correlations and levels if there are any."""
        more = [f"correlation={self.correlation!r}"] if self.correlation.pairs else []
        more += [f"levels={self.levels!r}"] if self.levels else []
        return f"Inputs({', '.join([repr(self.laws), *more])})"

    def law(self, i: int) -> Law:
        """The law of parameter i."""
        return list(self.laws.values())[i]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of the n parameters."""
        return tuple(self.laws)

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters in the order of alpha."""
        own = self._own if self.covariate_model is None else self.covariate_model.hyperparameters
        return (*own, *self.correlation.hyperparameters)

    @property
    def regressed(self) -> bool:
        """Whether a law follows covariates, so that experiments have laws of their own."""
        return any(h.by is not None for h in self._own)

    @property
    def covariates(self) -> tuple[str, ...]:
        """The names of the covariates in all formulas; InputsError where a formula is invalid."""
        found = [variables(h.by.formula, h.name) for h in self._own if h.by is not None]
        return tuple(dict.fromkeys(name for names in found for name in names))

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of the table that the laws need: covariates, and levels of parameters."""
        return tuple(dict.fromkeys([*self.covariates, *self.levels.values()]))

    @property
    def individual_laws(self) -> bool:
        """Whether experiments differ in their laws, or share parameters: `resolved` says how."""
        return self.regressed or bool(self.levels)

    def resolved(self, covariates: Table) -> Inputs:
        """The joint laws of experiments with these covariates; each row is one experiment.

        Each `By` becomes the coefficients of its formula, named ``k.mean[Intercept]``,
        ``k.mean[temperature]``, ``k.mean[supplier=b]``. If these inputs are resolved already, the
        result has the same coefficients and is for the experiments of the new table. Raises
        InputsError for an unknown name in a formula, a missing value, a level that only one
        experiment has, columns that are linearly dependent and, in a new table, a level that the
        first one does not have. A level whose column the table lacks makes each experiment a group.

        >>> from aleator.laws import By, Normal
        >>> import pandas as pd
        >>> table = pd.DataFrame({"t": [0.0, 1.0, 2.0]})
        >>> inputs = Inputs({"k": Normal(By("1 + t", 0.0, 10.0), 1.0)}).resolved(table)
        >>> [h.name for h in inputs.hyperparameters]
        ['k.mean[Intercept]', 'k.mean[t]', 'k.sd']
        >>> [values.tolist() for values in inputs.values(np.array([1.0, 2.0, 0.5]), slice(1, 3))]
        [[[[3.0], [5.0]], [[0.5], [0.5]]]]
        """
        if not self.individual_laws:
            return self
        found = copy(self)
        if self.levels:
            found.grouping = self._grouped(covariates)
        if not self.regressed:
            return found
        # The cached hyperparameters are those of the laws without a table.
        found.__dict__.pop("hyperparameters", None)
        known = self.covariate_model
        found.covariate_model = (
            CovariateModel.of(self._own, covariates) if known is None else known.at(covariates)
        )
        return found

    def _grouped(self, table: Table) -> Grouping:
        """The groups of the experiments; without the column of a level each is a group."""
        alone, levels = np.arange(len(table)), dict.fromkeys(self.levels.values())
        columns = {n: np.asarray(table[n]) if n in table else alone for n in levels}
        return Grouping.by(columns, [self.levels.get(self.names[i]) for i in self.scattered])

    @property
    def size(self) -> int:
        """The number K of entries of alpha, without those of the noise."""
        return len(self.hyperparameters)

    @cached_property
    def box(self) -> Array:
        """Limits (n, 2) that contain every quadrature node for every admissible alpha."""
        return np.array([law.box for law in self.laws.values()])

    @property
    def bounded(self) -> bool:
        """Whether the user stated the range of every parameter."""
        return all(law.bounded for law in self.laws.values())

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """The places of each law's hyperparameters in alpha.

        Raises InputsError where laws follow covariates, because alpha then has coefficients.
        """
        if self.regressed:
            raise InputsError(
                "laws that follow covariates differ between experiments",
                "ask for the laws of experiments: individual(alpha, xi, experiments)",
            )
        return self.parts

    @cached_property
    def parts(self) -> tuple[slice, ...]:
        """The places of each law's hyperparameters among those of all laws, before covariates."""
        ends = np.cumsum([len(law.hyperparameters) for law in self.laws.values()]).tolist()
        return tuple(slice(a, b) for a, b in zip([0, *ends[:-1]], ends, strict=True))

    @property
    def scattering(self) -> int:
        """The number of parameters that vary between experiments."""
        return len(self.scattered)

    @cached_property
    def scattered(self) -> tuple[int, ...]:
        """The indices of the parameters that vary between experiments."""
        return tuple(i for i, law in enumerate(self.laws.values()) if law.scatters)

    @cached_property
    def classes(self) -> Indices:
        """The number of the mixture component of each law (C, n) in each of C classes.

        A class is one combination of components of all mixtures. Without mixtures there is one
        class.
        """
        counts = [
            len(law.components) if isinstance(law, Mixture) else 1 for law in self.laws.values()
        ]
        return np.array(list(product(*(range(count) for count in counts))), dtype=np.intp)

    @cached_property
    def correlated(self) -> tuple[int, ...]:
        """The indices of the parameters that are correlated, in the order of `correlation`."""
        return tuple(self.scattered[i] for i in self.correlation.members)

    def correlation_matrix(self, alpha: Array) -> Array:
        """The correlation matrix R (n, n) of the normal variates theta.

        For normal laws R is also the correlation matrix of x. For any continuous laws the rank
        correlations are 6/pi arcsin(R/2).
        """
        matrix = np.eye(len(self.names))
        at = np.ix_(self.correlated, self.correlated)
        matrix[at] = self.correlation.matrix(alpha[self.partials])[0]
        return matrix

    def correlation_slope(self, alpha: Array) -> Array:
        """The derivative dR/dalpha (n, n, K) of the correlation matrix, for standard errors."""
        n = len(self.names)
        slope = np.zeros((n, n, self.size))
        at = np.ix_(self.correlated, self.correlated, range(*self.partials.indices(self.size)))
        slope[at] = self.correlation.matrix(alpha[self.partials])[1]
        return slope

    @single_threaded
    def image(self, alpha: Array, xi: Array) -> tuple[Array, Array]:
        """Parameters x (J, n) of independent standard normal xi (J, scattering), and dx/dalpha.

        x_i = F_i^-1(Phi(theta_i) | alpha), where theta is xi itself, or L xi for correlated
        parameters. x is smooth in alpha for fixed xi, and `dx` (J, n, K) is its exact derivative.

        >>> from aleator.laws import Normal
        >>> x, dx = Inputs({"v": Normal(1.0, 0.5)}).image(np.array([1.0, 0.5]), np.array([[2.0]]))
        >>> x.tolist(), dx.tolist()
        ([[2.0]], [[[1.0, 2.0]]])
        """
        count, n = xi.shape[0], len(self.names)
        theta = np.zeros((n, count))
        theta[list(self.scattered)] = xi.T
        x, dx = zeros(count, n, self.size)
        for i, (law, part) in enumerate(zip(self.laws.values(), self.slices, strict=True)):
            if i not in self.correlated:
                own = law.standard(alpha[part], theta[i])
                x[:, i] = own.x
                dx[:, i, part] = own.dvalues
        if self.correlated:
            at = list(self.correlated)
            x[:, at], dx[:, at] = self.tied(alpha, theta[at].T)
        return x, dx

    def tied(self, alpha: Array, theta: Array) -> tuple[Array, Array]:
        """The m correlated parameters x (J, m) of standard normal theta (J, m), and dx/dalpha.

        The entries of theta are independent: x_i = F_i^-1(Phi((L theta)_i)) with R = L L'. The
        parameters are in the order of `correlated`. dx (J, m, K) is the derivative at fixed theta.

        >>> from aleator.laws import Normal
        >>> pair = Inputs({"a": Normal(1.0, 2.0), "b": Normal(0.0, 1.0)}, {("a", "b"): 0.6})
        >>> pair.tied(np.array([1.0, 2.0, 0.0, 1.0, 0.6]), np.ones((1, 2)))[0].round(9).tolist()
        [[3.0, 1.4]]
        """
        factor, slope = self.correlation.cholesky(alpha[self.partials])
        mixed = factor @ theta.T
        x, dx = zeros(theta.shape[0], len(self.correlated), self.size)
        for row, i in enumerate(self.correlated):
            own = self.law(i).standard(alpha[self.slices[i]], mixed[row])
            x[:, row] = own.x
            dx[:, row, self.slices[i]] = own.dvalues
            for k in np.flatnonzero(np.any(slope[row], axis=0)):
                dx[:, row, self.partials.start + k] = own.dtheta * (theta @ slope[row, :, k])
        return x, dx

    def independent(self, alpha: Array) -> tuple[tuple[Law, ...], tuple[Array, ...]]:
        """The laws, and their hyperparameters, of n independent variables that determine x.

        The variable of an independent parameter is the parameter itself, with its law. The variable
        of a correlated parameter is a standard normal variate, from which `tied` computes x.
        Products of polynomials that are orthonormal under these laws are so under the joint law.
        """
        tied = set(self.correlated)
        laws = [STANDARD_NORMAL if i in tied else law for i, law in enumerate(self.laws.values())]
        values = [
            np.array([0.0, 1.0]) if i in tied else alpha[part] for i, part in enumerate(self.slices)
        ]
        return tuple(laws), tuple(values)

    def marginal(self, alpha: Array, probability: Array) -> Array:
        """The quantiles (R, n) of each parameter's marginal law at probabilities (R, n)."""
        columns = [
            law.quantile(alpha[part], probability[:, i])
            for i, (law, part) in enumerate(zip(self.laws.values(), self.slices, strict=True))
        ]
        return np.stack(columns, axis=1)

    def sample(self, alpha: Array, uniform: Array) -> Array:
        """Parameters (R, n) of the joint law from independent uniform numbers (R, n)."""
        x = self.marginal(alpha, uniform)
        if self.correlated:
            at = list(self.correlated)
            theta = special.ndtri(np.clip(uniform[:, at], 1e-300, 1.0 - 2.0**-53))
            x[:, at], _ = self.tied(alpha, theta)
        return x

    def values(self, alpha: Array, experiments: slice) -> tuple[Array, ...]:
        """Each law's hyperparameters in B experiments: (k,), or (k, B, 1) with covariates.

        Raises InputsError where laws follow covariates and no table was given (see `resolved`).
        """
        if self.covariate_model is not None:
            return tuple(
                self.covariate_model.values(alpha, part, experiments) for part in self.parts
            )
        return tuple(alpha[part] for part in self.slices)

    def of_experiment(self, alpha: Array, experiment: int) -> tuple[Inputs, Array]:
        """The joint law of one experiment: inputs without covariates, and their alpha."""
        if self.covariate_model is None:
            return self, alpha
        one = self.values(alpha, slice(experiment, experiment + 1))
        found = copy(self)
        found.covariate_model = None
        for name in ("hyperparameters", "slices", "parts"):
            found.__dict__.pop(name, None)
        found.__dict__["_own"] = tuple(replace(h, by=None) for h in self._own)
        own = [np.ravel(values) for values in one]
        return found, np.concatenate([*own, alpha[self.partials]])

    def centered(self, x: Array) -> Array:
        """The alpha (K,) of laws centered at the point x (n,); other values are at their starts."""
        alpha = np.array([h.start for h in self.hyperparameters])
        wanted = [law.filling(value) for law, value in zip(self.laws.values(), x, strict=True)]
        own = np.concatenate(wanted)
        model = self.covariate_model
        alpha[: self.partials.start] = own if model is None else model.coefficients_for(own)
        return alpha

    def filling(self, region: Array, widths: float) -> Array:
        """The alpha (K,) of laws centered in a region (n, 2), with sd = width / `widths`."""
        alpha = np.array([h.start for h in self.hyperparameters])
        for law, part, (low, high) in zip(self.laws.values(), self.slices, region, strict=True):
            alpha[part] = law.filling(0.5 * (low + high), (high - low) / widths)
        return alpha

    def individual(self, alpha: Array, xi: Array, experiments: slice) -> Individual:
        """The parameters of B experiments at J standard normal variates xi (B, J, s) of each."""
        return Individual.of(self, alpha, xi, experiments)

    def log_density(self, alpha: Array, x: Array) -> Array:
        """The log-density log p(x | alpha) at each x (J, n), minus infinity outside the support.

        It is the sum of the marginal log-densities and, for correlated parameters, the log-density
        of the Gaussian copula: -1/2 log det R - 1/2 theta' (R^-1 - I) theta with the normal scores
        theta of x (Song, 2000). A constant contributes the logarithm of its probability: zero at
        its value, minus infinity elsewhere. Cost O(J n). Raises InputsError where a correlation is
        1 or -1, because the law then has no density.

        >>> from aleator.laws import Normal
        >>> pair = Inputs({"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0)}, {("a", "b"): 0.6})
        >>> alpha = np.array([0.0, 1.0, 0.0, 1.0, 0.6])
        >>> pair.log_density(alpha, np.zeros((1, 2))).round(6).tolist()   # -log(2 pi 0.8)
        [-1.614734]
        """
        return self.log_density_of(range(len(self.laws)), alpha, x, self.normal_scores(alpha, x))

    def log_density_of(self, some: Iterable[int], alpha: Array, x: Array, scores: Array) -> Array:
        """The sum (J,) of the log-densities of some parameters and of the copula.

        The `scores` (m, J) are the normal scores of the m correlated parameters (see
        `normal_scores`).
        """
        found = self.correlation.log_density(alpha[self.partials], scores)
        for i in some:
            found += self.law(i).log_density(alpha[self.slices[i]], x[:, i])
        return found

    def normal_scores(self, alpha: Array, x: Array) -> Array:
        """The normal scores (m, J) of the m correlated parameters at x (J, n)."""
        found = np.empty((len(self.correlated), len(x)))
        for row, i in zip(found, self.correlated, strict=True):
            row[:] = self.normal_score(i, alpha, x)
        return found

    def normal_score(self, i: int, alpha: Array, x: Array) -> Array:
        """The normal score (J,) of parameter i at x (J, n)."""
        return self.law(i).normal_score(alpha[self.slices[i]], x[:, i])

    @cached_property
    def _own(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters of the laws, before formulas of covariates become coefficients."""
        return tuple(h.named(name) for name, law in self.laws.items() for h in law.hyperparameters)

    @property
    def partials(self) -> slice:
        """The places of the partial correlations in alpha."""
        return slice(self.size - len(self.correlation.hyperparameters), self.size)


def zeros(count: int, n: int, size: int) -> tuple[Array, Array]:
    """Arrays of zeros for x (J, n) and dx (J, n, K), where each dx[:, i, k] is one piece of memory.

    x_i depends only on the hyperparameters of its own law; with this layout the memory for all
    other derivatives is never touched.
    """
    return np.zeros((n, count)).T, np.zeros((n, size, count)).transpose(2, 0, 1)


@dataclass(frozen=True, eq=False)
class Individual:
    """Parameters x (B, J, n) of B experiments at J standard normal variates xi (B, J, s) of each.

    x = T(xi | alpha): each parameter is the image of a variate in `theta` (B, J, s), and theta =
    L xi makes the correlations (see `Inputs`). x is smooth in alpha for fixed xi, whatever the
    support of a law. With mixtures an experiment belongs to one of C classes (`Inputs.classes`).
    The first J/C points are then those of the first class, and so on; `log_weight` (B or 1, J) is
    the logarithm of the probability of each point's class.
    """

    inputs: Inputs
    xi: Array
    theta: Array
    x: Array
    images: tuple[Standard, ...]
    log_weight: Array
    mixing: Array
    mixing_slope: Array
    values: tuple[Array, ...]
    alpha: Array
    experiments: slice

    @classmethod
    def of(cls, inputs: Inputs, alpha: Array, xi: Array, experiments: slice) -> Individual:
        """The parameters at the variates under the laws alpha (K,) of the given experiments."""
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
        """The derivatives dx/dxi (B, J, n, s) of the parameters by the variates."""
        slopes = np.zeros((*self.x.shape, self.xi.shape[2]))
        for s, i in enumerate(self.inputs.scattered):
            slopes[:, :, i] = self.images[i].dtheta[..., None] * self.mixing[s]
        return slopes

    @property
    def normal_scores(self) -> Array:
        """The normal scores (B, J, s) of the parameters under their complete laws.

        They equal theta, except for mixtures, where theta belongs to one component.
        """
        found = self.theta
        for s, i in enumerate(self.inputs.scattered):
            law = self.inputs.law(i)
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
        """The derivative (B, K) by alpha of a weighted sum over the points, for fixed xi.

        It is sum_j g_j dx_j/dalpha + share_j dlog w_j/dalpha, with the `gradient` g (B, J, n) by x,
        the `share` (B, J) of each point, and the probability w of each point's class.
        """
        first = self.inputs.partials.start
        found = np.zeros((len(self.x), self.inputs.size))
        found[:, :first] = self._score_of_laws(gradient, share)
        for k in range(self.mixing_slope.shape[2]):
            moved = self.xi @ self.mixing_slope[:, :, k].T
            for s, i in enumerate(self.inputs.scattered):
                if np.any(self.mixing_slope[s, :, k]):
                    by_theta = gradient[..., i] * self.images[i].dtheta
                    found[:, first + k] += np.sum(by_theta * moved[..., s], axis=1)
        return found

    def _score_of_laws(self, gradient: Array, share: Array) -> Array:
        """The score (B, K') by all hyperparameters except the correlations."""
        by_values = np.concatenate(
            [
                np.einsum("bj,bjk->bk", gradient[..., i], own.dvalues)
                for i, own in enumerate(self.images)
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
        """The part sum_c p_c dlog w_c/dvalues (B, H) of the score; p_c is the share of class c."""
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
    """The parameters x and log weights of `Individual.of`, without derivatives and thus faster.

    `often` says that the same laws will be evaluated at many more variates, so that a table of each
    law is worth its cost.
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
    """Random parameters (N, n) of N = `count` experiments, each drawn from its own law.

    Experiments of a group share the parameters of its level.
    """
    classes, xi = len(inputs.classes), rng.standard_normal((count, 1, inputs.scattering))
    xi = np.repeat(xi if inputs.grouping is None else inputs.grouping.shared(xi), classes, axis=1)
    found = Individual.of(inputs, alpha, xi, slice(0, count))
    if classes == 1:
        return found.x[:, 0]
    reached = np.cumsum(np.exp(np.broadcast_to(found.log_weight, (count, classes))), axis=1)
    chosen = np.sum(reached[:, :-1] < rng.random((count, 1)), axis=1)
    return np.asarray(found.x[np.arange(count), chosen])


def variates_of(inputs: Inputs, alpha: Array, x: Array, experiments: slice) -> Array:
    """The variates xi (B, C, s) that are mapped to the parameters x (B, C, n) of C classes.

    This is the inverse of `Individual.of`: xi = L^-1 theta, where theta are the normal scores of x.
    They are not finite where x lies outside the support of its law.
    """
    values = inputs.values(alpha, experiments)
    theta = np.empty((*x.shape[:2], inputs.scattering))
    for s, i in enumerate(inputs.scattered):
        for c, component in enumerate(inputs.classes[:, i]):
            law, own, _ = _component(inputs.law(i), values[i], component)
            theta[:, c, s] = law.normal_score(own, x[:, c, i, None])[:, 0]
    return np.asarray(theta @ np.linalg.inv(_mixing(inputs, alpha)[0]).T)


def _parts(count: int, classes: int) -> list[slice]:
    """The slice of each class among `count` points, which are in the order of the classes."""
    each = count // classes
    return [slice(c * each, (c + 1) * each) for c in range(classes)]


def _of_classes(law: Law, values: Array, theta: Array, components: Indices) -> Standard:
    """The parameters at theta (B, J), whose C equal parts belong to the given components."""
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
    """The law of one component of a mixture, its values, and their places among all values."""
    if not isinstance(law, Mixture):
        return law, values, slice(0, len(values))
    place = law.parts[component]
    return law.components[component], values[place], place


def _log_weights(inputs: Inputs, values: tuple[Array, ...]) -> Array:
    """The log probability of each class (B, C), or (1, C) if it is equal in all experiments."""
    found = np.zeros((1, len(inputs.classes)))
    for law, own, components in zip(inputs.laws.values(), values, inputs.classes.T, strict=True):
        if isinstance(law, Mixture):
            found = found + law.log_weights(own)[0][components].reshape(components.size, -1).T
    return found


def _mixing(inputs: Inputs, alpha: Array) -> tuple[Array, Array]:
    """The matrix L (s, s) of theta = L xi for all scattering parameters, and its derivatives.

    The derivatives (s, s, p) are by the p partial correlations.
    """
    s, members = inputs.scattering, list(inputs.correlation.members)
    partial = alpha[inputs.partials]
    mixing, slope = np.eye(s), np.zeros((s, s, partial.size))
    if members:
        factor, by_partial = inputs.correlation.cholesky(partial)
        mixing[np.ix_(members, members)] = factor
        slope[np.ix_(members, members, range(partial.size))] = by_partial
    return mixing, slope


def _standard(law: Law, values: Array, theta: Array) -> Standard:
    """The parameters at theta (B, J) under one law, with their derivatives."""
    if values.ndim > 1:
        return law.standard(values, theta)
    # A law written by a user may accept only one-dimensional arrays of variates.
    found = law.standard(values, theta.ravel())
    shape = theta.shape
    return Standard(
        found.x.reshape(shape),
        found.dtheta.reshape(shape),
        found.dvalues.reshape(*shape, found.dvalues.shape[-1]),
    )


def law_region(inputs: Inputs, alphas: list[Array], tail: float = IMAGES.region) -> Array:
    """The smallest region (n, 2) that contains the laws of all given alphas except their tails.

    >>> from aleator.laws import Constant, Normal
    >>> inputs = Inputs({"v": Normal(0.0, 1.0), "b": Constant(2.0)})
    >>> law_region(inputs, [np.array([0.0, 1.0, 2.0])]).round(2).tolist()
    [[-5.2, 5.2], [2.0, 2.0]]
    """
    ends = np.array([[tail] * len(inputs.names), [1.0 - tail] * len(inputs.names)])
    x = np.concatenate([inputs.marginal(alpha, ends) for alpha in alphas])
    return np.stack([x.min(axis=0), x.max(axis=0)], axis=1)
