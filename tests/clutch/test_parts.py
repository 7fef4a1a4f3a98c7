"""The parts of the clutch: converter, current, hydraulics, plates, shafts."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from aleator.clutch.converter import CELLS, capacity, capacity_table, idle_speed
from aleator.clutch.current import breakpoints, current_at, offsets
from aleator.clutch.hydraulics import WINDOW, Signals, system, windows
from aleator.clutch.parameters import CLUTCH
from aleator.clutch.plates import constants, increments, positions
from aleator.clutch.runs import Runs, make_runs
from aleator.clutch.shafts import Stepper


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


def test_coefficients_of_the_hydraulics() -> None:
    matrix = system()
    assert matrix[1] == pytest.approx([-196, -26.6, 0, 3.92e8, 3.92e6, -3.92e7])
    assert matrix[2] == pytest.approx([3.2e-8, 3.0e-11, -5.6, 0, 0, 0])


def test_converter_passes_through_its_nodes() -> None:
    nodes = CLUTCH.converter
    f_c = np.array([14.396, 14.354, 14.227, 14.206, 14.406, 14.700])
    f_c = np.append(f_c, [15.213, 16.009, 17.067, 20.702])
    expected = np.array(nodes.torque_ratio[:-1]) / f_c**2
    values = capacity(np.array(nodes.speed_ratio))
    assert values[:-1] == pytest.approx(expected, rel=2e-4)
    assert values[-1] == pytest.approx(0.0, abs=1e-15)


def test_converter_stays_below_the_power_of_the_motor() -> None:
    nu = np.linspace(0, 1, 1001)
    f_c = np.array(CLUTCH.converter.k_factor) * np.pi / 30
    w_m = 1500 * np.pi / 30
    assert w_m**3 * (f_c**-2.0).max() == pytest.approx(19.2e3, rel=0.01)
    assert (w_m**2 * capacity(nu) * nu * w_m < 30e3).all()


def test_table_of_the_converter_is_accurate_and_continuous() -> None:
    table, cells = capacity_table(), np.linspace(0, CELLS, 123_457)[:-1]
    cell = cells.astype(int)
    values = table.real[cell] + table.imag[cell] * (cells - cell)
    assert np.abs(values - capacity(cells / CELLS)).max() < 1e-10
    assert table.real[:-1] + table.imag[:-1] == pytest.approx(table.real[1:], abs=1e-16)


def test_idle_speed_balances_the_drag() -> None:
    w_m, drag = np.array([100.0, 140.0, 140.0]), np.array([0.05, 0.05, 0.2])
    w_1 = idle_speed(w_m, drag)
    assert w_m**2 * capacity(w_1 / w_m) == pytest.approx(drag * w_1, rel=1e-12)


def test_breakpoints_of_the_current() -> None:
    times, levels = breakpoints(np.array([0.09]), np.array([0.26]), np.array([0.07]))
    expected = [0, 0.01, 0.09, 0.10, 0.39, 0.40, 0.51, 0.78, 1.88]
    assert times[:, 0] == pytest.approx(expected, abs=1e-15)
    assert levels[:, 0] == pytest.approx([0.1, 0.65, 0.65, 0.26, 0.26, 0.33, 0.33, 0.281, 0.65])
    at = current_at(np.array([0.005, 0.05, 0.2, 0.45, 4.0]), times[:, 0], levels[:, 0])
    assert at == pytest.approx([0.375, 0.65, 0.26, 0.33, 0.65])


def test_windows_can_align_to_every_breakpoint() -> None:
    ratio = offsets() / WINDOW
    assert ratio == pytest.approx(np.rint(ratio), abs=1e-9)


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
        out = np.empty_like(state)
        stepper.step(state, push, drag, False, out)
        state = out

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
    drag, out = np.zeros((3, 1)), np.empty((2, 1))
    state = np.array([100.0 * c.cell, [0.0]])
    # R T_c = 18, 19, 19.5 N m against 20 N m
    Stepper(c, h).step(state, np.outer([9.0, 9.5, 9.75], to_push), drag, True, out)
    assert out[1, 0] == 0.0
    # R T_c - T_b0 goes from -2 to 6 N m: it accelerates for 3/4 of the step with 3 N m on average.
    Stepper(c, h).step(state, np.outer([9.0, 11.0, 13.0], to_push), drag, True, out)
    speed = out[1, 0] / c.cell[0] / CLUTCH.shafts.ratio
    assert speed == pytest.approx(0.75 * h * 3.0 / CLUTCH.shafts.inertia_2, rel=2e-4)
