"""Print stops.csv: braking distances that are drawn from known laws. Nobody has driven them."""

import numpy as np
import pandas as pd
from model import distance

SPEEDS = [50.0, 80.0, 110.0]
ROADS = {"dry": (0.80, 0.05), "wet": (0.62, 0.05)}  # mean and standard deviation of the friction
DELAY = 0.25  # s
ERROR = 0.3  # m


def main(seed: int = 1) -> None:
    rng = np.random.default_rng(seed)
    table = pd.DataFrame(
        [(speed, road) for speed in SPEEDS for road in ROADS for _ in range(6)],
        columns=["speed", "road"],
    )
    friction = [rng.normal(*ROADS[road]) for road in table["road"]]
    exact = distance(table["speed"], np.array(friction), DELAY)
    table["distance"] = (exact + rng.normal(0.0, ERROR, len(table))).round(1)
    table.insert(0, "id", [f"S{k:02d}" for k in range(1, len(table) + 1)])
    print(table.to_csv(index=False), end="")


if __name__ == "__main__":
    main()
