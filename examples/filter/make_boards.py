"""Print boards.csv: cutoffs that are drawn from known laws. These boards were never built."""

import re
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd

BOARD = (1.0, 0.01)  # mean and standard deviation of the capacitors of one reel, over nominal
REEL = 0.03  # standard deviation between reels
ERROR = 20.0  # Hz
NETLIST = (Path(__file__).parent / "filter.cir.tpl").read_text(encoding="utf-8")


def cutoff(capacitor: float, shift: float) -> float:
    netlist = NETLIST.replace("<capacitor>", str(capacitor)).replace("<shift>", str(shift))
    said = subprocess.run(
        ["ngspice", "-b"], input=netlist, capture_output=True, text=True, check=True
    )
    return float(re.findall(r"^cutoff\s+=\s+(\S+)", said.stdout, re.MULTILINE)[-1])


def main(seed: int = 1) -> None:
    rng = np.random.default_rng(seed)
    rows = []
    for reel in range(10):
        shift = REEL * rng.standard_normal()
        for k in range(4):
            measured = cutoff(rng.normal(*BOARD), shift) + ERROR * rng.normal()
            rows.append((f"B{4 * reel + k + 1:02d}", f"R{reel + 1:02d}", round(measured)))
    table = pd.DataFrame(rows, columns=["board", "reel", "cutoff"])
    print(table.to_csv(index=False), end="")


if __name__ == "__main__":
    main()
