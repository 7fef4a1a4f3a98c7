"""Writes the two tables of docs/repeated.md: simulated experiments of a law that is known."""

from pathlib import Path

import numpy as np
import pandas as pd

HERE = Path(__file__).parent


def wear(rng: np.random.Generator) -> pd.DataFrame:
    """Thirty brake pads of two suppliers, each measured after five distances.

    The mean rate is 0.20 + 0.03 (pressure - 4) mm/Mm for supplier A, and 0.05 more for B.
    """
    rows = []
    for pad in range(30):
        supplier, pressure = "AB"[pad % 2], float(rng.choice([2.0, 3.0, 4.0, 5.0, 6.0]))
        mean = 0.20 + 0.03 * (pressure - 4.0) + 0.05 * (supplier == "B")
        rate = mean * np.exp(0.10 * rng.standard_normal())
        for distance in (2.0, 5.0, 10.0, 20.0, 30.0):
            truth = 0.3 * (1.0 - np.exp(-distance / 3.0)) + rate * distance
            measured = truth + 0.05 * rng.standard_normal()
            rows.append((f"P{pad + 1:02d}", supplier, pressure, distance, round(measured, 2)))
    columns = ["pad", "supplier", "pressure", "distance", "wear"]
    return pd.DataFrame(rows, columns=columns)


def coasting(rng: np.random.Generator) -> pd.DataFrame:
    """Twenty trolleys that coast: speed and way at six times, some ways not measured."""
    rows = []
    for trolley in range(20):
        start = float(rng.choice([2.0, 3.0, 4.0]))
        drag = 0.25 * np.exp(0.2 * rng.standard_normal())
        for time in (0.5, 1.0, 2.0, 3.0, 5.0, 8.0):
            speed = start * np.exp(-drag * time) * (1.0 + 0.02 * rng.standard_normal())
            way = start / drag * (1.0 - np.exp(-drag * time)) + 0.05 * rng.standard_normal()
            seen = "" if rng.random() < 0.1 else f"{way:.2f}"
            rows.append((f"T{trolley + 1}", start, time, f"{speed:.3f}", seen))
    return pd.DataFrame(rows, columns=["trolley", "start", "time", "speed", "way"])


if __name__ == "__main__":
    rng = np.random.default_rng(1)
    wear(rng).to_csv(HERE / "wear" / "wear.csv", index=False)
    coasting(rng).to_csv(HERE / "coasting" / "coasting.csv", index=False)
