"""Experiments with several observations: whole fits, one evaluation of many, and two peers.

statsmodels' MixedLM maximizes the same likelihood where the simulator is linear. Metropolis within
Gibbs is how the example of OpenTURNS solves the fission-gas study; it is slow to ask for an
estimate as exact as ours, so it is asked for a hundred effective draws of each hyperparameter.
"""

from __future__ import annotations

import importlib.util
import resource
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd

from aleator import Experiments, Free, Identification, Inputs, LogNormal, Noise, Normal, identify
from aleator.cli.running import identified
from aleator.core.progress import Silent
from aleator.core.types import Array
from aleator.likelihood.individual import Direct, GaussHermite, IndividualLikelihood, Layout
from aleator.observations.errors import MeasurementErrors
from aleator.simulators import as_runner
from aleator.study import load_study
from benchmarks.gibbs import effective, posterior
from benchmarks.row import Row, seconds_row

ROOT = Path(__file__).parent.parent
SLEEP = ROOT / "tests" / "data" / "sleepstudy.csv"
FISSION = ROOT / "examples" / "fission_gas" / "study.toml"
FISSION_MAXIMUM = 57.102331
"""log L by a quadrature of its own: tests/examples/test_fission_gas.py."""
NODES = 5
MANY = {10_000: 0.5, 100_000: 5.0}
"""Experiments, and seconds for log L with its score."""
MEMORY = 2.0
"""GiB of the whole process."""
DRAWS = 100
SWEEPS = 4000


def individual_rows() -> list[Row]:
    """All of it, in some minutes."""
    rows = [small_row(), *(row for count in MANY for row in large_rows(count))]
    return [*rows, *linear_rows(), *fission_rows()]


def uptake(time: Array, absorption: Array, elimination: Array) -> Array:
    """A concentration after a dose of ten that is absorbed and eliminated, in a volume of one."""
    ratio = absorption / (absorption - elimination)
    return np.asarray(10.0 * ratio * (np.exp(-elimination * time) - np.exp(-absorption * time)))


LAWS = Inputs(
    {
        "absorption": LogNormal(Free(0.3, 10.0, 5.0), Free(0.01, 5.0, 2.0)),
        "elimination": LogNormal(Free(0.005, 0.25, 0.02), Free(0.0005, 0.2, 0.1)),
    }
)


def series(experiments: int, observations: int) -> pd.DataFrame:
    """Series of lognormal parameters, with normal errors."""
    rng = np.random.default_rng(0)
    theta = rng.standard_normal((experiments, 2))
    own = np.repeat(np.exp([0.4, -2.5] + 0.4 * theta), observations, axis=0)
    time = np.tile(np.geomspace(0.25, 24.0, observations), experiments)
    y = uptake(time, *own.T) + 0.3 * rng.standard_normal(time.size)
    return pd.DataFrame(
        {"id": np.repeat(np.arange(experiments), observations), "time": time, "y": y}
    )


def small_row() -> Row:
    """12 x 11, from poor starts; runs of the simulator are part of it."""
    table = Experiments.from_frame(series(12, 11), outcome="y")
    began = time.perf_counter()
    identify(uptake, table, LAWS, noise=Noise(Free(0.01, 5.0, 2.0)), vectorized=True)
    seconds = time.perf_counter() - began
    return seconds_row("12 x 11, two scattering parameters: identify, 10 starts", seconds, 0.5)


def large_rows(count: int) -> list[Row]:
    """log L with its score: nodes held, and adapted."""
    table = Experiments.from_frame(series(count, 10), outcome="y")
    runner = as_runner(uptake, table, LAWS.names, True)
    layout = Layout(count, table.observations.experiment, runner.unit, runner.column)
    errors = MeasurementErrors.of(Noise(Free(0.01, 5.0)), table)
    direct = Direct(runner, np.arange(2), LAWS.box)
    likelihood = IndividualLikelihood.of(LAWS, errors, direct, layout, GaussHermite(NODES))
    alpha = np.array([1.6, 0.7, 0.09, 0.04, 0.3])
    began = time.perf_counter()
    held = likelihood.adapted(alpha)
    adapted = time.perf_counter()
    held(alpha)
    ended = time.perf_counter()
    what = f"{count:,} x 10, two scattering parameters, {NODES**2} nodes"
    unit = 1024.0**3 if sys.platform == "darwin" else 1024.0**2
    gibibytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
    return [
        seconds_row(f"{what}: log L with score", ended - adapted, MANY[count]),
        seconds_row(f"{what}: adapting the nodes", adapted - began, MANY[count]),
        Row(f"{what}: most memory so far", f"{gibibytes:.2f} GiB", f"target {MEMORY} GiB",
            gibibytes / MEMORY),
    ]  # fmt: skip


def linear_rows() -> list[Row]:
    """Seconds, and how far statsmodels' maximum is above ours; nothing without statsmodels."""
    if importlib.util.find_spec("statsmodels") is None:
        return []
    from statsmodels.regression.mixed_linear_model import MixedLM

    table = Experiments.from_csv(SLEEP, outcome="reaction", id="unit")
    inputs = Inputs(
        {
            "start": Normal(Free(100.0, 400.0), Free(0.1, 200.0)),
            "slope": Normal(Free(-50.0, 50.0), Free(0.05, 50.0)),
        },
        {("start", "slope"): Free(-0.99, 0.99)},
    )
    began = time.perf_counter()
    ours = identify(
        lambda days, start, slope: start + slope * days, table, inputs,
        noise=Noise(Free(1.0, 200.0)), vectorized=True,
    )  # fmt: skip
    between = time.perf_counter()
    frame = pd.read_csv(SLEEP)
    model = MixedLM.from_formula("reaction ~ days", frame, "~days", groups=frame["unit"])
    theirs = model.fit(reml=False)
    ended = time.perf_counter()
    gap = float(theirs.llf) - ours.log_likelihood.estimated
    what = "sleepstudy, correlated"
    return [
        Row(f"{what}: identify with its intervals / MixedLM.fit", f"{between - began:.2f} s",
            f"{ended - between:.2f} s", (between - began) / (ended - between)),
        Row(f"{what}: log L below MixedLM's", f"{gap:.1e}", "target 0.01", abs(gap) / 0.01),
    ]  # fmt: skip


def fission_rows() -> list[Row]:
    """Seconds to the maximum, and to a hundred effective draws of the posterior."""
    study = load_study(FISSION)
    began = time.perf_counter()
    ours: Identification = identified(study, study.runner(), Silent())
    between = time.perf_counter()
    draws = posterior(study, SWEEPS)
    ended = time.perf_counter()
    least = min(effective(column) for column in draws.T)
    theirs = (ended - between) * DRAWS / least
    gap = FISSION_MAXIMUM - ours.log_likelihood.estimated
    return [
        Row(f"fission gas: identify / {DRAWS} effective draws by Metropolis within Gibbs",
            f"{between - began:.1f} s", f"{theirs:.1f} s", (between - began) / theirs),
        Row("fission gas: log L below the exact maximum", f"{gap:.1e}", "target 0.01",
            abs(gap) / 0.01),
    ]  # fmt: skip
