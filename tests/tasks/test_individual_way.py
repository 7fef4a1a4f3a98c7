"""The way of an identification through experiments with several observations."""

from dataclasses import replace

import numpy as np
import pytest
from identifications import unjudged
from individual_cases import ALPHA, PAIR, decay, likelihood_of, straight_line, table

from aleator import Experiments, Free, Noise, ResponseSurface
from aleator.fit.quadrature import nearest_maximum, with_enough_nodes
from aleator.inference.check import checked
from aleator.likelihood.individual import OnSurfaces
from aleator.simulators import Runner
from aleator.surrogates import build_surface

REGION = np.array([[-12.0, 14.0], [-6.0, 6.0]])


def line(time, a, b):
    return a + b * time


def test_it_settles_where_no_step_and_no_node_gains():
    likelihood = likelihood_of(decay, table(decay, experiments=20), nodes=3)
    end = with_enough_nodes(likelihood, ALPHA)
    again, alpha = nearest_maximum(end.likelihood, end.alpha * 1.02)
    assert again.evaluate(alpha).total == pytest.approx(end.value, abs=1e-3)
    finest = end.likelihood.by(replace(end.likelihood.rule, first=41, others=41), end.alpha)
    assert finest.evaluate(end.alpha).total == pytest.approx(end.value, abs=1e-2)
    assert end.gap == pytest.approx(0.0, abs=2e-3)


@pytest.mark.slow
def test_surfaces_and_the_simulator_itself_lead_to_one_answer():
    frame = table(straight_line, experiments=15)
    experiments = Experiments.from_frame(frame, outcome="y", id="id")
    noise = Noise(Free(0.01, 5.0))
    direct, surfaced = (
        unjudged(line, experiments, PAIR, noise=noise, propagation=ResponseSurface(surfaces=way))
        for way in ("none", "own")
    )
    assert surfaced.sound
    assert surfaced.log_likelihood.estimated == pytest.approx(
        direct.log_likelihood.estimated, abs=0.01
    )
    assert surfaced.log_likelihood.verified == pytest.approx(
        direct.log_likelihood.estimated, abs=0.01
    )
    off = (surfaced.values - direct.values) / direct.errors
    assert off.abs().max() < 0.05


def test_the_check_tells_what_wrong_surfaces_change():
    frame = table(straight_line, experiments=12)
    experiments = Experiments.from_frame(frame, outcome="y", id="id")
    time = frame["time"].to_numpy()
    row = experiments.observations.row
    wrong = build_surface(
        lambda index, x: line(time[index], x[:, 0] + 0.1, x[:, 1]), REGION, len(frame)
    )
    direct = likelihood_of(straight_line, frame)
    surfaces = OnSurfaces(wrong, REGION, row)
    on_wrong = type(direct).of(PAIR, direct.errors, surfaces, direct.layout, direct.rule)
    found = checked(on_wrong.adapted(ALPHA), ALPHA, Runner(line, experiments, PAIR.names), 64)
    wanted = direct.adapted(ALPHA)(ALPHA).total - on_wrong.adapted(ALPHA)(ALPHA).total
    assert abs(wanted) > 0.3
    assert found.total == pytest.approx(wanted, abs=0.02)
    assert found.standard_error < abs(wanted)
