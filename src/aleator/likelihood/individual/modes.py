"""Modes of the individual laws, and what a rule that places nodes about them is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from aleator.core.types import Array, Flags


@dataclass(frozen=True)
class ModeSettings:
    """How the modes of individual laws are sought; chosen by judgement.

    `arrived`: a Newton step that gains less than this in log-density is the last. `near`: the same
    where nodes only have to lie about the mode, within a seventh of its width. `steps`: most Newton
    steps of a climb. `near_steps`: the same of modes that only have to be near; where alpha is
    absurd, so are they. `raised` and `lowered`: factors of the damping after a step without gain
    and after one with gain. `least_damping`: damping below this is none. `stiff`: damping that is
    about as strong in all directions. `apart`: standard deviations between two modes that are not
    one. `least_log_mass`: logarithm of a mode's share of the first one's mass from where on it is
    none. `farthest`: variates beyond this have no mass, and no step goes farther. `starts`: where
    modes are sought along each variate, besides about the last one. `informed`: information about a
    variate, of which the law's part is one, from which on observations say more than the law.
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
    """The log-density of variates z (B, P, s) with its gradient and information.

    Value (B, P), gradient (B, P, s), and a positive definite approximation (B, P, s, s) of the
    negative Hessian.
    """

    def __call__(self, z: Array) -> tuple[Array, Array, Array]:
        """Value, gradient and information at P points of each of B experiments."""


Valued = Callable[[Array], Array]
"""The log-density (B, P) of variates z (B, P, s)."""


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes z (B, ..., s), the information (B, ..., s, s) and the log-density (B, ...) there."""

    z: Array
    information: Array
    value: Array


def modes(
    log_density: Curved,
    start: Array,
    basis: Array | None = None,
    arrived: float = MODES.arrived,
    classes: int = 1,
    settings: ModeSettings = MODES,
) -> Modes:
    """Climb from start (B, P, s) by Gauss-Newton steps, all points in one batch.

    With a `basis` (B, P, s, k) only in the directions of its columns. Levenberg's damping, raised
    where a step does not gain, lowered where it does. Ends, without an error, when no point gains;
    those that have ended are not computed again. The points are those of so many `classes`, one
    after the other.
    """
    z = start
    value, gradient, information = log_density(z)
    damping = np.zeros(z.shape[:2])
    for _ in range(settings.steps if arrived < settings.near else settings.near_steps):
        slope, curvature = _within(gradient, information, basis)
        step = _damped_step(curvature, slope, damping[..., None, None], settings.stiff)
        gain = 0.5 * np.sum(slope * step, axis=-1)
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

    In one direction it makes steps shorter. In several it is added to the information, of which
    the law's part is one: along a narrow ridge steps become shorter, those back to it do not.
    """
    if slope.shape[-1] == 1:
        return np.asarray(slope / (information * (1.0 + damping))[..., 0])
    added = damping + (damping / stiff) ** 2 * information
    damped = information + added * np.eye(slope.shape[-1])
    return np.asarray(np.linalg.solve(damped, slope[..., None])[..., 0])


def _of_some(
    log_density: Curved, z: Array, wanted: Flags, classes: int
) -> tuple[Array, Array, Array]:
    """The log-density with its derivatives at some of the points, `wanted` (B, P); zeros at the
    others.

    It is evaluated at as many points of each class as the class with most of them has.
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
    """Where a step from z ends that goes no farther than is allowed; unless it may go `everywhere`,
    it keeps its direction."""
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
    """The modes (B, C, M, s) of most mass that climbs from starts (B, C, T, s) end in.

    Modes nearer to each other than two of their standard deviations are one, and one of less than
    a thousandth of the first one's mass is none. Where there are fewer than M, the first stands in
    for the others.
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
    """The individual laws of experiments first, ..., first + B - 1, as a rule of nodes sees them.

    The log-density of their variates, with and without its slopes, and M modes (B, C, M, s) of each
    of C classes, the highest first.
    """

    curved: Curved
    valued: Valued
    modes: Modes
    first: int


class NodeRule(ABC):
    """Nodes of the integral over the s standard normal variates of an experiment.

    `name` is that of reports. Steps to the modes may have `arrived` left to gain in log-density, at
    least. A rule `holds_parameters` whose nodes are kept as parameters, and not as variates (see
    `Parameters`).
    """

    name: ClassVar[str]
    arrived: ClassVar[float] = MODES.arrived
    holds_parameters: ClassVar[bool] = False

    @property
    def centers(self) -> int:
        """M, the modes of an experiment that the nodes lie about."""
        return 1

    @property
    def rough(self) -> NodeRule:
        """One with few nodes that serves for statistics of many replicates."""
        return self

    @abstractmethod
    def size(self, dimensions: int, /) -> int:
        """J, the number of nodes while they are sought."""

    def finer(self, dimensions: int, /) -> tuple[NodeRule, ...]:  # noqa: ARG002
        """Finer rules, whose differences from this one show how exact it is."""
        return ()

    def refined(
        self,
        gaps: Sequence[float],  # noqa: ARG002
        enough: float,  # noqa: ARG002
        dimensions: int,  # noqa: ARG002
        /,
    ) -> NodeRule | None:
        """One with more nodes, where the finer rules change more than enough by these gaps.

        None where they do not, and where more nodes would be too many.
        """
        return None

    def gap(self, gaps: Sequence[float], dimensions: int, /) -> float:  # noqa: ARG002
        """What more nodes change altogether, by what each of the finer rules changes."""
        return float(sum(gaps))

    @abstractmethod
    def place(self, laws: IndividualLaws) -> tuple[Array, Array]:
        """Nodes xi (B, C J, s) of the experiments, class by class, and log weights (B, C J).

        int g(xi) phi(xi) dxi = sum_j exp(log_weight_j) g(xi_j) in each class, where the log-density
        is that of g(xi) exp(-xi^2/2).
        """


class DenseRule(NodeRule):
    """What rules share whose nodes are as many as are needed, wherever an outcome is not smooth.

    A mode only says where the nodes begin.
    """

    arrived = MODES.near
    holds_parameters = True
