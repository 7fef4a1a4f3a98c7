"""Runs: validated conditions and parameters of R simulations, one array per quantity."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.clutch.current import offsets
from aleator.clutch.parameters import CLUTCH
from aleator.errors import SimulatorError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Runs:
    """R runs; every field has shape (R,). The fields after `zp_scale` are 'as modeled' by default.

    They exist for the virtual test bench, which differs from the model in ways the model cannot follow.
    """

    pulse_duration: Array  #: s, Delta t
    hold_current: Array  #: A, u_0
    pulse_current: Array  #: A, Delta u
    motor_speed: Array  #: rad/s, w_m
    brake_torque: Array  #: N m, T_b0
    c2_scale: Array  #: -, x_1
    zp_scale: Array  #: -, x_2
    delay: Array  #: s, of the valve
    frequency_factor: Array  #: -, on the natural frequency of the hydraulics
    drag_factor: Array  #: -, on gamma
    friction_factor: Array  #: -, on alpha
    fade: Array  #: -, friction is alpha (1 - fade exp(-slip / FADE_SPEED))

    def take(self, index: NDArray[np.intp] | slice) -> Runs:
        """Return the runs at `index`."""
        return Runs(*(getattr(self, f.name)[index] for f in fields(self)))


def _require(name: str, values: Array, good: NDArray[np.bool_], expected: str) -> None:
    if not np.all(good):
        worst = float(values[~good][0])
        raise SimulatorError(f"{name} = {worst:g} is not admissible", f"use {expected}")


def make_runs(
    *,
    pulse_duration: ArrayLike,
    hold_current: ArrayLike,
    pulse_current: ArrayLike,
    motor_speed: ArrayLike,
    brake_torque: ArrayLike,
    c2_scale: ArrayLike,
    zp_scale: ArrayLike,
    delay: ArrayLike = 0.0,
    frequency_factor: ArrayLike = 1.0,
    drag_factor: ArrayLike = 1.0,
    friction_factor: ArrayLike = 1.0,
    fade: ArrayLike = 0.0,
) -> Runs:
    """Return broadcast, checked runs; `motor_speed` in rpm, the rest in the units of `Runs`."""
    given = dict(locals())
    try:
        arrays = [np.asarray(value, dtype=np.float64) for value in given.values()]
        flat = [np.atleast_1d(a).copy() for a in np.broadcast_arrays(*arrays)]
    except (TypeError, ValueError) as error:
        raise SimulatorError(
            f"the arguments of the clutch do not fit together: {error}",
            "give numbers, or one-dimensional arrays of the same length",
        ) from error
    if flat[0].ndim != 1:
        raise SimulatorError(
            "the arguments of the clutch have more than one dimension", "ravel them"
        )
    runs = Runs(**dict(zip(given, flat, strict=True)))
    _check(runs)
    return Runs(**{**vars(runs), "motor_speed": runs.motor_speed * np.pi / 30})


def _check(runs: Runs) -> None:
    """Raise SimulatorError for conditions that no test bench could run."""
    current = CLUTCH.current
    last = current.end - offsets()[-1]
    duration = runs.pulse_duration
    _require(
        "pulse_duration",
        duration,
        (duration > current.flank) & (duration <= last),
        f"more than {current.flank:g} and at most {last:g} s",
    )
    for name in ("hold_current", "pulse_current"):
        values = getattr(runs, name)
        _require(name, values, (values >= 0) & np.isfinite(values), "a finite current >= 0 A")
    for name, unit in (("motor_speed", "rpm"), ("brake_torque", "N m")):
        values = getattr(runs, name)
        _require(name, values, (values > 0) & np.isfinite(values), f"a finite value > 0 {unit}")
