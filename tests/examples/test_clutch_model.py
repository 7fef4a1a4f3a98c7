"""The shifting time of the wet clutch against known values, solve_ivp and its own parts."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from examples.wet_clutch import model
from examples.wet_clutch import reference as plain
from examples.wet_clutch.bench import BOX, design
from examples.wet_clutch.model import (
    CELLS,
    CLUTCH,
    WINDOW,
    Clutch,
    Runs,
    Signals,
    Stepper,
    breakpoints,
    capacity,
    capacity_table,
    constants,
    increments,
    make_runs,
    positions,
    shifting_time,
    synchronization_time,
    system,
    windows,
)
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


def test_vectorized_equals_one_by_one() -> None:
    runs = sample(12, seed=2)
    together = shifting_time(**runs)
    alone = [
        shifting_time(**{name: values[k] for name, values in runs.items()})[0] for k in range(12)
    ]
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-11)


def test_order_of_runs_and_size_of_blocks_do_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = sample(90, seed=4)
    expected = shifting_time(**runs)
    order = np.random.default_rng(0).permutation(90)
    shuffled = shifting_time(**{name: values[order] for name, values in runs.items()})
    np.testing.assert_allclose(shuffled, expected[order], rtol=0, atol=1e-11)
    monkeypatch.setattr(model, "BLOCK", 40)
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


def some_runs(**change: float) -> Runs:
    given = {
        "pulse_duration": 0.0874,
        "hold_current": 0.260,
        "pulse_current": 0.135,
        "motor_speed": 1350.0,
        "brake_torque": 20.0,
        "c2_scale": 0.9,
        "zp_scale": 0.7,
    }
    return make_runs(**{**given, **change})


def signals(runs: Runs) -> Signals:
    return Signals(*(getattr(runs, name) for name in Signals.__dataclass_fields__))


def test_table_of_the_converter_is_accurate_and_continuous() -> None:
    table, cells = capacity_table(), np.linspace(0, CELLS, 123_457)[:-1]
    cell = cells.astype(int)
    values = table.real[cell] + table.imag[cell] * (cells - cell)
    assert np.abs(values - capacity(cells / CELLS)).max() < 1e-10
    assert table.real[:-1] + table.imag[:-1] == pytest.approx(table.real[1:], abs=1e-16)


@pytest.mark.parametrize("delay", [0.0, 0.004])
@pytest.mark.parametrize("duration", [0.070, 0.0874])
def test_windows_are_aligned_and_follow_each_other(delay: float, duration: float) -> None:
    runs = some_runs(delay=delay, pulse_duration=duration)
    parts = list(islice(windows(signals(runs), 3), 200))
    starts = np.array([float(part.start[0]) for part in parts])
    lengths = np.array([float(part.length[0]) for part in parts])
    assert starts[1:] == pytest.approx((starts + lengths)[:-1], abs=1e-14)
    times, _ = breakpoints(runs.pulse_duration, runs.hold_current, runs.pulse_current, runs.delay)
    assert np.abs(starts[:, None] - times[:, 0]).min(axis=0).max() < 1e-12


@pytest.mark.parametrize("frequency_factor", [1.0, 0.97])
def test_hydraulics_agree_with_solve_ivp(frequency_factor: float) -> None:
    runs = some_runs(delay=0.004, frequency_factor=frequency_factor)
    times, levels = breakpoints(
        runs.pulse_duration, runs.hold_current, runs.pulse_current, runs.delay
    )
    knots, levels = np.insert(times[:, 0], 0, 0.0), np.insert(levels[:, 0], 0, 0.10)
    matrix, state = system(frequency_factor), np.zeros(3)
    reached = {0.0: state}
    for k in range(8):
        slope = (levels[k + 1] - levels[k]) / (knots[k + 1] - knots[k])

        def derivative(t: float, s: np.ndarray, k: int = k, slope: float = slope) -> np.ndarray:
            u = levels[k] + slope * (t - knots[k])
            return matrix[:3] @ [*s, u, slope, 1.0]

        span = (knots[k], knots[k + 1])
        solution = solve_ivp(derivative, span, state, rtol=1e-10, atol=[1e-3, 1e-2, 1e-12])
        state = solution.y[:, -1]
        reached[knots[k + 1]] = state
    parts = list(islice(windows(signals(runs), 2), 130))
    for time, expected in reached.items():
        part = min(parts, key=lambda p: abs(float(p.start[0]) - time))
        assert part.pressure[0, 0] == pytest.approx(expected[0], rel=1e-7, abs=0.1)
        assert part.piston[0, 0] == pytest.approx(expected[2], rel=1e-7, abs=1e-10)


def test_a_window_is_a_matrix_exponential() -> None:
    first, second = islice(windows(signals(some_runs(pulse_duration=0.09)), 2), 2)
    start = np.array([0, 0, 0, 0.10, 55.0, 1.0])
    after = expm(system() * WINDOW) @ start
    assert first.pressure[-1, 0] == pytest.approx(after[0], rel=1e-12)
    after[3:] = 0.65, 0.0, 1.0
    assert second.piston[2, 0] == pytest.approx((expm(system() * WINDOW / 2) @ after)[2], rel=1e-12)


def test_torque_of_the_plates_is_that_of_the_paper() -> None:
    runs, step, steps = some_runs(), 1e-3, 4
    c, plates = constants(runs, np.zeros(1, dtype=np.intp)), CLUTCH.plates
    z_p, h = 0.7 * plates.z_contact, CLUTCH.hydraulics
    seen = np.zeros(3, dtype=bool)
    for window in islice(windows(signals(runs), steps), 120):
        push, drag = increments(c, window, step)
        time = window.start + window.length * np.linspace(0, 1, 2 * steps + 1)
        z_bias = 0.9 * h.c2 / h.a5 * np.expm1(h.a5 * time)
        z = np.clip(window.piston[:, 0] + z_bias, 0, plates.z_max)
        sigma = (z - z_p) / (plates.z_max - z_p)
        assert positions(c, window)[::2, 0] == pytest.approx(sigma[::2], abs=1e-12)
        pressure = np.maximum(sigma, 0) * np.maximum(window.pressure[:, 0], 0)
        delta = np.where(sigma > 0, 3 * sigma**2 - 2 * sigma**3, 0)
        open_ = sigma < 1
        friction = push[:, 0] / step * CLUTCH.shafts.inertia_1 / c.cell
        assert friction[::2] == pytest.approx((delta * plates.alpha * pressure)[::2], abs=1e-9)
        viscous = drag[open_, 0] / step * CLUTCH.shafts.inertia_1
        couette = ((1 - delta[open_]) * plates.gamma) / (plates.z_max - z[open_])
        if open_.all():
            assert viscous == pytest.approx(couette, rel=1e-8)
        assert np.all(drag >= 0)
        seen |= [(z == 0).any(), ((sigma > 0) & open_).any(), (~open_).any()]
    assert seen.all(), "the run must pass through all three regimes"


def constant_torque_error(steps: int) -> float:
    """Integrate 0.2 s with constant F and G and return the error of both speeds [cells]."""
    c, h = constants(some_runs(), np.zeros(1, dtype=np.intp)), 0.2 / steps
    scale = h / CLUTCH.shafts.inertia_1
    push, drag = np.full((3, 1), 80.0 * c.cell * scale), np.full((3, 1), 0.2 * scale)
    state = np.array([111.0 * c.cell, 20.0 * c.cell])
    stepper = Stepper(c, h)
    for _ in range(steps):
        state = stepper.step(state, push, drag, False)

    def derivative(_: float, s: np.ndarray) -> list[float]:
        shafts, w_m = CLUTCH.shafts, 1350 * np.pi / 30
        torque = 80.0 + 0.2 * (s[0] - s[1])
        w_2 = s[1] / shafts.ratio
        dw_1 = (w_m**2 * float(capacity(np.array(s[0] / w_m))) - torque) / shafts.inertia_1
        dw_2 = (shafts.ratio * torque - 20.0 - shafts.viscous * w_2) / shafts.inertia_2
        return [dw_1, shafts.ratio * dw_2]

    assert 0.7 < state[0, 0] / CELLS < 0.8, "between two nodes of the converter, where it is smooth"
    exact = solve_ivp(derivative, (0, 0.2), [111.0, 20.0], rtol=1e-11, atol=1e-11, max_step=1e-3)
    return float(np.abs(state[:, 0] / c.cell[0] - exact.y[:, -1]).max())


def test_a_step_of_the_shafts_is_of_order_four() -> None:
    errors = [constant_torque_error(steps) for steps in (5, 10, 20)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders.min() > 3.5


def test_the_brake_holds_the_load_and_lets_it_go_in_time() -> None:
    c = constants(some_runs(), np.zeros(1, dtype=np.intp))
    h = 2e-3
    to_push = h / CLUTCH.shafts.inertia_1 * c.cell
    drag = np.zeros((3, 1))
    state = np.array([100.0 * c.cell, [0.0]])
    # R T_c = 18, 19, 19.5 N m against 20 N m
    out = Stepper(c, h).step(state, np.outer([9.0, 9.5, 9.75], to_push), drag, True)
    assert out[1, 0] == 0.0
    # R T_c - T_b0 goes from -2 to 6 N m: it accelerates for 3/4 of the step with 3 N m on average.
    out = Stepper(c, h).step(state, np.outer([9.0, 11.0, 13.0], to_push), drag, True)
    speed = out[1, 0] / c.cell[0] / CLUTCH.shafts.ratio
    assert speed == pytest.approx(0.75 * h * 3.0 / CLUTCH.shafts.inertia_2, rel=2e-4)


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


@pytest.mark.parametrize("factor", [0.8, 1.25])
@pytest.mark.parametrize("name", FACTORS)
def test_a_scale_is_that_of_its_parameter(
    name: str, factor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plain, "CLUTCH", changed(name, factor))
    conditions = dict(NOMINAL)
    if name == "brake_scale":
        conditions["brake_torque"] *= factor
    expected = plain.reference_shifting_time(**conditions)
    found = shifting_time(**NOMINAL, **{name: factor})[0]
    assert found == pytest.approx(expected, abs=1e-6)
    assert abs(found - shifting_time(**NOMINAL)[0]) > 2e-5  # it has an effect
