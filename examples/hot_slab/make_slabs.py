"""Writes simulated tests: slabs.csv of the bench, furnace.csv with some in a furnace besides."""

from pathlib import Path

import numpy as np
import pandas as pd
from model import reading

TRUTH = {"conductivity": (0.070, 0.004), "capacity": (4.2e5, 2.0e4)}  # mean, sd of each law
LAG, STRENGTH, NOISE = 0.02, (1.01, 0.015), 1.0
BENCH = [(flux, thickness, 0) for flux in (1000.0, 2000.0) for thickness in (0.0127, 0.0254)]
FURNACE = [(3500.0, 0.019, 1)]
TIMES = (200.0, 400.0, 600.0, 800.0, 1000.0)
SLABS, FURNACES = 6, 4  # of each kind


def slabs(kinds: list[tuple[float, float, int]], each: int, name: str, seed: int) -> pd.DataFrame:
    """A row for each slab and time: what the thermocouple reads, to a tenth of a degree."""
    rng, rows = np.random.default_rng(seed), []
    for number in range(each * len(kinds)):
        flux, thickness, fire = kinds[number % len(kinds)]
        k, c, strength = (rng.normal(*law) for law in (*TRUTH.values(), STRENGTH))
        for time in TIMES:
            true = reading(flux, thickness, time, fire, k, c, LAG, strength)
            read = round(true + rng.normal(0.0, NOISE), 1)
            rows.append((f"{name} {number + 1}", flux, thickness, time, fire, read))
    return pd.DataFrame(rows, columns=["id", "flux", "thickness", "time", "fire", "temperature"])


if __name__ == "__main__":
    bench, folder = slabs(BENCH, SLABS, "slab", seed=1), Path(__file__).parent
    bench.to_csv(folder / "slabs.csv", index=False)
    furnace = pd.concat([bench, slabs(FURNACE, FURNACES, "furnace", seed=2)])
    furnace.to_csv(folder / "furnace.csv", index=False)
