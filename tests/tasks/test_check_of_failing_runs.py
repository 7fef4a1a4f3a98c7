"""The check of surfaces on a simulator of which some runs fail, here and there."""

import numpy as np
import pytest
from individual_cases import ALPHA, PAIR, likelihood_of, straight_line, table

from aleator import Experiments
from aleator.inference.check import Checked, checked
from aleator.likelihood.individual import OnSurfaces
from aleator.simulators import Runner
from aleator.surrogates import build_surface

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
    if a > ALPHA[0]:
        raise RuntimeError("no convergence")
    return a + b * time


def found(simulator: object, off: float) -> Checked:
    frame = table(straight_line, experiments=40)
    experiments = Experiments.from_frame(frame, outcome="y", id="id")
    time = frame["time"].to_numpy()
    surface = build_surface(
        lambda index, x: line(time[index], x[:, 0] + off, x[:, 1]), REGION, len(frame)
    )
    direct = likelihood_of(straight_line, frame)
    predictor = OnSurfaces(surface, REGION, experiments.observations.row)
    likelihood = type(direct).of(PAIR, direct.errors, predictor, direct.layout, direct.rule)
    runner = Runner(simulator, experiments, PAIR.names, max_failed=1.0)
    return checked(likelihood.adapted(ALPHA), ALPHA, runner, 64)


def test_right_surfaces_are_right_though_some_runs_fail() -> None:
    assert found(brittle, 0.0).total == pytest.approx(0.0, abs=1e-6)


def test_wrong_surfaces_are_wrong_though_some_runs_fail() -> None:
    wanted = found(line, 0.5).total
    told = found(brittle, 0.5)
    assert abs(wanted) > 0.3
    assert told.total == pytest.approx(wanted, rel=0.3)
    assert told.standard_error < abs(wanted)


def test_an_experiment_of_which_every_run_fails_is_not_taken_for_checked() -> None:
    assert not np.isfinite(found(broken, 0.0).total)
