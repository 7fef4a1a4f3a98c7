"""The wet clutch as a simulator: shifting times of engagements, vectorized over runs.

The structure of the model is the paper's (arXiv 1908.04597). Neither its measurements nor most of
its parameters are public. The mark (i) means *invented*: such values were tuned together, so that
the model behaves as the paper describes. All 108 experiments synchronize, in 0.55 to 1.29 s at
nominal, every factor has a clear effect, and one experiment (number 16) has an outcome with two
modes. Nothing here says anything about a real clutch.

From the current of the valve follow pressure and piston (propagated exactly), from these the torque
of the plates, and from that the speeds of both shafts (Runge-Kutta) up to the time at which they
are equal. A study names it as `function = "model.py:shifting_time"`.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# ---------------------------------------------------------------------------- parameters


@dataclass(frozen=True)
class Current:
    """Timing and levels of the feed-forward current that three control parameters do not set."""

    flank: float = 0.010  #: s, every 'vertical' flank of the paper's figure (i)
    idle: float = 0.10  #: A, before the engagement (i)
    high: float = 0.65  #: A, during the filling pulse and after the engagement (i)
    hold_end: float = 0.30  #: s after the filling pulse, start of the second pulse (i)
    pulse: float = 0.11  #: s, length of the second pulse (i)
    fall: float = 0.27  #: s, length of the downward flank (i)
    fall_fraction: float = 0.30  #: -, part of the second pulse that is left after the flank (i)
    rise: float = 1.10  #: s, length of the final ramp to `high` (i)
    end: float = 5.0  #: s, a run that has not synchronized by then has failed (i)


@dataclass(frozen=True)
class Hydraulics:
    """Valve, hydraulic chamber and piston: the affine system of the paper's eq. pressureDyn."""

    natural_frequency: float = 14.0  #: rad/s, a1 = -196 1/s^2 (i)
    damping: float = 0.95  #: -, a2 = -26.6 1/s (i)
    gain: float = 20e5  #: Pa/A, static gain, b1 = 3.92e8 Pa/(A s^2) (i)
    zero_time: float = 0.010  #: s, b2 / b1, b2 = 3.92e6 Pa/(A s) (i)
    dead_current: float = 0.10  #: A, no pressure below it, c1 = -3.92e7 Pa/s^2 (i)
    a3: float = 3.2e-8  #: m/(Pa s), filling rate of the piston (i)
    a4: float = 3.0e-11  #: m/Pa (i)
    a5: float = -5.6  #: 1/s, return spring against flow (i)
    c2: float = -2.56e-3  #: m/s, oil pressure bias, scaled by x1; -c2/a3 = 0.8 bar of preload (i)


@dataclass(frozen=True)
class Plates:
    """The two series of friction plates."""

    z_max: float = 2.0e-3  #: m, z_M, full contact: 6 gaps of 0.33 mm (i)
    z_contact: float = 1.32e-3  #: m, z_p, first contact, scaled by x2 (i)
    alpha: float = 4.0e-4  #: N m/Pa, friction torque per plate pressure, N mu A_p R_m (i)
    gamma: float = 1.0e-4  #: N m^2 s/rad, Couette drag, N^2 (pi/2) mu_oil (r2^4 - r1^4) (i)


@dataclass(frozen=True)
class Shafts:
    """Input shaft 1, output shaft 2 with its flywheel, and the gear between clutch and output."""

    inertia_1: float = 0.30  #: kg m^2 (i)
    inertia_2: float = 2.70  #: kg m^2, flywheel 2.5 (paper) + 0.2 (i)
    ratio: float = 2.0  #: -, R = w_in / w_out (i)
    viscous: float = 0.20  #: N m s/rad, b of T_b = T_b0 + b w_2 (i)


@dataclass(frozen=True)
class Converter:
    """Torque ratio f_t and K-factor of the torque converter over the speed ratio nu = w_1 / w_m.

    The nodes are those of the automatic-transmission demonstration of MathWorks as public
    repositories reproduce them, with f_t(0.9) = 0.999 rounded to 1; the node nu = 1, where no
    torque is left, is (i).
    """

    speed_ratio: tuple[float, ...] = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)  #: -
    torque_ratio: tuple[float, ...] = (
        *(2.232, 2.075, 1.975, 1.846, 1.720, 1.564),
        *(1.409, 1.254, 1.096, 1.000, 1.000),
    )  #: -
    k_factor: tuple[float, ...] = (
        *(137.47, 137.07, 135.86, 135.66, 137.57, 140.37),
        *(145.27, 152.87, 162.98, 197.69, float("inf")),
    )  #: rpm/sqrt(N m), f_c = K pi / 30


@dataclass(frozen=True)
class Clutch:
    """All parameters of the model."""

    current: Current = field(default_factory=Current)
    hydraulics: Hydraulics = field(default_factory=Hydraulics)
    plates: Plates = field(default_factory=Plates)
    shafts: Shafts = field(default_factory=Shafts)
    converter: Converter = field(default_factory=Converter)


CLUTCH = Clutch()


# ---------------------------------------------------------------------------- runs

#: Deviations from the model's parameters, and the bench's from the model, where nobody says: none.
_FACTORS = [
    *("frequency_factor", "drag_factor", "friction_factor"),
    *("brake_factor", "inertia_factor", "viscous_factor"),
]
_AS_MODELED = {**dict.fromkeys(_FACTORS, 1.0), "delay": 0.0, "fade": 0.0}


@dataclass(frozen=True)
class Runs:
    """R runs; every field has shape (R,).

    `delay` and `fade` are deviations that only the virtual test bench has.
    """

    pulse_duration: Array  #: s, Delta t
    hold_current: Array  #: A, u_0
    pulse_current: Array  #: A, Delta u
    motor_speed: Array  #: rad/s, w_m
    brake_torque: Array  #: N m, T_b0
    c2_scale: Array  #: -, x_1
    zp_scale: Array  #: -, x_2
    frequency_factor: Array  #: -, on the natural frequency of the hydraulics
    drag_factor: Array  #: -, on gamma
    friction_factor: Array  #: -, on alpha
    brake_factor: Array  #: -, on T_b0; the brake torque includes it
    inertia_factor: Array  #: -, on J_2
    viscous_factor: Array  #: -, on b
    delay: Array  #: s, of the valve
    fade: Array  #: -, F = alpha (1 - fade exp(-slip / FADE_SPEED)) ...

    def take(self, index: NDArray[np.intp]) -> Runs:
        """Return the runs at `index`."""
        return Runs(*(values[index] for values in vars(self).values()))


def make_runs(**quantities: ArrayLike) -> Runs:
    """Return checked runs from the fields of `Runs`, broadcast; `motor_speed` is in rpm here.

    Raises ValueError for arguments that do not fit together or that no test bench could run.
    """
    names = [field.name for field in fields(Runs)]
    given = {**_AS_MODELED, **quantities}
    try:
        arrays = [np.asarray(given[name], dtype=np.float64) for name in names]
        runs = Runs(*(np.atleast_1d(array) for array in np.broadcast_arrays(*arrays)))
    except (TypeError, ValueError) as error:
        raise ValueError(f"the arguments of the clutch do not fit together: {error}") from error
    if runs.c2_scale.ndim != 1:
        raise ValueError(f"arguments of {runs.c2_scale.ndim} dimensions: give numbers or vectors")
    current = CLUTCH.current
    last = current.end - float(offsets()[-1])
    _require(runs, "pulse_duration", (runs.pulse_duration > current.flank), f"> {current.flank:g}")
    _require(runs, "pulse_duration", (runs.pulse_duration <= last), f"at most {last:g} s")
    for name in ("hold_current", "pulse_current"):
        _require(runs, name, getattr(runs, name) >= 0.0, "a current >= 0 A")
    for name in ("motor_speed", "brake_torque", *_FACTORS):
        _require(runs, name, getattr(runs, name) > 0.0, "above 0")
    return replace(
        runs,
        motor_speed=runs.motor_speed * np.pi / 30.0,
        brake_torque=runs.brake_torque * runs.brake_factor,
    )


def _require(runs: Runs, name: str, good: NDArray[np.bool_], expected: str) -> None:
    values = getattr(runs, name)
    good = good & (values < np.inf)
    if not np.all(good):
        run = int(np.argmin(good))
        raise ValueError(f"run {run}: {name} = {values[run]:g}, but it must be {expected}, finite")


# ---------------------------------------------------------------------------- current


def offsets() -> Array:
    """Return the times [s] after the filling pulse at which the slope of the current changes."""
    current = CLUTCH.current
    start = current.hold_end
    steps = [current.flank, current.pulse, current.fall, current.rise]
    return np.array([0.0, current.flank, *np.cumsum([start, *steps])])


def breakpoints(
    pulse_duration: Array, hold_current: Array, pulse_current: Array, delay: Array | float = 0.0
) -> tuple[Array, Array]:
    """Return times [s] and currents [A] of the breakpoints, each of shape (9, S), for S signals.

    `delay` [s] is the time before which the valve sees nothing but the idle current.
    """
    c = CLUTCH.current
    pulse_duration = np.asarray(pulse_duration, dtype=np.float64)
    rest = np.zeros_like(pulse_duration)
    early = np.stack([rest, rest + c.flank])
    times = np.concatenate([early, pulse_duration + offsets()[:, None]]) + delay
    peak = hold_current + pulse_current
    fallen = hold_current + c.fall_fraction * pulse_current
    early_levels: list[Array | float] = [c.idle, c.high, c.high, hold_current, hold_current]
    levels = [*early_levels, peak, peak, fallen, c.high]
    return times, np.stack([rest + level for level in levels])


# ---------------------------------------------------------------------------- pressure and piston
#
# s' = A s + B [u, u'] + c (paper, eq. pressureDyn). The current is linear between its
# breakpoints, so the state [p, p', z, u, u', 1] follows a constant linear system there and its
# solution is a matrix exponential. Time is cut into *windows* of one flank of the current (10
# ms), aligned to the breakpoints. Within a window the exponential is its Taylor series:
# |eigenvalue| * 10 ms = 0.14, so the terms left out are below rounding. The bias c_2 is the only
# place where x_1 enters. By linearity z~ = z_A(t) + x_1 z_B(t). The states here are those of z_A,
# without bias; z_B' = a_5 z_B + c_2 has the solution z_B = (c_2 / a_5)(exp(a_5 t) - 1), which
# `positions` adds.

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


# ---------------------------------------------------------------------------- torque converter
#
# T_1 = w_m^2 f_t(nu) / f_c(nu)^2 with nu = w_1 / w_m, as in the paper.


#: Cells of the lookup table. Its error, max|f''| / (8 CELLS^2), is below 1e-10 where f is of order
#: 1e-2. A multiple of 10, so that every node of the interpolants is a node of the table.
CELLS = 20_000


@functools.cache
def _interpolants() -> tuple[PchipInterpolator, PchipInterpolator]:
    converter = CLUTCH.converter
    nu = np.array(converter.speed_ratio)
    f_c = np.array(converter.k_factor) * np.pi / 30  # rpm -> rad/s
    return PchipInterpolator(nu, converter.torque_ratio), PchipInterpolator(nu, f_c**-2.0)


def capacity(nu: Array) -> Array:
    """Return f(nu) = T_1 / w_m^2 [N m s^2/rad^2]; nu is clipped to [0, 1]."""
    torque_ratio, inverse_square = _interpolants()
    nu = np.clip(nu, 0.0, 1.0)
    return np.asarray(torque_ratio(nu) * inverse_square(nu), dtype=np.float64)


@functools.cache
def capacity_table() -> NDArray[np.complex128]:
    """Return f at i / CELLS as real part and the difference to the next node as imaginary part.

    One complex number a cell means one gather, instead of two, in the innermost loop.
    """
    f = capacity(np.linspace(0.0, 1.0, CELLS + 1))
    table = f.astype(np.complex128)
    table.imag[:-1] = np.diff(f)
    table.setflags(write=False)
    return table


def idle_speed(motor_speed: Array, drag: Array) -> Array:
    """Return the speed w_1 [rad/s] at which T_1(w_m, w_1) = drag w_1, the load being at rest.

    `motor_speed` w_m is in rad/s, `drag` = gamma / z_M in N m s/rad. T_1 is zero at w_1 = w_m and
    above the drag at w_1 = 0; bisection halves [0, w_m] down to rounding.
    """
    pairs, inverse = np.unique(np.stack([motor_speed, drag]), axis=1, return_inverse=True)
    w_m, drag = pairs
    low, high = np.zeros_like(w_m), np.ones_like(w_m)
    for _ in range(53):  # bits of a float64
        nu = 0.5 * (low + high)
        faster = w_m * capacity(nu) > drag * nu
        low, high = np.where(faster, nu, low), np.where(faster, high, nu)
    return np.asarray((w_m * 0.5 * (low + high))[inverse.reshape(-1)])


# ---------------------------------------------------------------------------- torque of the plates
#
# T_c = F + G slip, F and G from pressure and piston. Speeds are counted in cells of the converter's
# table (w_m = CELLS cells) and rates are multiplied by the step, so that the innermost loop of the
# integration has no scaling left to do.


@dataclass(frozen=True)
class Constants:
    """What stays the same during a run, shape (R,); speeds in cells, see the module."""

    run: Indices  #: position among all runs
    signal: Indices  #: position among the signals
    cell: Array  #: cells s/rad
    torque: Array  #: w_m^2 / J_1, cells / s per unit of T_1 / w_m^2
    hold: Array  #: R T_b0 / J_2, cells / s
    spread: Array  #: R^2 J_1 / J_2, -
    viscous: Array  #: b / J_2, 1 / s
    friction: Array  #: alpha / J_1, cells / (s Pa)
    drag: Array  #: gamma / (J_1 (z_M - x_2 z_p)), 1 / s
    slope: Array  #: 1 / (z_M - x_2 z_p), 1 / m
    contact: Array  #: x_2 z_p / (z_M - x_2 z_p), -
    bias: Array  #: x_1 c_2 / a_5 / (z_M - x_2 z_p), -
    fade: Array  #: -, see `Runs`

    def take(self, keep: NDArray[np.bool_] | Indices) -> Constants:
        """Return the constants of the runs to keep."""
        return Constants(*(values[keep] for values in vars(self).values()))


def constants(runs: Runs, signal: Indices) -> Constants:
    """Return the constants of `runs`, whose currents are numbered by `signal`."""
    plates, hydraulics, shafts = CLUTCH.plates, CLUTCH.hydraulics, CLUTCH.shafts
    cell = CELLS / runs.motor_speed
    contact = plates.z_contact * runs.zp_scale
    slope = 1.0 / (plates.z_max - contact)
    inertia = shafts.inertia_2 * runs.inertia_factor
    return Constants(
        run=np.arange(len(signal)),
        signal=signal,
        cell=cell,
        torque=runs.motor_speed**2 / shafts.inertia_1 * cell,
        hold=shafts.ratio * runs.brake_torque / inertia * cell,
        spread=shafts.ratio**2 * shafts.inertia_1 / inertia,
        viscous=shafts.viscous * runs.viscous_factor / inertia,
        friction=plates.alpha * runs.friction_factor / shafts.inertia_1 * cell,
        drag=plates.gamma * runs.drag_factor / shafts.inertia_1 * slope,
        slope=slope,
        contact=contact * slope,
        bias=runs.c2_scale * hydraulics.c2 / hydraulics.a5 * slope,
        fade=runs.fade,
    )


def positions(c: Constants, window: Window) -> Array:
    """Return sigma = (z - x_2 z_p) / (z_M - x_2 z_p) at the instants of a window, (2 n + 1, R)."""
    a5 = CLUTCH.hydraulics.a5
    decay = np.exp(a5 * np.linspace(0.0, 1.0, len(window.piston))[:, None] * window.length)
    if decay.shape[1] > 1:
        decay = decay.take(c.signal, axis=1)
    # z~ = z_A + x_1 z_B with z_B = (c_2 / a_5)(exp(a_5 t) - 1)
    amplitude = c.bias * np.exp(a5 * window.start).take(c.signal)
    sigma = window.piston.take(c.signal, axis=1) * c.slope + decay * amplitude
    sigma = np.maximum(sigma - (c.bias + c.contact), -c.contact)
    _clip_above(sigma)
    return sigma


def _clip_above(sigma: Array) -> None:
    """Clip sigma to 1 in place, such that Simpson's rule stays right where a step meets the clip.

    Runge-Kutta weighs the three instants of a step by 1, 4, 1. For a ramp that is cut off at 1
    inside the step this misses the integral by a term of order h^2, which would dominate all other
    errors. The value in the middle of the step makes up for it.
    """
    excess = sigma[::2] - 1.0
    np.minimum(sigma, 1.0, out=sigma)
    above = excess > 0.0
    step, run = np.nonzero(above[:-1] != above[1:])
    if len(step) == 0:
        return
    left, right = excess[step, run], excess[step + 1, run]
    high, low = np.maximum(left, right), np.minimum(left, right)
    integral = 0.5 * high**2 / (high - low)
    simpson = (high + 4.0 * np.maximum(0.5 * (high + low), 0.0)) / 6.0
    sigma[2 * step + 1, run] += 1.5 * (simpson - integral)


def increments(c: Constants, window: Window, step: Array | float) -> tuple[Array, Array]:
    """Return h F / J_1 [cells] and h G / J_1 [-] at the instants of a window, (2 n + 1, R).

    With delta = 3 sigma^2 - 2 sigma^3 for 0 < sigma < 1, F = delta alpha sigma p_hc and

        (1 - delta) / (z_M - z) = (1 - sigma)(1 + 2 sigma) / (z_M - x_2 z_p),

    which stays finite at z = z_M. Before contact G = gamma / (z_M - z) and F = 0.
    """
    sigma = positions(c, window)
    closed = np.maximum(sigma, 0.0)
    pressure = np.maximum(window.pressure, 0.0).take(c.signal, axis=1)
    push = (closed * -2.0 + 3.0) * closed * closed * closed * pressure * (c.friction * step)
    drag = ((closed * -2.0 + 1.0) * closed + 1.0) / (1.0 - np.minimum(sigma, 0.0))
    return push, drag * (c.drag * step)


# ---------------------------------------------------------------------------- speeds of the shafts
#
# State: w = w_1 and v = R w_2, so that the slip is w - v. With q = T_c / J_1 the asynchronous phase
# of the paper reads  w' = T_1 / J_1 - q,  v' = (R^2 J_1 / J_2) q - R T_b0 / J_2 - (b / J_2) v.
# The paper is silent on a load that its brake holds. Here v stays 0 until R T_c exceeds T_b0.


FADE_SPEED = 25.0  #: rad/s, slip over which a fade of the friction dies out, virtual bench only (i)


class Stepper:
    """Integrates the runs of `Constants` with one step size [s], scalar or (R,).

    A state is an array (2, R) of w and v in cells; a rate is its derivative times the step.
    """

    def __init__(self, c: Constants, step: Array | float) -> None:
        self._torque, self._hold, self._viscous = c.torque * step, c.hold * step, c.viscous * step
        self._spread = c.spread
        self._fade = (c.fade, -1.0 / (c.cell * FADE_SPEED)) if c.fade.any() else None

    def rate(self, state: Array, push: Array, drag: Array) -> Array:
        """The rate of a state, the load taken as moving."""
        w, v = state
        slip = w - v
        if self._fade is not None:
            amount, decay = self._fade
            push = push * (1.0 - amount * np.exp(slip * decay))
        q = slip * drag + push
        # T_1: linear between the nodes of the table, one cell of it being the unit of w
        whole = np.trunc(w)
        cells = capacity_table().take(whole.astype(np.intp), mode="clip")
        rate = np.empty_like(state)
        rate[0] = ((w - whole) * cells.imag + cells.real) * self._torque - q
        rate[1] = q * self._spread - self._hold - v * self._viscous
        return rate

    def may_rest(self, state: Array, steps: int) -> bool:
        """Tell whether a load rests, or could come to rest under its brake within `steps` steps."""
        v = state[1]
        return bool(np.any(v <= steps * (self._hold + self._viscous * v)))

    def step(self, state: Array, push: Array, drag: Array, braked: bool) -> Array:
        """The state one step later; `push` and `drag` have the step's 3 instants.

        `braked` tells that some load may rest: only then is the brake's stiction looked at.
        """
        first = self.rate(state, push[0], drag[0])
        start = _hold(first[1], state[1]) if braked else None
        at, total = first * 0.5 + state, first
        for share in (0.5, 1.0):
            rate = self.rate(at, push[1], drag[1])
            if braked:
                _hold(rate[1], at[1])
            at = rate * share + state
            total = total + rate * 2.0
        last = self.rate(at, push[2], drag[2])
        end = _hold(last[1], at[1]) if braked else None
        out = state + (total + last) * (1.0 / 6.0)
        if start is not None and end is not None:
            _release(state[1], start, end, out[1])
        return np.asarray(out)


def _hold(rate: Array, v: Array) -> Array:
    """Keep the load from turning backward, in place; return a copy of the rate before that."""
    free = rate.copy()
    np.maximum(rate, -v, out=rate)
    return free


def _release(v: Array, start: Array, end: Array, new_v: Array) -> None:
    """Correct the new speed of loads that left their rest during the step, in place.

    Driving torque minus brake goes from `start` < 0 to `end` > 0 and accelerates the load from its
    zero on. The integral of the positive part, exact for a linear course, is what the load gains;
    Runge-Kutta misses it by a term of order h^2.
    """
    np.maximum(new_v, 0.0, out=new_v)
    (run,) = np.nonzero((v <= 0.0) & (start < 0.0) & (end > 0.0))
    new_v[run] = 0.5 * end[run] ** 2 / (end[run] - start[run])


# ---------------------------------------------------------------------------- shifting time

STEPS = 5  #: Runge-Kutta steps in a window of 10 ms
BLOCK = 10_000  #: runs that advance together: bounds the memory, some 15 MB


def shifting_time(
    *,
    pulse_duration: ArrayLike,
    hold_current: ArrayLike,
    pulse_current: ArrayLike,
    motor_speed: ArrayLike,
    brake_torque: ArrayLike,
    c2_scale: ArrayLike,
    zp_scale: ArrayLike,
    alpha_scale: ArrayLike = 1.0,
    gamma_scale: ArrayLike = 1.0,
    omega_scale: ArrayLike = 1.0,
    brake_scale: ArrayLike = 1.0,
    j2_scale: ArrayLike = 1.0,
    b_scale: ArrayLike = 1.0,
) -> Array:
    """Shifting time [s] (R,): from the start of the current to equal speeds of both shafts.

    The root of w_1 = R w_2 in the paper's model of the asynchronous phase. Runge-Kutta of order 4
    with a step of 2 ms integrates the speeds, and the root is that of the cubic Hermite
    interpolant of the slip. Each argument is a number or an array (R,): `pulse_duration` Delta t
    [s], 0.01 to 3.21; `hold_current` u_0 and `pulse_current` Delta u [A], at least 0;
    `motor_speed` w_m [rpm] and `brake_torque` T_b0 [N m], above 0. `c2_scale` x_1 scales the oil
    pressure bias c_2 and `zp_scale` x_2 the contact position z_p; the box of the benchmark is
    [0.5, 1.4] x [0.3, 1.2]. The other scales, above 0, are those of friction alpha, drag gamma,
    natural frequency of the hydraulics, brake torque T_b0, output inertia J_2 and viscous
    friction b, for a sensitivity study.

    NaN if the shafts do not synchronize within 5 s, if the clutch stalls the input shaft because
    the brake holds the load, if x_1 is not finite, or if x_2 is not in (0, 1.515): the plates
    would touch always or never. Raises ValueError for conditions outside the ranges above.

    In the box the error is below 1e-6 s, 99 % below 2e-7 s. Cost, on one core: 40 ms for a single
    run, 50 ms for 100, 0.4 s for 10,000. Outside the box (x_2 above 1.2) synchronization can be
    grazing; the outcome then jumps as a function of x, and no accuracy can be promised there.
    """
    runs = make_runs(
        pulse_duration=pulse_duration,
        hold_current=hold_current,
        pulse_current=pulse_current,
        motor_speed=motor_speed,
        brake_torque=brake_torque,
        c2_scale=c2_scale,
        zp_scale=zp_scale,
        friction_factor=alpha_scale,
        drag_factor=gamma_scale,
        frequency_factor=omega_scale,
        brake_factor=brake_scale,
        inertia_factor=j2_scale,
        viscous_factor=b_scale,
    )
    return synchronization_time(runs)


def synchronization_time(runs: Runs, steps: int = STEPS) -> Array:
    """Return the time [s] at which w_1 = R w_2 for each run, NaN where there is none."""
    plates = CLUTCH.plates
    times = np.full(len(runs.c2_scale), np.nan)
    reach = plates.z_max / plates.z_contact
    possible = np.isfinite(runs.c2_scale) & (runs.zp_scale > 0) & (runs.zp_scale < reach)
    (todo,) = np.nonzero(possible)
    for first in range(0, len(todo), BLOCK):
        index = todo[first : first + BLOCK]
        times[index] = _block(runs.take(index), steps)
    return times


def signals_of(runs: Runs) -> tuple[Signals, Indices]:
    """Return the different currents of `runs`, and for each run the position of its own."""
    key = np.stack([getattr(runs, f.name) for f in fields(Signals)])
    different, inverse = np.unique(key, axis=1, return_inverse=True)
    return Signals(*different), inverse.reshape(-1)


def initial_speed(runs: Runs) -> Array:
    """Return w_1 [rad/s] of the steady state in which runs begin: z = 0, the load at rest."""
    plates = CLUTCH.plates
    return idle_speed(runs.motor_speed, plates.gamma * runs.drag_factor / plates.z_max)


def _block(runs: Runs, steps: int) -> Array:
    """Return the synchronization times of runs that advance together."""
    signals, signal = signals_of(runs)
    c = constants(runs, signal)
    state = np.stack([initial_speed(runs) * c.cell, np.zeros(len(signal))])
    brackets = np.full((6, len(signal)), np.nan)
    for window in windows(signals, steps):
        if len(c.run) == 0 or window.start.min() >= CLUTCH.current.end:
            break
        step = step_of(window, steps, c.signal)
        push, drag = increments(c, window, step)
        track = advance(Stepper(c, step), state, push, drag)
        state = track[-1]
        ahead = track[:, 0] > track[:, 1]
        going = np.asarray(ahead.all(axis=0))
        if not going.all():
            (done,) = np.nonzero(~going)
            node = np.argmin(ahead[:, done], axis=0) - 1
            brackets[:, c.run[done]] = _bracket(c, window, step, track, (push, drag), done, node)
            c, state = c.take(going), state[:, going]
    return _root(brackets)


def step_of(window: Window, steps: int, signal: Indices) -> Array | float:
    """Return the step [s] of each run in a window, a single number where all have the same."""
    lengths = window.length / steps
    return float(lengths[0]) if len(lengths) == 1 else lengths.take(signal)


def advance(stepper: Stepper, state: Array, push: Array, drag: Array) -> Array:
    """Return the states at the n + 1 nodes of a window, shape (n + 1, 2, R)."""
    steps = len(push) // 2
    track = np.empty((steps + 1, *state.shape))
    track[0] = state
    braked = stepper.may_rest(state, steps)
    for k in range(steps):
        instants = slice(2 * k, 2 * k + 3)
        track[k + 1] = stepper.step(track[k], push[instants], drag[instants], braked)
    return track


def _bracket(
    c: Constants,
    window: Window,
    step: Array | float,
    track: Array,
    torques: tuple[Array, Array],
    done: Indices,
    node: Indices,
) -> Array:
    """Return start, length, slips and rates of slip at both ends of the steps that end the runs.

    Where the load still rests, the clutch has stalled the input shaft instead of synchronizing the
    load: the start is NaN.
    """
    length = np.broadcast_to(step, len(c.run))[done]
    stepper = Stepper(c.take(done), length)
    start = window.start.take(c.signal[done]) + node * length
    rows = [np.where(track[node + 1, 1, done] > 0.0, start, np.nan), length]
    slips, rates = [], []
    for k in (node, node + 1):
        state = track[k, :, done].T
        push, drag = (torque[2 * k, done] for torque in torques)
        dw, dv = stepper.rate(state, push, drag)
        slips.append(state[0] - state[1])
        rates.append(dw - np.maximum(dv, -state[1]))
    return np.stack([*rows, *slips, *rates])


def _root(brackets: Array) -> Array:
    """Return the time at which the cubic Hermite interpolant of the slip is zero; NaN stays NaN."""
    start, length, s0, s1, d0, d1 = brackets
    c2, c3 = 3.0 * (s1 - s0) - 2.0 * d0 - d1, 2.0 * (s0 - s1) + d0 + d1
    low, high = np.zeros_like(start), np.ones_like(start)
    for _ in range(40):  # 2^-40 of a step is far below 1e-12 s
        x = 0.5 * (low + high)
        positive = s0 + x * (d0 + x * (c2 + x * c3)) > 0.0
        low, high = np.where(positive, x, low), np.where(positive, high, x)
    times = start + length * 0.5 * (low + high)
    return np.where(times <= CLUTCH.current.end, times, np.nan)
