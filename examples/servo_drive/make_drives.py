"""Print drives.csv: travels that are drawn from a known law. These drives do not exist."""

import numpy as np
import pandas as pd
from model import travel

BACKLASH = (1.2, 0.35)  # mean and standard deviation of the lognormal law, mrad
STIFFNESS = (4.0, 0.5)  # mean and standard deviation of the normal law, Nm/mrad
ERROR = 0.03  # mrad, of the encoder
COMMANDS = [1.5, 3.0]
TORQUES = [0.5, 2.0]


def main(seed: int = 1) -> None:
    rng = np.random.default_rng(seed)
    mean, sd = BACKLASH
    spread = np.sqrt(np.log1p((sd / mean) ** 2))
    rows = []
    for k in range(20):
        backlash = mean * np.exp(spread * rng.standard_normal() - 0.5 * spread**2)
        stiffness = rng.normal(*STIFFNESS)
        for command in COMMANDS:
            for torque in TORQUES:
                exact = travel(command, torque, backlash, stiffness)
                measured = round(float(exact + ERROR * rng.normal()), 3)
                rows.append((f"D{k + 1:02d}", command, torque, measured))
    table = pd.DataFrame(rows, columns=["drive", "command", "torque", "travel"])
    print(table.to_csv(index=False), end="")


if __name__ == "__main__":
    main()
