"""Print frames.csv: drifts that are drawn from known laws. These frames were never built."""

import numpy as np
import pandas as pd
from model import drift

BASE = {"A": 4.0, "B": 6.0}  # means of the lognormal laws, MN m/rad
SD = 1.0  # of both
ERROR = 0.2  # mm
LOADS = [15.0, 30.0]  # kN


def main(seed: int = 1) -> None:
    rng = np.random.default_rng(seed)
    rows = []
    for k in range(24):
        workshop = "AB"[k % 2]
        mean = BASE[workshop]
        spread = np.sqrt(np.log1p((SD / mean) ** 2))
        base = mean * np.exp(spread * rng.standard_normal() - 0.5 * spread**2)
        for load in LOADS:
            measured = round(drift(load, base) + ERROR * rng.normal(), 2)
            rows.append((f"F{k + 1:02d}", workshop, load, measured))
    table = pd.DataFrame(rows, columns=["frame", "workshop", "load", "drift"])
    print(table.to_csv(index=False), end="")


if __name__ == "__main__":
    main()
