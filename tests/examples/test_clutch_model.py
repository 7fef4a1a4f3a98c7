"""The shifting time of the wet clutch against known values, solve_ivp and its own parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from examples.wet_clutch import reference as plain
from examples.wet_clutch.bench import BOX, design
from examples.wet_clutch.model import CLUTCH, Clutch, make_runs, shifting_time, synchronization_time
from examples.wet_clutch.reference import reference_shifting_time

CONDITIONS = {
    "pulse_duration": 0.090,
    "hold_current": 0.260,
    "pulse_current": 0.070,
    "motor_speed": 1350.0,
    "brake_torque": 20.0,
}
SCALES = [(1.0, 1.0), (0.91, 0.55), (0.6, 0.4), (1.3, 1.15)]
# Computed by two other integrators, which agree to 5e-8 s.
KNOWN = {
    1: (1.1445475, 0.9166339, 0.7116423, 1.2500312),
    16: (0.8715967, 0.6269692, 0.5042846, 1.2534958),
}


def sample(size: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Random experiments, scales uniform in the box."""
    rng = np.random.default_rng(seed)
    table = design().drop(columns="id")
    rows = table.iloc[rng.integers(0, len(table), size)]
    arguments = {name: rows[name].to_numpy(dtype=np.float64) for name in table.columns}
    arguments["c2_scale"] = rng.uniform(*BOX[0], size)
    arguments["zp_scale"] = rng.uniform(*BOX[1], size)
    return arguments


def reference(runs: dict[str, np.ndarray], **options: float) -> np.ndarray:
    rows = zip(*(np.asarray(values).tolist() for values in runs.values()), strict=True)
    return np.array(
        [reference_shifting_time(**dict(zip(runs, row, strict=True)), **options) for row in rows]
    )


@pytest.mark.parametrize("experiment", KNOWN)
def test_known_shifting_times(experiment: int) -> None:
    conditions = design().set_index("id").loc[experiment].to_dict()
    c2_scale, zp_scale = np.transpose(SCALES)
    times = shifting_time(**conditions, c2_scale=c2_scale, zp_scale=zp_scale)
    assert times == pytest.approx(KNOWN[experiment], abs=1e-6)


def test_the_reference_gives_the_known_shifting_times() -> None:
    conditions = design().set_index("id").loc[16].to_dict()
    for (c2_scale, zp_scale), known in zip(SCALES, KNOWN[16], strict=True):
        time = reference_shifting_time(**conditions, c2_scale=c2_scale, zp_scale=zp_scale)
        assert time == pytest.approx(known, abs=2e-7)


def test_agrees_with_solve_ivp_over_experiments_and_box() -> None:
    runs = sample(30, seed=7)
    expected = reference(runs, tolerance=1e-9, max_step=2e-3)
    assert np.abs(shifting_time(**runs) - expected).max() < 1e-6


def test_agrees_with_solve_ivp_for_conditions_never_tested() -> None:
    rng = np.random.default_rng(11)
    size = 20
    runs = {
        "pulse_duration": rng.uniform(0.05, 0.13, size),  # not a multiple of 10 ms
        "hold_current": rng.uniform(0.24, 0.30, size),
        "pulse_current": rng.uniform(0.05, 0.16, size),
        "motor_speed": rng.uniform(1000, 1700, size),
        "brake_torque": rng.uniform(5, 100, size),  # partly less than the drag of the open plates
        "c2_scale": rng.uniform(0.5, 1.4, size),
        "zp_scale": rng.uniform(0.3, 1.1, size),
    }
    expected = reference(runs, tolerance=1e-9, max_step=2e-3)
    assert np.abs(shifting_time(**runs) - expected).max() < 1e-6


def test_error_falls_with_the_step_and_stays_below_a_microsecond() -> None:
    given = sample(400, seed=5)
    runs = make_runs(**given)
    fine = synchronization_time(runs, steps=40)
    errors = [
        np.sqrt(np.mean((synchronization_time(runs, steps) - fine) ** 2)) for steps in (2, 4, 8)
    ]
    # Order 4 between kinks; what is left at the kinks is of order between 2 and 3.
    assert errors[0] / errors[1] > 4
    assert errors[1] / errors[2] > 4
    assert np.abs(shifting_time(**given) - fine).max() < 1e-6


def test_vectorized_equals_one_by_one() -> None:
    runs = sample(12, seed=2)
    together = shifting_time(**runs)
    alone = [
        shifting_time(**{name: values[k] for name, values in runs.items()})[0] for k in range(12)
    ]
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-11)


def test_every_experiment_is_feasible_over_the_box() -> None:
    grids = np.meshgrid(np.arange(108), *(np.linspace(*side, 7) for side in BOX), indexing="ij")
    experiment, c2_scale, zp_scale = (grid.ravel() for grid in grids)
    conditions = design().drop(columns="id").iloc[experiment]
    times = shifting_time(
        **{name: conditions[name].to_numpy() for name in conditions},
        c2_scale=c2_scale,
        zp_scale=zp_scale,
    )
    assert np.isfinite(times).all()
    assert times.min() == pytest.approx(0.389, abs=2e-3)
    assert times.max() == pytest.approx(1.412, abs=2e-3)


def test_runs_that_do_not_synchronize_are_nan_and_harm_no_others() -> None:
    good = shifting_time(**CONDITIONS, c2_scale=1.0, zp_scale=0.5)[0]
    times = shifting_time(
        **CONDITIONS,
        c2_scale=[1.0, np.nan, 1.0, 1.0, 1.0, np.inf],
        zp_scale=[0.5, 0.5, 1.6, -0.1, np.nan, 0.5],
    )
    assert times[0] == pytest.approx(good, abs=1e-11)
    assert np.isnan(times[1:]).all()


def test_nan_when_the_brake_is_stronger_than_the_clutch() -> None:
    # At 11 bar the clutch carries alpha p = 440 N m, so 880 N m at the output.
    times = shifting_time(
        **{**CONDITIONS, "brake_torque": [80.0, 1500.0]}, c2_scale=1.0, zp_scale=1.0
    )
    assert np.isfinite(times[0])
    assert np.isnan(times[1])


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"motor_speed": 0.0}, "motor_speed"),
        ({"motor_speed": [1200.0, -5.0]}, "run 1.*motor_speed"),
        ({"brake_torque": float("nan")}, "brake_torque"),
        ({"pulse_duration": 0.005}, "pulse_duration"),
        ({"pulse_duration": 4.0}, "pulse_duration"),
        ({"hold_current": -0.1}, "hold_current"),
        ({"pulse_current": float("inf")}, "pulse_current"),
        ({"motor_speed": "fast"}, "'fast'"),
        ({"c2_scale": [1.0, 1.0], "zp_scale": [1.0, 1.0, 1.0]}, r"\(2,\).*\(3,\)"),
        ({"c2_scale": np.ones((2, 2))}, " 2 "),
        ({"j2_scale": 0.0}, "inertia_factor"),
    ],
)
def test_misuse_is_named(change: dict[str, object], name: str) -> None:
    arguments = {**CONDITIONS, "c2_scale": 1.0, "zp_scale": 1.0, **change}
    with pytest.raises(ValueError, match=name):
        shifting_time(**arguments)


NOMINAL = {
    **CONDITIONS,
    "pulse_current": 0.070,
    "brake_torque": 80.0,
    "c2_scale": 0.9,
    "zp_scale": 0.7,
}
FACTORS = ["alpha_scale", "gamma_scale", "omega_scale", "brake_scale", "j2_scale", "b_scale"]


def changed(name: str, factor: float) -> Clutch:
    hydraulics, plates, shafts = CLUTCH.hydraulics, CLUTCH.plates, CLUTCH.shafts
    return {
        "alpha_scale": replace(CLUTCH, plates=replace(plates, alpha=plates.alpha * factor)),
        "gamma_scale": replace(CLUTCH, plates=replace(plates, gamma=plates.gamma * factor)),
        "omega_scale": replace(
            CLUTCH,
            hydraulics=replace(hydraulics, natural_frequency=hydraulics.natural_frequency * factor),
        ),
        "brake_scale": CLUTCH,
        "j2_scale": replace(CLUTCH, shafts=replace(shafts, inertia_2=shafts.inertia_2 * factor)),
        "b_scale": replace(CLUTCH, shafts=replace(shafts, viscous=shafts.viscous * factor)),
    }[name]


@pytest.mark.parametrize("name", FACTORS)
def test_a_scale_is_that_of_its_parameter(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    factor = 1.25
    monkeypatch.setattr(plain, "CLUTCH", changed(name, factor))
    conditions = dict(NOMINAL)
    if name == "brake_scale":
        conditions["brake_torque"] *= factor
    expected = plain.reference_shifting_time(**conditions)
    found = shifting_time(**NOMINAL, **{name: factor})[0]
    assert found == pytest.approx(expected, abs=1e-6)
    assert abs(found - shifting_time(**NOMINAL)[0]) > 2e-5  # it has an effect
