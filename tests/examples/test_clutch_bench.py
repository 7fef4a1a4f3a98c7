"""The design of experiments, the virtual test bench, and the course of one engagement."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import cumulative_simpson

from examples.wet_clutch.bench import design, measure
from examples.wet_clutch.course import trajectories
from examples.wet_clutch.model import CLUTCH, shifting_time

CONDITIONS = ["pulse_duration", "hold_current", "pulse_current", "motor_speed", "brake_torque"]


@pytest.mark.parametrize(
    ("experiment", "conditions"),
    [
        (1, [0.070, 0.248, 0.070, 1200, 20]),
        (2, [0.070, 0.248, 0.070, 1200, 80]),
        (16, [0.110, 0.260, 0.070, 1200, 80]),
        (19, [0.070, 0.248, 0.135, 1200, 20]),
        (108, [0.110, 0.272, 0.135, 1500, 80]),
    ],
)
def test_numbering_of_the_experiments(experiment: int, conditions: list[float]) -> None:
    assert design().set_index("id").loc[experiment].tolist() == conditions


@pytest.mark.parametrize(
    ("experiment", "skewness", "excess"),
    [(16, 0.31, -1.18), (9, 0.02, -0.92), (13, -2.0, 6.4), (15, 1.55, 4.2)],
)
def test_moments_of_remarkable_experiments(experiment: int, skewness: float, excess: float) -> None:
    x = np.random.default_rng(0).normal((1.0, 1.0), (0.07, 0.02), (6000, 2)).T
    conditions = design().set_index("id").loc[experiment].to_dict()
    times = shifting_time(**conditions, c2_scale=x[0], zp_scale=x[1])
    standard = (times - times.mean()) / times.std()
    assert np.mean(standard**3) == pytest.approx(skewness, abs=0.15 + 0.1 * abs(skewness))
    assert np.mean(standard**4) - 3 == pytest.approx(excess, abs=0.1 + 0.2 * abs(excess))


@pytest.mark.parametrize("kind", ["realistic", "model"])
def test_a_seed_fixes_the_measurements(kind: str) -> None:
    first = measure(3, kind=kind)
    pd.testing.assert_frame_equal(first, measure(3, kind=kind))
    assert not first["shifting_time"].equals(measure(4, kind=kind)["shifting_time"])
    pd.testing.assert_frame_equal(first[["id", *CONDITIONS]], design())


def test_the_benches_do_not_change_unnoticed() -> None:
    # A valve delay, say, moves every outcome by 4 ms; published results would no longer repeat.
    realistic, model = (measure(0, kind=kind)["shifting_time"] for kind in ("realistic", "model"))
    assert realistic.head(3).to_numpy() == pytest.approx([0.977, 1.062, 0.743], abs=1.1e-3)
    assert realistic.mean() == pytest.approx(0.76363, abs=1e-4)
    assert model.head(3).to_numpy() == pytest.approx([0.891066, 1.040649, 0.700143], abs=3e-6)
    assert model.mean() == pytest.approx(0.736202, abs=3e-6)


@pytest.fixture(scope="module")
def course() -> pd.DataFrame:
    conditions = design().set_index("id").loc[16].to_dict()
    return trajectories(**conditions, c2_scale=0.91, zp_scale=0.55, until=1.5)


def test_the_course_meets_the_shifting_time(course: pd.DataFrame) -> None:
    first = course[course["synchronous"]].iloc[0]
    assert first["time"] == pytest.approx(0.6269692, abs=1e-6)
    assert first["input_speed"] == pytest.approx(2 * first["output_speed"], rel=1e-12)
    before = course[~course["synchronous"]]
    assert (before["input_speed"] > 2 * before["output_speed"]).all()
    assert course["time"].is_monotonic_increasing
    assert course["time"].diff().max() <= 0.0020001
    assert not course.isna().any().any()


def test_both_shafts_obey_the_balance_of_angular_momentum(course: pd.DataFrame) -> None:
    shafts = CLUTCH.shafts
    for phase in (course[~course["synchronous"]], course[course["synchronous"]]):
        time = phase["time"].to_numpy()
        w_1, w_2 = phase["input_speed"].to_numpy(), phase["output_speed"].to_numpy()
        brake = np.where(w_2 > 0, 80.0 + shafts.viscous * w_2, phase["output_torque"])
        if phase["synchronous"].all():
            inertia = shafts.inertia_1 + shafts.inertia_2 / shafts.ratio**2
            balances = [(inertia, w_1, phase["input_torque"] - brake / shafts.ratio)]
        else:
            balances = [
                (shafts.inertia_1, w_1, phase["input_torque"] - phase["clutch_torque"]),
                (shafts.inertia_2, w_2, phase["output_torque"] - brake),
            ]
        for inertia, speed, torque in balances:
            gained = cumulative_simpson(torque.to_numpy(), x=time, initial=0)
            assert inertia * (speed - speed[0]) == pytest.approx(gained, abs=5e-3)
            assert np.abs(gained).max() > 5


@pytest.mark.parametrize("kind", ["realistic", "model"])
def test_other_conditions_are_measured_as_the_design_is(kind: str) -> None:
    whole = measure(3, kind=kind)
    again = measure(3, kind=kind, conditions=design())
    pd.testing.assert_frame_equal(whole, again)
    one = measure(3, kind=kind, conditions=design().drop(columns="id").iloc[[5, 5, 5]])
    assert one["shifting_time"].nunique() == 3
    with pytest.raises(ValueError, match="brake_torque"):
        measure(3, kind=kind, conditions=design().drop(columns="brake_torque"))
