"""Print mounts.csv: curves that are drawn from known laws. These mounts do not exist."""

import numpy as np
import pandas as pd
from model import place

STIFFNESS = (1800.0, 90.0)  # mean and standard deviation of the normal law, N/m
DAMPING = (8.0, 1.5)  # mean and standard deviation of the lognormal law, N s/m
HARDENING = 20.0  # N/m per mm2
ERROR = 0.1  # mm
TIMES = 0.05 * np.arange(1, 11)  # s
START = 10.0  # mm


def main(seed: int = 1) -> None:
    rng = np.random.default_rng(seed)
    mean, sd = DAMPING
    spread = np.sqrt(np.log1p((sd / mean) ** 2))
    rows = []
    for k in range(12):
        stiffness = rng.normal(*STIFFNESS)
        damping = mean * np.exp(spread * rng.standard_normal() - 0.5 * spread**2)
        exact, _slopes = place(TIMES, START, stiffness, damping, HARDENING)
        for time, value in zip(TIMES, exact, strict=True):
            measured = round(float(value + ERROR * rng.normal()), 2)
            rows.append((f"M{k + 1:02d}", round(time, 2), START, measured))
    table = pd.DataFrame(rows, columns=["mount", "time", "start", "place"])
    print(table.to_csv(index=False), end="")


if __name__ == "__main__":
    main()
