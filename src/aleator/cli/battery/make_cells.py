"""Print cells.csv: capacities that are drawn from a known law. Nobody has cycled these cells."""

import numpy as np
import pandas as pd
from model import capacity

FADE = (0.42, 0.06)  # mean and standard deviation of the lognormal law, % over root of cycles
ACTIVATION = 25.0  # kJ/mol
ERROR = 0.3  # %
CYCLES = [50.0, 150.0, 300.0, 500.0]
TEMPERATURES = [25.0, 40.0, 55.0]


def main(seed: int = 1) -> None:
    rng = np.random.default_rng(seed)
    mean, sd = FADE
    spread = np.sqrt(np.log1p((sd / mean) ** 2))
    rows = []
    for k in range(18):
        temperature = TEMPERATURES[k % 3]
        fade = mean * np.exp(spread * rng.standard_normal() - 0.5 * spread**2)
        for cycles in CYCLES:
            measured = capacity(cycles, temperature, fade, ACTIVATION) + ERROR * rng.normal()
            rows.append((f"C{k + 1:02d}", temperature, cycles, round(float(measured), 2)))
    table = pd.DataFrame(rows, columns=["cell", "temperature", "cycles", "capacity"])
    print(table.to_csv(index=False), end="")


if __name__ == "__main__":
    main()
