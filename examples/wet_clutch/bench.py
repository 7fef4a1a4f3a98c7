"""The virtual test bench: synthetic measurements of the 108 experiments of the wet clutch.

The measurements of the paper are not public. Everything here was invented, and is marked (i).
`python -m examples.wet_clutch.bench --seed 1`, in the project's folder, prints the table of the
example, with the order of the runs and the temperature of the oil as two more columns.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.special import ndtr, ndtri

from examples.wet_clutch.model import Array, make_runs, shifting_time, synchronization_time

#: Levels of the full factorial design. The paper gives their numbers and the motor speeds.
LEVELS = {
    "pulse_duration": (0.070, 0.090, 0.110),  # s, Delta t (i)
    "hold_current": (0.248, 0.260, 0.272),  # A, u_0 (i)
    "pulse_current": (0.070, 0.135),  # A, Delta u (i)
    "motor_speed": (1200.0, 1350.0, 1500.0),  # rpm (paper)
    "brake_torque": (20.0, 80.0),  # N m, T_b0 (i)
}

#: Feasible box of (x_1, x_2): all 108 experiments synchronize in it, and no jump was found (i).
BOX = ((0.5, 1.4), (0.3, 1.2))

KINDS = ("realistic", "model")


def design() -> pd.DataFrame:
    """The 108 experiments, one a row: `id` (1 to 108) and the conditions of `LEVELS`.

    The brake torque varies fastest, then hold current, filling pulse, pulse current and motor
    speed.
    """
    names = ["motor_speed", "pulse_current", "pulse_duration", "hold_current", "brake_torque"]
    grids = np.meshgrid(*(LEVELS[name] for name in names), indexing="ij")
    columns = {name: grid.ravel() for name, grid in zip(names, grids, strict=True)}
    table = pd.DataFrame(columns)[list(LEVELS)]
    table.insert(0, "id", np.arange(1, len(table) + 1))
    return table


def measure(
    seed: int,
    kind: str = "realistic",
    noise_sd: float = 0.0,
    alpha: Sequence[float] = (0.91, 0.55, 0.081, 0.046),
    conditions: pd.DataFrame | None = None,
) -> pd.DataFrame:
    """One synthetic measurement of the shifting time for each experiment, of `design` by default.

    Kind "model" is well specified: y_l = Y(l; x_l) + noise, with x_l independent for each
    experiment, normal with the means and standard deviations of `alpha` (mean 1, mean 2, sd 1,
    sd 2), truncated to the box, and a normal noise of standard deviation `noise_sd` [s]. It serves
    recovery studies, because the truth is known.

    Kind "realistic" differs from the model in ways the model knows nothing of: the temperature of
    the oil wanders and starts cold (viscosity, valve, friction), the plates wear, the friction
    falls with the slip, centrifugal force adds to the oil's pressure, the brake scatters, the valve
    is 4 ms late, and the clock adds 2 ms of noise and rounds up to 1 ms. It has the columns
    `run_order` (from 0) and `oil_temperature` [degC] too, which the model does not use.

    The same seed gives the same measurements. Raises ValueError for an unknown kind, a negative
    standard deviation or one of kind "realistic", an `alpha` of another length, or conditions that
    lack a column. Takes some 60 ms.
    """
    if kind not in KINDS:
        raise ValueError(f"kind = {kind!r} is not a kind of test bench: use 'realistic' or 'model'")
    if not noise_sd >= 0.0 or (kind == "realistic" and noise_sd > 0.0):
        raise ValueError(f"noise_sd = {noise_sd!r}: use a number >= 0, and 0 for 'realistic'")
    table = design() if conditions is None else conditions.reset_index(drop=True)
    missing = [name for name in LEVELS if name not in table]
    if missing:
        raise ValueError(f"the conditions have no column {', '.join(missing)}")
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
        raise ValueError(f"alpha = {alpha!r}: give two means and two standard deviations > 0")
    (mean_1, mean_2, sd_1, sd_2), (box_1, box_2) = values, BOX
    times = shifting_time(
        **{name: table[name] for name in LEVELS},
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
        **{name: table[name] for name in LEVELS if name != "brake_torque"},
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


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the measurements of a seed as a table."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--kind", choices=KINDS, default="realistic")
    chosen = parser.parse_args(arguments)
    measure(chosen.seed, chosen.kind).to_csv(sys.stdout, index=False, lineterminator="\n")


if __name__ == "__main__":
    main()
