"""Prints the tests of simulated specimens: `python make_specimens.py > experiments.csv`."""

import sys

import numpy as np
import pandas as pd
from model import kilocycles

TRUTH = {"v.mean": -0.6, "v.sd": 0.03, "b0.value": -1.0, "b1.value": -3.0, "noise.sd": 0.25}
RATIOS = (0.95, 0.80, 0.70, 0.65, 0.60, 0.575)
SPECIMENS = 15  # at each ratio
END = 10_000.0  # thousands of cycles after which a test is ended


def specimens(seed: int = 1) -> pd.DataFrame:
    """One row a specimen: its stress ratio, its life to four digits, and how the test ended."""
    rng = np.random.default_rng(seed)
    ratio = np.repeat(RATIOS, SPECIMENS)
    v = rng.normal(TRUTH["v.mean"], TRUTH["v.sd"], ratio.size)
    noise = rng.normal(0.0, TRUTH["noise.sd"], ratio.size)
    life = kilocycles(ratio, v, TRUTH["b0.value"], TRUTH["b1.value"]) * np.exp(noise)
    seen = [float(f"{value:.4g}") for value in np.minimum(life, END)]
    ended = np.where(life < END, "failure", "run-out")
    return pd.DataFrame({"ratio": ratio, "kilocycles": seen, "ended": ended})


if __name__ == "__main__":
    specimens().to_csv(sys.stdout, index=False)
