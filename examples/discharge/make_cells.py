"""Print cells.csv: capacities drawn from a known law. Nobody has discharged these cells."""

import numpy as np
import pandas as pd
from model import capacity

CONTACT = (18.0, 5.0)  # mean and standard deviation of the normal law, mOhm
DIFFUSIVITY = 3.3  # 1e-14 m2/s
ERROR = 0.01  # A h
CURRENTS = [5.0, 10.0]  # A


def main(seed: int = 1) -> None:
    rng = np.random.default_rng(seed)
    rows = []
    for k in range(20):
        contact = rng.normal(*CONTACT)
        for current in CURRENTS:
            measured = capacity(current, contact, DIFFUSIVITY) + ERROR * rng.normal()
            rows.append((f"C{k + 1:02d}", current, round(measured, 3)))
    table = pd.DataFrame(rows, columns=["cell", "current", "capacity"])
    print(table.to_csv(index=False), end="")


if __name__ == "__main__":
    main()
