"""The virtual test bench: synthetic measurements of the 108 experiments.

The measurements of the paper are not public. Everything here was invented, and is marked (i).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.special import ndtr, ndtri

from aleator.clutch.doe import design
from aleator.clutch.runs import make_runs
from aleator.clutch.simulator import shifting_time, synchronization_time
from aleator.errors import SimulatorError, nearest
from aleator.types import Array

#: Feasible box of (x_1, x_2): all 108 experiments synchronize in it, and no jump was found (i).
BOX = ((0.5, 1.4), (0.3, 1.2))

_KINDS = ("realistic", "model")
_CONDITIONS = (
    "pulse_duration",
    "hold_current",
    "pulse_current",
    "motor_speed",
    "brake_torque",
)


def measure(
    seed: int,
    kind: str = "realistic",
    noise_sd: float = 0.0,
    alpha: Sequence[float] = (0.91, 0.55, 0.081, 0.046),
    conditions: pd.DataFrame | None = None,
) -> pd.DataFrame:
    """Return one synthetic measurement of the shifting time for each of the 108 experiments.

    Or of other experiments, a row of `conditions` each.

    The numbers are synthetic: the paper's measurements are not public, and the bench is invented.

    Kind "model" is well specified: y_l = Y(l; x_l) + noise, with x_l independent for each
    experiment, normal with the means and standard deviations of `alpha` and truncated to the box
    [0.5, 1.4] x [0.3, 1.2]. It serves recovery studies, because the truth is known.

    Kind "realistic" differs from the model in ways the model knows nothing of: the temperature of
    the oil wanders and starts cold (viscosity, valve, friction), the plates wear, the friction
    falls with the slip, centrifugal force adds to the oil's pressure, the brake scatters, the valve
    is 4 ms late, and the clock adds 2 ms of noise and rounds up to 1 ms.

    Parameters
    ----------
    seed
        Seed of `numpy.random.default_rng`; the same seed gives the same measurements.
    kind
        "realistic" or "model".
    noise_sd
        Standard deviation [s] of a normal measurement noise, of kind "model" only; at least 0.
    alpha
        Means and standard deviations (mean 1, mean 2, sd 1, sd 2) of x, of kind "model" only.
    conditions
        The columns of `design` but for the id, a row for each experiment; None is the design.

    Returns
    -------
    DataFrame
        The columns of `design` and `shifting_time` [s]; for "realistic" also `run_order` (from 0)
        and `oil_temperature` [degC], which a study may look at but the model does not use.

    Raises
    ------
    SimulatorError
        An unknown kind, a negative standard deviation, an `alpha` of another length, conditions
        that lack a column, or
        `noise_sd` with kind "realistic", which has its own noise.

    Notes
    -----
    Takes some 60 ms.

    Examples
    --------
    >>> bench = measure(seed=1)
    >>> len(bench), bool(bench.shifting_time.between(0.4, 1.4).all())
    (108, True)
    """
    if kind not in _KINDS:
        raise SimulatorError(
            f"kind = {kind!r} is not a kind of test bench{nearest(kind, _KINDS)}",
            "use 'realistic' or 'model'",
        )
    if not noise_sd >= 0.0 or (kind == "realistic" and noise_sd > 0.0):
        raise SimulatorError(
            f"noise_sd = {noise_sd!r} is not admissible for kind {kind!r}",
            "use a number >= 0 for 'model'; 'realistic' has its own noise of 2 ms",
        )
    table = design() if conditions is None else conditions.reset_index(drop=True)
    for name in _CONDITIONS:
        if name not in table:
            raise SimulatorError(
                f"the conditions have no column '{name}'", f"give {', '.join(_CONDITIONS)}"
            )
    rng = np.random.default_rng(seed)
    if kind == "realistic":
        return _realistic(rng, table)
    return _model(rng, table, noise_sd, alpha)


def _model(
    rng: np.random.Generator, table: pd.DataFrame, noise_sd: float, alpha: Sequence[float]
) -> pd.DataFrame:
    """Return measurements of a bench that is the model itself."""
    values = np.asarray(alpha, dtype=np.float64)
    if values.shape != (4,) or not np.all(np.isfinite(values)) or not np.all(values[2:] > 0.0):
        raise SimulatorError(
            f"alpha = {alpha!r} is not admissible",
            "give two means and two standard deviations > 0",
        )
    (mean_1, mean_2, sd_1, sd_2), (box_1, box_2) = values, BOX
    times = shifting_time(
        **{name: table[name] for name in _CONDITIONS},
        c2_scale=_truncated_normal(rng, mean_1, sd_1, box_1, len(table)),
        zp_scale=_truncated_normal(rng, mean_2, sd_2, box_2, len(table)),
    )
    return table.assign(shifting_time=times + noise_sd * rng.standard_normal(len(table)))


def _truncated_normal(
    rng: np.random.Generator, mean: float, sd: float, box: tuple[float, float], size: int
) -> Array:
    """Return draws of Normal(mean, sd) truncated to `box`, by inversion."""
    low, high = ndtr((np.array(box) - mean) / sd)
    draws = mean + sd * ndtri(rng.uniform(low, high, size))
    return np.asarray(np.clip(draws, *box))


def oil_temperature(rng: np.random.Generator, size: int) -> Array:
    """Return the temperature [degC] over the run order: AR(1) about 80, after a cold start (i)."""
    memory, sd = 0.9, 2.0  # -, K (i)
    shocks = sd * rng.standard_normal(size)
    wander = np.empty(size)
    wander[0] = shocks[0]
    for r in range(1, size):
        wander[r] = memory * wander[r - 1] + np.sqrt(1.0 - memory**2) * shocks[r]
    return np.asarray(80.0 + wander - 8.0 * np.exp(-np.arange(size) / 15.0))


def _realistic(rng: np.random.Generator, table: pd.DataFrame) -> pd.DataFrame:
    """Return measurements of a bench that the model does not know; every number in it is (i)."""
    size = len(table)
    order = rng.permutation(size)
    temperature = oil_temperature(rng, size)[order]
    warmer = temperature - 80.0  # K
    wear = order / max(size - 1, 1)
    centrifugal = (table["motor_speed"].to_numpy() / 1350.0) ** 2 - 1.0
    scatter = rng.standard_normal((4, size))
    runs = make_runs(
        **{name: table[name] for name in _CONDITIONS[:-1]},
        brake_torque=table["brake_torque"] * (1.0 + 0.03 * scatter[0]),
        c2_scale=0.91 * (1.0 - 0.10 * centrifugal) + 0.08 * scatter[1],
        zp_scale=0.55 * (1.0 + 0.05 * wear) + 0.045 * scatter[2],
        delay=0.004,  # s
        frequency_factor=1.0 + 0.004 * warmer,
        drag_factor=np.exp(-0.02 * warmer),
        friction_factor=(1.0 - 0.0015 * warmer) * (1.0 - 0.03 * wear),
        fade=0.10,
    )
    times = synchronization_time(runs) + 0.002 * scatter[3]  # s
    return table.assign(
        shifting_time=np.ceil(times * 1000.0) / 1000.0,
        run_order=order,
        oil_temperature=temperature,
    )
