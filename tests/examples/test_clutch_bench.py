"""The design of experiments, the virtual test bench, and the course of one engagement."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import cumulative_simpson

from examples.wet_clutch.bench import design, measure, oil_temperature
from examples.wet_clutch.course import trajectories
from examples.wet_clutch.model import CLUTCH, make_runs, shifting_time, synchronization_time

CONDITIONS = ["pulse_duration", "hold_current", "pulse_current", "motor_speed", "brake_torque"]


def times_of(table: pd.DataFrame, c2_scale: float, zp_scale: float) -> np.ndarray:
    conditions = {name: table[name].to_numpy() for name in CONDITIONS}
    return shifting_time(**conditions, c2_scale=c2_scale, zp_scale=zp_scale)


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


def test_the_oil_warms_up_and_then_wanders_about_80_degrees() -> None:
    rng = np.random.default_rng(0)
    temperature = np.array([oil_temperature(rng, 108) for _ in range(400)])
    assert temperature[:, 0].mean() == pytest.approx(72, abs=0.4)
    late = temperature[:, 80:]
    assert late.mean() == pytest.approx(80, abs=0.3)
    assert late.std() == pytest.approx(2.0, abs=0.15)
    assert np.corrcoef(late[:, 0], late[:, 1])[0, 1] == pytest.approx(0.9, abs=0.04)


@pytest.mark.parametrize(
    ("change", "low", "high"),
    [
        ({"delay": 0.004}, 0.003, 0.005),
        ({"frequency_factor": 1.05}, -0.05, -0.001),
        ({"drag_factor": 0.8}, 0.001, 0.05),
        ({"friction_factor": 0.9}, 0.005, 0.2),
        ({"fade": 0.10}, 0.0005, 0.05),
    ],
)
def test_every_deviation_of_the_bench_has_its_effect(
    change: dict[str, float], low: float, high: float
) -> None:
    conditions = design().set_index("id").loc[40].to_dict()
    given = {**conditions, "c2_scale": 0.91, "zp_scale": 0.55}
    (later,) = synchronization_time(make_runs(**given, **change)) - shifting_time(**given)
    assert low < later < high


@pytest.mark.parametrize(
    "arguments",
    [
        {"kind": "realistc"},
        {"kind": "model", "noise_sd": -0.1},
        {"kind": "model", "noise_sd": float("nan")},
        {"kind": "realistic", "noise_sd": 0.1},
        {"kind": "model", "alpha": (0.9, 0.5, 0.1)},
        {"kind": "model", "alpha": (0.9, 0.5, 0.1, 0.0)},
    ],
)
def test_misuse_of_the_bench_is_named(arguments: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"kind|noise_sd|alpha"):
        measure(0, **arguments)


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


def test_the_clutch_only_loses_energy(course: pd.DataFrame) -> None:
    shafts = CLUTCH.shafts
    phase = course[~course["synchronous"]]
    w_1, w_2 = phase["input_speed"], phase["output_speed"]
    heat = phase["clutch_torque"] * (w_1 - shafts.ratio * w_2)
    assert (heat >= 0).all()
    energy = 0.5 * shafts.inertia_1 * w_1**2 + 0.5 * shafts.inertia_2 * w_2**2
    brake = (80.0 + shafts.viscous * w_2) * w_2
    power = (phase["input_torque"] * w_1 - heat - brake).to_numpy()
    gained = cumulative_simpson(power, x=phase["time"].to_numpy(), initial=0)
    assert (energy - energy.iloc[0]).to_numpy() == pytest.approx(gained, abs=1.0)  # J of 2 kJ


def test_a_course_that_never_synchronizes_has_no_synchronous_phase() -> None:
    conditions = {**design().set_index("id").loc[1].to_dict(), "brake_torque": 1500.0}
    course = trajectories(**conditions, until=1.0)
    assert not course["synchronous"].any()
    assert (course["output_speed"] == 0).all()


@pytest.mark.parametrize(
    "change", [{"until": 0.0}, {"until": 6.0}, {"c2_scale": [1.0, 1.1]}, {"motor_speed": -1.0}]
)
def test_misuse_of_trajectories_is_named(change: dict[str, object]) -> None:
    conditions = design().set_index("id").loc[1].to_dict()
    with pytest.raises(ValueError, match=r"until|single|motor_speed"):
        trajectories(**{**conditions, **change})


@pytest.mark.parametrize("kind", ["realistic", "model"])
def test_other_conditions_are_measured_as_the_design_is(kind: str) -> None:
    whole = measure(3, kind=kind)
    again = measure(3, kind=kind, conditions=design())
    pd.testing.assert_frame_equal(whole, again)
    one = measure(3, kind=kind, conditions=design().drop(columns="id").iloc[[5, 5, 5]])
    assert one["shifting_time"].nunique() == 3
    with pytest.raises(ValueError, match="brake_torque"):
        measure(3, kind=kind, conditions=design().drop(columns="brake_torque"))
