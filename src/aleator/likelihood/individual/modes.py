"""Modes of the individual laws, and the interface of rules that place nodes about them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from aleator.core.types import Array, Flags
from aleator.likelihood.individual.clusters import Clusters


@dataclass(frozen=True)
class ModeSettings:
    """Settings for the search for modes of individual laws. The values are chosen by judgement.

    `arrived`: the search ends when a Newton step gains less than this in log-density. `near`: the
    same tolerance where nodes only need to lie about the mode, within a seventh of its width.
    `steps`: the largest number of Newton steps. `near_steps`: the largest number with the tolerance
    `near`. `raised` and `lowered`: the factors of the damping after a step without a gain and after
    one with a gain. `least_damping`: a smaller damping is set to zero. `stiff`: a damping that
    shortens steps about equally in all directions. `apart`: two modes that are closer than this, in
    standard deviations, count as one. `least_log_mass`: a mode is ignored if the logarithm of its
    probability, relative to the first mode, is below this. `farthest`: no step goes to larger
    variates, which have practically no probability. `starts`: values of each variate from which
    modes are sought, besides the last mode. `informed`: the information about a variate above which
    the observations say more than the law, whose part of the information is one.
    """

    arrived: float = 1e-6
    near: float = 1e-2
    steps: int = 30
    near_steps: int = 6
    raised: float = 4.0
    lowered: float = 0.25
    least_damping: float = 0.1
    stiff: float = 1024.0
    apart: float = 2.0
    least_log_mass: float = -7.0
    farthest: float = 8.0
    starts: tuple[float, ...] = (-2.0, -1.0, 1.0, 2.0)
    informed: float = 2.0


MODES = ModeSettings()


class Curved(Protocol):
    """A function that gives the log-density of variates z (B, P, s) with derivatives.

    It returns the value (B, P), the gradient (B, P, s) and the information: a positive definite
    approximation (B, P, s, s) of the negative Hessian.
    """

    def __call__(self, z: Array) -> tuple[Array, Array, Array]:
        """The log-density, gradient and information at P points of each of B experiments."""


Valued = Callable[[Array], Array]
"""A function that gives the log-density (B, P) of variates z (B, P, s)."""


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes z (B, ..., s), with the information (B, ..., s, s) and log-density (B, ...) there."""

    z: Array
    information: Array
    value: Array


def inner(a: Array, b: Array) -> Array:
    """The sums (...) of a_k b_k over the variates (..., s), one variate after the other.

    NumPy is up to twelve times as slow with a sum over the short rows of two or three variates.

    >>> inner(np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([1.0, 10.0])).tolist()
    [21.0, 43.0]
    """
    found = np.zeros(a.shape[:-1])
    for k in range(a.shape[-1]):
        found += a[..., k] * b[..., k]
    return found


def modes(
    log_density: Curved,
    start: Array,
    basis: Array | None = None,
    arrived: float = MODES.arrived,
    classes: int = 1,
    settings: ModeSettings = MODES,
) -> Modes:
    """The modes of individual laws, by Gauss-Newton steps from points `start` (B, P, s).

    With a `basis` (B, P, s, k), steps go only in the directions of its columns. Levenberg's damping
    is raised where a step does not gain and lowered where it does. The search ends when no point
    gains, or after the largest number of steps, without an error. Points that have converged are
    not computed again. The P points are sorted by
    mixture component (`classes`).
    """
    z = start
    value, gradient, information = log_density(z)
    damping = np.zeros(z.shape[:2])
    for _ in range(settings.steps if arrived < settings.near else settings.near_steps):
        slope, curvature = _within(gradient, information, basis)
        step = _damped_step(curvature, slope, damping[..., None, None], settings.stiff)
        gain = 0.5 * inner(slope, step)
        open_ = gain > arrived
        if not np.any(open_):
            break
        whole = step if basis is None else (basis @ step[..., None])[..., 0]
        trial = _reached(z, whole * open_[..., None], basis is None, settings.farthest)
        new_value, new_gradient, new_information = _of_some(log_density, trial, open_, classes)
        better = open_ & (new_value > value)
        z = np.where(better[..., None], trial, z)
        value = np.where(better, new_value, value)
        gradient = np.where(better[..., None], new_gradient, gradient)
        information = np.where(better[..., None, None], new_information, information)
        harder = np.where(open_, np.maximum(settings.raised * damping, 1.0), damping)
        eased = settings.lowered * damping * (damping > settings.least_damping)
        damping = np.where(better, eased, harder)
    return Modes(z, information, value)


def _damped_step(information: Array, slope: Array, damping: Array, stiff: float) -> Array:
    """Steps (B, P, k) by the information (B, P, k, k) and Levenberg's damping (B, P, 1, 1).

    In one direction the damping makes steps shorter. In several directions it is added to the
    information. Steps along a narrow ridge then become shorter, while steps back to the ridge do
    not. Where the noise is tiny the information across the ridge is so large that rounding makes
    that along it vanish: as much as rounding takes is added.
    """
    if slope.shape[-1] == 1:
        return np.asarray(slope / (information * (1.0 + damping))[..., 0])
    added = damping + (damping / stiff) ** 2 * information
    rounding = np.finfo(float).eps * np.trace(information, axis1=-2, axis2=-1)[..., None, None]
    damped = information + (added + rounding) * np.eye(slope.shape[-1])
    return np.asarray(np.linalg.solve(damped, slope[..., None])[..., 0])


def _of_some(
    log_density: Curved, z: Array, wanted: Flags, classes: int
) -> tuple[Array, Array, Array]:
    """The log-density with derivatives at the flagged points `wanted` (B, P); zeros elsewhere.

    The number of evaluated points is the same in every class, namely that of the class with most
    flagged points.
    """
    parts = wanted.reshape(len(wanted), classes, -1)
    most = int(parts.sum(axis=2).max())
    if most == parts.shape[2]:
        return log_density(z)
    first = parts.shape[2] * np.arange(classes)[:, None]
    which = np.argsort(~parts, axis=2, kind="stable")[..., :most] + first
    rows, columns = np.arange(len(z))[:, None], which.reshape(len(z), -1)
    found = []
    for part in log_density(z[rows, columns]):
        whole = np.zeros((*z.shape[:2], *part.shape[2:]))
        whole[rows, columns] = part
        found.append(whole)
    return found[0], found[1], found[2]


def _reached(z: Array, step: Array, everywhere: bool, farthest: float) -> Array:
    """The end of a step from z, limited by `farthest`.

    With `everywhere` each coordinate of the end is limited; otherwise the step is shortened and
    keeps its direction.
    """
    if everywhere:
        return np.clip(z + step, -farthest, farthest)
    length = np.max(np.abs(step), axis=-1, keepdims=True)
    return np.asarray(z + step * np.minimum(1.0, farthest / np.maximum(length, farthest)))


def highest(
    log_density: Curved,
    start: Array,
    count: int,
    arrived: float = MODES.arrived,
    settings: ModeSettings = MODES,
) -> Modes:
    """The M modes (B, C, M, s) with most probability among those reached from T starts.

    The starts are (B, C, T, s). Modes closer than two standard deviations count as one. A mode with
    less than a thousandth of the first one's probability is ignored. If there are fewer than M
    modes, the first one is repeated.
    """
    shape = start.shape[:3]
    flat = start.reshape(shape[0], -1, start.shape[3])
    found = modes(log_density, flat, arrived=arrived, classes=shape[1], settings=settings)
    z, value = found.z.reshape(start.shape), found.value.reshape(shape)
    information = found.information.reshape(*start.shape, start.shape[3])
    mass = value - 0.5 * np.linalg.slogdet(information)[1]
    mass = np.where(np.isfinite(mass), mass, -np.inf)
    least = mass.max(axis=2, keepdims=True) + settings.least_log_mass
    chosen = np.zeros((*shape[:2], count), dtype=np.intp)
    for m in range(count):
        best = np.argmax(mass, axis=2)[..., None]
        known = np.take_along_axis(mass, best, axis=2) > least
        chosen[..., m] = np.where(known, best, chosen[..., :1])[..., 0]
        here = np.take_along_axis(z, best[..., None], axis=2)
        about = np.take_along_axis(information, best[..., None, None], axis=2)[:, :, 0]
        away = np.einsum("bcts,bcsr,bctr->bct", z - here, about, z - here)
        mass = np.where(away < settings.apart**2, -np.inf, mass)
    return Modes(
        np.take_along_axis(z, chosen[..., None], axis=2),
        np.take_along_axis(information, chosen[..., None, None], axis=2),
        np.take_along_axis(value, chosen, axis=2),
    )


def _within(gradient: Array, information: Array, basis: Array | None) -> tuple[Array, Array]:
    if basis is None:
        return gradient, information
    across = np.swapaxes(basis, -1, -2)
    return (across @ gradient[..., None])[..., 0], across @ information @ basis


@dataclass(frozen=True, eq=False)
class IndividualLaws:
    """The individual laws of the B experiments from number `first` on, for a node rule.

    `curved` gives the log-density of their variates with derivatives, `valued` without. `modes` has
    M modes (B, C, M, s) of each of C classes, the highest first. Where experiments share variates,
    `clusters` says which; the law of a shared variate then counts once in the log-densities.
    """

    curved: Curved
    valued: Valued
    modes: Modes
    first: int
    clusters: Clusters | None = None


@dataclass(frozen=True, eq=False)
class PlacedNodes:
    """The nodes xi (B, J, s) of B experiments, with log weights (B, J).

    Where experiments share variates, these have Q nodes at each of L stages, and J is a multiple of
    Q_1 ... Q_L. `shared` (B, Q_1, ..., Q_L) has the log weights of these nodes, with the first
    experiment of each group and zero with the others.
    """

    xi: Array
    log_weight: Array
    shared: Array | None = None


class NodeRule(ABC):
    """Interface of rules that place nodes for the integral over an experiment's normal variates.

    `name` is the name in reports. `arrived` is the tolerance in log-density to which the rule needs
    its modes. `holds_parameters` says that nodes are stored as parameter values, and not as
    variates (see `Parameters`).
    """

    name: ClassVar[str]
    arrived: ClassVar[float] = MODES.arrived
    holds_parameters: ClassVar[bool] = False

    @property
    def centers(self) -> int:
        """The number M of modes of an experiment about which the nodes lie."""
        return 1

    @property
    def rough(self) -> NodeRule:
        """A rule with fewer nodes, accurate enough for statistics of many replicates."""
        return self

    @abstractmethod
    def size(self, dimensions: int, /) -> int:
        """The number J of nodes for which memory is needed while the nodes are computed."""

    def finer(self, dimensions: int, /) -> tuple[NodeRule, ...]:  # noqa: ARG002
        """Finer rules, whose differences from this one estimate its error."""
        return ()

    def refined(
        self,
        gaps: Sequence[float],  # noqa: ARG002
        enough: float,  # noqa: ARG002
        dimensions: int,  # noqa: ARG002
        /,
    ) -> NodeRule | None:
        """A rule with more nodes, if the differences `gaps` to the finer rules exceed `enough`.

        None where they do not, and where there would be too many nodes.
        """
        return None

    def gap(self, gaps: Sequence[float], dimensions: int, /) -> float:  # noqa: ARG002
        """The error estimate of this rule: the sum of the differences `gaps` to the finer rules."""
        return float(sum(gaps))

    @abstractmethod
    def place(self, laws: IndividualLaws) -> PlacedNodes:
        """Nodes xi (B, C J, s) of the experiments, class by class, and log weights (B, C J).

        int g(xi) phi(xi) dxi = sum_j exp(log_weight_j) g(xi_j) in each class. The log-density of
        `laws` is log g(xi) - xi^2/2.
        """


class DenseRule(NodeRule):
    """Base class of rules that place as many nodes as needed where an outcome is not smooth.

    They need a mode only as a first guess of where nodes should lie.
    """

    arrived = MODES.near
    holds_parameters = True
