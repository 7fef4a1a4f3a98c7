"""The check on the simulator: what it tells is right, and surfaces that are off are refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
from individual_cases import ALPHA as AT_LINES
from individual_cases import PAIR, likelihood_of, straight_line, table
from scipy import stats

from aleator import Free, Inputs, Noise, Normal
from aleator.core.types import Array, Indices
from aleator.errors import InputsError
from aleator.inference.check import Check, Checked, checked, smoothed, unsmoothed
from aleator.inference.surface_diagnostics import check_refusals, worse_than_estimated
from aleator.likelihood.individual import (
    Direct,
    GaussHermite,
    IndividualLikelihood,
    Layout,
    OnSurfaces,
)
from aleator.likelihood.level_sets import LevelLikelihood
from aleator.observations.errors import MeasurementErrors
from aleator.observations.experiments import Experiments
from aleator.simulators import Runner, as_runner
from aleator.simulators.response_functions import DirectResponse
from aleator.surrogates import build_surface

COUNT, ALPHA = 100, np.array([1.0, 0.3, 0.5, 0.2])
LAW = Inputs(
    {"a": Normal(Free(0.0, 2.0), Free(0.01, 1.0)), "b": Normal(Free(0.0, 2.0), Free(0.01, 1.0))}
)
LOADS = np.linspace(0.5, 2.0, COUNT)
MIDDLE, SCATTER = LOADS * ALPHA[0] + ALPHA[2], np.hypot(LOADS * ALPHA[1], ALPHA[3])


class Surfaces(Direct):
    """Those of y = load a + b, off by a part `off` (N,) of what they are asked for."""

    def __init__(self, runner: Runner, off: Array) -> None:
        super().__init__(runner, np.arange(2), LAW.box)
        self.__dict__["off"] = off

    def values(self, block, x: Array) -> Array:  # type: ignore[no-untyped-def]
        return super().values(block, x) + self.__dict__["off"][block.rows, None]

    def with_slopes(self, block, x: Array) -> tuple[Array, Array]:  # type: ignore[no-untyped-def]
        eta, slopes = super().with_slopes(block, x)
        return eta + self.__dict__["off"][block.rows, None], slopes


def study(seed: int) -> tuple[Runner, Experiments]:
    rng = np.random.default_rng(seed)
    y = MIDDLE + SCATTER * rng.standard_normal(COUNT)
    table = Experiments.from_frame(pd.DataFrame({"load": LOADS, "y": y}), outcome="y")
    return as_runner(model, table, LAW.names, True, None), table


def model(load: Array, a: Array, b: Array) -> Array:
    return load * a + b


def layout(runner: Runner) -> Layout:
    return Layout(COUNT, np.arange(COUNT), runner.unit, runner.column)


def exactly(off: Array, seed: int, runs: int = 12) -> tuple[Checked, Array]:
    """The check of exact outcomes, and the outcomes."""
    runner, table = study(seed)
    y, settings = table.outcomes, Check()
    likelihood = smoothed(LAW, ALPHA, Surfaces(runner, off), layout(runner), y, settings.smooth)
    return checked(likelihood, ALPHA, runner, runs, settings), y


def with_noise(off: Array, seed: int, sd: float) -> tuple[Checked, Array]:
    runner, table = study(seed)
    errors = MeasurementErrors.of(Noise(sd), table)
    likelihood = IndividualLikelihood.of(
        LAW, errors, Surfaces(runner, off), layout(runner), GaussHermite(3)
    )
    alpha = np.append(ALPHA, sd)
    return checked(likelihood.adapted(alpha), alpha, runner, 12), table.outcomes


@pytest.mark.parametrize("way", [exactly, lambda off, seed: with_noise(off, seed, 0.1)])
def test_right_surfaces_are_right(way: Callable[[Array, int], tuple[Checked, Array]]) -> None:
    found, _ = way(np.zeros(COUNT), 1)
    assert abs(found.total) < 1e-9
    assert found.largest.max() < 1e-9
    np.testing.assert_allclose(found.scatter, SCATTER, rtol=0.04)


def test_the_change_is_that_of_the_marginal_density() -> None:
    """Of a normal outcome it is in closed form; the error that is told is larger."""
    off = 0.1 * SCATTER * np.sin(np.arange(COUNT))
    found, y = with_noise(off, 2, 0.1)
    sd = np.hypot(SCATTER, 0.1)
    exact = stats.norm.logpdf(y, MIDDLE, sd) - stats.norm.logpdf(y, MIDDLE + off, sd)
    assert abs(found.total - exact.sum()) < 3.0 * found.standard_error + 0.02
    np.testing.assert_allclose(found.largest, np.abs(off), atol=1e-9)
    np.testing.assert_allclose(found.relative, np.abs(off) / SCATTER, rtol=0.04, atol=1e-9)


@pytest.mark.parametrize("noise", [None, 0.02, 0.1, 0.5])
@pytest.mark.parametrize("seed", [3, 4])
def test_surfaces_off_by_a_twentieth_in_a_twentieth_of_the_experiments_are_refused(
    noise: float | None, seed: int
) -> None:
    rng, off = np.random.default_rng(seed), np.zeros(COUNT)
    which: Indices = rng.choice(COUNT, COUNT // 20, replace=False)
    off[which] = 0.05 * SCATTER[which] * rng.choice([-1.0, 1.0], which.size)
    found, _ = exactly(off, seed) if noise is None else with_noise(off, seed, noise)
    estimated = 0.005 * SCATTER
    ids = [str(k) for k in range(COUNT)]
    refused = worse_than_estimated(found, estimated, ids)
    assert len(refused) == 1
    assert set(refused[0].concerns) <= {str(k) for k in which}


@pytest.mark.parametrize("seed", range(5, 9))
def test_errors_that_surfaces_know_of_refuse_nothing(seed: int) -> None:
    off = 0.005 * SCATTER * np.random.default_rng(seed).standard_normal(COUNT)
    ids = [str(k) for k in range(COUNT)]
    for found, _ in (exactly(off, seed), exactly(off, seed, 2), with_noise(off, seed, 0.1)):
        assert not worse_than_estimated(found, 0.005 * SCATTER, ids)
        assert not check_refusals(found.total, found.standard_error)


@pytest.mark.parametrize("runs", [2, 12])
def test_of_exact_outcomes_the_change_is_that_of_their_own_density(runs: int) -> None:
    """The simulator is 1.03 times what surfaces say and 0.04 more: both normal, in closed form."""
    runner, table = study(11)
    y, settings = table.outcomes, Check()
    surfaces = DirectResponse(lambda i, x: LOADS[i] * x[:, 0] + x[:, 1], COUNT, LAW.box)
    levels = LevelLikelihood(LAW, surfaces, LAW.box, np.arange(COUNT), y, 128)
    off_runner = as_runner(
        lambda load, a, b: 1.03 * (load * a + b) + 0.04, table, LAW.names, True, None
    )
    likelihood = smoothed(
        LAW, ALPHA, Surfaces(runner, np.zeros(COUNT)), layout(runner), y, settings.smooth
    )
    found = checked(likelihood, ALPHA, off_runner, runs, settings, y)
    told = unsmoothed(found, levels, ALPHA)
    after = stats.norm.logpdf(y, 1.03 * MIDDLE + 0.04, 1.03 * SCATTER)
    exact = after - stats.norm.logpdf(y, MIDDLE, SCATTER)
    np.testing.assert_allclose(told.change, exact, atol=0.01)
    assert abs(told.total - exact.sum()) < 0.05 < abs(found.total - exact.sum())


@pytest.mark.parametrize("samples", [1, -5])
def test_too_few_runs_are_refused(samples: int) -> None:
    with pytest.raises(InputsError, match="samples"):
        Check(samples)


# ------------------------------------------------------------------------------ series

REGION = np.array([[-12.0, 14.0], [-6.0, 6.0]])


def line(time: float, a: float, b: float) -> float:
    return a + b * time


def brittle(time: float, a: float, b: float) -> float:
    """The same, but one run of twenty fails: which, has nothing to do with what it would give."""
    if (1e6 * (a + 3.0 * b)) % 1.0 < 0.05:
        raise RuntimeError("no convergence")
    return a + b * time


def broken(time: float, a: float, b: float) -> float:
    """It fails for a whole experiment's share of the law."""
    if a > AT_LINES[0]:
        raise RuntimeError("no convergence")
    return a + b * time


def of_series(simulator: object, off: float) -> tuple[Checked, float]:
    """The check of surfaces whose a is off by so much, and the change of the log-likelihood."""
    frame = table(straight_line, experiments=20)
    experiments = Experiments.from_frame(frame, outcome="y", id="id")
    time = frame["time"].to_numpy()
    surface = build_surface(
        lambda index, x: line(time[index], x[:, 0] + off, x[:, 1]), REGION, len(frame)
    )
    direct = likelihood_of(straight_line, frame)
    predictor = OnSurfaces(surface, REGION, experiments.observations.row)
    parts = (direct.errors, predictor, direct.layout, direct.rule)
    surfaces = IndividualLikelihood.of(PAIR, *parts).adapted(AT_LINES)
    runner = Runner(simulator, experiments, PAIR.names, max_failed=1.0)
    change = direct.adapted(AT_LINES)(AT_LINES).total - surfaces(AT_LINES).total
    return checked(surfaces, AT_LINES, runner, 64), change


def test_of_series_too_the_change_is_that_of_the_log_likelihood() -> None:
    found, change = of_series(line, 0.1)
    assert abs(change) > 0.3
    assert found.total == pytest.approx(change, abs=0.05)
    assert found.standard_error < abs(change)


@pytest.mark.parametrize("off", [0.0, 0.5])
def test_runs_that_fail_here_and_there_change_no_verdict(off: float) -> None:
    whole, found = of_series(line, off)[0], of_series(brittle, off)[0]
    assert found.total == pytest.approx(whole.total, rel=0.3, abs=1e-6)
    assert found.standard_error < max(abs(whole.total), 1e-6)


def test_an_experiment_of_which_every_run_fails_is_not_taken_for_checked() -> None:
    assert not np.isfinite(of_series(broken, 0.0)[0].total)
