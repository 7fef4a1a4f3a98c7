"""Pressure and piston: the affine system s' = A s + B [u, u'] + c (paper, eq. pressureDyn).

The current is linear between its breakpoints, so the augmented state [p, p', z, u, u', 1] follows
a constant linear system there and its solution is a matrix exponential. Time is cut into *windows*
of one flank of the current (10 ms), aligned to the breakpoints. Within a window the exponential is
its Taylor series: |eigenvalue| * 10 ms = 0.14, so the terms left out are below rounding.

The bias c_2 is the only place where x_1 enters. By linearity z~ = z_A(t) + x_1 z_B(t). The states
here are those of z_A, without bias; z_B' = a_5 z_B + c_2 has the solution
z_B = (c_2 / a_5)(exp(a_5 t) - 1), which `plates.positions` adds.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aleator.clutch.current import breakpoints, offsets
from aleator.clutch.parameters import CLUTCH
from aleator.types import Array

WINDOW = CLUTCH.current.flank  #: s, a divisor of every offset of the current after the pulse
_TERMS = 14  # 0.3^14 / 14! = 5e-19: below rounding up to twice the natural frequency


@dataclass(frozen=True)
class Signals:
    """S different currents, with the valve that each of them meets; every field has shape (S,)."""

    pulse_duration: Array  #: s
    hold_current: Array  #: A
    pulse_current: Array  #: A
    delay: Array  #: s, of the valve
    frequency_factor: Array  #: -, multiplies the natural frequency


@dataclass(frozen=True)
class Window:
    """A stretch of time in which every current is linear, with 2 n + 1 equidistant instants."""

    start: Array  #: s, (S,)
    length: Array  #: s, (S,) or (1,)
    pressure: Array  #: Pa, p_hc at the instants, (2 n + 1, S)
    piston: Array  #: m, z_A at the instants, (2 n + 1, S)


def system(frequency_factor: float = 1.0) -> Array:
    """Return the matrix of the augmented state [p, p', z, u, u', 1] without c_2, in SI units."""
    h = CLUTCH.hydraulics
    omega = h.natural_frequency * frequency_factor
    a1, a2, b1 = -(omega**2), -2 * h.damping * omega, h.gain * omega**2
    matrix = np.zeros((6, 6))
    matrix[0, 1] = 1.0
    matrix[1] = [a1, a2, 0.0, b1, b1 * h.zero_time, -b1 * h.dead_current]
    matrix[2, :3] = [h.a3, h.a4, h.a5]
    matrix[3, 4] = 1.0
    return matrix


def windows(signals: Signals, steps: int) -> Iterator[Window]:
    """Yield windows of `steps` steps each, with node and mid-step values, from t = 0 without end.

    The first windows absorb what is not a multiple of 10 ms: the delay of the valve, the rising
    flank, the rest of the filling pulse. From then on all signals share one length, and every
    breakpoint is the start of a window.
    """
    times, levels = breakpoints(
        signals.pulse_duration, signals.hold_current, signals.pulse_current, signals.delay
    )
    chamber = _Chamber(signals.frequency_factor, steps)
    whole, rest = _whole_windows(times[2] - times[1])
    full = np.array([WINDOW])
    if signals.delay.any():
        yield chamber.fill(signals.delay, levels[0], 0.0)
    yield chamber.fill(full, levels[0], (levels[1] - levels[0]) / WINDOW)
    if rest.any():
        yield chamber.fill(rest, levels[1], 0.0)
    knots = np.rint(offsets() / WINDOW).astype(np.intp)
    slopes = np.zeros_like(levels)  # A/s after each breakpoint; none after the last
    slopes[2:-1] = np.diff(levels[2:], axis=0) / np.diff(offsets())[:, None]
    column = np.arange(len(whole))
    index = -whole  # windows since the end of the filling pulse
    while True:
        knot = np.searchsorted(knots, index, side="right") + 1  # row of the last breakpoint
        slope = slopes[knot, column]
        since = (index - knots[knot - 2]) * WINDOW  # of no effect in the filling pulse: no slope
        yield chamber.fill(full, levels[knot, column] + slope * since, slope)
        index = index + 1


class _Chamber:
    """The state of the hydraulics of every signal, and how it moves on by a window."""

    def __init__(self, frequency_factor: Array, steps: int) -> None:
        shared = np.all(frequency_factor == frequency_factor[0])
        factors = frequency_factor[:1] if shared else frequency_factor
        self._series = np.stack([_taylor_rows(float(factor)) for factor in factors])
        self._fractions = np.linspace(0.0, 1.0, 2 * steps + 1)[:, None]
        self._state = np.zeros((6, len(frequency_factor)))
        self._state[5] = 1.0
        self._now = np.zeros(len(frequency_factor))

    def fill(self, length: Array, current: Array, slope: Array | float) -> Window:
        """Return the next window, over which the current starts at `current` with `slope`."""
        self._state[3], self._state[4] = current, slope
        values = _evaluate(_coefficients(self._series, self._state), self._fractions * length)
        self._state[:3] = values[-1]
        start, self._now = self._now, self._now + length
        return Window(start, length, values[:, 0], values[:, 2])


def _whole_windows(plateau: Array) -> tuple[NDArray[np.intp], Array]:
    """Return how many windows fit into the plateau of the filling pulse, and the rest [s]."""
    snap = 1e-9  # of a window: what is left of 0.09 s minus 8 times 0.01 s is rounding
    whole = np.floor(plateau / WINDOW + snap)
    rest = plateau - whole * WINDOW
    return whole.astype(np.intp), np.where(rest > snap * WINDOW, rest, 0.0)


@functools.lru_cache(maxsize=512)
def _taylor_rows(frequency_factor: float) -> Array:
    """Return the rows p, p', z of matrix^k / k! for all k, shape (3 _TERMS, 6)."""
    matrix, term = system(frequency_factor), np.eye(6)
    rows = []
    for k in range(_TERMS):
        rows.append(term[:3])
        term = term @ matrix / (k + 1)
    return np.concatenate(rows)


def _coefficients(series: Array, state: Array) -> Array:
    """Return the Taylor coefficients of p, p', z, shape (_TERMS, 3 S)."""
    if len(series) == 1:
        return np.asarray((series[0] @ state).reshape(_TERMS, -1))
    return np.asarray(np.einsum("sri,is->rs", series, state).reshape(_TERMS, -1))


def _evaluate(coefficients: Array, instants: Array) -> Array:
    """Return p, p', z at `instants` since the window's start, (m, S) or (m, 1): (m, 3, S)."""
    powers = instants[..., None] ** np.arange(_TERMS)
    if instants.shape[1] == 1:
        return np.asarray((powers[:, 0] @ coefficients).reshape(len(instants), 3, -1))
    shaped = coefficients.reshape(_TERMS, 3, -1)
    return np.asarray(np.einsum("msk,kcs->mcs", powers, shaped))
