"""Print nights.csv: pressures that are drawn from a known law. Nobody has opened these hydrants."""

import numpy as np
import pandas as pd
from model import pressures

DEMAND = (1.0, 0.2)  # mean and standard deviation of the normal law
ROUGHNESS = 105.0
ERROR = 0.2  # m, of both gauges
FLOWS = [10.0, 25.0]  # L/s


def main(seed: int = 1) -> None:
    rng = np.random.default_rng(seed)
    rows = []
    for k in range(14):
        demand = rng.normal(*DEMAND)
        for flow in FLOWS:
            exact = pressures(flow, demand, ROUGHNESS)
            measured = [round(value + ERROR * rng.normal(), 2) for value in exact.values()]
            rows.append((f"N{k + 1:02d}", flow, *measured))
    table = pd.DataFrame(rows, columns=["night", "flow", "at_hydrant", "at_junction"])
    print(table.to_csv(index=False), end="")


if __name__ == "__main__":
    main()
