"""The next experiments on the wet clutch: chosen ones against repeating the factorial.

The virtual bench of kind "model" measures the 108 experiments, the law is identified, and the
experiments are chosen by which the standard error of the weakest standard deviation is to halve.
They are measured on the same bench, and all are identified again. Beside that stands the factorial
with three repetitions, which quarter every variance.
All measurements are synthetic.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from rich.console import Console
from scipy.stats import qmc

from aleator import (
    Check,
    Free,
    GradientMultistart,
    Identification,
    Inputs,
    MaximumEntropy,
    TruncatedNormal,
    identify,
    next_experiments,
)
from aleator.tasks.next_experiment import NextExperiments
from examples.wet_clutch.bench import BOX, design, measure
from examples.wet_clutch.model import shifting_time

TRUTH = (0.91, 0.55, 0.081, 0.046)
"""Means and standard deviations that the bench draws its two parameters by."""
LIMITS = {
    "pulse_duration": (0.065, 0.115),
    "hold_current": (0.245, 0.275),
    "pulse_current": (0.055, 0.150),
    "motor_speed": (1150.0, 1550.0),
    "brake_torque": (15.0, 90.0),
}
"""Of candidates: about a quarter of a step of the factorial beyond its levels."""
CANDIDATES = 8
"""Power of two of their number."""
MOST = 162
"""Half of the 324 experiments by which the factorial halves every standard error."""
EACH = 8
"""How often a candidate may be chosen."""
LAWS = Inputs(
    {
        "c2_scale": TruncatedNormal(BOX[0], sd=Free(0.002, 0.4)),
        "zp_scale": TruncatedNormal(BOX[1], sd=Free(0.002, 0.4)),
    }
)


def print_next(console: Console, seeds: range = range(1, 3)) -> None:
    """A block of lines for each seed of the first measurements, in some minutes each."""
    for seed in seeds:
        one_plan(console, seed)


def one_plan(console: Console, seed: int) -> None:
    """Plan by the measurements of one seed, measure, and identify again."""
    first = measure(seed, kind="model", alpha=TRUTH)
    found = identified(first)
    plan = next_experiments(found, candidates(), MOST, repeat=EACH)
    about = plan.about
    size = 1 + int(np.argmax(np.array(plan.after) <= 0.5 * plan.now))
    reached = plan.after[size - 1]
    console.print(
        f"seed {seed}: {about} {_with_error(found, about)}; planned: {size} experiments "
        f"({len(set(plan.chosen[:size]))} distinct) from {plan.now:.4f} to {reached:.4f}"
    )
    if reached > 0.5 * plan.now:
        console.print(f"  {MOST} experiments do not halve it")
        return
    console.print(
        f"  {MOST} chosen: as good as {108 * (plan.repetitions or 0):.0f} of the factorial"
    )
    rows = {f"{size} chosen": chosen_rows(plan, size), "324 of the factorial": factorial(3)}
    for name, conditions in rows.items():
        new = measure(seed + 1000, kind="model", alpha=TRUTH, conditions=conditions)
        again = identified(pd.concat([first, new], ignore_index=True).drop(columns="id"))
        console.print(f"  with {name}: {_with_error(again, about)}")


def identified(table: pd.DataFrame) -> Identification:
    """The law by four moments, as the example identifies it."""
    return identify(
        shifting_time, table, LAWS, outcome="shifting_time", vectorized=True,
        density=MaximumEntropy(4), verification=Check(0), search=GradientMultistart(starts=4),
    )  # fmt: skip


def candidates() -> pd.DataFrame:
    """Conditions all over the limits."""
    u = qmc.Sobol(len(LIMITS), rng=3).random_base2(CANDIDATES)
    return pd.DataFrame(qmc.scale(u, *np.array([*LIMITS.values()]).T), columns=[*LIMITS])


def chosen_rows(plan: NextExperiments, size: int) -> pd.DataFrame:
    """The conditions of the first experiments of a plan."""
    return plan.plan()[[*LIMITS]].iloc[:size].reset_index(drop=True)


def factorial(times: int) -> pd.DataFrame:
    """The conditions of the 108 experiments, so many times."""
    return pd.concat([design().drop(columns="id")] * times, ignore_index=True)


def _with_error(found: Identification, name: str) -> str:
    return f"{found.values[name]:.4f} with standard error {found.errors[name]:.4f}"
