"""Print shots.csv: delays that are drawn from a known law. These shots were never fired."""

import numpy as np
import pandas as pd
from model import delay

OFF = 8.0  # standard deviation of the normal law, K
BRANCHING = 1.15
ERROR = 0.03  # of the logarithm
TEMPERATURES = [980.0, 1050.0, 1150.0, 1300.0]  # K


def main(seed: int = 1) -> None:
    rng = np.random.default_rng(seed)
    rows = []
    for k in range(36):
        temperature = TEMPERATURES[k % 4]
        exact = delay(temperature, OFF * rng.standard_normal(), BRANCHING)
        measured = exact * np.exp(ERROR * rng.standard_normal())
        rows.append((f"S{k + 1:02d}", temperature, round(float(measured), 1)))
    table = pd.DataFrame(rows, columns=["id", "temperature", "delay"])
    print(table.to_csv(index=False), end="")


if __name__ == "__main__":
    main()
