"""The shifting time against known values, against solve_ivp, and against itself."""

from __future__ import annotations

import numpy as np
import pytest

from aleator.clutch import design, shifting_time
from aleator.clutch import simulator as simulator_module
from aleator.clutch.bench import BOX
from aleator.clutch.reference import reference_shifting_time
from aleator.clutch.runs import make_runs
from aleator.clutch.simulator import initial_speed, synchronization_time
from aleator.errors import AleatorError, SimulatorError

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
    runs = sample(60, seed=7)
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


def test_runs_begin_in_the_steady_state_of_the_open_clutch() -> None:
    speeds = initial_speed(
        make_runs(**{**CONDITIONS, "motor_speed": [1200, 1350, 1500]}, c2_scale=1, zp_scale=1)
    )
    assert speeds == pytest.approx([123.95851, 139.66789, 155.37694], abs=5e-6)


def test_vectorized_equals_one_by_one() -> None:
    runs = sample(12, seed=2)
    together = shifting_time(**runs)
    alone = [
        shifting_time(**{name: values[k] for name, values in runs.items()})[0] for k in range(12)
    ]
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-11)


def test_one_by_one_with_odd_pulses_equals_vectorized() -> None:
    durations = np.array([0.0613, 0.0700, 0.0874, 0.1059])
    scales = {"c2_scale": 0.9, "zp_scale": 0.6}
    together = shifting_time(**{**CONDITIONS, "pulse_duration": durations}, **scales)
    alone = [shifting_time(**{**CONDITIONS, "pulse_duration": d}, **scales)[0] for d in durations]
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-11)


def test_order_of_runs_and_size_of_blocks_do_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = sample(90, seed=4)
    expected = shifting_time(**runs)
    order = np.random.default_rng(0).permutation(90)
    shuffled = shifting_time(**{name: values[order] for name, values in runs.items()})
    np.testing.assert_allclose(shuffled, expected[order], rtol=0, atol=1e-11)
    monkeypatch.setattr(simulator_module, "BLOCK", 40)
    np.testing.assert_allclose(shifting_time(**runs), expected, rtol=0, atol=1e-11)


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


def test_every_condition_has_the_effect_that_physics_says() -> None:
    scales = {"c2_scale": 1.0, "zp_scale": 0.8}
    base = shifting_time(**CONDITIONS, **scales)[0]

    def changed(**change: float) -> float:
        return float(shifting_time(**{**CONDITIONS, **scales, **change})[0])

    assert changed(pulse_duration=0.110) < base - 0.01
    assert changed(hold_current=0.272) < base - 0.01
    assert changed(pulse_current=0.135) < base - 0.01
    assert changed(motor_speed=1500.0) > base + 0.01
    assert changed(brake_torque=80.0) > base + 0.01
    assert changed(c2_scale=1.2) > base + 0.01
    assert changed(zp_scale=1.0) > base + 0.01


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
    ],
)
def test_misuse_is_named(change: dict[str, object], name: str) -> None:
    arguments = {**CONDITIONS, "c2_scale": 1.0, "zp_scale": 1.0, **change}
    with pytest.raises(SimulatorError, match=name) as caught:
        shifting_time(**arguments)
    assert isinstance(caught.value, AleatorError)
    assert caught.value.remedy
