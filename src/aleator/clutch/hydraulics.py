"""Pressure and piston: the affine system s' = A s + B [u, u'] + c (paper, equation pressureDyn).

The current is linear between breakpoints, so the augmented state [p, p', z, u, u', 1] follows a constant
linear system there and the solution is its matrix exponential. Time is cut into *windows* of one flank of
the current (10 ms), aligned to the breakpoints; within a window the exponential is its own Taylor series,
and since |eigenvalue| * 10 ms = 0.14 the terms left out are below rounding.

The bias c_2 is the only place where x_1 enters. By linearity z~ = z_A(t) + x_1 z_B(t): the states here
are those of z_A, without bias, and z_B has the closed form of `bias_response`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aleator.clutch.current import breakpoints, offsets
from aleator.clutch.parameters import CLUTCH

Array = NDArray[np.float64]

WINDOW = (
    CLUTCH.current.flank
)  #: s; a divisor of every offset of the current after the filling pulse
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
    """A stretch of time in which the currents are linear, with 2 n + 1 equidistant instants."""

    start: Array  #: s, (S,)
    length: Array  #: s, (S,) or (1,)
    pressure: Array  #: Pa, p_hc at the instants, (2 n + 1, S)
    piston: Array  #: m, z_A at the instants, (2 n + 1, S)


def system(frequency_factor: float = 1.0) -> Array:
    """Return the matrix of the augmented state [p, p', z, u, u', 1] without the bias c_2, SI units."""
    h = CLUTCH.hydraulics
    omega = h.natural_frequency * frequency_factor
    a1, a2, b1 = -(omega**2), -2 * h.damping * omega, h.gain * omega**2
    matrix = np.zeros((6, 6))
    matrix[0, 1] = 1.0
    matrix[1] = [a1, a2, 0.0, b1, b1 * h.zero_time, -b1 * h.dead_current]
    matrix[2, :3] = [h.a3, h.a4, h.a5]
    matrix[3, 4] = 1.0
    return matrix


def bias_response(time: Array) -> Array:
    """Return z_B [m], the answer of the piston to the bias: z_B' = a_5 z_B + c_2, z_B(0) = 0."""
    h = CLUTCH.hydraulics
    return np.asarray(h.c2 / h.a5 * np.expm1(h.a5 * time))


@functools.lru_cache(maxsize=512)
def _series_of(frequency_factor: float) -> Array:
    """Return rows p, p', z of matrix^k / k!, shape (3 * _TERMS, 6)."""
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
    """Return p, p', z at `instants` since the start, (m, S) or (m, 1); shape (m, 3, S)."""
    powers = instants[..., None] ** np.arange(_TERMS)
    if instants.shape[1] == 1:
        return np.asarray((powers[:, 0] @ coefficients).reshape(len(instants), 3, -1))
    shaped = coefficients.reshape(_TERMS, 3, -1)
    return np.asarray(np.einsum("msk,kcs->mcs", powers, shaped))


def windows(signals: Signals, steps: int) -> Iterator[Window]:
    """Yield windows of `steps` steps each, with node and mid-step values, from t = 0 without end.

    The first windows absorb what is not a multiple of the window: the delay of the valve, the rising
    flank, the rest of the filling pulse. After them all signals share one length and every breakpoint
    is the start of a window.
    """
    times, levels = breakpoints(
        signals.pulse_duration, signals.hold_current, signals.pulse_current, signals.delay
    )
    series = np.stack([_series_of(float(f)) for f in _shared(signals.frequency_factor)])
    plateau = times[2] - times[1]
    whole = np.floor(plateau / WINDOW + 1e-9)
    rest = np.maximum(plateau - whole * WINDOW, 0.0)
    rest[rest < 1e-9 * WINDOW] = 0.0
    knots = np.rint(offsets() / WINDOW).astype(np.intp)
    slopes = np.append(np.diff(levels, axis=0), np.zeros((1, levels.shape[1])), axis=0)
    slopes[:-1] /= np.diff(times, axis=0)
    column = np.arange(levels.shape[1])
    fractions = np.linspace(0.0, 1.0, 2 * steps + 1)[:, None]

    state = np.zeros((6, levels.shape[1]))
    state[5] = 1.0
    now = np.zeros(levels.shape[1])

    def window(length: Array, current: Array, slope: Array | float) -> Window:
        nonlocal now
        state[3], state[4] = current, slope
        values = _evaluate(_coefficients(series, state), fractions * length)
        state[:3] = values[-1]
        start, now = now, now + length
        return Window(start, length, values[:, 0], values[:, 2])

    full = np.array([WINDOW])
    if signals.delay.any():
        yield window(signals.delay, levels[0], 0.0)
    yield window(full, levels[0], slopes[0])
    if rest.any():
        yield window(rest, levels[1], 0.0)
    index = -whole.astype(np.intp)  # windows since the end of the filling pulse
    while True:
        knot = np.searchsorted(knots, index, side="right") + 1  # row of the last breakpoint
        slope = slopes[knot, column]
        since = np.where(knot > 1, index - knots[knot - 2], 0) * WINDOW
        yield window(full, levels[knot, column] + slope * since, slope)
        index = index + 1


def _shared(values: Array) -> Array:
    """Return a single value if all are equal, else all of them."""
    return values[:1] if np.all(values == values[0]) else values
