"""Measure the speed of the simulator: `python -m aleator.clutch.speed` prints a table.

Runs are drawn over all experiments and the whole box. solve_ivp gets the loosest tolerances whose
error comes near 1e-6 s. Seconds are those of the processor, so other work on the machine counts
little; set OMP_NUM_THREADS=1 and OPENBLAS_NUM_THREADS=1, so that they are those of one core.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from aleator.clutch.bench import BOX
from aleator.clutch.doe import design
from aleator.clutch.reference import reference_shifting_time
from aleator.clutch.simulator import shifting_time

Array = NDArray[np.float64]

BATCHES = (1, 10, 100, 1_000, 10_000)
REFERENCES = (("RK45", 1e-8), ("LSODA", 1e-7), ("DOP853", 1e-8))


def sample(size: int, seed: int = 0) -> dict[str, Array]:
    """Return arguments of `shifting_time`: random experiments, scales uniform in the box."""
    rng = np.random.default_rng(seed)
    table = design().drop(columns="id")
    rows = table.iloc[rng.integers(0, len(table), size)]
    arguments = {name: rows[name].to_numpy(dtype=np.float64) for name in table.columns}
    (low_1, high_1), (low_2, high_2) = BOX
    arguments["c2_scale"] = rng.uniform(low_1, high_1, size)
    arguments["zp_scale"] = rng.uniform(low_2, high_2, size)
    return arguments


def _reference(runs: dict[str, Array], method: str, tolerance: float, max_step: float) -> Array:
    """Return the reference's shifting times, one run after the other."""
    times = [
        reference_shifting_time(
            **dict(zip(runs, row, strict=True)),
            method=method,
            tolerance=tolerance,
            max_step=max_step,
        )
        for row in zip(*(values.tolist() for values in runs.values()), strict=True)
    ]
    return np.array(times)


def main() -> None:
    """Print runs per second of the simulator and of the reference, with errors."""
    print("simulator, best of 3")
    for size in BATCHES:
        runs, seconds = sample(size), []
        for _ in range(3):
            start = time.process_time()
            shifting_time(**runs)
            seconds.append(time.process_time() - start)
        print(f"  batch of {size:6d}: {size / min(seconds):8.0f} runs/s")
    runs = sample(100, seed=1)
    exact = _reference(runs, "RK45", 1e-10, 2e-3)
    error = np.abs(shifting_time(**runs) - exact).max()
    print(f"simulator, largest error over {len(exact)} runs: {error:.1e} s")
    print("solve_ivp, restarted at every breakpoint of the current")
    for method, tolerance in REFERENCES:
        start = time.process_time()
        times = _reference(runs, method, tolerance, np.inf)
        rate = len(times) / (time.process_time() - start)
        error = np.abs(times - exact).max()
        print(f"  {method:6s} {tolerance:.0e}: {rate:8.0f} runs/s, largest error {error:.1e} s")


if __name__ == "__main__":
    main()
