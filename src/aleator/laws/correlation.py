"""Correlation of parameters by a Gaussian copula.

The correlated parameters are images of the normal variates theta = L(rho) xi, where xi are
independent standard normal variates. The identified quantities are the partial correlations rho of
a canonical vine (Bedford and Cooke, 2002; Joe, 2006; Lewandowski, Kurowicka and Joe, 2009). Each of
them may take any value in [-1, 1] whatever the others are: R = L L' is always a valid correlation
matrix.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
from scipy import linalg

from aleator.core.types import Array
from aleator.errors import InputsError, nearest
from aleator.laws.hyperparameter import OPEN, Hyperparameter, Specification, resolve

Pair = tuple[str, str]


@dataclass(frozen=True)
class CorrelationLimits:
    """Settings for the limits of correlations. The values are chosen by judgement.

    widest: the largest size of a correlation for which the user states no limits; two parameters
    whose correlation is closer to one are practically the same. steepest: the smallest value that
    sqrt(1 - rho^2) takes in derivatives, because they are infinite at perfect correlation.
    """

    widest: float = 0.99
    steepest: float = 1e-8


LIMITS = CorrelationLimits()


@dataclass(frozen=True)
class Correlation:
    """The correlated parameters and their partial correlations.

    `members` (m,) are the indices of the correlated parameters, in the order of the vine. `pairs`
    (p,) has one (row, column) for each partial correlation, with column < row; both count in the
    order of the vine. It is the correlation of the members at row and column, given all members
    before the column. A pair that is not listed has partial correlation zero. `hyperparameters`
    (p,) are those of the `pairs`.
    """

    members: tuple[int, ...]
    pairs: tuple[tuple[int, int], ...]
    hyperparameters: tuple[Hyperparameter, ...]

    def cholesky(self, partial: Array) -> tuple[Array, Array]:
        """The lower triangular L (m, m) of R = L L', and its derivatives (m, m, p).

        The derivatives are by the partial correlations, `partial` (p,).
        With r_ij the partial correlation of i and j given 1..j-1, and s_ij = sqrt(1 - r_ij^2):
        L_ij = r_ij prod_(k < j) s_ik and L_ii = prod_(k < i) s_ik (Lewandowski, Kurowicka and Joe,
        2009, sec. 2.4). Cost O(p m).

        >>> from aleator.laws import Free
        >>> two = between(("a", "b"), {("a", "b"): Free(-1.0, 1.0)})
        >>> factor, _ = two.cholesky(np.array([0.6]))
        >>> factor.round(12).tolist()
        [[1.0, 0.0], [0.6, 0.8]]
        """
        return _factor(len(self.members), self.pairs, np.asarray(partial, np.float64).tobytes())

    def matrix(self, partial: Array) -> tuple[Array, Array]:
        """The correlation matrix R (m, m) of theta, and its derivatives (m, m, p).

        The derivatives are by the partial correlations, `partial` (p,).

        >>> three = between(("a", "b", "c"), dict.fromkeys([("a", "b"), ("a", "c")], 0.5))
        >>> three.matrix(np.array([0.5, 0.5]))[0].round(12).tolist()   # b, c independent given a
        [[1.0, 0.5, 0.5], [0.5, 1.0, 0.25], [0.5, 0.25, 1.0]]
        """
        factor, slope = self.cholesky(partial)
        half = np.einsum("ijk,lj->ilk", slope, factor)
        matrix = factor @ factor.T
        np.fill_diagonal(matrix, 1.0)
        return matrix, half + half.transpose(1, 0, 2)

    def log_density(self, partial: Array, theta: Array) -> Array:
        """The log-density (J,) of the Gaussian copula at normal scores theta (m, J).

        It is -1/2 log det R - 1/2 theta' (R^-1 - I) theta (Song, 2000), and minus infinity where a
        score is infinite, as at an end of its law. Raises InputsError where a correlation is 1 or
        -1.

        >>> pair = between(("a", "b"), {("a", "b"): 0.6})
        >>> pair.log_density(np.array([0.6]), np.zeros((2, 1))).round(6).tolist()   # -log 0.8
        [0.223144]
        """
        if not len(theta):
            return np.zeros(theta.shape[1])
        factor, _ = self.cholesky(partial)
        if not np.all(np.diag(factor) > 0.0):
            raise InputsError(
                "perfectly correlated parameters have no density", "keep correlations within 0.99"
            )
        inside = np.all(np.isfinite(theta), axis=0)
        xi = linalg.solve_triangular(factor, theta[:, inside], lower=True)
        found = np.full(theta.shape[1], -np.inf)
        found[inside] = 0.5 * np.sum(theta[:, inside] ** 2 - xi**2, axis=0)
        return np.asarray(found - np.log(np.diag(factor)).sum())


@lru_cache(maxsize=64)
def _factor(m: int, pairs: tuple[tuple[int, int], ...], partial: bytes) -> tuple[Array, Array]:
    """The factor of given partial correlations, which many blocks of experiments ask for."""
    r = np.eye(m)
    for (i, j), value in zip(pairs, np.frombuffer(partial), strict=True):
        r[i, j] = value
    # The product (1 - r)(1 + r) keeps its digits for a correlation near one.
    s = np.sqrt(np.tril((1.0 - r) * (1.0 + r), -1))
    before = np.ones((m, m))
    np.cumprod(s[:, :-1], axis=1, out=before[:, 1:])
    factor = np.tril(r * before)
    slope = np.zeros((m, m, len(pairs)))
    for k, (i, j) in enumerate(pairs):
        slope[i, j, k] = before[i, j]
        others = s[i].copy()
        others[j] = -r[i, j] / max(s[i, j], LIMITS.steepest)
        after = np.cumprod(others)[j:i]
        slope[i, j + 1 : i + 1, k] = r[i, j + 1 : i + 1] * after
    for array in (factor, slope):
        array.setflags(write=False)  # All callers share it.
    return factor, slope


def between(names: Sequence[str], pairs: Mapping[Pair, Specification]) -> Correlation:
    """The correlation of pairs of the named parameters; each a number, or `Free` to identify it.

    Parameters that are connected by pairs, directly or through others, form a group. In each group
    the parameter with most pairs comes first; equal counts keep the order of the parameters. A pair
    that contains the first parameter of its group has a plain correlation, ``correlation.a.b``.
    Any other pair has a partial correlation, given the parameters that come before both of its
    members: ``correlation.b.c.given.a``. Limits default to -0.99 and 0.99. Raises InputsError for a
    pair that is unknown, repeated or of one parameter, and for limits or numbers beyond [-1, 1].

    >>> from aleator.laws import Free
    >>> tied = between(("a", "b", "c"), {("c", "a"): Free(), ("a", "b"): Free(), ("b", "c"): 0.2})
    >>> [h.name for h in tied.hyperparameters]
    ['correlation.a.b', 'correlation.a.c', 'correlation.b.c.given.a']
    """
    wanted = {}
    for pair, specification in pairs.items():
        key = _checked(pair, names)
        if key in wanted:
            raise InputsError(
                f"the correlation of {names[key[0]]} and {names[key[1]]} is given twice",
                "keep one of the two",
            )
        wanted[key] = specification
    groups = _groups(wanted)
    members = tuple(i for group in groups for i in group)
    entries = []
    for group in groups:
        for a, i in enumerate(group):
            for j in group[a + 1 :]:
                key = (min(i, j), max(i, j))
                if key in wanted:
                    given = [names[k] for k in sorted(group[:a])]
                    place = (members.index(j), members.index(i))
                    entries.append((place, _hyperparameter(key, given, names, wanted[key])))
    return Correlation(members, tuple(e[0] for e in entries), tuple(e[1] for e in entries))


def full(names: Sequence[str]) -> dict[Pair, Specification]:
    """All pairs of the named parameters, each with a correlation that is to be identified.

    With normal laws this gives a full covariance matrix.

    >>> list(full(["a", "b", "c"]))
    [('a', 'b'), ('a', 'c'), ('b', 'c')]
    """
    return dict.fromkeys(combinations(names, 2), OPEN)


def _checked(pair: Pair, names: Sequence[str]) -> tuple[int, int]:
    if len(pair) != 2:
        raise InputsError(
            f"correlation of {pair!r}: this is not a pair", 'name two parameters: ("a", "b")'
        )
    for name in pair:
        if name not in names:
            raise InputsError(
                f"correlation of {pair[0]} and {pair[1]}: there is no parameter "
                f"'{name}' that scatters{nearest(name, names)}",
                f"the parameters that scatter are {', '.join(names) or 'none'}; "
                "a constant has no correlation",
            )
    if pair[0] == pair[1]:
        raise InputsError(f"correlation of {pair[0]} with itself", "name two different parameters")
    i, j = sorted(names.index(name) for name in pair)
    return i, j


def _groups(pairs: Mapping[tuple[int, int], object]) -> list[list[int]]:
    """Groups of parameters that are correlated directly or through others, in the vine's order."""
    ties: dict[int, set[int]] = {}
    for i, j in sorted(pairs):
        ties.setdefault(i, set()).add(j)
        ties.setdefault(j, set()).add(i)
    groups, left = [], set(ties)
    while left:
        group, reached = set(), {min(left)}
        while reached:
            group |= reached
            reached = set().union(*(ties[i] for i in reached)) - group
        left -= group
        groups.append(sorted(group, key=lambda i: (-len(ties[i]), i)))
    return groups


def _hyperparameter(
    pair: tuple[int, int],
    given: Sequence[str],
    names: Sequence[str],
    specification: Specification,
) -> Hyperparameter:
    label = ".".join(
        ["correlation", *(names[i] for i in pair), *(["given", *given] if given else [])]
    )
    found = resolve(label, specification, (-LIMITS.widest, LIMITS.widest))
    if found.lower < -1.0 or found.upper > 1.0:
        limits = f"[{found.lower:g}, {found.upper:g}]" if found.free else f"{found.start:g}"
        raise InputsError(f"{label}: {limits} is not within [-1, 1]", "keep between -1 and 1")
    return found
